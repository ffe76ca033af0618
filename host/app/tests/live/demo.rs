//! `lrfslam demo`: both sides live over a pseudo-terminal, in a small room so that it takes a few seconds.

use crate::common::run;

pub const WORLD: &str = "
[[room]]
from = [0, 0]
to = [6, 4]

[[block]]
centre = [4.5, 3.2]
size_m = [0.8, 0.6]
z_m = [0, 1.2]

[robot]
route = [[1.5, 1.5], [3.0, 1.5]]
speed_mps = 0.5
turn_degps = 45
laser_m = [0, 0, 0.4]
stop = [{ corner = 1, sweep = { from_deg = -40, to_deg = 60, rate_degps = 60 } }]
";

#[test]
fn demo_maps_a_room_live_and_judges_itself() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("room.toml"), WORLD).unwrap();
    let (code, table, stderr) = run(folder.path(), &["demo", "--world", "room.toml", "--out", "out"]);
    assert_eq!(code, 0, "{stderr}");
    for name in
        ["map.png", "path.png", "trajectory.tum", "truth.tum", "cloud.ply", "cloud.pcd", "cloud.png", "errors.md"]
    {
        assert!(folder.path().join("out").join(name).metadata().is_ok_and(|about| about.len() > 100), "{name}");
    }
    let number = |row: &str, column: usize| -> f64 {
        let line = table.lines().find(|line| line.contains(row)).unwrap_or_else(|| panic!("{table}"));
        line.split('|').nth(column).unwrap().trim().parse().unwrap()
    };
    // Wider than what is reached: the machine may be busy, and stamps with it.
    assert!(number("path, position, best aligned", 3) < 3.0 && number("path, heading", 3) < 0.5, "{table}");
    assert!(number("cloud to true surface", 3) < 3.0, "{table}");
    let within: f64 =
        table.lines().find(|line| line.contains("% of")).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(within > 95.0, "{table}");
    assert!(table.contains("no loop closed") && table.contains("\nVerdict: "), "{table}");
    // All is in the map's frame: the truth as it was written is as far from the path as the table says.
    let same_frame = ["eval", "out/trajectory.tum", "--truth", "out/truth.tum", "--same-frame", "--json"];
    let report: serde_json::Value = serde_json::from_str(&run(folder.path(), &same_frame).1).unwrap();
    let rmse_cm = report["absolute_m"]["rmse"].as_f64().unwrap() * 100.0;
    assert!((rmse_cm - number("path, position, best aligned", 3)).abs() < 0.02, "{rmse_cm} {table}");
}

#[test]
fn demo_refuses_what_it_cannot_show() {
    let folder = tempfile::tempdir().unwrap();
    let (code, _, stderr) = run(folder.path(), &["demo", "--world", "castle"]);
    assert!(code == 2 && stderr.starts_with("lrfslam: castle: cannot be read"), "{stderr}");
    let (code, _, stderr) = run(folder.path(), &["demo", "--world", "room"]);
    assert!(code == 2 && stderr.contains("has no route: say by --seconds"), "{stderr}");
}
