//! What a run does, in an MCAP file: scans, poses, frames, the map and words, as Foxglove draws them; of a laser, its bytes too.

use std::fs::{self, File, OpenOptions};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::time::Instant;

use crate::foxglove::{self, FRAME_TRANSFORMS, FREE, GRID, LASER_SCAN, LOG, OCCUPIED, POSE_IN_FRAME, Seen, UNKNOWN};
use crate::maps::occupancy::{Occupancy, Raster};
use crate::output::GrowingFile;
use crate::scans::mcap::{ChannelPlan, RAW_ENCODING, RAW_TOPIC, SharedMcap};

const SCAN: usize = 0;
const POSE: usize = 1;
const TRANSFORMS: usize = 2;
const MAP: usize = 3;
const WORDS: usize = 4;

const fn drawn(topic: &'static str, schema: (&'static str, &'static str)) -> ChannelPlan {
    ChannelPlan { topic, encoding: "json", schema: Some(schema) }
}

/// The last one is a laser's.
static CHANNELS: [ChannelPlan; 6] = [
    drawn("/scan", LASER_SCAN),
    drawn("/pose", POSE_IN_FRAME),
    drawn("/tf", FRAME_TRANSFORMS),
    drawn("/map", GRID),
    drawn("/log", LOG),
    ChannelPlan { topic: RAW_TOPIC, encoding: RAW_ENCODING, schema: None },
];

/// True if a recording of this name is to be MCAP.
pub fn is_mcap_name(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("mcap"))
}

/// See the [module](self). Clones write to the same file.
#[derive(Debug, Clone)]
pub struct RunBag {
    file: SharedMcap,
    /// Where the file is to be; `None` if the recorder of a laser makes it.
    path: Option<PathBuf>,
}

impl RunBag {
    /// One into which the bytes of a laser go too; their recorder makes the file.
    pub fn live() -> Self {
        Self { file: SharedMcap::new(&CHANNELS), path: None }
    }

    /// One at `path`, once it is [begun](Self::begin).
    ///
    /// # Errors
    /// If its name is not that of an MCAP file.
    pub fn at(path: &Path) -> anyhow::Result<Self> {
        anyhow::ensure!(is_mcap_name(path), "{}: expected a name that ends in .mcap", path.display());
        Ok(Self { file: SharedMcap::new(&CHANNELS[..WORDS + 1]), path: Some(path.to_owned()) })
    }

    /// The file itself.
    pub fn file(&self) -> &SharedMcap {
        &self.file
    }

    /// Makes the file, if that is not done yet, nor somebody else's to do.
    ///
    /// # Errors
    /// If it cannot be made, or is there already and `overwrite` does not say that it may go.
    pub fn begin(&self, overwrite: bool) -> anyhow::Result<()> {
        let Some(path) = self.path.as_ref().filter(|_| !self.file.has_begun()) else { return Ok(()) };
        let name = path.display();
        anyhow::ensure!(overwrite || !path.exists(), "{name}: is there already (--overwrite replaces it)");
        let file = make(path).with_context(|| format!("{name}: cannot be written"))?;
        self.file.begin(GrowingFile::new(path, file), u64::MAX);
        Ok(())
    }

    /// A scan that was placed, and where; unless the laser's bytes are there, it can be read back exactly.
    pub fn scan(
        &self,
        scan: &RangeScan<'_>,
        (odometry, robot_from_lrf): (Option<Pose2>, Pose2),
        map_from_robot: Pose2,
    ) {
        let (time_ns, is_exact) = (time_ns(scan.stamp), self.path.is_some());
        let seen = Seen { odometry, robot_from_lrf, is_exact };
        self.file.write(SCAN, time_ns, &foxglove::scan(time_ns, scan, seen));
        self.pose(scan.stamp, map_from_robot, Some(robot_from_lrf));
    }

    /// Where the robot is believed to be at a time.
    pub fn pose(&self, stamp: Instant, map_from_robot: Pose2, robot_from_lrf: Option<Pose2>) {
        let time_ns = time_ns(stamp);
        self.file.write(POSE, time_ns, &foxglove::pose(time_ns, map_from_robot));
        self.file.write(TRANSFORMS, time_ns, &foxglove::transforms(time_ns, map_from_robot, robot_from_lrf));
    }

    /// The map as it is now.
    pub fn map(&self, raster: &Raster) {
        let time_ns = self.file.time_ns();
        // Rows go up, where those of the image go down.
        let rows = raster.pixels.chunks(raster.width.max(1)).rev();
        let cell = |occupancy: &Occupancy| match occupancy {
            Occupancy::Free => FREE,
            Occupancy::Unknown => UNKNOWN,
            Occupancy::Occupied => OCCUPIED,
        };
        let cells = (raster.width, rows.flatten().map(cell));
        self.file.write(MAP, time_ns, &foxglove::cells(time_ns, raster.origin_m, raster.pixel_size_m, cells));
    }

    /// What was said to the user.
    pub fn say(&self, words: &str) {
        let words = words.to_owned();
        self.file.write_now(WORDS, move |time_ns| foxglove::log(time_ns, &words));
    }

    /// Closes the file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(&self) -> std::io::Result<()> {
        self.file.finish()
    }
}

/// Beside an older file first: what reads that one goes on with it.
fn make(path: &Path) -> std::io::Result<File> {
    path.parent().map_or(Ok(()), fs::create_dir_all)?;
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let file = OpenOptions::new().write(true).create(true).truncate(true).open(&part)?;
    fs::rename(part, path)?;
    Ok(file)
}

/// Logs without a clock begin at 0; earlier there is nothing.
fn time_ns(stamp: Instant) -> u64 {
    u64::try_from(stamp.micros).unwrap_or(0).saturating_mul(1000)
}
