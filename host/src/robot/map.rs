//! What a robot has told so far: the particles' paths, the scans' poses, and the map of the best particle.

use std::collections::BTreeMap;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::grid::CellIndex;
use lrfslam_core::slam::SlamConfig;
use lrfslam_robot::wire::message::{Capacities, FromRobot, ScanPose, TileUpdate};

use super::client::fitted;
use super::paths::ParticlePaths;
use super::render::render;
use crate::mapping::Correction;
use crate::mapping::LowLevel;
use crate::mapping::MatchCounts;
use crate::maps::occupancy::{MapConfig, OccupancyMap};
use crate::scans::store::ScanStore;
use crate::trajectory::TimedPose;

/// Tiles by column and row.
pub type Tiles = BTreeMap<(i16, i16), Vec<u8>>;

fn put(tiles: &mut Tiles, tile: &TileUpdate<'_>) {
    tiles.insert((tile.column, tile.row), tile.squares.to_vec());
}

/// What a robot has told so far.
#[derive(Debug, Clone)]
pub struct RobotMap {
    config: SlamConfig,
    seed: u64,
    capacities: Capacities,
    paths: ParticlePaths,
    scans: Vec<ScanPose>,
    tiles: Tiles,
    /// The newest that the robot left at each place; one that was given back stays: the robot may be reset before it has it.
    left: Tiles,
    /// What it is given back instead once a loop was closed: the corrected map, and what it has left since.
    corrected: Option<Tiles>,
    /// Tiles told since the robot began to tell the whole map.
    told: u32,
    is_complete: bool,
}

impl LowLevel for RobotMap {
    /// The robot drives on in its own frame; what it left behind is put where it belongs as seen from there.
    fn correct(&mut self, correction: &Correction, scans: &ScanStore) -> anyhow::Result<Pose2> {
        let frame_from_robot = self.scans.last().map_or(Pose2::IDENTITY, |scan| scan.odometry);
        let frame_from_map = frame_from_robot * correction.map_from_robot.inverse();
        if let Some(corrected) = render((&self.config, self.seed), frame_from_map, correction, scans)? {
            self.corrected = Some(corrected);
        }
        Ok(frame_from_robot)
    }

    /// A step for each scan.
    fn path(&self) -> Vec<Pose2> {
        self.path().into_iter().map(|pose| pose.map_from_robot).collect()
    }

    fn has_particles(&self) -> bool {
        true
    }

    fn counts(&self) -> MatchCounts {
        self.match_counts()
    }

    /// Those of the last step told, which weigh the same.
    fn particles(&self) -> Vec<(Pose2, f32)> {
        self.paths.particles().iter().map(|node| (node.map_from_robot, 1.0)).collect()
    }
}

impl Default for RobotMap {
    fn default() -> Self {
        Self::new(&SlamConfig::small(), 1)
    }
}

impl RobotMap {
    /// Of a robot with this configuration that has told nothing yet.
    pub fn new(config: &SlamConfig, seed: u64) -> Self {
        Self {
            config: *config,
            seed,
            capacities: Capacities::default(),
            paths: ParticlePaths::default(),
            scans: Vec::new(),
            tiles: Tiles::new(),
            left: Tiles::new(),
            corrected: None,
            told: 0,
            is_complete: false,
        }
    }

    /// Takes a message; those that say nothing about the map change nothing.
    pub fn take(&mut self, message: &FromRobot<'_>) {
        match message {
            FromRobot::Identity(identity) => {
                self.capacities = identity.capacities;
                self.config = fitted(&self.config, &identity.capacities);
            }
            FromRobot::Segment(segment) => self.paths.take(segment),
            FromRobot::Scan(scan) => self.scans.push(*scan),
            FromRobot::Tile(tile) => {
                put(&mut self.tiles, tile);
                self.told += 1;
            }
            FromRobot::MapBegin => self.begin_whole_map(),
            FromRobot::MapEnd(tiles) => self.is_complete = self.told == *tiles,
            FromRobot::Left(tile) => {
                put(&mut self.left, tile);
                self.corrected.iter_mut().for_each(|corrected| put(corrected, tile));
            }
            FromRobot::Recall(_)
            | FromRobot::Configured
            | FromRobot::Refused(_)
            | FromRobot::Said(_)
            | FromRobot::Sweep(_) => {}
        }
    }

    /// What the robot has in its memory follows; of the rest of its map only what it left here is valid.
    fn begin_whole_map(&mut self) {
        self.tiles.clone_from(&self.left);
        self.told = 0;
        self.is_complete = false;
    }

    /// What it is given back when it asks: what it has left with this host, or the corrected map.
    pub fn to_give_back(&self) -> &Tiles {
        self.corrected.as_ref().unwrap_or(&self.left)
    }

    /// How the matching went, as far as the robot tells.
    fn match_counts(&self) -> MatchCounts {
        let count = |is_so: fn(&&ScanPose) -> bool| self.scans.iter().filter(is_so).count() as u64;
        MatchCounts {
            lost_scans: count(|scan| scan.is_lost),
            undetermined_scans: count(|scan| scan.undetermined.is_some()),
            ..MatchCounts::default()
        }
    }

    /// True if the robot has stopped and all of its map is here.
    pub fn is_complete(&self) -> bool {
        self.is_complete
    }

    /// What the robot's memory holds.
    pub fn capacities(&self) -> Capacities {
        self.capacities
    }

    /// Scans that the robot took since the first one told, and that nobody told of: the link was away for longer than its memory lasts.
    pub fn missing_scans(&self) -> u32 {
        let ends = self.scans.first().zip(self.scans.last());
        let taken = ends.map_or(0, |(first, last)| last.number.saturating_sub(first.number).saturating_add(1));
        taken.saturating_sub(self.scans.len() as u32)
    }

    /// All scans' poses, in order, each relative to the filter's step before.
    pub fn scans(&self) -> &[ScanPose] {
        &self.scans
    }

    /// The map as it is known: hits and travelled distance of every square of every tile.
    pub fn tiles(&self) -> &Tiles {
        &self.tiles
    }

    /// The tiles as a map with the robot's squares.
    ///
    /// * `square_size_m` — of the particles' maps; `config` — how it is judged what is occupied
    pub fn draw(&self, square_size_m: f32, config: &MapConfig) -> OccupancyMap {
        let side = usize::from(self.capacities.tile_side.max(1));
        let mut map = OccupancyMap::new(MapConfig { cell_size_m: square_size_m, ..*config });
        for ((column, row), squares) in &self.tiles {
            for (index, [hits, travel]) in squares.as_chunks().0.iter().enumerate() {
                let at = |tile: i16, offset: usize| i32::from(tile) * side as i32 + offset as i32;
                let cell = CellIndex { column: at(*column, index % side), row: at(*row, index / side) };
                // A ray that crosses a square travels about its side, which is told as 8.
                map.add(cell, u16::from(*hits), u16::from(travel.div_ceil(8)));
            }
        }
        map
    }

    /// The best particle's path, a pose for each scan. Where steps are not known, because segments were joined or the host came later,
    /// laser odometry leads on from the last known one, or back from the first.
    pub fn path(&self) -> Vec<TimedPose> {
        let steps: BTreeMap<u32, Pose2> = self.paths.best_backwards().collect();
        let known = |scan: &ScanPose| steps.get(&scan.step).map(|step| *step * scan.moved);
        let first = self.scans.iter().find_map(|scan| Some((known(scan)?, scan.odometry)));
        let mut last = first.unwrap_or_default();
        let pose = |scan: &ScanPose| {
            let map_from_robot = known(scan).unwrap_or(last.0 * last.1.between(scan.odometry));
            last = (map_from_robot, scan.odometry);
            TimedPose { stamp: scan.stamp, map_from_robot }
        };
        self.scans.iter().map(pose).collect()
    }

    /// True if the path to the latest pose begins with the robot's first step.
    pub fn is_from_start(&self) -> bool {
        self.paths.is_from_start()
    }
}
