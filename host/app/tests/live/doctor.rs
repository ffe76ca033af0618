//! `lrfslam doctor` with a laser now.

use crate::common::run;
use crate::laser::Laser;

#[test]
fn a_laser_is_examined_for_some_seconds_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let laser = Laser::far_sighted(folder.path());
    let arguments = ["doctor", "--lrf", "hokuyo", "--port", &laser.port(), "--seconds", "3"];
    let (code, stdout, stderr) = run(folder.path(), &arguments);
    assert!(code == 0 || code == 3, "{stdout}{stderr}");
    assert!(stdout.contains("1081 beams a scan over 270°"), "{stdout}");
    assert!(stdout.contains("no-odometry") && !stdout.contains("WRONG"), "{stdout}");
    drop(laser);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is written");
}
