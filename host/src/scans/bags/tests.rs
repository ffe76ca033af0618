//! Messages as they come, and those that are wrong.

use std::io::Cursor;
use std::sync::Arc;

use lrfslam_core::time::{Duration, Instant};

use super::messages::scan;
use super::*;
use crate::scans::mcap::Message;

/// A scan of ROS 2 in either order of bytes: from `start` on, `step` apart.
fn laser_scan(is_big: bool, [start, step]: [f32; 2], ranges: &[f32]) -> Message {
    let word = |value: u32| if is_big { value.to_be_bytes() } else { value.to_le_bytes() };
    let mut data = vec![0, u8::from(!is_big), 0, 0];
    // Time, and a frame of three letters and the 0 behind them, which needs no filling up.
    for value in [7, 500_000_000, 4] {
        data.extend(word(value));
    }
    data.extend(b"abc\0");
    let last = start + step * (ranges.len() as f32 - 1.0);
    for value in [start, last, step, 0.001, 0.1, 0.2, 10.0] {
        data.extend(word(value.to_bits()));
    }
    data.extend(word(ranges.len() as u32));
    data.extend(ranges.iter().flat_map(|range| word(range.to_bits())));
    data.extend(word(0));
    message("sensor_msgs/msg/LaserScan", "cdr", data)
}

/// A frame of ROS 1, turned as `quaternion` (x, y, z, w) says.
fn frame(parent: &str, child: &str, quaternion: [f64; 4]) -> Message {
    let text = |text: &str| [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
    let mut data = vec![1, 0, 0, 0];
    data.extend([0_u32, 7, 500_000_000].map(u32::to_le_bytes).concat());
    data.extend([text(parent), text(child)].concat());
    let numbers = [0.5, -0.25, 1.0].into_iter().chain(quaternion);
    data.extend(numbers.flat_map(f64::to_le_bytes));
    let channel =
        Channel { topic: "/tf_static".to_owned(), encoding: "ros1".to_owned(), schema: "tf/tfMessage".to_owned() };
    Message { channel: Arc::new(channel), ..message("", "", data) }
}

/// Messages as if they were a bag.
struct Told(VecDeque<Message>);

impl Container for Told {
    fn next(&mut self) -> Next {
        self.0.pop_front().map_or(Next::End { is_cut: false }, Next::Message)
    }

    fn position(&self) -> u64 {
        0
    }
}

#[test]
fn a_laser_lies_in_the_plane_of_the_robot_or_is_refused() {
    let wanted = TfWanted { mounting: true, ..TfWanted::default() };
    let look = |quaternion| {
        // The laser's frame is that of its scans; ROS 1 wrote a stroke before names.
        let told = [laser_scan(false, [-0.3, 0.2], &[1.0; 4]), frame("/base_link", "/abc", quaternion)];
        let bag: Box<dyn Container> = Box::new(Told(told.into()));
        tf::look([bag].into_iter(), None, &wanted)
    };
    let found = look([0.0, 0.0, 1.0, 1.0]).unwrap().robot_from_lrf.unwrap();
    assert!(found.between(Pose2::new(0.5, -0.25, std::f32::consts::FRAC_PI_2)).position().norm() < 1e-6);
    assert!((found.heading - std::f32::consts::FRAC_PI_2).abs() < 1e-6, "{found:?}");
    // Upside down.
    let fault = look([1.0, 0.0, 0.0, 0.0]).unwrap_err().to_string();
    assert!(fault.contains("abc leans by 180° against base_link"), "{fault}");
    // No turn at all: the message cannot be read.
    let fault = look([0.0; 4]).unwrap_err().to_string();
    assert!(
        fault.contains("no transforms base_link or base_footprint → abc") && fault.ends_with("are none"),
        "{fault}"
    );
}

#[test]
fn frames_that_cannot_be_read_are_said() {
    let whole = frame("base_link", "abc", [0.0, 0.0, 0.0, 1.0]);
    assert_eq!(messages::transforms(&whole).unwrap().len(), 1);
    for cut in 0..whole.data.len() {
        let text = messages::transforms(&Message { data: whole.data[..cut].to_vec(), ..whole.clone() })
            .unwrap_err()
            .to_string();
        assert!(text.contains("/tf_static (tf/tfMessage): expected a whole message"), "{text}");
    }
    let text = messages::transforms(&frame("base_link", "abc", [f64::NAN; 4])).unwrap_err().to_string();
    assert!(text.contains("a transform of numbers"), "{text}");
    let mut many = whole;
    many.data[..4].fill(0xff);
    assert!(messages::transforms(&many).is_err());
}

fn message(schema: &str, encoding: &str, data: Vec<u8>) -> Message {
    let channel = Channel { topic: "/scan".to_owned(), encoding: encoding.to_owned(), schema: schema.to_owned() };
    Message { channel: Arc::new(channel), sequence: 0, time_ns: 1, data, is_suspect: false }
}

#[test]
fn either_order_of_bytes_and_either_way_round() {
    let ranges = [1.0, f32::INFINITY, 0.1, 4.0];
    for is_big in [false, true] {
        let read = scan(3, &laser_scan(is_big, [-0.3, 0.2], &ranges)).unwrap();
        assert_eq!((read.number, read.stamp), (3, Instant::from_micros(7_500_000)));
        let Ranges::Even { ranges_m, bearings_rad, offsets, range_max_m } = read.ranges else { panic!() };
        assert_eq!((ranges_m[0], ranges_m[1], ranges_m[3]), (1.0, f32::INFINITY, 4.0));
        assert!(ranges_m[2].is_nan(), "nearer than the laser sees");
        assert_eq!((bearings_rad, range_max_m), ([-0.3, 0.2], Some(10.0)));
        assert_eq!(offsets, [Duration::ZERO, Duration::from_micros(1000)]);
        // Clockwise: the last beam comes first, and is the latest.
        let read = scan(3, &laser_scan(is_big, [0.3, -0.2], &ranges)).unwrap();
        let Ranges::Even { ranges_m, bearings_rad: [first, step], offsets, .. } = read.ranges else { panic!() };
        assert!(ranges_m[0] == 4.0 && ranges_m[3] == 1.0 && (first + 0.3).abs() < 1e-6 && step == 0.2);
        assert_eq!(offsets, [Duration::from_micros(3000), Duration::from_micros(-1000)]);
    }
}

#[test]
fn what_is_wrong_is_said_with_topic_type_and_what_was_expected() {
    let fault = |message: &Message| scan(1, message).unwrap_err().to_string();
    let whole = laser_scan(false, [-0.3, 0.2], &[1.0; 4]);
    for cut in 0..whole.data.len() - 4 {
        let text = fault(&Message { data: whole.data[..cut].to_vec(), ..whole.clone() });
        assert!(text.contains("/scan (sensor_msgs/msg/LaserScan): expected a whole message"), "{text}");
    }
    assert!(fault(&laser_scan(false, [0.0, 0.2], &[])).contains("expected 1 to 20000 ranges, found 0"));
    assert!(fault(&laser_scan(false, [0.0, 4.0], &[1.0; 4])).contains("expected an angle_increment"));
    assert!(fault(&laser_scan(false, [f32::NAN, 0.1], &[1.0; 4])).contains("expected an angle_increment"));
    let json = message("foxglove.LaserScan", "protobuf", Vec::new());
    assert!(fault(&json).contains("expected messages in json, found protobuf"));
    let other = Message { channel: message("sensor_msgs/LaserScan", "cbor", Vec::new()).channel, ..whole };
    assert!(fault(&other).contains("expected messages in cdr or ros1, found cbor"));
}

#[test]
fn what_is_no_bag_is_refused() {
    let open = |bytes: &[u8]| Bag::from_reader(Cursor::new(bytes.to_vec()), None);
    assert!(open(b"").unwrap_err().to_string().contains("not a bag"));
    assert!(open(b"FLASER 1 2 3").is_err());
    for magic in [b"\x89MCAP0\r\n".as_slice(), b"#ROSBAG V2.0\n", b"SQLite format 3\0"] {
        let Ok(mut bag) = open(magic) else { continue };
        assert!(matches!(bag.take(), Taken::Cut | Taken::End), "{magic:?}");
    }
}

/// A table's first page beyond the end of the file, and far beyond: damage is said, and reading ends.
#[test]
fn a_table_that_begins_nowhere_is_damaged() {
    let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/tests/golden/bags/ros2.db3");
    let Ok(file) = std::fs::read(golden) else { return println!("skipped: no {golden}") };
    // In the list of tables: its name twice, then the number of its first page, a byte.
    let name = b"messagesmessages";
    let root = file.windows(name.len()).position(|window| window == name).expect("a table of messages") + name.len();
    for page in [0, 0x7f, 0xff] {
        let mut file = file.clone();
        file[root] = page;
        let mut bag = Bag::from_reader(Cursor::new(file), None).expect("a bag so far");
        let fault = bag.take();
        assert!(matches!(fault, Taken::Damaged(..)), "{page}");
        assert!(matches!(bag.take(), Taken::Cut), "{page}");
    }
}
