use super::*;
use crate::wire::frame::{FrameDecoder, MAX_FRAME, encode};
use crate::wire::session::{LAYOUT, Packet, Progress, Received, Session, SessionMemory, VERSION};
use lrfslam_core::random::RandomStream;
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

const KEY: Key = Key::new([7; 32]);
const OTHER: Key = Key::new([8; 32]);

/// One end, and what it was told.
struct Party {
    session: Session<'static>,
    heard: Vec<u32>,
    foreign: Vec<Foreign>,
    /// Frames that it has sent so far.
    said: Vec<Vec<u8>>,
}

impl Party {
    fn new(epoch: u32, resume: Option<Progress>, lock: Option<Lock>) -> Self {
        let memory = SessionMemory { queue: vec![0; 600].leak(), frame: vec![0; MAX_FRAME].leak() };
        let session = Session::new(epoch, resume, memory).with_lock(lock);
        Self { session, heard: Vec::new(), foreign: Vec::new(), said: Vec::new() }
    }

    fn hear(&mut self, now: Instant, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let (taken, received) = self.session.take(now, rest);
            match received {
                Some(Received::Reliable(message)) => self.heard.push(postcard::from_bytes(message).unwrap()),
                Some(Received::Foreign(why)) => self.foreign.push(why),
                _ => {}
            }
            rest = &rest[taken..];
        }
    }

    /// What it has to say now.
    fn speak(&mut self, now: Instant) -> Vec<Vec<u8>> {
        if self.session.deadline() <= now {
            self.session.timeout(now);
        }
        let mut memory = [0; MAX_FRAME];
        let mut frames = Vec::new();
        while let Some(frame) = self.session.poll_transmit(now, &mut memory) {
            frames.push(frame.to_vec());
        }
        self.said.extend(frames.clone());
        frames
    }
}

/// A robot and a host, and the line between them.
struct Line {
    now: Instant,
    robot: Party,
    host: Party,
    rng: RandomStream,
    /// Chance that a frame is lost, and that it comes twice.
    loss: f32,
}

fn robot(start: u8, key: Key) -> Party {
    Party::new(10 + u32::from(start), None, Some(Lock::of_robot(key, [start; 16])))
}

fn host(start: u8, key: Key) -> Party {
    Party::new(100 + u32::from(start), None, Some(Lock::of_host(key, [128 + start; 16])))
}

impl Line {
    fn new(robot: Party, host: Party) -> Self {
        let mut line = Self { now: Instant::default(), robot, host, rng: RandomStream::new(1, 0, 0), loss: 0.0 };
        line.robot.session.connected(line.now);
        line.host.session.connected(line.now);
        line
    }

    fn carry(&mut self, is_up: bool) {
        let (from, to) = if is_up { (&mut self.robot, &mut self.host) } else { (&mut self.host, &mut self.robot) };
        for frame in from.speak(self.now) {
            let mut strikes = || (self.rng.next_u32() as f32) < self.loss * u32::MAX as f32;
            if !strikes() {
                to.hear(self.now, &frame);
            }
            if strikes() {
                to.hear(self.now, &frame);
            }
        }
    }

    fn run(&mut self, milliseconds: u32) {
        for _ in 0..milliseconds / 10 {
            self.now = self.now + Duration::from_millis(10);
            self.carry(true);
            self.carry(false);
        }
    }

    /// Both say these numbers, and are heard.
    fn talk(&mut self, numbers: core::ops::Range<u32>) {
        for number in numbers {
            self.robot.session.send(&number).unwrap();
            self.host.session.send(&number).unwrap();
            let is_done = (0..2000).any(|_| {
                self.run(10);
                self.robot.session.is_idle() && self.host.session.is_idle()
            });
            assert!(is_done, "{number}: {:?} {:?}", self.robot.session, self.host.session);
        }
    }
}

fn numbers(count: u32) -> Vec<u32> {
    (0..count).collect()
}

fn framed(payload: &[u8]) -> Vec<u8> {
    let mut memory = [0; MAX_FRAME];
    encode(payload, &mut memory).unwrap().to_vec()
}

fn payload(frame: &[u8]) -> Vec<u8> {
    let mut memory = [0; MAX_FRAME];
    FrameDecoder::new(&mut memory).take(frame).1.unwrap().to_vec()
}

fn hello() -> Vec<u8> {
    let (epoch, layout) = (666, LAYOUT);
    let hello =
        Packet::Hello { version: VERSION, epoch, peer: None, next: 0, base: 0, credit: 9, is_heard: false, layout };
    framed(postcard::to_slice(&hello, &mut [0; 64]).unwrap())
}

#[test]
fn who_has_the_key_is_heard_and_everything_is_sealed() {
    let mut line = Line::new(robot(1, KEY), host(1, KEY));
    line.talk(0..20);
    assert_eq!((&line.robot.heard, &line.host.heard), (&numbers(20), &numbers(20)));
    let said = || line.robot.said.iter().chain(&line.host.said).map(|frame| payload(frame)[0]);
    assert!(said().all(|kind| [WANTED, KNOCK, CHALLENGE, SEALED].contains(&kind)));
    assert_eq!(said().filter(|kind| *kind == CHALLENGE).count(), 1);
    assert_eq!(line.robot.session.counters().refused + line.host.session.counters().refused, 0);
}

#[test]
fn another_key_or_none_is_told_and_moves_nothing() {
    for (robot, host, why) in [
        (robot(1, KEY), host(1, OTHER), Foreign::OtherKey),
        (robot(1, KEY), Party::new(1, None, None), Foreign::WantsKey),
        (Party::new(1, None, None), host(1, KEY), Foreign::NoKey),
    ] {
        let mut line = Line::new(robot, host);
        line.robot.session.send(&1_u32).unwrap();
        line.host.session.send(&2_u32).unwrap();
        line.run(5000);
        assert_eq!((&line.robot.heard, &line.host.heard), (&vec![], &vec![]), "{why:?}");
        assert!(!line.robot.session.is_live() && !line.host.session.is_live(), "{why:?}");
        assert!(!line.host.foreign.is_empty() && line.host.foreign.iter().all(|told| *told == why), "{why:?}");
    }
}

#[test]
fn a_recorded_conversation_is_not_heard_again() {
    let mut line = Line::new(robot(1, KEY), host(1, KEY));
    line.talk(0..5);
    let recorded = line.host.said.clone();
    // In the same life of the robot, on a new connection and on the old one; and to the next life.
    let mut next = robot(2, KEY);
    next.session.connected(line.now);
    line.run(1000);
    for (who, robot) in [("on", &mut line.robot), ("next", &mut next)] {
        for is_new_line in [false, true] {
            if is_new_line {
                robot.session.disconnected();
                robot.session.connected(line.now);
            }
            for frame in &recorded {
                line.now = line.now + Duration::from_millis(30);
                robot.hear(line.now, frame);
                robot.speak(line.now);
            }
            assert_eq!(robot.heard.len(), if who == "on" { 5 } else { 0 }, "{who}");
        }
    }
    assert!(!next.session.is_live() && line.robot.session.counters().refused >= 5);
}

#[test]
fn what_is_put_into_a_conversation_is_refused_and_it_goes_on() {
    let mut line = Line::new(robot(1, KEY), host(1, KEY));
    line.talk(0..3);
    let mut spoilt: Vec<Vec<u8>> = vec![hello(), framed(&[WANTED]), framed(&[KNOCK; 17]), framed(&[CHALLENGE; 49])];
    spoilt.extend(line.host.said.iter().chain(&line.robot.said).cloned());
    // One bit of the number, of the packet and of the tag each.
    let sealed = payload(line.host.said.last().unwrap());
    for at in [1, Lock::HEAD, sealed.len() - 1] {
        let mut sealed = sealed.clone();
        sealed[at] ^= 1;
        spoilt.push(framed(&sealed));
    }
    for number in 3..40 {
        for frame in &spoilt {
            line.robot.hear(line.now, frame);
            line.host.hear(line.now, frame);
        }
        line.talk(number..number + 1);
    }
    assert_eq!((&line.robot.heard, &line.host.heard), (&numbers(40), &numbers(40)));
    assert_eq!((&line.robot.foreign, &line.host.foreign), (&vec![], &vec![]));
    assert!(line.robot.session.counters().refused > 100);
}

#[test]
fn strangers_cost_at_most_two_answers_a_second() {
    let mut line = Line::new(robot(1, KEY), host(1, KEY));
    line.talk(0..1);
    line.robot.said.clear();
    for _ in 0..1000 {
        line.robot.hear(line.now, &hello());
        line.robot.hear(line.now, &framed(&[KNOCK; 17]));
        line.robot.hear(line.now, &framed(&[SEALED; 60]));
        line.robot.speak(line.now);
    }
    assert!(line.robot.said.len() <= 2, "{}", line.robot.said.len());
}

/// Its bytes were computed by other code than ours.
const SPECIFICATION: &str = include_str!("../../../../../docs/robot-link.md");

#[test]
fn examples_of_the_specification_are_what_is_said() {
    let count = |from: u8| core::array::from_fn(|index| from + index as u8);
    let (host, robot) = (count(0x40), count(0x60));
    let mut lock = Lock::of_robot(Key::new(core::array::from_fn(|index| index as u8)), [0; 16]);
    let mut memory = [0; 200];
    let mut said = Vec::new();
    let mut say = |memory: &[u8]| said.push(framed(memory));
    lock.ask(Instant::default());
    say(&[WANTED]);
    assert_eq!(lock.poll(&mut memory), Some(1));
    say(&[&[KNOCK][..], &host].concat());
    lock.take_knock(Instant::default(), &host);
    lock.robot_nonce = Some(robot);
    let length = lock.poll(&mut memory).unwrap();
    say(&memory[..length]);
    lock.in_force = Some(Seals { next: 5, ..lock.seals(&host, &robot) });
    let ack = Packet::Ack { epoch: 10, peer: 20, next: 3, credit: 32, missing: false };
    let length = postcard::to_slice(&ack, &mut memory[Lock::HEAD..]).unwrap().len();
    let length = lock.seal(&mut memory, length).unwrap();
    say(&memory[..length]);
    for frame in said {
        let words: Vec<std::string::String> = frame.iter().map(|byte| std::format!("{byte:02x}")).collect();
        assert!(SPECIFICATION.contains(&std::format!("    {}\n", words.join(" "))), "{words:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// The robot is reset, or another host comes, without anybody at the line noticing; and the line loses and doubles frames.
    #[test]
    fn a_new_life_at_either_end_finds_the_other(loss in 0.0..0.1_f32, seed in any::<u64>(), lives in 0..6_u8) {
        let mut line = Line::new(robot(1, KEY), host(1, KEY));
        (line.loss, line.rng) = (loss, RandomStream::new(seed, 0, 0));
        line.talk(0..10);
        for life in 2..2 + lives {
            let is_robot = seed >> life & 1 == 1;
            let (end, new) = if is_robot { (&mut line.robot, robot(life, KEY)) } else { (&mut line.host, host(life, KEY)) };
            *end = new;
            end.session.connected(line.now);
            line.talk(0..10);
            let end = if is_robot { &line.robot } else { &line.host };
            prop_assert_eq!(&end.heard[end.heard.len() - 10..], &numbers(10)[..]);
        }
    }

    #[test]
    fn any_payloads_are_survived(payloads in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..60), 0..40)) {
        for mut party in [robot(1, KEY), host(1, KEY)] {
            party.session.connected(Instant::default());
            for (step, payload) in (0..).zip(&payloads) {
                let now = Instant::default() + Duration::from_millis(30 * step);
                let mut kinds = payload.clone();
                if let Some(kind) = kinds.first_mut() {
                    *kind = WANTED + *kind % 4;
                }
                party.hear(now, &framed(&kinds));
                party.hear(now, &framed(payload));
                party.speak(now);
            }
            prop_assert_eq!(&party.heard, &vec![]);
            prop_assert!(!party.session.is_live());
        }
    }
}
