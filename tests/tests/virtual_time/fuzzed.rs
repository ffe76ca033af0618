//! Every entry with samples of what is right, spoiled: nothing panics, nothing hangs, nothing asks for all memory.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use lrfslam_robot::RobotConfig;
use lrfslam_robot::wire::frame::{MAX_FRAME, encode};
use lrfslam_robot::wire::message::ToRobot;
use lrfslam_robot::wire::session::{LAYOUT, Packet, VERSION};
use lrfslam_tests::entries::{ENTRIES, piece};

/// A small generator of its own: samples must be the same everywhere.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % sides.max(1)
    }
}

const WORDS: [&[u8]; 12] = [
    b"nan",
    b"-inf",
    b"1e308",
    b"-1",
    b"18446744073709551616",
    b"\0\0\0\0",
    b"\xff\xff\xff\xff",
    b"[[",
    b"\n",
    b" ",
    b"=",
    b"\x7f",
];

/// Spoiled samples of each entry: a second of the slowest.
const SAMPLES: usize = 5000;

/// One to four changes: bits, bytes, cuts, repeats, odd words.
fn spoil(sample: &[u8], dice: &mut Dice) -> Vec<u8> {
    let mut bytes = sample.to_vec();
    for _ in 0..=dice.roll(4) {
        let at = dice.roll(bytes.len());
        match dice.roll(6) {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << dice.roll(8),
            1 if !bytes.is_empty() => bytes[at] = dice.roll(256) as u8,
            2 => bytes.truncate(at),
            3 => {
                let end = (at + dice.roll(64)).min(bytes.len());
                let again = bytes[at.min(end)..end].to_vec();
                bytes.splice(at..at, again);
            }
            4 => {
                let end = (at + dice.roll(16)).min(bytes.len());
                bytes.drain(at.min(end)..end);
            }
            _ => {
                let word = WORDS[dice.roll(WORDS.len())];
                let end = (at + word.len()).min(bytes.len());
                bytes.splice(at.min(end)..end, word.iter().copied());
            }
        }
    }
    bytes
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

fn samples(entry: &str) -> Vec<Vec<u8>> {
    let text = |text: &str| text.as_bytes().to_vec();
    match entry {
        "logs" => vec![
            text(&"FLASER 3 1.0 2.0 3.0 0 0 0 0 0 0 1.0 host 1.0\n".repeat(3)),
            text("ROBOTLASER1 0 -1.57 3.14 0.0174 81.9 0.01 0 2 1.5 2.5 0 0 0 0 0 0 0 0 0 0 0 0 1.0 host 1.0\n"),
            text("Odometry 0 0 0\nLaser 3 1.0 2.0 3.0\n"),
        ],
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
        "recordings" => vec![std::fs::read(golden("LRFREC01.lrfrec")).expect("a golden file")],
        "maps" => vec![text("LRFMAP04"), vec![0; 64]],
        "journals" => {
            let mut journal = format!("LRFROB{VERSION:02}").into_bytes();
            journal.extend(golden_messages("journal").concat());
            vec![journal]
        }
        "worlds" => {
            vec![
                text(include_str!("../../../firmware-sim/worlds/room.toml")),
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

/// The same samples each time, however fast the machine; `LRFSLAM_FUZZ_S=SECONDS` goes on for so long with each entry.
#[test]
fn spoiled_samples_of_everything_that_comes_in_are_survived() {
    let seconds = std::env::var("LRFSLAM_FUZZ_S").ok().and_then(|text| text.parse().ok()).unwrap_or(0.0);
    for (name, entry) in ENTRIES {
        let samples = samples(name);
        samples.iter().for_each(|sample| entry(sample));
        let (mut dice, started, mut count) = (Dice(1), Instant::now(), 0);
        let mut longest = (Duration::ZERO, Vec::new());
        while count < SAMPLES || started.elapsed() < Duration::from_secs_f64(seconds) {
            let sample = &samples[dice.roll(samples.len())];
            let spoiled = spoil(sample, &mut dice);
            let begun = Instant::now();
            entry(&spoiled);
            longest = longest.max((begun.elapsed(), spoiled));
            count += 1;
        }
        println!("{name}: {count} spoiled samples, the longest took {:.1} ms", longest.0.as_secs_f64() * 1e3);
        assert!(longest.0 < Duration::from_secs(10), "{name}: {:?} took {:?}", longest.1, longest.0);
    }
}
