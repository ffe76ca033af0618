use super::*;
use crate::scans::family::LrfFamily;
use lrfslam_core::time::Instant;
use std::path::Path;

fn header() -> RecordingHeader {
    RecordingHeader { program: "test".into(), port: "none".into(), lrf: LrfOptions::new(LrfFamily::Hokuyo) }
}

/// Two blocks: what waited for a laser to be found, and what came then.
fn recording() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.lrfrec");
    let mut recorder = Recorder::new(&RecordPlan::new(&path), header()).unwrap();
    let at = Instant::from_micros;
    recorder.input(at(1), Input::Connected).unwrap();
    recorder.sent(at(2), b"QT\n").unwrap();
    recorder.baud(at(2), 19_200).unwrap();
    assert!(!path.exists(), "no laser was found yet");
    recorder.begin(LrfFamily::Hokuyo).unwrap();
    recorder.input(at(3), Input::Bytes(b"QT\n00P\n\n")).unwrap();
    recorder.input(at(4), Input::Timeout).unwrap();
    recorder.finish().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(
        recorder.report(),
        Some(RecordingReport { path, bytes: bytes.len() as u64, fault: None, holes: Vec::new() })
    );
    bytes
}

const CUT: RecordingEnd = RecordingEnd { is_closed: false, ..RecordingEnd::WHOLE };

/// How many records there are, and how it ends.
fn read(bytes: &[u8]) -> Option<(usize, RecordingEnd)> {
    let mut reader = RecordingReader::new(bytes).ok()?;
    let count = reader.by_ref().count();
    Some((count, reader.end().expect("read to its end")))
}

#[test]
fn what_is_written_is_read_back() {
    let bytes = recording();
    let reader = RecordingReader::new(&bytes[..]).unwrap();
    assert_eq!(*reader.header(), header());
    let entries: Vec<(i64, Entry)> = reader.map(|(at, entry)| (at.micros, entry)).collect();
    let expected = [
        (1, Entry::Connected),
        (2, Entry::Sent(b"QT\n".to_vec())),
        (2, Entry::Baud(19_200)),
        (3, Entry::Received(b"QT\n00P\n\n".to_vec())),
        (4, Entry::Timeout),
    ];
    assert_eq!(entries, expected);
}

#[test]
fn cut_anywhere_it_reads_up_to_the_cut_and_says_so() {
    let bytes = recording();
    let mut last = 0;
    for cut in 0..bytes.len() {
        let Some((count, end)) = read(&bytes[..cut]) else { continue };
        assert!(count == last || count == last + 1);
        last = count;
        // Before its first check it looks like an old one, which has none.
        assert!(end == CUT || count < 4 && end == RecordingEnd::WHOLE, "{cut}: {end}");
    }
    assert_eq!((last, read(&bytes)), (5, Some((5, RecordingEnd::WHOLE))));
}

/// Seconds of a laser, a block each; where the blocks end.
fn seconds_of_a_laser(path: &Path) -> (Vec<u8>, Vec<usize>) {
    let mut recorder = Recorder::new(&RecordPlan::new(path), header()).unwrap();
    recorder.begin(LrfFamily::Hokuyo).unwrap();
    let mut ends = Vec::new();
    for second in 0..6 {
        for part in 0..9_i64 {
            let at = Instant::from_micros(second * 1_200_000 + part * 130_000);
            recorder.input(at, Input::Bytes(&[part as u8; 30])).unwrap();
        }
        ends.push(std::fs::metadata(path).unwrap().len() as usize);
    }
    recorder.finish().unwrap();
    (std::fs::read(path).unwrap(), ends)
}

fn entries(bytes: &[u8]) -> (Vec<(Instant, Entry)>, RecordingEnd) {
    let mut reader = RecordingReader::new(bytes).unwrap();
    let entries = reader.by_ref().collect();
    (entries, reader.end().unwrap())
}

fn records_begin(bytes: &[u8]) -> usize {
    12 + u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize
}

#[test]
fn a_flipped_bit_anywhere_is_mended_and_said() {
    let folder = tempfile::tempdir().unwrap();
    let (bytes, _) = seconds_of_a_laser(&folder.path().join("a.rec"));
    let (whole, end) = entries(&bytes);
    assert_eq!((whole.len(), end), (54, RecordingEnd::WHOLE));
    // The last record, the end, has no check behind it.
    for at in records_begin(&bytes)..bytes.len() - HEAD {
        for bit in [0, 2, 6] {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << bit;
            let (found, end) = entries(&damaged);
            assert!(found == whole, "byte {at}, bit {bit}: {} of {}, {end}", found.len(), whole.len());
            assert!(end.is_whole(), "byte {at}, bit {bit}: {end}");
        }
    }
}

#[test]
fn what_is_behind_damage_is_read_and_what_is_left_out_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (bytes, ends) = seconds_of_a_laser(&folder.path().join("a.rec"));
    let (whole, _) = entries(&bytes);
    for at in (records_begin(&bytes)..ends[4]).step_by(3) {
        let mut damaged = bytes.clone();
        damaged[at..at + 20].fill(0xA5);
        let (found, end) = entries(&damaged);
        assert!(
            found.len() >= 54 - 20 && found.iter().all(|entry| whole.contains(entry)),
            "byte {at}: {}",
            found.len()
        );
        assert!(end.is_closed && end.damaged_places == 1 && end.damaged_bytes > 300, "byte {at}: {end}");
        assert!(end.damaged_at <= at as u64 && !end.is_whole(), "byte {at}: {end}");
        let words = format!("the recording is damaged in 1 place, the first at byte {}: ", end.damaged_at);
        assert!(end.to_string().starts_with(&words), "{end}");
    }
    // A part of the file is gone.
    let gone = [&bytes[..ends[1] - 100], &bytes[ends[3] + 50..]].concat();
    let (found, end) = entries(&gone);
    assert!((15..40).contains(&found.len()) && end.is_closed && end.damaged_places == 1, "{} {end}", found.len());
}

#[test]
fn a_run_goes_on_in_the_recording_of_one_that_was_killed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rec");
    let (bytes, ends) = seconds_of_a_laser(&path);
    for cut in [ends[2], ends[2] + 1, ends[2] + 13, ends[2] + 60, ends[2] + 200, ends[3] - 1, bytes.len()] {
        std::fs::write(&path, &bytes[..cut]).unwrap();
        let mut known = RecordingReader::open(&path).unwrap();
        known.skip_unchecked();
        let before: Vec<_> = known.by_ref().collect();
        let mut recorder = Recorder::new(&RecordPlan { goes_on: true, ..RecordPlan::new(&path) }, header()).unwrap();
        let at = Instant::from_micros(90_000_000);
        recorder.input(at, Input::Connected).unwrap();
        recorder.begin(LrfFamily::Hokuyo).unwrap();
        recorder.scan_came().unwrap();
        recorder.finish().unwrap();
        let report = recorder.report().unwrap();
        assert_eq!((report.bytes, report.fault), (std::fs::metadata(&path).unwrap().len(), None));
        let (found, end) = entries(&std::fs::read(&path).unwrap());
        let wanted = [&before[..], &[(at, Entry::GoesOn), (at, Entry::Connected)]].concat();
        assert_eq!(
            (found == wanted, end),
            (true, RecordingEnd::WHOLE),
            "cut at {cut}: {} {}",
            found.len(),
            wanted.len()
        );
        assert!(std::fs::read(&path).unwrap().starts_with(&bytes[..cut]), "nothing of it is gone");
    }
    let mut other = header();
    other.lrf.cluster = 3;
    let mut recorder = Recorder::new(&RecordPlan { goes_on: true, ..RecordPlan::new(&path) }, other).unwrap();
    assert!(recorder.begin(LrfFamily::Hokuyo).unwrap_err().to_string().contains("of another laser"));
}

#[test]
fn recordings_without_checks_are_read_as_ever() {
    let bytes = recording();
    let begin = records_begin(&bytes);
    let old = [&bytes[..begin], b"c\x01\0\0\0\0\0\0\0\0\0\0\0", b"t\x02\0\0\0\0\0\0\0\0\0\0\0"].concat();
    assert_eq!(read(&old), Some((2, RecordingEnd::WHOLE)));
    assert_eq!(read(&old[..old.len() - 1]), Some((1, CUT)));
    let too_long = [&old[..], b"<\x03\0\0\0\0\0\0\0\xFF\xFF\xFF\x7F"].concat();
    assert_eq!(
        read(&too_long),
        Some((2, RecordingEnd { damaged_places: 1, damaged_bytes: 13, damaged_at: old.len() as u64, ..CUT }))
    );
}

#[test]
fn other_files_are_refused_in_words() {
    for (bytes, words) in [
        (&b"CARMEN log"[..], "does not begin with LRFREC"),
        (b"LRFREC99....", "version 99"),
        (b"LRFREC01\x10\0\0\0abc", "cut"),
    ] {
        let error = format!("{:#}", RecordingReader::new(bytes).unwrap_err());
        assert!(error.contains(words), "{error}");
    }
}
