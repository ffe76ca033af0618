//! A saved map as it is searched and tracked in.

use lrfslam_core::geometry::Pose2;

use crate::mapping::high::{HighConfigs, HighSlam, SavedPathError};
use crate::mapping::saved_map::SavedMap;
use crate::maps::occupancy::OccupancyMap;
use crate::places::correlation::{CorrelationGrid, SearchWindow};
use crate::places::submap::Submap;

/// Scans so far apart, m, or so far turned, rad, tell where the walls are.
const WALLS_APART: (f32, f32) = (0.2, 0.1);

/// A map that does not change.
#[derive(Debug)]
pub struct KnownMap {
    high: HighSlam<'static>,
    walls: Submap,
    /// `None`: nothing was seen.
    grid: Option<CorrelationGrid>,
    window: SearchWindow,
}

impl KnownMap {
    /// The map that was saved.
    ///
    /// # Errors
    /// If its parts do not fit together.
    pub fn new(saved: &SavedMap, config: &HighConfigs) -> Result<Self, SavedPathError> {
        let high = saved.high_slam(config)?;
        let walls = Submap::new(high.placed_scans(WALLS_APART), high.scans(), config.closure.range_max_m);
        let grid = CorrelationGrid::new(walls.points());
        let window = SearchWindow::about(walls.points());
        Ok(Self { high, walls, grid, window })
    }

    /// Where the robot was last when the map was made.
    pub fn last_pose(&self) -> Pose2 {
        self.high.trajectory().last().map_or(Pose2::IDENTITY, |pose| pose.map_from_robot)
    }

    /// Draws its scans.
    pub fn draw(&self, map: &mut OccupancyMap) {
        self.high.each_scan(&mut |sweep, map_from_robot| map.insert(sweep, map_from_robot));
    }

    pub(super) fn walls(&self) -> &Submap {
        &self.walls
    }

    /// Its path, and what it was drawn from.
    pub(crate) fn high(&self) -> &HighSlam<'static> {
        &self.high
    }

    /// The grid of all walls, and the window of all poses in it.
    pub(super) fn search_space(&self) -> Option<(&CorrelationGrid, &SearchWindow)> {
        self.grid.as_ref().map(|grid| (grid, &self.window))
    }
}
