//! A map that lives on: `map.lrfslam`, everything that is needed to draw it again, and to find a robot in it.
//!
//! 8 bytes magic, version (u16), length (u64) and CRC-32 (ISO-HDLC, u32) of the rest, all little endian; the rest is a gzip stream of postcard:
//! the program's version, the configuration as TOML, the scans kept (ranges to 0.1 mm, bearings to 10 µrad), their path and its pose graph.
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use std::io::{self, BufWriter, IntoInnerError, Read as _, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crc::{CRC_32_ISO_HDLC, Crc, Digest};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use serde::{Deserialize, Serialize};

use crate::mapping::high::{HighConfigs, HighSlam, SavedPath, SavedPathError};
use crate::output::PendingFile;
use crate::program::Program;
use crate::scans::store::ScanStore;

/// Its name in a map's folder.
pub const FILE_NAME: &str = "map.lrfslam";

const MAGIC: [u8; 8] = *b"LRFSLAM\x1a";
/// To be raised with every change of what is written, and with every key of the configuration that goes or is called otherwise.
const VERSION: u16 = 4;
const HEADER: usize = 8 + 2 + 8 + 4;
/// More than this is no map of ours, bytes unpacked: four days of driving.
const UNPACKED_MAX: u64 = 1 << 32;
/// Bytes that are packed at once.
const PACKED_AT_ONCE: usize = 1 << 16;
static CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A saved map; one that is written need not own its parts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedMap<P = SavedPath, S = ScanStore> {
    /// Version of the program that made it.
    pub program: String,
    /// The configuration it was made with, as TOML: whatever the program that made it calls so.
    pub config: String,
    /// The path of its scans.
    pub path: P,
    /// The scans.
    pub scans: S,
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
    #[error(
        "{0}: saved map of version {1}, expected version {VERSION}: made by {age} lrfslam than this; map the log again",
        age = if *.1 < VERSION { "an older" } else { "a newer" }
    )]
    Version(PathBuf, u16),
    /// Its configuration has keys or values that are not known here; the version of the program that made it, and which.
    #[error("{0}: made by lrfslam {1}, whose configuration this program does not know: {2}; map the log again")]
    Configuration(PathBuf, String, String),
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

/// What is to be saved of `high`, which was made with `config`, in TOML; it is read while it is written.
pub fn map_of<'h>(config: String, high: &'h HighSlam<'_>) -> SavedMap<impl Serialize + 'h, &'h ScanStore> {
    SavedMap { program: Program::THIS.version.to_owned(), config, path: high.saved(), scans: high.scans() }
}

impl<P: Serialize, S: Serialize> SavedMap<P, S> {
    /// Writes it into `folder`.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        let mut file = PendingFile::create(&folder.join(FILE_NAME))?;
        self.pack(&mut file)?;
        Ok(file.finish()?)
    }

    /// Writes the file into `out`, which is at its start: what is packed while it is made, then the header, which tells of it.
    fn pack(&self, out: &mut (impl Write + Seek)) -> anyhow::Result<()> {
        out.write_all(&[0; HEADER])?;
        let packer =
            GzEncoder::new(Packed { out, length: 0, crc: CRC32.digest(), fault: None }, Compression::default());
        let packer = postcard::to_io(self, BufWriter::with_capacity(PACKED_AT_ONCE, packer))?;
        let packed = packer.into_inner().map_err(IntoInnerError::into_error)?.finish()?;
        if let Some(fault) = packed.fault {
            return Err(fault.into());
        }
        let (length, crc) = (packed.length.to_le_bytes(), packed.crc.finalize().to_le_bytes());
        out.seek(SeekFrom::Start(0))?;
        Ok(out.write_all(&[&MAGIC[..], &VERSION.to_le_bytes(), &length, &crc].concat())?)
    }
}

/// Goes through to `out`, and is counted and summed up for the header. The serialiser forgets why it could not write, such as a full disk: the
/// fault is kept here, and nothing is written after it.
struct Packed<'o, W> {
    out: &'o mut W,
    length: u64,
    crc: Digest<'static, u32>,
    fault: Option<io::Error>,
}

impl<W: Write> Write for Packed<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.fault.is_none() {
            self.fault = self.out.write_all(bytes).err();
            self.crc.update(bytes);
            self.length += bytes.len() as u64;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl SavedMap {
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
        postcard::from_bytes(&content).map_err(|error| damaged(error.to_string()))
    }

    /// The high level that was saved, with its scans.
    ///
    /// # Errors
    /// If its parts do not fit together.
    pub fn high_slam(&self, config: &HighConfigs) -> Result<HighSlam<'static>, SavedPathError> {
        HighSlam::restored(config, &self.path, self.scans.clone())
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
        header.get(range).unwrap_or_default().iter().rev().fold(0_u64, |number, byte| (number << 8) | u64::from(*byte))
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

    use crate::mapping::LowPose;

    /// A drive of 12 m, three segments long.
    fn saved() -> SavedMap {
        let mut high = HighSlam::new(&HighConfigs::default(), None);
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
            let low = LowPose { map_from_robot, undetermined: None, is_lost: false, is_blind: false, is_frozen: false };
            high.add_scan(&Sweep::at_rest(scan, Pose2::new(0.1, 0.0, 0.0)), &low).unwrap();
        }
        let mut written = io::Cursor::new(Vec::new());
        map_of("[map]\ncell_size_m = 0.05\n".to_owned(), &high).pack(&mut written).unwrap();
        postcard::from_bytes(&unpack(&written.into_inner()[HEADER..]).unwrap()).unwrap()
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
        assert_eq!((&back.path, &back.config, back.scans.len()), (&map.path, &map.config, 40));
        let [before, after] = [&map, &back].map(|map| {
            let high = map.high_slam(&HighConfigs::default()).unwrap();
            high.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect::<Vec<_>>()
        });
        assert_eq!((before.len(), &before), (40, &after));
        back.write(folder.path()).unwrap();
        assert_eq!(std::fs::read(folder.path().join(FILE_NAME)).unwrap(), bytes, "saved again it is the same");
    }

    /// A disk with room for so many bytes.
    struct Full(usize);

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0 = self.0.checked_sub(bytes.len()).ok_or(io::ErrorKind::StorageFull)?;
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Full {
        fn seek(&mut self, _: SeekFrom) -> io::Result<u64> {
            Ok(0)
        }
    }

    #[test]
    fn a_full_disk_is_called_so_wherever_it_is_met() {
        let map = saved();
        let length = written().2.len();
        for room in [0, HEADER, HEADER + 10, length - 1, length + HEADER - 1] {
            let error = map.pack(&mut Full(room)).unwrap_err();
            let kind = error.downcast_ref::<io::Error>().map(io::Error::kind);
            assert_eq!(kind, Some(io::ErrorKind::StorageFull), "room for {room} of {length} bytes: {error}");
        }
        map.pack(&mut Full(length + HEADER)).unwrap();
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
        let mut newer = bytes.clone();
        newer[8] = 7;
        let newer = error(&newer);
        let told = "saved map of version 7, expected version 4: made by a newer lrfslam than this; map the log again";
        assert!(newer.ends_with(told), "{newer}");
        let mut older = bytes.clone();
        older[8] = 1;
        let told = "saved map of version 1, expected version 4: made by an older lrfslam than this; map the log again";
        assert!(error(&older).ends_with(told), "{}", error(&older));
        assert!(error(&flipped(bytes.len() / 2)).contains("the checksum is"));
        std::fs::remove_file(&file).unwrap();
        assert!(SavedMap::read(folder.path()).unwrap_err().to_string().contains("not there; expected a folder"));
    }

    /// Two scans and a path that names every value otherwise.
    fn golden_map() -> SavedMap {
        let mut scans = ScanStore::default();
        let beam = |bearing_rad, echo| Beam { bearing_rad, offset: Duration::ZERO, echo };
        let beams = [beam(-0.5, Echo::Hit(2.0)), beam(0.0, Echo::Miss), beam(0.25, Echo::Hit(3.5))];
        for micros in [1_000_000, 1_100_000] {
            let scan = RangeScan { stamp: Instant::from_micros(micros), range_max_m: 8.0, beams: &beams };
            scans.add(&Sweep::at_rest(scan, Pose2::new(0.1, -0.2, 0.5)));
        }
        let config = include_str!("../../tests/golden/map-4/config.toml").to_owned();
        SavedMap { program: "golden".to_owned(), config, path: SavedPath::example(), scans }
    }

    /// A map of this version that an earlier build has saved is read as what it was, and saved again has the same bytes.
    #[test]
    fn maps_of_this_version_stay_readable() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/map-{VERSION}"));
        let how = "LRFSLAM_RENEW_GOLDEN=1 cargo test -p lrfslam-host saved_map";
        let raise = format!(
            "builds of this version would misread one another's maps: raise VERSION in host/src/mapping/saved_map.rs, write the golden file of the new version by\n    {how}\nand delete {}",
            folder.display()
        );
        let map = golden_map();
        let renews = std::env::var_os("LRFSLAM_RENEW_GOLDEN").is_some();
        let is_old = || SavedMap::read(&folder).map_or(true, |known| known.config != map.config);
        if renews && is_old() {
            std::fs::create_dir_all(&folder).unwrap();
            map.write(&folder).unwrap();
        }
        let known = SavedMap::read(&folder).unwrap_or_else(|error| panic!("{error}\n{raise}"));
        let bytes = |map: &SavedMap| postcard::to_stdvec(&(&map.path, &map.scans)).unwrap();
        assert!(known.path == map.path && bytes(&known) == bytes(&map), "{raise}\n{:?}\n{:?}", known.path, map.path);
        let file = folder.join(FILE_NAME);
        let content = unpack(packed_part(&file, &std::fs::read(&file).unwrap()).unwrap()).unwrap();
        assert!(postcard::to_stdvec(&map).unwrap() == content, "{raise}");
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
                && let Ok(high) = HighSlam::restored(&HighConfigs::default(), &path, scans)
            {
                prop_assert!(high.trajectory().count() <= 41);
            }
        }
    }
}
