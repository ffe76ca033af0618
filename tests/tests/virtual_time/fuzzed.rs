//! Every entry with samples of what is right, spoiled: nothing panics, nothing hangs, nothing asks for all memory.

use std::time::{Duration, Instant};

use lrfslam_host::mapping::high::HighConfigs;
use lrfslam_host::mapping::saved_map::{FILE_NAME, SavedMap, SavedMapError};
use lrfslam_host::scans::recording::RecordingReader;
use lrfslam_tests::entries::{ENTRIES, map_file_of, with_checks};
use lrfslam_tests::laser_scripts::play;
use lrfslam_tests::samples::samples;

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

/// Spoiled conversations would never reach what reads scans if the right ones did not.
#[test]
fn samples_of_lasers_come_to_scans() {
    samples("drivers").iter().for_each(|script| assert!(play(script) >= 3, "laser {}", script[0]));
}

/// Spoiled recordings would all be mended or left out if their checks were not made right.
#[test]
fn checks_of_spoiled_recordings_are_right() {
    let [recording, _] = samples("recordings").try_into().expect("one with checks, and one of old");
    assert_eq!(with_checks(&recording), recording);
    let mut spoiled = recording.clone();
    let sent = recording.windows(3).position(|bytes| bytes == [0x51, 0x54, 0x0A]).expect("what was sent");
    spoiled[sent..sent + 2].iter_mut().for_each(|byte| *byte ^= 1);
    let told = |bytes: &[u8]| {
        let mut reader = RecordingReader::new(bytes).unwrap_or_else(|error| panic!("{error}"));
        let entries: Vec<_> = reader.by_ref().map(|entry| format!("{entry:?}")).collect();
        (entries, format!("{:?}", reader.end()))
    };
    assert_ne!(told(&spoiled).1, told(&recording).1);
    assert_eq!(told(&with_checks(&spoiled)).1, told(&recording).1);
    assert_ne!(told(&with_checks(&spoiled)).0, told(&recording).0);
}

/// Spoiled maps would all be refused at once if the file that is made of them were not of this version.
#[test]
fn samples_of_maps_are_maps() {
    let [file, content] = samples("maps").try_into().expect("a file, and what its header tells of");
    for file in [file, map_file_of(&content)] {
        let map = as_map(&file).unwrap_or_else(|error| panic!("{error}"));
        assert!(map.high_slam(&HighConfigs::default()).is_ok() && !map.scans.is_empty());
    }
}

fn as_map(file: &[u8]) -> Result<SavedMap, SavedMapError> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join(FILE_NAME), file).expect("room for it");
    SavedMap::read(folder.path())
}
