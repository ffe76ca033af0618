//! What is right at each of the [entries](crate::entries): where fuzzing starts from.

use std::io::Read as _;
use std::path::{Path, PathBuf};

use flate2::read::GzDecoder;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::sweep::Sweep;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_host::mapping::LowPose;
use lrfslam_host::mapping::high::{HighConfigs, HighSlam};
use lrfslam_host::mapping::saved_map::{FILE_NAME, map_of};
use lrfslam_robot::RobotConfig;
use lrfslam_robot::wire::frame::{MAX_FRAME, encode};
use lrfslam_robot::wire::message::ToRobot;
use lrfslam_robot::wire::session::{LAYOUT, Packet, VERSION};

use crate::entries::{MAP_HEADER, RECORDING_OPENING, piece, with_checks};
use crate::laser_scripts::{HELP, LASERS, overheard};

/// Writes the samples of an entry into a folder, for a fuzzer to start from.
///
/// # Panics
/// If there is no room for them.
pub fn write(entry: &str, folder: &str) {
    std::fs::create_dir_all(folder).expect("a folder for samples");
    for (number, sample) in samples(entry).iter().enumerate() {
        std::fs::write(Path::new(folder).join(format!("sample-{number}")), sample).expect("room for samples");
    }
}

fn packed(packet: &Packet<'_>) -> Vec<u8> {
    let mut memory = [0; 1200];
    postcard::to_slice(packet, &mut memory).expect("it fits").to_vec()
}

/// A piece that is a whole frame already, so that its payload has any length.
fn framed(payload: &[u8]) -> Vec<u8> {
    let mut piece = piece(encode(payload, &mut [0; MAX_FRAME]).expect("it fits"));
    piece[0] |= 1;
    piece
}

/// What a host says at first, or a robot.
fn conversation(messages: &[Vec<u8>]) -> Vec<u8> {
    let hello = Packet::Hello {
        version: VERSION,
        epoch: 9,
        peer: None,
        next: 0,
        base: 0,
        credit: 32,
        is_heard: true,
        layout: LAYOUT,
    };
    let said = (0..).zip(messages).map(|(sequence, message)| packed(&Packet::Reliable { epoch: 9, sequence, message }));
    std::iter::once(packed(&hello)).chain(said).flat_map(|payload| piece(&payload)).collect()
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}

/// Bytes of the messages that the golden file has behind `what`.
fn golden_messages(what: &str) -> Vec<Vec<u8>> {
    let text = std::fs::read_to_string(golden(&format!("robot-link-{VERSION}.txt"))).expect("a golden file");
    let unhex = |digits: &str| {
        let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap_or("0"), 16).unwrap_or(0);
        digits.as_bytes().chunks(2).map(byte).collect()
    };
    let lines = text.lines().filter(|line| line.starts_with(what));
    lines.filter_map(|line| Some(unhex(line.split_once(" = ")?.1))).collect()
}

/// Samples of what is right for an entry, small.
///
/// # Panics
/// If a golden file is not there.
pub fn samples(entry: &str) -> Vec<Vec<u8>> {
    let text = |text: &str| text.as_bytes().to_vec();
    match entry {
        "logs" => vec![
            text(&"FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0 1.0 host 1.0\n".repeat(3)),
            text("ROBOTLASER1 0 -1.57 3.14 0.0174 81.9 0.01 0 2 1.5 2.5 0 0 0 0 0 0 0 0 0 0 0 0 1.0 host 1.0\n"),
            text("Odometry 0 0 0\nLaser 3 1.0 2.0 3.0\n"),
        ],
        "drivers" => LASERS.map(|laser| overheard(laser, 3)).to_vec(),
        "scip" => vec![[&[63][..], &HELP.concat()].concat()],
        "configurations" => vec![text("[ndt]\nnoise_m = 0.02\n[map]\ncell_size_m = 0.05\n")],
        "robots" => {
            let mut memory = [0; 1200];
            let configure = ToRobot::Configure(RobotConfig::default());
            let configure = postcard::to_slice(&configure, &mut memory).expect("it fits").to_vec();
            let locked = [&[65; 17][..], &[67; 60]].map(framed).concat();
            vec![conversation(&golden_messages("to robot: ")), conversation(&[configure]), locked]
        }
        "hosts" => {
            let locked = [&[64][..], &[66; 49], &[67; 60]].map(framed).concat();
            vec![conversation(&golden_messages("from robot: ")), locked]
        }
        "recordings" => recordings().to_vec(),
        "maps" => vec![map_file(), content_of_map(&map_file())],
        "journals" => {
            let mut journal = format!("LRFROB{VERSION:02}").into_bytes();
            journal.extend(golden_messages("journal").concat());
            vec![journal]
        }
        "worlds" => {
            vec![
                text(include_str!("../../firmware-sim/worlds/room.toml")),
                text(
                    "[[wall]]\nfrom = [0, 0]\nto = [4, 0]\nopening = [{ at_m = 1.0 }]\n[robot]\nroute = [[1, 1], [2, 1]]\nspeed_mps = 0.5\n",
                ),
                text("[[curved_wall]]\ncentre = [0, 0]\nradius_m = 3\n[[person]]\nway = [[0, 0], [1, 1]]\n"),
            ]
        }
        "bags" => ["ros2.mcap", "ros2.db3", "ros1-lz4.bag"]
            .map(|name| std::fs::read(golden(&format!("bags/{name}"))).expect("a golden file"))
            .to_vec(),
        "images" => vec![b"P5\n# ours\n3 2\n255\n\x00\xfe\xcd\xfe\xfe\xfe".to_vec()],
        _ => vec![text("1 2 3 0 0 0 0 1\n2 2 3 0 0 0 0 1\n"), text("1 2 3 4\n")],
    }
}

/// One with checks, and one of old, without.
fn recordings() -> [Vec<u8>; 2] {
    let old = std::fs::read(golden("LRFREC01.lrfrec")).expect("a golden file");
    let records = RECORDING_OPENING + usize::from(old[RECORDING_OPENING - 4]);
    [checked(&old, &old[records..]), old]
}

/// A recording that goes on with `records`, with checks.
fn checked(recording: &[u8], records: &[u8]) -> Vec<u8> {
    let check = |kind: u8, payload: u8| {
        [&[kind, 0, 0, 0, 0, 0, 0, 0, 0, payload, 0, 0, 0][..], &[0; 4][..usize::from(payload)]].concat()
    };
    with_checks(&[recording, &check(b'#', 4), records, &check(b'#', 4), &check(b'e', 0)].concat())
}

/// The map of a square room, driven round twice by a laser of few beams.
fn map_file() -> Vec<u8> {
    let mut high = HighSlam::new(&HighConfigs::default(), None);
    for (i, map_from_robot) in (0..).zip(round().chain(round())) {
        let beam = |k: i32| {
            let bearing_rad = 0.26 * k as f32;
            Beam { bearing_rad, offset: Duration::ZERO, echo: Echo::Hit(range_m(map_from_robot, bearing_rad)) }
        };
        let beams: Vec<Beam> = (-12..12).map(beam).collect();
        let scan = RangeScan { stamp: Instant::from_micros(200_000 * i), range_max_m: 8.0, beams: &beams };
        let low = LowPose { map_from_robot, undetermined: None, is_lost: false, is_blind: false, is_frozen: false };
        high.add_scan(&Sweep::at_rest(scan, Pose2::IDENTITY), &low).expect("few beams");
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    map_of(String::new(), &high).write(folder.path()).expect("room for it");
    std::fs::read(folder.path().join(FILE_NAME)).expect("it was written")
}

/// Along a square of 4 m.
fn round() -> impl Iterator<Item = Pose2> {
    (0..4).flat_map(|side| {
        let corner = Pose2::new(-2.0, -2.0, 0.0);
        let turned = Pose2::new(0.0, 0.0, std::f32::consts::FRAC_PI_2 * side as f32);
        (0..8).map(move |step| turned * corner * Pose2::new(0.5 * step as f32, 0.0, 0.0))
    })
}

/// To the walls of a room of 6 m.
fn range_m(from: Pose2, bearing_rad: f32) -> f32 {
    let direction = from.heading + bearing_rad;
    let to_wall = |at: f32, along: f32| (3.0 * along.signum() - at) / along;
    to_wall(from.x, direction.cos()).min(to_wall(from.y, direction.sin()))
}

/// What the header of a saved map tells of, unpacked.
fn content_of_map(file: &[u8]) -> Vec<u8> {
    let mut content = Vec::new();
    GzDecoder::new(&file[MAP_HEADER..]).read_to_end(&mut content).expect("it was packed");
    content
}
