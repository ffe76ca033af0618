use super::*;
use crate::scans::family::LrfOptions;
use crate::scans::recording::RecordingEnd;

fn header() -> RecordingHeader {
    let lrf = LrfOptions::new(LrfFamily::Hokuyo);
    RecordingHeader { program: "test".into(), port: "none".into(), lrf }
}

#[test]
fn an_older_file_stays_until_a_scan_has_come_and_longer_unless_it_may_go() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("laser.rec");
    fs::write(&path, "precious").unwrap();
    let refused = Recorder::new(&RecordPlan::new(&path), header()).unwrap_err().to_string();
    assert!(refused.contains("is there already (--overwrite replaces it)"), "{refused}");
    let plan = RecordPlan { overwrite: true, ..RecordPlan::new(&path) };
    let mut recorder = Recorder::new(&plan, header()).unwrap();
    recorder.input(Instant::default(), Input::Connected).unwrap();
    recorder.finish().unwrap();
    assert_eq!((fs::read(&path).unwrap(), recorder.report()), (b"precious".to_vec(), None));
    let begun = || {
        let mut recorder = Recorder::new(&plan, header()).unwrap();
        recorder.begin(LrfFamily::Ld06).unwrap();
        recorder.input(Instant::default(), Input::Timeout).unwrap();
        recorder
    };
    drop(begun());
    assert_eq!(fs::read(&path).unwrap(), b"precious", "a program that was killed");
    let mut recorder = begun();
    recorder.finish().unwrap();
    assert_eq!(recorder.report().unwrap().fault.unwrap(), "no scan came: the older file stays");
    assert_eq!((fs::read(&path).unwrap(), fs::read_dir(folder.path()).unwrap().count()), (b"precious".to_vec(), 1));
    let mut recorder = begun();
    recorder.scan_came().unwrap();
    recorder.finish().unwrap();
    assert_eq!((recorder.report().unwrap().fault, fs::read_dir(folder.path()).unwrap().count()), (None, 1));
    assert_eq!(RecordingReader::open(&path).unwrap().header().lrf.family, LrfFamily::Ld06);
}

#[test]
fn a_file_that_came_meanwhile_is_not_overwritten_either() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("laser.rec");
    let mut recorder = Recorder::new(&RecordPlan::new(&path), header()).unwrap();
    fs::write(&path, "precious").unwrap();
    assert!(recorder.begin(LrfFamily::Hokuyo).is_err());
    recorder.input(Instant::default(), Input::Timeout).expect("said once");
    assert_eq!(fs::read(&path).unwrap(), b"precious");
    assert!(recorder.report().unwrap().fault.unwrap().contains("exists"));
}

#[test]
fn a_place_where_nothing_can_be_written_is_refused_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    std::os::unix::fs::symlink("nowhere", folder.path().join("link")).unwrap();
    let others = [folder.path().join("link"), PathBuf::from("/dev/null")];
    for path in [folder.path().join("file/laser.rec"), folder.path().to_owned()].into_iter().chain(others) {
        let plan = RecordPlan { overwrite: true, ..RecordPlan::new(path) };
        let error = Recorder::new(&plan, header()).unwrap_err().to_string();
        assert!(error.contains("cannot be written"), "{error}");
    }
}

#[test]
fn a_full_one_ends_below_its_size_and_is_whole_wherever_it_was_moved() {
    let folder = tempfile::tempdir().unwrap();
    let (path, moved) = (folder.path().join("a/laser.rec"), folder.path().join("b"));
    let plan = RecordPlan { max_bytes: 300_000, ..RecordPlan::new(&path) };
    let mut recorder = Recorder::new(&plan, header()).unwrap();
    recorder.begin(LrfFamily::Hokuyo).unwrap();
    fs::rename(folder.path().join("a"), &moved).unwrap();
    let record = |index: i64| recorder.input(Instant::from_micros(index * 1000), Input::Bytes(&[7; 100]));
    let faults: Vec<String> = (0..4000).map(record).filter_map(|done| Some(done.err()?.to_string())).collect();
    assert_eq!(faults, ["full at 0 MB (--record-max)"]);
    recorder.finish().unwrap();
    let report = recorder.report().unwrap();
    let file = moved.join("laser.rec");
    assert_eq!((report.bytes, report.fault), (fs::metadata(&file).unwrap().len(), Some(faults[0].clone())));
    assert!((299_000..=300_000).contains(&report.bytes), "{}", report.bytes);
    let mut reader = RecordingReader::open(&file).unwrap();
    let count = reader.by_ref().count();
    assert_eq!(reader.end(), Some(RecordingEnd::WHOLE));
    assert!((2600..2660).contains(&count), "{count}");
}
