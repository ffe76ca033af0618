//! What a run was and what it cost: `run.json`, beside every result.

use lrfslam_core::scan::{Echo, RangeScan};
use serde::Serialize;

use crate::mapping::MatchCounts;
use crate::mapping::high::HighCounts;
use crate::output::{Hole, RECORDING};
use crate::program::Program;
use crate::results::quality::Quality;
use crate::results::step_table::ParticleSummary;
use crate::scans::log::{LogCounts, LogFormat};
use crate::scans::recording::RecordingReport;

/// Everything needed to judge and to repeat a run.
#[derive(Debug, Clone, Serialize)]
pub struct RunReport<C> {
    /// Name and version of the program.
    pub program: Program,
    /// Where the scans came from.
    #[serde(flatten)]
    pub source: Source,
    /// The folder of the map that was gone on with.
    pub continues: Option<String>,
    /// Every value used, as the program has its configuration.
    pub config: C,
    /// Of the random numbers.
    pub seed: u64,
    /// The log's odometry was used.
    pub odometry: bool,
    /// What the beams said.
    pub beams: BeamCounts,
    /// How the matching went.
    pub matching: MatchCounts,
    /// How the particles did; none with matching alone.
    pub particles: Option<ParticleSummary>,
    /// What the high level did, if there is one.
    pub high: Option<HighCounts>,
    /// How far the map is to be trusted.
    pub quality: Quality,
    /// Time spent and memory used.
    pub cost: Cost,
    /// Not all scans that there were are in the results.
    pub partial: bool,
    /// How the run ended.
    pub ending: Ending,
    /// What ended it early, if anything did.
    pub fault: Option<String>,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ending {
    /// All scans that there were, or that the user wanted, are in the results.
    Complete,
    /// It has not: these are the results on the way. If the run is over, it was killed.
    Running,
    /// The user did not wait for the end of the log.
    Interrupted,
    /// Something went wrong on the way.
    Failed,
}

/// Where scans came from.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum Source {
    /// A log.
    Log {
        /// The file.
        input: Input,
        /// What was met in it.
        log: LogCounts,
        /// Ranges from here on were misses, m.
        range_max_m: f32,
    },
    /// A laser, now or recorded.
    Laser {
        /// Its port, or the recording's name.
        port: String,
        /// What its driver counted.
        laser: LaserCounts,
        /// What was recorded of it, when the run is over.
        recording: Option<RecordingCounts>,
    },
    /// A robot that does the SLAM itself.
    Robot {
        /// Where it was reached.
        port: String,
        /// What it counted, and what of it is not here.
        robot: RobotCounts,
    },
}

impl Source {
    /// The times of the scans were measured, not made up.
    pub fn has_times(&self) -> bool {
        !matches!(self, Self::Log { log, .. } if log.synthetic_times)
    }
}

/// What was recorded of a laser.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RecordingCounts {
    /// The file; among the results if it has no folder.
    pub file: String,
    /// Its size.
    pub bytes: u64,
    /// Why it ends before the run did.
    pub fault: Option<String>,
    /// When its disk had no room: what is missing in it, not in the map.
    pub holes: Vec<Hole>,
}

impl From<&RecordingReport> for RecordingCounts {
    fn from(report: &RecordingReport) -> Self {
        let is_among_results = report.path.ends_with(RECORDING);
        let file = if is_among_results { RECORDING.to_owned() } else { report.path.display().to_string() };
        Self { file, bytes: report.bytes, fault: report.fault.clone(), holes: report.holes.clone() }
    }
}

/// What a robot counted, and what of it did not come here.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RobotCounts {
    /// Its board.
    pub board: String,
    /// The path begins with the robot's first step; otherwise the host came later.
    pub is_from_start: bool,
    /// The robot has stopped and told all of its map.
    pub is_map_complete: bool,
    /// Scans that it took and that nobody was told of.
    pub missing_scans: u32,
    /// Scans not told with their beams, for want of room on the link.
    pub untold_sweeps: u32,
    /// Scans that it left out because it maps slower than they come.
    pub late_scans: u32,
    /// Scans larger than its memory.
    pub refused_scans: u32,
    /// Particles that went because no map tile was free.
    pub dropped_particles: u32,
    /// Squares of its map left out because no map tile was free with one particle left.
    pub squares_left_out: u32,
    /// Map tiles that the robot left with its host.
    pub tiles_left: u32,
    /// Map tiles that it took back.
    pub tiles_restored: u32,
    /// Map tiles that are lost: no host was there for them, or no room when they came back.
    pub tiles_forgotten: u32,
    /// Scans and replies of the laser refused because something in them was wrong.
    pub damaged: u32,
    /// Sessions with the laser begun anew after trouble.
    pub restarts: u32,
    /// Frames of the link that came damaged.
    pub damaged_frames: u32,
    /// When the journal's disk had no room: missing in the journal, not in the map.
    pub journal_holes: Vec<Hole>,
    /// Messages missing in the journal that was gone on with: they are missing in the map, too.
    pub journal_missing: u32,
}

/// What the driver of a laser counted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct LaserCounts {
    /// Scans and replies refused because something in them was wrong.
    pub damaged: u32,
    /// Sessions begun anew after trouble.
    pub restarts: u32,
    /// Turns of a laser that spins in which samples were missing.
    pub incomplete: u32,
    /// Scans lost because the computer was too slow for the laser.
    pub overrun: u32,
    /// Scans during which the robot moved faster than the laser's rate allows, eq. (4.44) and (4.45).
    pub too_fast: u32,
}

/// The file that was read.
#[derive(Debug, Clone, Serialize)]
pub struct Input {
    /// Its name as given; `-` is the standard input.
    pub name: String,
    /// SHA-256 of its bytes, hexadecimal; where reading failed, of those before; none while it is read.
    pub sha256: Option<String>,
    /// How many these are.
    pub bytes: u64,
    /// What it was found to be.
    pub format: Option<LogFormat>,
}

/// What beams said.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct BeamCounts {
    /// Something at a range.
    pub hits: u64,
    /// Nothing up to the maximum range.
    pub misses: u64,
    /// No measurement.
    pub invalid: u64,
}

/// Time and memory.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cost {
    /// Scans mapped.
    pub scans: u64,
    /// Time spent on mapping them, s.
    pub wall_s: f64,
    /// Scans per second of it.
    pub scans_per_s: f64,
    /// Between the stamps of the first and the last scan, s.
    pub driven_s: f64,
    /// The most memory the process has held, bytes, where the system tells.
    pub peak_memory_bytes: Option<u64>,
}

/// The most memory this process has held so far, bytes; `None` where there is no `/proc` that tells (`VmHWM`).
pub fn peak_memory_bytes() -> Option<u64> {
    status_bytes("VmHWM:")
}

/// The memory this process holds now, bytes; `None` where there is no `/proc` that tells (`VmRSS`).
pub fn resident_memory_bytes() -> Option<u64> {
    status_bytes("VmRSS:")
}

fn status_bytes(name: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kibibytes: u64 = status.lines().find_map(|l| l.strip_prefix(name))?.split_whitespace().next()?.parse().ok()?;
    Some(kibibytes * 1024)
}

impl BeamCounts {
    /// Counts those of a scan.
    pub fn add(&mut self, scan: &RangeScan<'_>) {
        for beam in scan.beams {
            match beam.echo {
                Echo::Hit(_) => self.hits += 1,
                Echo::Miss => self.misses += 1,
                Echo::Invalid => self.invalid += 1,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peak_memory_is_plausible_where_it_is_told() {
        if let Some(bytes) = peak_memory_bytes() {
            assert!((1 << 20..1 << 36).contains(&bytes), "{bytes}");
        }
    }
}
