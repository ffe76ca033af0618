use super::*;
use lrfslam_host::scans::log::ToldScans;

fn beam(bearing_rad: f32, offset_us: i64, echo: Echo) -> Beam {
    Beam { bearing_rad, offset: Duration::from_micros(offset_us), echo }
}

#[test]
fn scan_of_even_beams_is_read_back() {
    let echoes = [Echo::Hit(1.5), Echo::Miss, Echo::Invalid, Echo::Hit(2.25), Echo::Hit(0.5)];
    let beams: Vec<Beam> =
        echoes.iter().enumerate().map(|(i, echo)| beam(i as f32 * 0.25 - 0.5, 100 * i as i64, *echo)).collect();
    let sent = RangeScan { stamp: Instant::from_micros(1_700_000_000_123_456), range_max_m: 8.0, beams: &beams };
    let read = ToldScans::new("/scan", None).take(Instant::default(), scan(&sent, Duration::ZERO));
    let read = read.expect("a scan");
    assert_eq!((read.stamp, read.range_max_m, &read.beams), (sent.stamp, 8.0, &beams));
}

/// A laser that turns clockwise: its beams, by bearing, are the later the smaller their bearing.
#[test]
fn times_of_a_clockwise_laser_stay() {
    let beams: Vec<Beam> = (0..5).map(|i| beam(i as f32 * 0.25, 400 - 100 * i, Echo::Hit(1.0))).collect();
    let sent = RangeScan { stamp: Instant::from_micros(5_000_000), range_max_m: 8.0, beams: &beams };
    let read = ToldScans::new("/scan", None).take(Instant::default(), scan(&sent, Duration::ZERO)).expect("a scan");
    let times = |stamp: Instant, beams: &[Beam]| -> Vec<i64> {
        beams.iter().map(|beam| stamp.micros + beam.offset.micros).collect()
    };
    assert_eq!(times(read.stamp, &read.beams), times(sent.stamp, &beams));
}

#[test]
fn uneven_beams_come_to_the_nearest_even_one() {
    let hits = [(0.0, 3.0), (0.9, 2.0), (1.1, 1.0), (3.0, 4.0)];
    let beams: Vec<Beam> = hits.iter().map(|(bearing, range)| beam(*bearing, 0, Echo::Hit(*range))).collect();
    let Even { first_rad, step_rad, ranges_m } = even(&beams);
    assert_eq!((first_rad, step_rad), (0.0, 1.0));
    assert!(ranges_m[2].is_nan() && [ranges_m[0], ranges_m[1], ranges_m[3]] == [3.0, 1.0, 4.0], "{ranges_m:?}");
    assert!(even(&[]).ranges_m.is_empty());
    assert_eq!(even(&beams[3..]).ranges_m, [4.0]);
}

/// What is damaged on its way is told, and the next is read.
#[test]
fn cut_message_is_told() {
    let beams = [beam(0.0, 0, Echo::Hit(1.0)), beam(0.1, 0, Echo::Hit(1.0))];
    let sent = RangeScan { stamp: Instant::from_micros(5_000_000), range_max_m: 8.0, beams: &beams };
    let whole = scan(&sent, Duration::ZERO);
    let mut scans = ToldScans::new("/scan", None);
    for length in 0..whole.len() - 4 {
        assert!(scans.take(Instant::default(), whole[..length].to_vec()).is_err(), "{length} bytes");
    }
    assert_eq!(scans.take(Instant::default(), whole).expect("whole").beams, beams);
}

fn f64_at(message: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(message[at..at + 8].try_into().expect("eight bytes"))
}

/// Composed, the transforms give the robot in the map.
#[test]
fn transforms_chain_from_map_to_robot() {
    let frames = Frames {
        map_from_robot: PoseF64::new(3.0, -1.0, 2.0),
        odom_from_robot: PoseF64::new(2.0, 0.5, -1.5),
        robot_from_lrf: None,
    };
    let message = transforms(Instant::from_micros(2_000_000), &frames);
    // Of the body: count, stamp, "map", "odom", a pose; stamp, "odom", "base_link", a pose. Poses stand at multiples of 8.
    let (first, second) = (32, 128);
    assert_eq!(message.len(), 4 + second + 56);
    let read = |at: usize| {
        let [x, y, z, w] = [0, 8, 40, 48].map(|offset| f64_at(&message, 4 + at + offset));
        PoseF64::new(x, y, 2.0 * z.atan2(w))
    };
    let composed = read(first).then(read(second));
    let off = composed.between(frames.map_from_robot);
    assert!(off.distance_m() < 1e-12 && off.heading.abs() < 1e-12, "{composed:?}");
}

#[test]
fn covariance_has_x_y_and_yaw() {
    let of_pose = Matrix3::new(1.0, 2.0, 3.0, 2.0, 4.0, 5.0, 3.0, 5.0, 6.0);
    let mut message = Cdr::new();
    covariance(&mut message, &of_pose);
    let message = message.finish();
    let read: Vec<f64> = (0..36).map(|index| f64_at(&message, 4 + 8 * index)).collect();
    let expected = [(0, 1.0), (1, 2.0), (5, 3.0), (6, 2.0), (7, 4.0), (11, 5.0), (30, 3.0), (31, 5.0), (35, 6.0)];
    for (index, value) in read.iter().enumerate() {
        let found = expected.iter().find(|(of, _)| *of == index).map_or(0.0, |(_, value)| *value);
        assert_eq!(*value, found, "{index}");
    }
}
