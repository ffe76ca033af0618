//! Encodings that carry a version, byte for byte: what one build writes another one of that version must read.
//!
//! `tests/tests/golden` has a file for each encoding and version. A change of what is written fails here, and says which version is to be raised;
//! `LRFSLAM_RENEW_GOLDEN=1 cargo test -p lrfslam-tests --test virtual_time encodings` then writes the file of the new version, and never over that of an old one.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use lrfslam_core::config::Section;
use lrfslam_core::distributed_map::Region;
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::sweep::SweepMotion;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_host::robot::{Journal, Told};
use lrfslam_host::scans::family::{LrfFamily, LrfOptions};
use lrfslam_host::scans::recording::{Entry, RecordPlan, Recorder, RecordingHeader, RecordingReader};
use lrfslam_lrf::driver::Input;
use lrfslam_robot::RobotConfig;
use lrfslam_robot::wire::frame::{MAX_FRAME, encode};
use lrfslam_robot::wire::message::{
    Capacities, FromRobot, Health, Identity, PathNode, ScanPose, Segment, Status, TileUpdate, ToRobot,
};
use lrfslam_robot::wire::session::{LAYOUT, Packet, Progress, VERSION};
use lrfslam_robot::wire::sweep::SweepPart;

const RENEW: &str = "LRFSLAM_RENEW_GOLDEN";
const LINK_VERSION: &str = "VERSION in core/robot/src/wire/packet.rs (of the robot link, and so of robot.journal)";
const RECORDING_VERSION: &str = "MAGIC in host/src/scans/recording/mod.rs (LRFREC01)";
/// Before the bytes of the configuration, in the file.
const CONFIGURE: &str = "to robot: Configure = ";

fn golden(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(file)
}

/// Lines that are in one of two texts only, as a diff has them.
fn difference(golden: &str, now: &str) -> String {
    let only = |a: &str, b: &str, sign: &str| {
        let lines = a.lines().filter(|line| !b.lines().any(|other| other == *line));
        lines.take(8).fold(String::new(), |text, line| format!("{text}{sign} {line:.200}\n"))
    };
    only(golden, now, "-") + &only(now, golden, "+")
}

/// Holds what is written now against the file of this version.
fn check(file: &str, version: &str, now: &str) {
    let path = golden(file);
    if std::env::var_os(RENEW).is_some() && !path.exists() {
        std::fs::write(&path, now).unwrap();
    }
    let known = std::fs::read_to_string(&path).unwrap_or_default();
    let renew = format!("{RENEW}=1 cargo test -p lrfslam-tests --test virtual_time encodings");
    assert!(
        !known.is_empty(),
        "{file} is not there: this version is new. Write it by\n    {renew}\nand delete the one before"
    );
    assert!(
        known == now,
        "the encoding has changed, and builds of this version would misread one another: raise {version},\nthen write the golden file of the new version by\n    {renew}\nand delete {file}. It has (-), and this program (+):\n{}",
        difference(&known, now)
    );
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn unhex(text: &str) -> Vec<u8> {
    let digits = text.as_bytes().chunks(2);
    digits.map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap()).collect()
}

/// Postcard's bytes of a message, packet or status.
macro_rules! bytes {
    ($value:expr) => {{
        let mut memory = [0; MAX_FRAME];
        postcard::to_slice($value, &mut memory).expect("it fits a frame").to_vec()
    }};
}

/// The configuration in the golden file, so that a new default is not taken for a new layout; today's if that cannot be read.
fn configuration() -> RobotConfig {
    let text = std::fs::read_to_string(golden(&format!("robot-link-{VERSION}.txt"))).unwrap_or_default();
    let known = text.lines().find_map(|line| line.strip_prefix(CONFIGURE)).map(unhex).unwrap_or_default();
    match postcard::take_from_bytes(&known) {
        Ok((ToRobot::Configure(config), [])) => config,
        _ => RobotConfig::default(),
    }
}

/// Every field with its value, a line each.
fn list(config: &RobotConfig, text: &mut String) {
    let RobotConfig { seed, robot_from_lrf: Pose2 { x, y, heading }, .. } = config;
    writeln!(text, "layout of the configuration = {LAYOUT:08x}").unwrap();
    writeln!(text, "seed = {seed}\nrobot_from_lrf = {x:?}, {y:?}, {heading:?}").unwrap();
    config.visit_sections(&mut |name: &str, section: &dyn Section| {
        section.visit(&mut |field| {
            write!(text, "{name}.{} = ", field.name).unwrap();
            field.value.write_toml(text).unwrap();
            text.push('\n');
        });
    });
}

const TILE: TileUpdate<'static> = TileUpdate { column: -1, row: 300, squares: &[1, 4, 0, 9] };
const REGION: Region = Region { columns: [9, 15], rows: [-7, 8] };

/// Its name; a message that is not named here has no golden bytes yet: add it to [`to_robot`].
fn name_to_robot(message: &ToRobot<'_>) -> &'static str {
    match message {
        ToRobot::Configure(_) => "Configure",
        ToRobot::Stop => "Stop",
        ToRobot::Restart => "Restart",
        ToRobot::Tile(_) => "Tile",
        ToRobot::Recalled(_) => "Recalled",
    }
}

fn to_robot() -> [ToRobot<'static>; 5] {
    let config = ToRobot::Configure(configuration());
    [config, ToRobot::Stop, ToRobot::Restart, ToRobot::Tile(TILE), ToRobot::Recalled(REGION)]
}

/// As [`name_to_robot`].
fn name_from_robot(message: &FromRobot<'_>) -> &'static str {
    match message {
        FromRobot::Identity(_) => "Identity",
        FromRobot::Configured => "Configured",
        FromRobot::Refused(_) => "Refused",
        FromRobot::Scan(_) => "Scan",
        FromRobot::Segment(_) => "Segment",
        FromRobot::Tile(_) => "Tile",
        FromRobot::MapBegin => "MapBegin",
        FromRobot::MapEnd(_) => "MapEnd",
        FromRobot::Said(_) => "Said",
        FromRobot::Sweep(_) => "Sweep",
        FromRobot::Left(_) => "Left",
        FromRobot::Recall(_) => "Recall",
    }
}

fn scan_pose() -> ScanPose {
    ScanPose {
        stamp: Instant::from_micros(1_000_000),
        number: 7,
        step: 2,
        moved: Pose2::new(0.5, 0.25, 0.125),
        odometry: Pose2::new(1.5, -2.0, 1.0),
        undetermined: Some(Point2::new(0.6, 0.8)),
        is_lost: true,
    }
}

fn segment() -> Segment {
    let node = |parent| PathNode { parent, map_from_robot: Pose2::new(f32::from(parent), 0.5, -0.5) };
    let particles = [3, 200].map(node).into_iter().collect();
    Segment { step: 9, since_step: 8, stamp: Instant::from_micros(-5), best: 1, particles }
}

fn sweep() -> SweepPart<'static> {
    let displacement = Pose2::new(0.5, 0.0, -0.25);
    SweepPart {
        stamp: Instant::from_micros(2_000_000),
        range_max_m: 5.5,
        motion: SweepMotion { displacement, duration: Duration::from_millis(100) },
        bearing_rad: -0.25,
        bearing_step_rad: 0.5,
        offset: Duration::from_micros(3),
        offset_step: Duration::from_micros(98),
        is_last: true,
        echoes: &[0, 1, 0xa2, 0x1f, 5],
    }
}

fn from_robot() -> [FromRobot<'static>; 12] {
    let capacities =
        Capacities { beams: 682, particles: 32, tiles: 1728, tile_side: 8, ndt_tiles: 966, window_side: 33 };
    [
        FromRobot::Identity(Identity { board: "board", is_configured: true, capacities }),
        FromRobot::Configured,
        FromRobot::Refused("why"),
        FromRobot::Scan(scan_pose()),
        FromRobot::Segment(segment()),
        FromRobot::Tile(TILE),
        FromRobot::MapBegin,
        FromRobot::MapEnd(1000),
        FromRobot::Said("words"),
        FromRobot::Sweep(sweep()),
        FromRobot::Left(TILE),
        FromRobot::Recall(REGION),
    ]
}

fn status() -> Status {
    let health = Health { stack_used: 101, lrf_overrun: 102, link_overrun: 103, longest_us: 104, fault_at: 105 };
    Status {
        now: Instant::from_micros(50),
        map_from_robot: Pose2::new(1.0, 2.0, -0.5),
        scans: 1,
        steps: 2,
        particles: 3,
        tiles: 4,
        dropped_particles: 5,
        squares_left_out: 15,
        refused_scans: 6,
        damaged: 7,
        restarts: 8,
        lost_scans: 9,
        untold_sweeps: 10,
        late_scans: 14,
        tiles_left: 11,
        tiles_restored: 12,
        tiles_forgotten: 13,
        health,
    }
}

/// As [`name_to_robot`].
fn name_of_packet(packet: &Packet<'_>) -> &'static str {
    match packet {
        Packet::Hello { .. } => "Hello",
        Packet::Reliable { .. } => "Reliable",
        Packet::Ack { .. } => "Ack",
        Packet::Latest { .. } => "Latest",
        Packet::Busy { .. } => "Busy",
    }
}

fn packets() -> [Packet<'static>; 5] {
    let (peer, credit, layout) = (Some(20), 32, 0x1234_5678);
    [
        Packet::Hello { version: VERSION, epoch: 10, peer, next: 3, base: 4, credit, is_heard: true, layout },
        Packet::Reliable { epoch: 10, sequence: 300, message: &[1, 2, 0] },
        Packet::Ack { epoch: 10, peer: 20, next: 3, credit, missing: true },
        Packet::Latest { epoch: 10, message: &[5, 0] },
        Packet::Busy { peer: 20 },
    ]
}

/// A journal with two messages.
fn journal() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.journal");
    let mut journal = Journal::create(&path).unwrap();
    for (next, message) in [(0, FromRobot::Configured), (1, FromRobot::MapEnd(3))] {
        journal.add(&Told { at: Progress { epoch: 10, next }, bytes: &bytes!(&message) }).unwrap();
    }
    std::fs::read(path).unwrap()
}

#[test]
fn robot_link_and_journal_are_those_of_their_version() {
    let mut text = String::new();
    list(&configuration(), &mut text);
    for message in to_robot() {
        writeln!(text, "to robot: {} = {}", name_to_robot(&message), hex(&bytes!(&message))).unwrap();
    }
    for message in from_robot() {
        writeln!(text, "from robot: {} = {}", name_from_robot(&message), hex(&bytes!(&message))).unwrap();
    }
    writeln!(text, "from robot, latest: Status = {}", hex(&bytes!(&status()))).unwrap();
    let mut memory = [0; MAX_FRAME];
    for packet in packets() {
        let packed = bytes!(&packet);
        let frame = encode(&packed, &mut memory).unwrap();
        writeln!(text, "packet: {} = {}\nframe of it = {}", name_of_packet(&packet), hex(&packed), hex(frame)).unwrap();
    }
    writeln!(text, "robot.journal = {}", hex(&journal())).unwrap();
    check(&format!("robot-link-{VERSION}.txt"), LINK_VERSION, &text);
}

fn recording_header() -> RecordingHeader {
    let lrf = LrfOptions::new(LrfFamily::Hokuyo);
    RecordingHeader { program: "lrfslam".into(), port: "/dev/ttyACM0".into(), lrf }
}

/// A recording with a record of every kind.
fn recording() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.lrfrec");
    let mut recorder = Recorder::new(&RecordPlan::new(&path), recording_header()).unwrap();
    recorder.begin(LrfFamily::Hokuyo).unwrap();
    let at = Instant::from_micros;
    recorder.input(at(1), Input::Connected).unwrap();
    recorder.sent(at(2), b"QT\n").unwrap();
    recorder.baud(at(3), 19_200).unwrap();
    recorder.input(at(4), Input::Bytes(b"QT\n00P\n\n")).unwrap();
    recorder.input(at(5), Input::Timeout).unwrap();
    recorder.input(at(6), Input::Stop).unwrap();
    recorder.input(at(0x0102_0304_0506_0708), Input::Disconnected).unwrap();
    recorder.finish().unwrap();
    std::fs::read(path).unwrap()
}

/// Where the records begin.
fn records(recording: &[u8]) -> usize {
    12 + u32::from_le_bytes(recording[8..12].try_into().unwrap()) as usize
}

/// The header is text, and may have keys more; those of before must still be understood.
#[test]
fn recordings_are_those_of_their_version_and_stay_readable() {
    let now = recording();
    let magic = String::from_utf8_lossy(&now[..8]);
    check(&format!("{magic}.txt"), RECORDING_VERSION, &format!("{magic}\n{}\n", hex(&now[records(&now)..])));
    let known = golden(&format!("{magic}.lrfrec"));
    if std::env::var_os(RENEW).is_some() && !known.exists() {
        std::fs::write(&known, &now).unwrap();
    }
    let reader = RecordingReader::open(&known).unwrap_or_else(|error| panic!("{error:#}: raise {RECORDING_VERSION}"));
    assert_eq!(*reader.header(), recording_header(), "a header means something else: raise {RECORDING_VERSION}");
    let entries: Vec<Entry> = reader.map(|(_, entry)| entry).collect();
    let wanted = RecordingReader::new(&now[..]).unwrap().map(|(_, entry)| entry);
    assert_eq!(entries, wanted.collect::<Vec<_>>());
    assert_eq!(entries.len(), 7);
}
