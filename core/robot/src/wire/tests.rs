use super::frame::{FrameDecoder, MAX_FRAME, MAX_PAYLOAD, encode};
use super::message::{FromRobot, ScanPose, TileUpdate};
use super::session::{Packet, Progress, Received, Session, SessionMemory, VERSION};
use super::sweep::for_each_part;
use lrfslam_core::distributed_map::Region;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::random::RandomStream;
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::sweep::{Sweep, SweepMotion};
use lrfslam_core::time::{Duration, Instant};
use proptest::prelude::*;
use rand_core::Rng;
use std::collections::VecDeque;
use std::vec;
use std::vec::Vec;

fn framed(payload: &[u8]) -> Vec<u8> {
    let mut memory = [0; MAX_FRAME];
    encode(payload, &mut memory).unwrap().to_vec()
}

/// Every payload found in `bytes`, given in pieces of `piece`.
fn payloads(bytes: &[u8], piece: usize) -> Vec<Vec<u8>> {
    let mut memory = [0; MAX_FRAME];
    let mut decoder = FrameDecoder::new(&mut memory);
    let mut found = Vec::new();
    for mut part in bytes.chunks(piece.max(1)) {
        while !part.is_empty() {
            let (taken, payload) = decoder.take(part);
            found.extend(payload.map(<[u8]>::to_vec));
            part = &part[taken..];
        }
    }
    found
}

#[test]
fn frame_is_the_one_of_the_specification() {
    // docs/robot-link.md, "A frame, byte by byte": "123456789" has the well-known CRC-32 CBF43926.
    let frame = framed(b"123456789");
    assert_eq!(frame, *b"\x0e123456789\x26\x39\xf4\xcb\x00");
    assert_eq!(framed(&[0x11, 0, 0x22]), [0x02, 0x11, 0x06, 0x22, 0xb1, 0x51, 0xc5, 0x37, 0x00]);
}

#[test]
fn longest_payload_fits_and_a_longer_one_is_refused() {
    assert_eq!(payloads(&framed(&[7; MAX_PAYLOAD]), 64), [vec![7; MAX_PAYLOAD]]);
    assert_eq!(encode(&[0; MAX_PAYLOAD + 1], &mut [0; 2 * MAX_FRAME]), None);
}

#[test]
fn tail_of_an_oversize_frame_is_not_taken_for_a_frame() {
    // Whatever the decoder's memory drops, the tail that is left is a whole and right frame.
    let mut bytes = vec![1; 3 * MAX_FRAME];
    bytes.extend(framed(b"tail"));
    bytes.extend(framed(b"next"));
    for piece in [1, 7, 512, bytes.len()] {
        assert_eq!(payloads(&bytes, piece), [b"next"], "{piece}");
    }
}

proptest! {
    #[test]
    fn frames_come_back_whatever_the_pieces(
        sent in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..600), 1..6), piece in 1..700_usize,
    ) {
        let bytes: Vec<u8> = sent.iter().flat_map(|payload| framed(payload)).collect();
        prop_assert_eq!(payloads(&bytes, piece), sent);
    }

    #[test]
    fn no_changed_frame_passes_and_the_next_one_does(
        payload in prop::collection::vec(any::<u8>(), 1..300), at in any::<prop::sample::Index>(), flip in 1..=255_u8,
    ) {
        let mut bytes = framed(&payload);
        let at = at.index(bytes.len());
        bytes[at] ^= flip;
        let is_cut = bytes[at] == 0 || at + 1 == bytes.len();
        bytes.extend(framed(b"next"));
        bytes.extend(framed(b"and next"));
        let found = payloads(&bytes, 64);
        prop_assert!(found.ends_with(&[b"and next".to_vec()]));
        prop_assert!(!found.contains(&payload) && (is_cut || found.contains(&b"next".to_vec())));
    }

    #[test]
    fn any_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..4000), piece in 1..600_usize) {
        payloads(&bytes, piece);
        let mut end = End::new(1, None);
        end.session.connected(Instant::default());
        end.hear(Instant::default(), &bytes);
    }
}

/// One end with its memory, and what it was told.
struct End {
    session: Session<'static>,
    sent: u32,
    heard: Vec<u32>,
    peers: u32,
}

const QUEUE: usize = 600;

impl End {
    fn new(epoch: u32, resume: Option<Progress>) -> Self {
        let memory = SessionMemory { queue: vec![0; QUEUE].leak(), frame: vec![0; MAX_FRAME].leak() };
        Self { session: Session::new(epoch, resume, memory), sent: 0, heard: Vec::new(), peers: 0 }
    }

    fn hear(&mut self, now: Instant, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let (taken, received) = self.session.take(now, bytes);
            match received {
                Some(Received::Reliable(message)) => self.heard.push(postcard::from_bytes(message).unwrap()),
                Some(Received::NewPeer { .. }) => self.peers += 1,
                _ => {}
            }
            bytes = &bytes[taken..];
        }
    }

    /// Queues numbers as long as there is room.
    fn speak(&mut self, until: u32) {
        while self.sent < until && self.session.send(&self.sent).is_ok() {
            self.sent += 1;
        }
    }
}

/// Frames under way in one direction; each is flipped, lost, doubled or held back with a chance of `rate`.
struct Line {
    frames: VecDeque<Vec<u8>>,
    held: Option<Vec<u8>>,
    rate: f32,
    rng: RandomStream,
}

impl Line {
    fn new(rate: f32, seed: u64) -> Self {
        Self { frames: VecDeque::new(), held: None, rate, rng: RandomStream::new(seed, 0, 0) }
    }

    fn strikes(&mut self) -> bool {
        lrfslam_core::math::uniform(&mut self.rng) < self.rate
    }

    fn put(&mut self, mut frame: Vec<u8>) {
        if self.strikes() {
            let at = self.rng.next_u32() as usize % frame.len();
            frame[at] ^= 1 << (self.rng.next_u32() % 8);
        }
        if self.strikes() {
            return;
        }
        if self.strikes() {
            self.frames.push_back(frame.clone());
        }
        if self.strikes() && self.held.is_none() {
            self.held = Some(frame);
            return;
        }
        self.frames.push_back(frame);
        self.frames.extend(self.held.take());
    }

    fn cut(&mut self) {
        self.frames.clear();
        self.held = None;
    }
}

/// Two ends and the lines between them, on a virtual clock.
struct Pair {
    now: Instant,
    robot: End,
    host: End,
    up: Line,
    down: Line,
}

impl Pair {
    fn new(rate: f32, seed: u64) -> Self {
        let mut pair = Self {
            now: Instant::default(),
            robot: End::new(10, None),
            host: End::new(20, None),
            up: Line::new(rate, seed),
            down: Line::new(rate, seed ^ 1),
        };
        pair.plug();
        pair
    }

    fn plug(&mut self) {
        self.up.cut();
        self.down.cut();
        self.robot.session.connected(self.now);
        self.host.session.connected(self.now);
    }

    /// 10 ms: three frames each way.
    fn step(&mut self) {
        self.now = self.now + Duration::from_millis(10);
        let Self { now, robot, host, up, down } = self;
        carry(*now, robot, up, host);
        carry(*now, host, down, robot);
    }

    /// Both say the numbers below `until`, and have been heard.
    fn run(&mut self, until: u32) {
        for _ in 0..200_000 {
            self.robot.speak(until);
            self.host.speak(until);
            let is_done = [&self.robot, &self.host].iter().all(|end| end.sent == until && end.session.is_idle());
            if is_done {
                return;
            }
            self.step();
        }
        panic!("still waiting: {:?} {:?}", self.robot.session, self.host.session);
    }
}

fn carry(now: Instant, from: &mut End, line: &mut Line, to: &mut End) {
    let mut memory = [0; MAX_FRAME];
    if from.session.deadline() <= now {
        from.session.timeout(now);
    }
    for _ in 0..3 {
        if let Some(frame) = from.session.poll_transmit(now, &mut memory) {
            line.put(frame.to_vec());
        }
    }
    for frame in line.frames.drain(..) {
        to.hear(now, &frame);
    }
}

fn numbers(range: core::ops::Range<u32>) -> Vec<u32> {
    range.collect()
}

#[test]
fn everything_arrives_once_and_in_order() {
    let mut pair = Pair::new(0.0, 1);
    pair.run(500);
    assert_eq!((pair.host.heard, pair.robot.heard), (numbers(0..500), numbers(0..500)));
    assert_eq!(pair.robot.session.counters().resends + pair.host.session.counters().resends, 0);
}

#[test]
fn credit_stops_the_sender_and_lets_it_go_on() {
    let mut pair = Pair::new(0.0, 1);
    pair.host.session.set_credit(0);
    pair.robot.speak(50);
    (0..1000).for_each(|_| pair.step());
    assert_eq!(pair.host.heard, []);
    pair.host.session.set_credit(1);
    pair.run(50);
    assert_eq!(pair.host.heard, numbers(0..50));
}

#[test]
fn full_queue_is_said_and_nothing_changes() {
    let mut end = End::new(1, None);
    end.speak(1_000_000);
    let (sent, room) = (end.sent, end.session.queue_room());
    assert!(sent > 100 && end.session.send(&[1_u8; 40].as_slice()).is_err());
    assert_eq!(end.session.queue_room(), room);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_bad_line_loses_nothing(rate in 0.0..0.1_f32, seed in any::<u64>()) {
        let mut pair = Pair::new(rate, seed);
        pair.run(300);
        prop_assert_eq!(pair.host.heard, numbers(0..300));
        prop_assert_eq!(pair.robot.heard, numbers(0..300));
    }

    /// What was acknowledged comes no second time, and nothing is left out, when the host starts anew and has kept how far it was.
    #[test]
    fn restarted_host_goes_on_where_it_was(seed in any::<u64>(), steps in prop::collection::vec(1..200_u32, 1..6)) {
        let mut pair = Pair::new(0.01, seed);
        let mut heard = Vec::new();
        for (run, count) in steps.into_iter().enumerate() {
            for _ in 0..count {
                pair.robot.speak(400);
                pair.step();
            }
            let kept = pair.host.session.progress();
            heard.append(&mut pair.host.heard);
            pair.host = End::new(21 + run as u32, kept);
            pair.host.sent = 400;
            pair.plug();
        }
        pair.run(400);
        heard.append(&mut pair.host.heard);
        prop_assert_eq!(heard, numbers(0..400));
    }

    /// A host that has kept nothing gets what it had not acknowledged, in order and without holes.
    #[test]
    fn forgetful_host_gets_what_was_not_acknowledged(seed in any::<u64>(), count in 1..200_u32) {
        let mut pair = Pair::new(0.01, seed);
        for _ in 0..count {
            pair.robot.speak(400);
            pair.step();
        }
        let before = pair.host.heard.len() as u32;
        pair.host = End::new(21, None);
        pair.plug();
        pair.run(500);
        let first = pair.host.heard[0];
        prop_assert!(first <= before, "{first} {before}");
        prop_assert_eq!(&pair.host.heard, &numbers(first..500));
    }

    /// A robot that was reset is noticed, and its new messages all come; what the host has to say comes once.
    #[test]
    fn reset_robot_is_noticed(seed in any::<u64>(), count in 1..200_u32) {
        let mut pair = Pair::new(0.01, seed);
        for _ in 0..count {
            pair.robot.speak(400);
            pair.host.speak(400);
            pair.step();
        }
        let heard_before = pair.robot.heard.clone();
        pair.robot = End::new(11, None);
        pair.robot.session.connected(pair.now);
        pair.up.cut();
        pair.down.cut();
        pair.host.heard.clear();
        pair.run(500);
        prop_assert!(pair.host.peers >= 1);
        prop_assert_eq!(&pair.host.heard, &numbers(0..500));
        let first = pair.robot.heard[0];
        prop_assert!(first as usize <= heard_before.len());
        prop_assert_eq!(&pair.robot.heard, &numbers(first..500));
    }
}

/// Its bytes were computed by other code than ours.
const SPECIFICATION: &str = include_str!("../../../../docs/robot-link.md");

fn is_in_the_specification(frame: &[u8]) -> bool {
    let words: Vec<std::string::String> = frame.iter().map(|byte| std::format!("{byte:02x}")).collect();
    SPECIFICATION.contains(&std::format!("    {}", words.join(" ")))
}

fn packet(packet: Packet<'_>) -> Vec<u8> {
    let mut memory = [0; MAX_FRAME];
    framed(postcard::to_slice(&packet, &mut memory).unwrap())
}

#[test]
fn examples_of_the_specification_are_what_is_sent() {
    let (epoch, layout) = (20, 0x1234_5678);
    let hello =
        Packet::Hello { version: VERSION, epoch, peer: None, next: 0, base: 0, credit: 32, is_heard: false, layout };
    let ack = Packet::Ack { epoch: 10, peer: 20, next: 3, credit: 32, missing: false };
    let mut squares = [0; 128];
    squares[..2].copy_from_slice(&[1, 4]);
    let tile = FromRobot::Tile(TileUpdate { column: -1, row: 2, squares: &squares });
    let mut memory = [0; MAX_FRAME];
    let tile = framed(postcard::to_slice(&tile, &mut memory).unwrap());
    let echo = [Echo::Invalid, Echo::Miss, Echo::Hit(2.0), Echo::Hit(1.998)];
    let beam = |index: usize| Beam {
        bearing_rad: -0.25 + 0.25 * index as f32,
        offset: Duration::from_micros(98 * index as i64),
        echo: echo[index],
    };
    let (stamp, forward) = (Instant::from_micros(1_000_000), Pose2::new(0.5, 0.0, 0.0));
    let scan = RangeScan { stamp, range_max_m: 5.5, beams: &[0, 1, 2, 3].map(beam) };
    let motion = SweepMotion { displacement: forward, duration: Duration::from_millis(100) };
    let mut sweep = Vec::new();
    let told = for_each_part(&Sweep { scan, robot_from_lrf: Pose2::IDENTITY, motion }, |part| {
        sweep = framed(postcard::to_slice(&FromRobot::Sweep(*part), &mut memory).unwrap());
        Ok(())
    });
    assert_eq!(told, Ok(()));
    let odometry = Pose2::new(1.5, 0.0, 0.0);
    let pose = ScanPose { stamp, number: 7, step: 2, moved: forward, odometry, undetermined: None, is_lost: false };
    let pose = framed(postcard::to_slice(&FromRobot::Scan(pose), &mut memory).unwrap());
    let region = Region { columns: [9, 15], rows: [-7, 8] };
    let recall = FromRobot::Recall(region);
    let recall = framed(postcard::to_slice(&recall, &mut memory).unwrap());
    for example in [&framed(b"123456789"), &packet(hello), &packet(ack), &tile[..14].to_vec(), &recall, &sweep, &pose] {
        assert!(is_in_the_specification(example), "{example:02x?}");
    }
    let [version, magic] = [std::format!("TCP. Version {VERSION}."), std::format!("`LRFROB{VERSION:02}`")];
    assert!(SPECIFICATION.contains(&version) && SPECIFICATION.contains(&magic), "{version} {magic}");
}
