//! Every entry by which bytes of others come in, for fuzzing: each takes any bytes, and must come back.
//!
//! `fuzz/` runs them with coverage for hours; the test `fuzzed` spoils small samples of what is right, for seconds.

use std::fs;
use std::io::{Cursor, Write as _};
use std::path::Path;

use crc::{CRC_32_ISO_HDLC, Crc};
use flate2::Compression;
use flate2::write::GzEncoder;
use lrfslam_app::config::RunConfig;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_host::localize::KnownMap;
use lrfslam_host::mapping::high::HighConfigs;
use lrfslam_host::mapping::saved_map::{self, SavedMap};
use lrfslam_host::maps::occupancy::{MapConfig, OccupancyMap};
use lrfslam_host::robot::{ClientMemory, JOURNAL, Journal, Judge, RobotClient, RobotEvent, RobotMap, Sweeps};
use lrfslam_host::scans::bags::{Bag, Taken, TfWanted};
use lrfslam_host::scans::log::{LogOptions, LogReader};
use lrfslam_host::scans::mcap::RawBytes;
use lrfslam_host::scans::recording::RecordingReader;
use lrfslam_robot::wire::frame::{MAX_FRAME, encode};
use lrfslam_robot::wire::key::Key;
use lrfslam_robot::wire::lock::Lock;
use lrfslam_robot::wire::message::{FromRobot, Health};
use lrfslam_robot::{CompactPools, Input, Pools as _, Ports, Robot, RobotConfig};

use crate::laser_scripts;

static CRC32: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// An entry, and what it is called.
pub type Entry = (&'static str, fn(&[u8]));

/// All of them.
pub const ENTRIES: [Entry; 12] = [
    ("drivers", drivers),
    ("logs", logs),
    ("bags", bags),
    ("configurations", configurations),
    ("robots", robots),
    ("hosts", hosts),
    ("recordings", recordings),
    ("maps", maps),
    ("journals", journals),
    ("worlds", worlds),
    ("images", images),
    ("trajectories", trajectories),
];

/// What a laser says to its driver, as a [script](crate::laser_scripts).
pub fn drivers(bytes: &[u8]) {
    laser_scripts::play(bytes);
}

/// A log, as a reader takes it.
pub fn logs(bytes: &[u8]) {
    let reader = LogReader::from_reader("a.log", Cursor::new(bytes.to_vec()), LogOptions::default());
    assert!(reader.map_or(0, |reader| reader.take(10_000).count()) <= 10_000);
}

/// A bag of any kind, with its frames; and, of MCAP, the bytes of a laser in it.
pub fn bags(bytes: &[u8]) {
    if let Ok(mut bag) = Bag::from_reader(Cursor::new(bytes.to_vec()), None) {
        let wanted = TfWanted { odometry_frame: Some("odom"), mounting: true, robot_frame: None };
        let _ = bag.find_frames_in(Cursor::new(bytes.to_vec()), &wanted);
        let mut taken = 0;
        while !matches!(bag.take(), Taken::End) && taken < 10_000 {
            taken += 1;
        }
        assert!(taken <= bytes.len(), "{taken} of {} bytes", bytes.len());
    }
    if let Ok(Some(stream)) = RawBytes::new(Cursor::new(bytes)) {
        assert!(RecordingReader::new(stream).map_or(0, Iterator::count) <= bytes.len());
    }
}

/// A file for `--config`.
pub fn configurations(bytes: &[u8]) {
    in_folder(&[("a.toml", bytes)], |folder| {
        let _ = RunConfig::load_over(RunConfig::default(), Some(&folder.join("a.toml")), &[]);
    });
}

/// What a robot hears from a host that may be any: raw bytes, and the payloads of whole frames. With a key it hears them, too.
pub fn robots(bytes: &[u8]) {
    let key = Key::new([7; 32]);
    for lock in [None, Some(Lock::of_robot(key, [1; 16]))] {
        let mut pools = Box::new(CompactPools::EMPTY);
        hear_host(Robot::new("fuzzed", 7, pools.lend()).with_lock(lock), bytes);
    }
}

fn hear_host(mut robot: Robot<'_>, bytes: &[u8]) {
    let mut silent = Silent;
    let mut now = Instant::from_micros(1_000_000);
    let _ = robot.handle(now, Input::LinkConnected, &mut silent);
    for_each_piece(bytes, |piece| {
        now = now + Duration::from_millis(10);
        let _ = robot.handle(now, Input::LinkBytes(piece), &mut silent);
        let _ = robot.handle(now, Input::Timeout, &mut silent);
    });
}

struct Silent;

impl Ports for Silent {
    fn send_to_laser(&mut self, _: &[u8]) {}
    fn set_laser_baud(&mut self, _: u32) {}
    fn link_room(&self) -> usize {
        MAX_FRAME
    }
    fn send_to_host(&mut self, _: &[u8]) {}
    fn restart(&mut self) {}
    fn health(&self) -> Health {
        Health::default()
    }
}

/// What a host hears from a robot that may be any; with a key, too.
pub fn hosts(bytes: &[u8]) {
    let key = Key::new([7; 32]);
    for lock in [None, Some(Lock::of_host(key, [1; 16]))] {
        let mut memory = ClientMemory::default();
        hear_robot(RobotClient::new(&RobotConfig::default(), 20, None, &mut memory).with_lock(lock), bytes);
    }
}

fn hear_robot(mut client: RobotClient<'_>, bytes: &[u8]) {
    let mut now = Instant::from_micros(1_000_000);
    client.session().connected(now);
    let (mut judge, mut map, mut sweeps) = (Judge::default(), RobotMap::default(), Sweeps::default());
    let mut take = |message: &FromRobot<'_>| {
        if judge.check(message).is_ok() {
            map.take(message);
            match message {
                FromRobot::Sweep(part) => sweeps.take_part(part),
                FromRobot::Scan(pose) => drop(sweeps.taken_at(pose.stamp)),
                _ => {}
            }
        }
    };
    for_each_piece(bytes, |piece| {
        now = now + Duration::from_millis(10);
        client.take(now, piece, &mut |event| match event {
            RobotEvent::Message(told) => told.message().iter().for_each(&mut take),
            RobotEvent::Recall(recall) => recall.answer(&lrfslam_host::robot::Tiles::new()),
            _ => {}
        });
        client.session().timeout(now);
        while client.session().poll_transmit(now, &mut [0; MAX_FRAME]).is_some() {}
    });
    let _ = map.path();
}

/// A recording of a laser: the bytes as they are, and with right checks.
pub fn recordings(bytes: &[u8]) {
    for bytes in [bytes, &with_checks(bytes)] {
        let Ok(mut reader) = RecordingReader::new(bytes) else { continue };
        let count = reader.by_ref().count();
        assert!(count <= bytes.len() && reader.end().is_some());
    }
}

/// Bytes of a recording before its header: magic, and the header's length.
pub(crate) const RECORDING_OPENING: usize = 12;

/// A recording whose checks are those of its records: a flipped bit of it comes through.
pub fn with_checks(recording: &[u8]) -> Vec<u8> {
    /// A record without its payload.
    const HEAD: usize = 13;
    let mut bytes = recording.to_vec();
    let length = |bytes: &[u8], at: usize| {
        let four = bytes.get(at..at + 4)?.try_into().ok()?;
        Some(u32::from_le_bytes(four) as usize)
    };
    let Some(header) = length(&bytes, RECORDING_OPENING - 4) else { return bytes };
    let (mut since, mut at) = (RECORDING_OPENING + header, RECORDING_OPENING + header);
    while let Some(payload) = length(&bytes, at + HEAD - 4)
        && at + HEAD + payload <= bytes.len()
    {
        let end = at + HEAD + payload;
        if bytes[at] == b'#' && payload == 4 {
            let crc = CRC32.checksum(&bytes[since..at]);
            bytes[at + HEAD..end].copy_from_slice(&crc.to_le_bytes());
            since = end;
        }
        at = end;
    }
    bytes
}

/// A saved map, as `map.lrfslam` in a folder: the bytes as its file, and as what its header tells of. What can be read is driven on in and
/// drawn.
pub fn maps(bytes: &[u8]) {
    for file in [bytes, &map_file_of(bytes)] {
        in_folder(&[(saved_map::FILE_NAME, file)], |folder| {
            let Ok(saved) = SavedMap::read(folder) else { return };
            let config = HighConfigs::default();
            if let Ok(known) = KnownMap::new(&saved, &config) {
                known.draw(&mut OccupancyMap::new(MapConfig::default()));
            }
            if let Ok(mut high) = saved.high_slam(&config) {
                let _ = high.drive_on_from(None);
            }
        });
    }
}

/// Bytes of the header of a saved map.
pub(crate) const MAP_HEADER: usize = 22;

/// A saved map whose header and packing are right.
pub fn map_file_of(content: &[u8]) -> Vec<u8> {
    let mut packed = Vec::new();
    let mut packer = GzEncoder::new(&mut packed, Compression::fast());
    packer.write_all(content).and_then(|()| packer.finish().map(drop)).expect("memory takes all");
    let (length, crc) = (packed.len() as u64, CRC32.checksum(&packed));
    [&b"LRFSLAM\x1a\x04\0"[..], &length.to_le_bytes(), &crc.to_le_bytes(), &packed].concat()
}

/// A robot's journal. It stays as it is.
pub fn journals(bytes: &[u8]) {
    in_folder(&[(JOURNAL, bytes)], |folder| {
        let mut judge = Judge::default();
        let _ = Journal::resume(&folder.join(JOURNAL), |told| {
            told.message().iter().for_each(|message| drop(judge.check(message)));
        });
        assert!(fs::read(folder.join(JOURNAL)).is_ok_and(|now| now.starts_with(bytes)), "a journal got shorter");
    });
}

/// A world of the simulator.
pub fn worlds(bytes: &[u8]) {
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = Scenario::parse(text, "a.toml", Path::new("/nonexistent"));
    }
}

/// The picture of a ROS map.
pub fn images(bytes: &[u8]) {
    let yaml = b"image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n";
    in_folder(&[("m.yaml", yaml), ("m.pgm", bytes)], |folder| {
        let _ = Scenario::load(&folder.join("m.yaml").display().to_string());
    });
}

/// A trajectory.
pub fn trajectories(bytes: &[u8]) {
    in_folder(&[("a.tum", bytes)], |folder| drop(lrfslam_host::trajectory::read_trajectory(&folder.join("a.tum"))));
}

/// With these files, for a moment.
fn in_folder(files: &[(&str, &[u8])], look: impl FnOnce(&Path)) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    files.iter().for_each(|(name, bytes)| fs::write(folder.path().join(name), bytes).expect("room for it"));
    look(folder.path());
}

/// Pieces of a conversation: a byte whose upper seven bits are their length in units of 8 bytes; if the lowest is set they come as they are, else as the
/// payload of a frame.
fn for_each_piece(bytes: &[u8], mut give: impl FnMut(&[u8])) {
    let mut rest = bytes;
    while let Some((length, after)) = rest.split_first() {
        let (piece, after) = after.split_at(after.len().min(8 * usize::from(*length / 2)));
        rest = after;
        let mut memory = [0; MAX_FRAME];
        match length % 2 {
            0 => give(encode(piece, &mut memory).unwrap_or_default()),
            _ => give(piece),
        }
    }
}

/// `bytes` as such a piece: a payload that becomes a frame, cut if it is long.
pub fn piece(payload: &[u8]) -> Vec<u8> {
    let units = payload.len().div_ceil(8).min(127);
    let mut piece = vec![2 * units as u8];
    piece.extend(payload.iter().copied().chain(std::iter::repeat(0)).take(8 * units));
    piece
}
