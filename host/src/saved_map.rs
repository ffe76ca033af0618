//! A map that lives on: `map.lrfslam`, everything that is needed to draw it again, and to find a robot in it.
//!
//! 8 bytes magic, version (u16), length (u64) and CRC-32 (ISO-HDLC, u32) of the rest, all little endian; the rest is a gzip stream of postcard:
//! the program's version, the configuration as TOML, the scans kept (ranges to 0.1 mm, bearings to 10 µrad), their path and its pose graph.

use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};

use crc::{CRC_32_ISO_HDLC, Crc};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use serde::{Deserialize, Serialize};

use crate::config::RunConfig;
use crate::high_slam::{HighSlam, SavedPath, SavedPathError};
use crate::output::write_file;
use crate::run_report::Program;
use crate::scan_store::ScanStore;

/// Its name in a map's folder.
pub const FILE_NAME: &str = "map.lrfslam";

const MAGIC: [u8; 8] = *b"LRFSLAM\x1a";
const VERSION: u16 = 1;
const HEADER: usize = 8 + 2 + 8 + 4;
/// More than this is no map of ours, bytes unpacked: four days of driving.
const UNPACKED_MAX: u64 = 1 << 32;
const CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A saved map.
#[derive(Debug, Clone, PartialEq)]
pub struct SavedMap {
    /// Version of the program that made it.
    pub program: String,
    /// The configuration it was made with.
    pub config: RunConfig,
    /// The path of its scans.
    pub path: SavedPath,
    /// The scans.
    pub scans: ScanStore,
}

#[derive(Serialize, Deserialize)]
struct Content<S, P> {
    program: String,
    config: String,
    path: P,
    scans: S,
}

/// Why there is no saved map to be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SavedMapError {
    /// There is none in the folder.
    #[error("{0}: not there; expected a folder that `lrfslam map` of this version has written")]
    Missing(PathBuf),
    /// The file cannot be read.
    #[error("{0}: cannot be read: {1}")]
    Read(PathBuf, std::io::Error),
    /// It begins with something else.
    #[error("{0}: not a saved map of lrfslam: expected it to begin with the bytes \"LRFSLAM\"")]
    Magic(PathBuf),
    /// Another program wrote it.
    #[error("{0}: saved map of version {1}, expected version {VERSION}; map the log again")]
    Version(PathBuf, u16),
    /// It ends early, or goes on.
    #[error("{0}: expected {1} bytes, found {2}: the file is cut or damaged")]
    Length(PathBuf, u64, u64),
    /// Bytes have changed.
    #[error("{0}: damaged: the checksum is {1:08x}, expected {2:08x}")]
    Checksum(PathBuf, u32, u32),
    /// The checksum is right, but not what it covers.
    #[error("{0}: damaged: {1}")]
    Content(PathBuf, String),
}

impl SavedMap {
    /// What is to be saved of `high`.
    pub fn new(config: &RunConfig, high: &HighSlam<'_>) -> Self {
        let (path, scans) = (high.saved(), high.scans().clone());
        Self { program: Program::THIS.version.to_owned(), config: *config, path, scans }
    }

    /// Writes it into `folder`.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        let config = toml::to_string(&self.config)?;
        let content = Content { program: self.program.clone(), config, path: &self.path, scans: &self.scans };
        let mut packer = GzEncoder::new(vec![0; HEADER], Compression::default());
        packer.write_all(&postcard::to_stdvec(&content)?)?;
        let mut bytes = packer.finish()?;
        let (header, packed) = bytes.split_at_mut(HEADER);
        let (version, length, crc) = (VERSION, packed.len() as u64, CRC32.checksum(packed));
        let parts = [&MAGIC[..], &version.to_le_bytes(), &length.to_le_bytes(), &crc.to_le_bytes()];
        header.copy_from_slice(&parts.concat());
        Ok(write_file(&folder.join(FILE_NAME), &bytes)?)
    }

    /// Reads the one in `folder`.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read(folder: &Path) -> Result<Self, SavedMapError> {
        let file = folder.join(FILE_NAME);
        let bytes = std::fs::read(&file).map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => SavedMapError::Missing(file.clone()),
            _ => SavedMapError::Read(file.clone(), error),
        })?;
        let damaged = |why: String| SavedMapError::Content(file.clone(), why);
        let content = unpack(packed_part(&file, &bytes)?).map_err(damaged)?;
        let content: Content<ScanStore, SavedPath> =
            postcard::from_bytes(&content).map_err(|error| damaged(error.to_string()))?;
        let wrong = |error: toml::de::Error| damaged(format!("its configuration: {}", error.message()));
        let config: RunConfig = toml::from_str(&content.config).map_err(wrong)?;
        config.validate().map_err(|error| damaged(error.to_string()))?;
        let Content { program, path, scans, .. } = content;
        Ok(Self { program, config, path, scans })
    }

    /// The high level that was saved, with its scans.
    ///
    /// # Errors
    /// If its parts do not fit together.
    pub fn high_slam(&self, config: &RunConfig) -> Result<HighSlam<'static>, SavedPathError> {
        HighSlam::restored(&config.high_slam(), &self.path, self.scans.clone())
    }
}

/// What the header covers, if it is as the header says.
fn packed_part<'b>(file: &Path, bytes: &'b [u8]) -> Result<&'b [u8], SavedMapError> {
    let has_magic = bytes.starts_with(&MAGIC);
    let (header, packed) = match bytes.split_at_checked(HEADER) {
        Some(parts) if has_magic => parts,
        _ if has_magic => return Err(SavedMapError::Length(file.into(), HEADER as u64, bytes.len() as u64)),
        _ => return Err(SavedMapError::Magic(file.into())),
    };
    let number = |range: std::ops::Range<usize>| {
        header[range].iter().rev().fold(0_u64, |number, byte| (number << 8) | u64::from(*byte))
    };
    let (version, length, crc) = (number(8..10) as u16, number(10..18), number(18..22) as u32);
    if version != VERSION {
        return Err(SavedMapError::Version(file.into(), version));
    }
    if packed.len() as u64 != length {
        let expected = length.saturating_add(HEADER as u64);
        return Err(SavedMapError::Length(file.into(), expected, bytes.len() as u64));
    }
    match CRC32.checksum(packed) {
        found if found == crc => Ok(packed),
        found => Err(SavedMapError::Checksum(file.into(), found, crc)),
    }
}

fn unpack(packed: &[u8]) -> Result<Vec<u8>, String> {
    let mut content = Vec::new();
    let read = GzDecoder::new(packed).take(UNPACKED_MAX + 1).read_to_end(&mut content);
    read.map_err(|error| error.to_string())?;
    if content.len() as u64 > UNPACKED_MAX { Err("it is too large for a map".to_owned()) } else { Ok(content) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::geometry::Pose2;
    use lrfslam_core::scan::{Beam, Echo, RangeScan};
    use lrfslam_core::sweep::Sweep;
    use lrfslam_core::time::{Duration, Instant};
    use proptest::prelude::*;

    use crate::high_slam::LowPose;

    /// A drive of 12 m, three segments long.
    fn saved() -> SavedMap {
        let config = RunConfig::default();
        let mut high = HighSlam::new(&config.high_slam(), None);
        for i in 0..40 {
            let beam = |k: i32| Beam {
                bearing_rad: 0.1 * k as f32,
                offset: Duration::ZERO,
                echo: if k % 7 == 0 { Echo::Miss } else { Echo::Hit(3.0 + 0.01 * (i + k) as f32) },
            };
            let beams: Vec<Beam> = (-15..=15).map(beam).collect();
            let stamp = Instant::from_micros(200_000 * i64::from(i));
            let scan = RangeScan { stamp, range_max_m: 8.0, beams: &beams };
            let map_from_robot = Pose2::new(0.3 * i as f32, 0.0, 0.01 * i as f32);
            let low = LowPose { map_from_robot, undetermined: None, is_lost: false };
            high.add_scan(&Sweep::at_rest(scan, Pose2::new(0.1, 0.0, 0.0)), &low).unwrap();
        }
        SavedMap::new(&config, &high)
    }

    fn written() -> (tempfile::TempDir, PathBuf, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        saved().write(folder.path()).unwrap();
        let file = folder.path().join(FILE_NAME);
        let bytes = std::fs::read(&file).unwrap();
        (folder, file, bytes)
    }

    #[test]
    fn what_is_written_is_read_back() {
        let (folder, _, bytes) = written();
        let (map, back) = (saved(), SavedMap::read(folder.path()).unwrap());
        assert_eq!((&back.path, back.config, back.scans.len()), (&map.path, map.config, 40));
        let [before, after] = [&map, &back].map(|map| {
            let high = map.high_slam(&map.config).unwrap();
            high.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect::<Vec<_>>()
        });
        assert_eq!((before.len(), &before), (40, &after));
        back.write(folder.path()).unwrap();
        assert_eq!(std::fs::read(folder.path().join(FILE_NAME)).unwrap(), bytes, "saved again it is the same");
    }

    #[test]
    fn wrong_files_are_named_with_what_was_expected() {
        let (folder, file, bytes) = written();
        let error = |bytes: &[u8]| {
            std::fs::write(&file, bytes).unwrap();
            let error = SavedMap::read(folder.path()).unwrap_err().to_string();
            assert!(error.starts_with(&file.display().to_string()), "{error}");
            error
        };
        assert!(error(b"P5\n3 2\n").contains("not a saved map"));
        assert!(error(&bytes[..12]).contains("expected 22 bytes, found 12"));
        assert!(error(&bytes[..bytes.len() - 1]).contains("the file is cut or damaged"));
        assert!(error(&[&bytes[..], &[0]].concat()).contains("the file is cut or damaged"));
        let flipped = |index: usize| {
            let mut bytes = bytes.clone();
            bytes[index] ^= 4;
            bytes
        };
        assert!(error(&flipped(8)).contains("saved map of version 5, expected version 1"));
        assert!(error(&flipped(bytes.len() / 2)).contains("the checksum is"));
        std::fs::remove_file(&file).unwrap();
        assert!(SavedMap::read(folder.path()).unwrap_err().to_string().contains("not there; expected a folder"));
    }

    proptest! {
        /// Past the checksum there may still be anything.
        #[test]
        fn contents_that_are_wrong_never_panic(at in 0_usize..6000, byte in any::<u8>()) {
            let map = saved();
            let mut bytes = postcard::to_stdvec(&(&map.path, &map.scans)).unwrap();
            let at = at % bytes.len();
            bytes[at] = byte;
            if let Ok((path, scans)) = postcard::from_bytes::<(SavedPath, ScanStore)>(&bytes)
                && let Ok(high) = HighSlam::restored(&map.config.high_slam(), &path, scans)
            {
                prop_assert!(high.trajectory().count() <= 41);
            }
        }
    }
}
