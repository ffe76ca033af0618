//! Sets of results that change all at once, and what kills and full disks leave.

use super::*;
use crate::output::write_file;
use std::io::Write as _;

fn save(folder: &mut ResultFolder, files: &[(&str, &str)]) -> anyhow::Result<()> {
    folder.save(|stage| Ok(files.iter().try_for_each(|(name, text)| write_file(&stage.join(name), text.as_bytes()))?))
}

fn read(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap_or_default()
}

#[test]
fn a_set_is_replaced_whole_and_only_if_that_was_said() {
    let parent = tempfile::tempdir().unwrap();
    let place = parent.path().join("a/map");
    let mut first = ResultFolder::claim(&place, false).unwrap();
    save(&mut first, &[("map.pgm", "one"), ("steps.csv", "one")]).unwrap();
    drop(first);
    let refused = ResultFolder::claim(&place, false).unwrap_err().to_string();
    assert!(refused.contains("holds map.pgm already") && refused.contains("--overwrite"), "{refused}");
    let mut second = ResultFolder::claim(&place, true).unwrap();
    assert!(second.save(|stage| Ok(write_file(&stage.join("no/such"), b"")?)).is_err());
    assert_eq!(read(&place, "steps.csv"), "one", "what could not be written has replaced nothing");
    save(&mut second, &[("map.pgm", "two")]).unwrap();
    drop(second);
    assert_eq!(names_in(&place).unwrap(), ["map.pgm"]);
    assert_eq!(read(&place, "map.pgm"), "two");
    assert_eq!(names_in(&parent.path().join("a")).unwrap(), ["map"], "nothing is left beside it");
}

#[test]
fn a_run_without_results_leaves_what_was_there() {
    let parent = tempfile::tempdir().unwrap();
    let place = parent.path().join("map");
    drop(ResultFolder::claim(&place, false).unwrap());
    assert!(!place.exists(), "a folder made for nothing is not left");
    fs::create_dir(&place).unwrap();
    drop(ResultFolder::claim(&place, false).unwrap());
    assert!(place.exists(), "one that the user has made is");
    fs::write(place.join("map.pgm"), "old").unwrap();
    drop(ResultFolder::claim(&place, true).unwrap());
    assert_eq!(
        (names_in(&place).unwrap(), names_in(parent.path()).unwrap()),
        (vec!["map.pgm".into()], vec!["map".into()])
    );
}

#[test]
fn nothing_foreign_is_replaced() {
    let parent = tempfile::tempdir().unwrap();
    let place = parent.path().join("map");
    fs::create_dir(&place).unwrap();
    fs::write(place.join("thesis.tex"), "years").unwrap();
    let refused = ResultFolder::claim(&place, true).unwrap_err().to_string();
    assert!(refused.contains("holds thesis.tex, which is no result"), "{refused}");
    fs::remove_file(place.join("thesis.tex")).unwrap();
    let mut folder = ResultFolder::claim(&place, false).unwrap();
    save(&mut folder, &[("map.pgm", "one")]).unwrap();
    fs::write(place.join("notes.txt"), "put there while it runs").unwrap();
    save(&mut folder, &[("map.pgm", "two")]).unwrap();
    assert_eq!(
        (read(&place, "notes.txt").as_str(), read(&place, "map.pgm").as_str()),
        ("put there while it runs", "two")
    );
}

#[test]
fn growing_files_go_from_set_to_set() {
    let parent = tempfile::tempdir().unwrap();
    let place = parent.path().join("map");
    fs::create_dir(&place).unwrap();
    fs::write(place.join("laser.rec"), "old").unwrap();
    let mut folder = ResultFolder::claim(&place, true).unwrap();
    let path = folder.growing("laser.rec");
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut recording = File::create(path).unwrap();
    recording.write_all(b"new").unwrap();
    assert_eq!(read(&place, "laser.rec"), "old", "until something is saved");
    for round in ["one", "two"] {
        save(&mut folder, &[("map.pgm", round)]).unwrap();
        recording.write_all(b"er").unwrap();
    }
    assert_eq!((read(&place, "laser.rec").as_str(), read(&place, "map.pgm").as_str()), ("newerer", "two"));
    assert_eq!(names_in(parent.path()).unwrap(), ["map"]);
}

#[test]
fn a_killed_run_s_leavings_are_cleared_and_its_recording_is_not() {
    let parent = tempfile::tempdir().unwrap();
    let place = parent.path().join("map");
    for (folder, file) in [
        ("map", "map.pgm"),
        ("map.lrfslam-new", "map.pgm"),
        ("map.lrfslam-new", "notes.txt"),
        ("map.part", "laser.rec"),
    ] {
        fs::create_dir_all(parent.path().join(folder)).unwrap();
        fs::write(parent.path().join(folder).join(file), folder).unwrap();
    }
    fs::remove_file(place.join("map.pgm")).unwrap();
    let mut folder = ResultFolder::claim(&place, false).unwrap_err().to_string();
    assert!(folder.contains("notes.txt"), "{folder}");
    folder.clear();
    assert_eq!(names_in(parent.path()).unwrap(), ["map", "map.part"]);
    assert_eq!(read(&parent.path().join("map.part"), "laser.rec"), "map.part");
}

#[test]
fn two_runs_do_not_share_a_folder() {
    let parent = tempfile::tempdir().unwrap();
    let place = parent.path().join("map");
    let mut first = ResultFolder::claim(&place, false).unwrap();
    let refused = || ResultFolder::claim(&place, true).unwrap_err().to_string();
    assert!(refused().contains("another lrfslam is writing there"), "{}", refused());
    save(&mut first, &[("map.pgm", "one")]).unwrap();
    assert!(refused().contains("another lrfslam is writing there"), "{}", refused());
    drop(first);
    assert!(ResultFolder::claim(&place, true).is_ok());
}

#[test]
fn new_folders_are_named_by_the_time() {
    let name = folder_names("hall-map").next().unwrap().display().to_string();
    assert!(
        name.starts_with("hall-map-2") && name.ends_with('Z') && name.len() == "hall-map-20261122T023105Z".len(),
        "{name}"
    );
}

/// DIR with an old set, and one more file beside it.
fn left(beside: &str, name: &str) -> (tempfile::TempDir, PathBuf) {
    let parent = tempfile::tempdir().unwrap();
    let place = parent.path().join("map");
    for (folder, name, text) in [("map", "map.pgm", "old"), (beside, name, "left")] {
        fs::create_dir_all(parent.path().join(folder)).unwrap();
        fs::write(parent.path().join(folder).join(name), text).unwrap();
    }
    (parent, place)
}

#[test]
fn nobody_else_s_folder_is_cleared_away() {
    let (parent, place) = left("map.new", "map.pgm");
    save(&mut ResultFolder::claim(&place, true).unwrap(), &[("map.pgm", "new")]).unwrap();
    assert_eq!(read(&parent.path().join("map.new"), "map.pgm"), "left");
}

#[test]
fn a_recording_without_another_name_survives_clearing_up() {
    let (parent, place) = left("map.lrfslam-new", "laser.rec");
    let folder = ResultFolder::claim(&place, true).unwrap();
    assert_eq!(read(&parent.path().join("map.part"), "laser.rec"), "left");
    assert!(folder.left_behind()[0].ends_with("map.part/laser.rec"), "{:?}", folder.left_behind());
    drop(folder);
    assert_eq!(names_in(parent.path()).unwrap(), ["map", "map.part"]);
}

#[test]
fn a_set_that_lost_its_name_for_a_moment_gets_it_back() {
    let (parent, place) = left("map.lrfslam-old", "map.pgm");
    fs::remove_dir_all(&place).unwrap();
    drop(ResultFolder::claim(&place, true).unwrap());
    assert_eq!(read(&place, "map.pgm"), "left");
    assert_eq!(names_in(parent.path()).unwrap(), ["map"]);
}

#[test]
fn a_journal_of_a_killed_run_is_gone_on_with_where_it_is() {
    let (parent, place) = left("map.part", "robot.journal");
    let mut folder = ResultFolder::go_on(&place, "robot.journal").unwrap();
    assert!(folder.growing("robot.journal").ends_with("map.part/robot.journal"));
    save(&mut folder, &[("map.pgm", "new")]).unwrap();
    assert_eq!((read(&place, "map.pgm").as_str(), read(&place, "robot.journal").as_str()), ("new", "left"));
    assert_eq!(names_in(parent.path()).unwrap(), ["map"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_cannot_be_replaced_is_refused_before_the_work() {
    let refused = ResultFolder::claim(Path::new("/proc"), true).unwrap_err().to_string();
    assert!(refused.contains("a disk is mounted there"), "{refused}");
}

#[test]
fn trouble_with_saving_is_told_once_and_its_end_too() {
    let parent = tempfile::tempdir().unwrap();
    let mut folder = ResultFolder::claim(&parent.path().join("map"), false).unwrap();
    let mut told = Vec::new();
    for is_full in [false, true, true, true, false, false, true] {
        let saved = folder.save(|_| if is_full { bail!("no space") } else { Ok(()) });
        told.push(folder.news(&saved).map(|text| text.split_once(';').is_some()));
    }
    assert_eq!(told, [None, Some(true), None, None, Some(false), None, Some(true)]);
}
