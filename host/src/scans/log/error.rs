//! What can be wrong with a log, said so that a person can find and mend it.

use super::DamagedLine;
use crate::input::text::LineFault;
use crate::scans::bags::TfFault;

/// Why a log cannot be read, or not further.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file cannot be opened.
    #[error("{file}: cannot be opened: {source}")]
    Open {
        /// Name of the file, as given.
        file: String,
        /// Why.
        source: LineFault,
    },
    /// Reading failed on the way: the disk, or damaged gzip data, or a line without end.
    #[error("{file}: after line {line}, {scans} scans read: {source}")]
    Read {
        /// Name of the file, as given.
        file: String,
        /// Last line that was read.
        line: u64,
        /// Scans read before.
        scans: u64,
        /// Why.
        source: LineFault,
    },
    /// No line of it is of a format known here.
    #[error(
        "{file}: not a log: no line of CARMEN (FLASER, ROBOTLASER1), DP-SLAM (Laser), tinySLAM or YDLIDAR X4 among its first {lines}"
    )]
    NotALog {
        /// Name of the file, as given.
        file: String,
        /// Lines looked at.
        lines: u64,
    },
    /// What `lrfslam run` recorded: a laser's bytes, not its scans.
    #[error("{file}: not a log but the recording of a laser: name its file")]
    Recording {
        /// Name of the file, as given.
        file: String,
    },
    /// A bag that cannot be read.
    #[error("{file}: cannot be read as a bag: {source}")]
    Bag {
        /// Name of the file, as given.
        file: String,
        /// Why.
        source: std::io::Error,
    },
    /// A bag without scans.
    #[error(
        "{file}: no scan that can be read{topic}: expected messages of sensor_msgs/LaserScan or foxglove.LaserScan; its topics are {topics}"
    )]
    NoScanInBag {
        /// Name of the file, as given.
        file: String,
        /// The topic that was wanted, with "on" before it.
        topic: String,
        /// Those that there are, with their types.
        topics: String,
    },
    /// A bag with scans of several lasers.
    #[error("{file}: scans on several topics, {topics}: say which with --topic")]
    SeveralTopics {
        /// Name of the file, as given.
        file: String,
        /// Those that have scans.
        topics: String,
    },
    /// A bag whose frames do not say what is wanted of them.
    #[error("{file}: {source}")]
    Frames {
        /// Name of the file, as given.
        file: String,
        /// Why.
        source: TfFault,
    },
    /// What has no frames, where some are wanted.
    #[error("{file}: frames (tf) are wanted, and only bags of ROS have them")]
    NoFrames {
        /// Name of the file, as given.
        file: String,
    },
    /// No byte, or nothing but blank lines.
    #[error("{file}: the log is empty")]
    Empty {
        /// Name of the file, as given.
        file: String,
    },
    /// A log, but without a scan.
    #[error("{file}: no scan in its {lines} lines: expected FLASER, ROBOTLASER1 or Laser lines")]
    NoScan {
        /// Name of the file, as given.
        file: String,
        /// Lines read.
        lines: u64,
    },
    /// A log none of whose scans can be read.
    #[error("{file}: no scan can be read: {damaged} damaged lines, the first: {first}")]
    AllDamaged {
        /// Name of the file, as given.
        file: String,
        /// Lines that are damaged.
        damaged: u64,
        /// Which field, what was expected, what stands there.
        first: DamagedLine,
    },
}
