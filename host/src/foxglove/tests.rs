//! What is written is read back.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::time::{Duration, Instant};

use super::*;

fn beam(bearing_rad: f32, offset_us: i64, echo: Echo) -> Beam {
    Beam { bearing_rad, offset: Duration::from_micros(offset_us), echo }
}

#[test]
fn a_scan_is_read_back_bit_by_bit() {
    let echoes = [Echo::Hit(1.234_567), Echo::Miss, Echo::Miss, Echo::Invalid, Echo::Hit(7.999_999)];
    let uneven: Vec<Beam> =
        (0..5).map(|k| beam(0.1 * k as f32 + 0.013 * (k % 2) as f32, 17 * k as i64, echoes[k])).collect();
    let even: Vec<Beam> = (0..5).map(|k| beam(super::read::even_bearing(-1.5, 1.3, 5, k), 0, echoes[k])).collect();
    for beams in [uneven, even] {
        let scanned = RangeScan { stamp: Instant::default(), range_max_m: 8.183, beams: &beams };
        let (odometry, robot_from_lrf) = (Some(Pose2::new(1.1, -2.7, 0.3)), Pose2::new(0.1, 0.0, -0.2));
        let written = scan(1_700_000_000_123_456_000, &scanned, Seen { odometry, robot_from_lrf, is_exact: true });
        let read = read_scan(&written).unwrap();
        let wanted = ReadScan {
            time_ns: 1_700_000_000_123_456_000,
            range_max_m: Some(8.183),
            beams: beams.clone(),
            odometry,
            robot_from_lrf: Some(robot_from_lrf),
        };
        assert_eq!(read, wanted);
    }
}

#[test]
fn scans_of_others_are_read_and_broken_ones_refused() {
    let text =
        r#"{"timestamp":{"sec":5,"nsec":7},"frame_id":"l","start_angle":-1,"end_angle":1,"ranges":[1.5,null,0]}"#;
    let read = read_scan(text.as_bytes()).unwrap();
    assert_eq!((read.time_ns, read.range_max_m, read.robot_from_lrf), (5_000_000_007, None, None));
    assert_eq!(read.beams, [beam(-1.0, 0, Echo::Hit(1.5)), beam(0.0, 0, Echo::Invalid), beam(1.0, 0, Echo::Invalid)]);
    assert!(read_scan(b"{}").unwrap_err().contains("timestamp"));
    let text = text.replace("\"ranges\"", "\"bearings\":[1],\"ranges\"");
    assert!(read_scan(text.as_bytes()).unwrap_err().contains("as many"));
}

#[test]
fn everything_is_json_and_fits_its_schema_s_names() {
    let all = [
        (POSE_IN_FRAME, pose(1, Pose2::new(1.0, 2.0, 3.0))),
        (FRAME_TRANSFORMS, transforms(1, Pose2::IDENTITY, Some(Pose2::IDENTITY))),
        (GRID, cells(1, (0.0, -1.5), 0.05, (2, [0, 100, 255, 0].into_iter()))),
        (POINT_CLOUD, points(1, [[1.0, 2.0, 3.0]].into_iter())),
        (LOG, log(1, "a \"word\"\n")),
    ];
    for ((name, schema), message) in all {
        let schema: serde_json::Value = serde_json::from_str(schema).unwrap();
        let message: serde_json::Value = serde_json::from_slice(&message).unwrap();
        let fields = |value: &serde_json::Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
        assert_eq!(fields(&schema["properties"]), fields(&message), "{name}");
    }
}
