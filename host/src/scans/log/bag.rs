//! A bag, read as a log: its messages take the place of lines.

use std::fs::File;
use std::io::{self, BufReader, Read as _};
use std::path::{Path, PathBuf};

use lrfslam_core::scan::Echo;
use sha2::{Digest as _, Sha256};

use super::raw::{Bearings, RawScan};
use super::{LOOK_AHEAD, LogError, LogFormat, LogOptions, LogReader};
use crate::input::text::{ByteCount, Lines};
use crate::scans::bags::{Bag, BagKind, BagScan, Ranges, Taken, bag_files, bag_kind};
use crate::scans::mcap::RawBytes;

/// Where the scans of a log stand.
pub(super) enum Source {
    Lines(Box<Lines>),
    Bag(Box<BagSource>),
}

/// A bag, its files, and how much of them was read.
pub(super) struct BagSource {
    bag: Bag,
    kind: BagKind,
    files: Vec<PathBuf>,
    wanted: Option<&'static str>,
    count: ByteCount,
    /// Of the message read last.
    number: u64,
}

/// The bag at `path`, and its size in bytes; `None` if what is there is none.
///
/// # Errors
/// If it is a bag that cannot be read, or the recording of a laser.
pub(super) fn bag_at(path: &Path, options: &LogOptions) -> Result<Option<(BagSource, u64)>, LogError> {
    let file = path.display().to_string();
    let files = bag_files(path);
    let fault = |source| LogError::Bag { file: path.display().to_string(), source };
    // What is read of a pipe is gone.
    let first = files.first().filter(|first| first.is_file());
    let kind_of = |first: &PathBuf| Some((first.clone(), kind_of(first).ok().flatten()?));
    let Some((first, kind)) = first.and_then(kind_of) else { return Ok(None) };
    let has_bytes = || Ok(RawBytes::new(BufReader::new(File::open(&first)?))?.is_some());
    if kind == BagKind::Mcap && has_bytes().map_err(fault)? {
        return Err(LogError::Recording { file });
    }
    let size = files.iter().filter_map(|file| file.metadata().ok()).map(|about| about.len()).sum();
    let (wanted, count) = (options.topic, ByteCount::default());
    let mut bag = Bag::open(files.clone(), wanted).map_err(fault)?;
    if options.tf.is_any() {
        bag.find_frames(&files, &options.tf).map_err(|source| LogError::Frames { file, source })?;
    }
    Ok(Some((BagSource { bag, kind, files, wanted, count, number: 0 }, size)))
}

fn kind_of(file: &Path) -> io::Result<Option<BagKind>> {
    let mut magic = Vec::new();
    File::open(file)?.take(16).read_to_end(&mut magic)?;
    Ok(bag_kind(&magic))
}

impl BagSource {
    pub fn format(&self) -> LogFormat {
        match self.kind {
            BagKind::Mcap => LogFormat::Mcap,
            BagKind::Sqlite => LogFormat::RosSqlite,
            BagKind::Ros1 => LogFormat::Ros1,
        }
    }

    pub fn bytes_read(&self) -> ByteCount {
        self.count.clone()
    }

    pub fn number(&self) -> u64 {
        self.number
    }

    pub fn frames_found(&self) -> &[String] {
        self.bag.frames_found()
    }

    /// Of its files, one behind the other.
    pub fn sha256(&self) -> String {
        let mut hash = Sha256::new();
        for file in self.files.iter().filter_map(|file| File::open(file).ok()) {
            let mut file = BufReader::with_capacity(1 << 16, file);
            let mut block = vec![0; 1 << 16];
            while let Ok(count @ 1..) = file.read(&mut block) {
                hash.update(block.get(..count).unwrap_or_default());
            }
        }
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Why there is no scan.
    pub fn no_scan(&self, file: String) -> LogError {
        let topic = self.wanted.map_or(String::new(), |topic| format!(" on {topic}"));
        LogError::NoScanInBag { file, topic, topics: self.bag.topics() }
    }
}

impl LogReader {
    /// The next scan of a bag; `None` at its end.
    pub(super) fn next_of_bag(&mut self) -> Result<Option<RawScan>, LogError> {
        loop {
            let Source::Bag(source) = &mut self.source else { return Ok(None) };
            let taken = source.bag.take();
            source.count.set(source.bag.position());
            if source.wanted.is_none() && self.scans_read <= LOOK_AHEAD as u64 && source.bag.scan_topics().len() > 1 {
                let topics = source.bag.scan_topics().join(", ");
                return Err(LogError::SeveralTopics { file: self.file.clone(), topics });
            }
            match taken {
                Taken::Scan(scan) => {
                    source.number = scan.number;
                    return Ok(Some(raw(*scan)));
                }
                Taken::Damaged(number, fault) => self.counts.add_damaged(number, fault),
                Taken::Cut => self.counts.cut_last_line = true,
                Taken::End => return Ok(None),
            }
        }
    }
}

pub(super) fn raw(scan: BagScan) -> RawScan {
    let new = RawScan {
        stamp: Some(scan.stamp),
        odometry_from_robot: scan.odometry_from_robot,
        robot_from_lrf: scan.robot_from_lrf,
        ..RawScan::new(scan.number, Vec::new())
    };
    match scan.ranges {
        Ranges::Even { ranges_m, bearings_rad: [first_rad, step_rad], offsets: [first, each], range_max_m } => {
            RawScan {
                ranges_m,
                bearings: Some(Bearings { first_rad, step_rad }),
                range_max_m,
                first_offset: first,
                beam_interval: each,
                ..new
            }
        }
        Ranges::Exact { beams, range_max_m } => {
            let range = |echo| match echo {
                Echo::Hit(range_m) => range_m,
                Echo::Miss => f32::INFINITY,
                Echo::Invalid => f32::NAN,
            };
            let step_rad = match &beams[..] {
                [first, second, ..] => second.bearing_rad - first.bearing_rad,
                _ => 0.0,
            };
            RawScan {
                ranges_m: beams.iter().map(|beam| range(beam.echo)).collect(),
                bearings: beams.first().map(|first| Bearings { first_rad: first.bearing_rad, step_rad }),
                range_max_m: Some(range_max_m),
                exact: Some(beams),
                ..new
            }
        }
    }
}
