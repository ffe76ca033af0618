//! `lrfslam cloud`: a simulated room along a log, real stops of a tilted SICK, and wrong input.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::common::{real_data, run};

/// The room's walls, floor and ceiling, m.
const ROOM: [[f64; 2]; 3] = [[-3.0, 3.5], [-2.0, 2.0], [0.0, 2.5]];
/// The tilt axis over the floor and the mirror ahead of it and above it, m.
const MOUNTING: [f64; 3] = [0.4, 0.05, 0.1];

/// Distance along a ray to the room's inside.
fn range(from: [f64; 3], direction: [f64; 3]) -> f64 {
    let along = |axis: usize| {
        let wall = ROOM[axis][usize::from(direction[axis] > 0.0)];
        if direction[axis].abs() < 1e-12 { f64::INFINITY } else { (wall - from[axis]) / direction[axis] }
    };
    [0, 1, 2].map(along).into_iter().fold(f64::INFINITY, f64::min)
}

/// Distance of a point from the room's nearest surface.
fn off(point: [f64; 3]) -> f64 {
    let distances = (0..3).flat_map(|axis| ROOM[axis].map(|wall| (point[axis] - wall).abs()));
    distances.fold(f64::INFINITY, f64::min)
}

/// A robot that drives an arc while its laser nods: log, path and encoder readings (at their own times).
pub fn write_drive(folder: &Path) {
    let tilt_at = |t: f64| 0.4 * t - 0.8;
    let (mut log, mut path, mut tilt) = (String::new(), String::new(), String::new());
    for i in 0..30 {
        let t = 0.2 * f64::from(i);
        let (x, y, heading) = (0.2 * t, 0.1 * t, 0.15 * t);
        let (sin_h, cos_h) = f64::sin_cos(heading);
        let (sin_t, cos_t) = f64::sin_cos(tilt_at(t));
        let [height, ahead, above] = MOUNTING;
        let world = |v: [f64; 3]| [cos_h * v[0] - sin_h * v[1], sin_h * v[0] + cos_h * v[1], v[2]];
        let raise = |v: [f64; 3]| [cos_t * v[0] - sin_t * v[2], v[1], sin_t * v[0] + cos_t * v[2]];
        let mirror = world(raise([ahead, 0.0, above]));
        let from = [mirror[0] + x, mirror[1] + y, mirror[2] + height];
        let mut ranges = String::new();
        for beam in 0..181 {
            let (sin, cos) = (f64::from(beam) - 90.0).to_radians().sin_cos();
            let _ = write!(ranges, " {:.5}", range(from, world(raise([cos, sin, 0.0]))));
        }
        let _ = writeln!(log, "FLASER 181{ranges} 0 0 0 0 0 0 {t:.3} nodding {t:.3}");
        let _ = writeln!(path, "{t:.3} {x:.6} {y:.6} {heading:.6}");
    }
    for i in 0..70 {
        let t = 0.093 * f64::from(i) - 0.05;
        let _ = writeln!(tilt, "{t:.4} {:.7}", tilt_at(t));
    }
    for (name, text) in [("room.log", log), ("path.txt", path), ("tilt.txt", tilt)] {
        fs::write(folder.join(name), text).unwrap();
    }
}

/// The points of a binary PLY of ours: 15 bytes each behind the header.
pub fn ply_points(path: &Path) -> Vec<[f64; 3]> {
    let bytes = fs::read(path).unwrap();
    let end = b"end_header\n";
    let data = bytes.windows(end.len()).position(|window| window == end).unwrap() + end.len();
    let float = |bytes: &[u8]| f64::from(f32::from_le_bytes(bytes.try_into().unwrap()));
    bytes[data..].chunks(15).map(|point| [0, 4, 8].map(|at| float(&point[at..at + 4]))).collect()
}

#[test]
fn a_nodding_laser_on_a_moving_robot_sees_the_room_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    write_drive(folder.path());
    let arguments = ["cloud", "room.log", "--trajectory", "path.txt", "--tilt", "tilt.txt", "--height", "0.4"];
    let rest = ["--mirror-ahead", "0.05", "--mirror-above", "0.1", "--voxel", "0"];
    let (code, stdout, stderr) = run(folder.path(), &[&arguments[..], &rest, &["--out", "cloud"]].concat());
    assert_eq!((code, stderr.as_str()), (0, ""), "{stdout}");
    assert!(stdout.contains(" points of 5430 hits") && stdout.ends_with("results in cloud\n"), "{stdout}");

    let out = folder.path().join("cloud");
    let points = ply_points(&out.join("cloud.ply"));
    assert!(points.len() > 5300, "{} points: few are mixed", points.len());
    let worst = points.iter().map(|&point| off(point)).fold(0.0, f64::max);
    assert!(worst < 2e-5, "{worst} m off the surfaces");
    for surface in ROOM.iter().enumerate().flat_map(|(axis, walls)| walls.map(|wall| (axis, wall))).skip(1) {
        let on_it = points.iter().filter(|point| (point[surface.0] - surface.1).abs() < 1e-4).count();
        assert!(on_it > 200, "{on_it} points on {surface:?}");
    }
    let report: serde_json::Value = serde_json::from_slice(&fs::read(out.join("cloud.json")).unwrap()).unwrap();
    assert_eq!(report["points"], points.len());
    assert!(fs::read(out.join("cloud.pcd")).unwrap().starts_with(b"# .PCD v0.7"));
    assert!(fs::read(out.join("cloud.png")).unwrap().starts_with(b"\x89PNG"));

    let again = [&arguments[..], &rest, &["--out", "again"]].concat();
    assert_eq!(run(folder.path(), &again).0, 0);
    let bytes = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("cloud/cloud.ply") == bytes("again/cloud.ply"), "the same input gives the same bytes");
}

#[test]
fn wrong_input_is_named() {
    let folder = tempfile::tempdir().unwrap();
    write_drive(folder.path());
    let fails = |arguments: &[&str]| {
        let (code, _, stderr) = run(folder.path(), arguments);
        assert_eq!(code, 2, "{stderr}");
        stderr
    };
    assert!(fails(&["cloud", "room.log"]).contains("room.log: a log needs --trajectory and --tilt"));
    assert!(fails(&["cloud", "."]).contains(".: no scanNNN.3d or scanNNN.3d.gz in it"));
    assert!(fails(&["cloud", ".", "--tilt", "tilt.txt"]).contains("--tilt goes with a log; . is a folder"));
    fs::write(folder.path().join("bad.txt"), "0 0.1\n1 x\n").unwrap();
    let error = fails(&["cloud", "room.log", "--trajectory", "path.txt", "--tilt", "bad.txt"]);
    assert!(error.contains("bad.txt: line 2: field tilt: expected a finite number up to 1e12, found \"x\""), "{error}");
}

/// A corridor seen from three places by a SICK on a servo. The floor is a plane as well as the servo lets it be, and our matching
/// of the stops agrees with the poses that came with the data.
#[test]
fn real_stops_have_flat_floors_and_are_found_where_the_data_says() {
    let Some(stops) = real_data("tilt3d") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (code, stdout, stderr) = run(folder.path(), &["cloud", stops.to_str().unwrap(), "--json"]);
    assert_eq!((code, stderr.as_str()), (0, ""));
    let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    let stops = report["stops"].as_array().unwrap();
    assert_eq!(stops.len(), 3);
    for stop in stops {
        let planes = stop["planes"].as_array().unwrap();
        let floor = planes.iter().find(|plane| plane["surface"] == "floor").unwrap();
        assert!(floor["rms_m"].as_f64().unwrap() < 0.02 && floor["points"].as_u64().unwrap() > 10_000, "{floor}");
        assert!(planes.iter().filter(|plane| plane["surface"] == "wall").count() >= 3);
    }
    for (stop, distance_m) in stops[1..].iter().zip([0.02, 0.05]) {
        let placed = &stop["registration"];
        assert!(placed["apart_m"].as_f64().unwrap() < distance_m, "{placed}");
        assert!(placed["apart_deg"].as_f64().unwrap() < 0.3, "{placed}");
    }
}
