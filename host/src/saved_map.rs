//! A map that lives on: `map.lrfslam`, everything that is needed to draw it again, to go on with it, or to find a robot in it.
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
    pub fn new(config: &RunConfig, high: &HighSlam) -> Self {
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
    pub fn high_slam(&self, config: &RunConfig) -> Result<HighSlam, SavedPathError> {
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
