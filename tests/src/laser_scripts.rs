//! What a laser says to its driver, as a script of bytes for fuzzing: any bytes are a script, and real conversations can be written as one.
//!
//! The first byte says which driver; then come steps, each a byte that says what happens, and what it needs.

use std::collections::VecDeque;

use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::lrf_model::LrfErrors;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_firmware_sim::virtual_lrf::ldrobot::VirtualLd06;
use lrfslam_firmware_sim::virtual_lrf::rplidar::{RplidarModel, VirtualRplidar};
use lrfslam_firmware_sim::virtual_lrf::sick::{SickModel, VirtualSick};
use lrfslam_lrf::driver::{BaudPolicy, Event, Input, LrfDriver, Output, run_input};
use lrfslam_lrf::hokuyo_scip::{self, HokuyoConfig, HokuyoDriver};
use lrfslam_lrf::ldrobot::{self, LdrobotDriver};
use lrfslam_lrf::rplidar::response::{Descriptor, ResponseKind};
use lrfslam_lrf::rplidar::{self, Capsule, RplidarConfig, RplidarDriver};
use lrfslam_lrf::sick_lms::telegram::{self, Direction};
use lrfslam_lrf::sick_lms::{self, SickConfig, SickDriver};

use crate::scenes::Round;

/// Answers of a Hokuyo with one beam: each a step of its own.
pub const HELP: [&[u8]; 9] = [
    b"QT\n00P\n\n",
    b"VV\n00P\nSERI:H0706400;F\n\n",
    b"PP\n00P\nMODL:URG-04LX(Hokuyo Automatic Co.,Ltd.);N\nDMIN:20;4\nDMAX:5600;_\nARES:1024;\\\nAMIN:44;7\nAMAX:44;7\nAFRT:384;6\nSCAN:600;e\n\n",
    b"II\n00P\nSTAT:well;8\n\n",
    b"TM0\n01Q\n\n",
    b"BM\n00P\n\n",
    b"MD0044004401000\n00P\n\n",
    b"MD0044004401000\n99b\n00000\n0EX=\n\n",
    b"SS115200\n00P\n\n",
];

/// The deadline is reached.
const TIMEOUT: u8 = 9;
/// From this one on it is so many bytes as the laser's, with a right check sum.
const SUMMED: u8 = 12;
/// From this one on it is so many bytes as they are, and a millisecond.
const BYTES: u8 = 76;

/// First byte of a script of a Hokuyo.
const HOKUYO: u8 = 0;
/// Of a SICK.
const SICK: u8 = 1;
/// Of an RPLIDAR.
const RPLIDAR: u8 = 2;
/// Of an LD06.
const LDROBOT: u8 = 3;
/// All of them; any other byte is one of these by its lowest two bits.
pub const LASERS: [u8; 4] = [HOKUYO, SICK, RPLIDAR, LDROBOT];

/// Memory of any driver.
struct Memory {
    bytes: Vec<u8>,
    beams: Vec<Beam>,
}

impl Memory {
    fn new() -> Self {
        Self {
            bytes: vec![0; hokuyo_scip::driver::FRAME_MEMORY],
            beams: vec![Beam::BLANK; rplidar::driver::BEAM_MEMORY],
        }
    }

    /// Beams that the driver of a script with the first byte `which` may use: of those that spin there may be too few for a turn.
    fn beams(which: u8) -> usize {
        match which & 3 {
            HOKUYO | SICK => hokuyo_scip::driver::BEAM_MEMORY,
            _ if which & 8 == 0 => rplidar::driver::BEAM_MEMORY,
            _ => 500,
        }
    }

    /// The driver that the first byte of a script says.
    fn driver(&mut self, which: u8) -> Box<dyn LrfDriver + '_> {
        let (bytes, beams) = (&mut self.bytes[..], &mut self.beams[..Self::beams(which)]);
        let baud = if which & 4 == 0 { BaudPolicy::Keep } else { BaudPolicy::Raise(115_200) };
        match which & 3 {
            HOKUYO => Box::new(HokuyoDriver::new(HokuyoConfig { baud, ..HokuyoConfig::default() }, bytes, beams)),
            SICK => {
                let config = SickConfig { baud, ..SickConfig::default() };
                Box::new(SickDriver::new(config, &mut bytes[..sick_lms::driver::TELEGRAM_MEMORY], beams))
            }
            RPLIDAR => Box::new(RplidarDriver::new(RplidarConfig::default(), beams)),
            _ => Box::new(LdrobotDriver::new(Duration::ZERO, beams)),
        }
    }
}

/// What the laser of `which` would send with a right sum: a telegram of `payload`, a packet, or the answer or capsule that its first byte says.
fn summed(which: u8, payload: &[u8]) -> Vec<u8> {
    match which & 3 {
        RPLIDAR => rplidar_answer(payload.first().copied().unwrap_or(0)),
        LDROBOT => {
            let head = [0x54, 0x2C].iter().chain(payload).copied();
            let mut packet: Vec<u8> = head.chain(std::iter::repeat(0)).take(ldrobot::packet::PACKET - 1).collect();
            packet.push(ldrobot::packet::crc(&packet));
            packet
        }
        _ => {
            let mut memory = [0; 128];
            let length = telegram::emit(Direction::ToHost, payload, &mut memory).unwrap_or(0);
            memory[..length].to_vec()
        }
    }
}

/// Answers and capsules, at angles of the input's choice.
fn rplidar_answer(what: u8) -> Vec<u8> {
    let kinds = [
        ResponseKind::Info,
        ResponseKind::Health,
        ResponseKind::Capsule,
        ResponseKind::DenseCapsule,
        ResponseKind::Sample,
    ];
    let Some(&kind) = kinds.get(usize::from(what)) else {
        let number = u16::from(what);
        let capsule = Capsule::build(what & 1 == 0, what == 5, f32::from(what) * 1.4, &[number * 9; 40]);
        return capsule.bytes().to_vec();
    };
    let mut bytes = Descriptor { kind }.emit().to_vec();
    bytes.resize(7 + if kind.repeats() { 0 } else { kind.length() }, 0);
    bytes
}

/// Plays a script; returns how many scans came of it.
///
/// # Panics
/// If bytes are not taken, outputs do not end, or a scan has more beams than fit or is none.
pub fn play(script: &[u8]) -> usize {
    let Some((which, mut rest)) = script.split_first() else { return 0 };
    let mut memory = Memory::new();
    let mut player = Player {
        driver: memory.driver(*which),
        now: Instant::default(),
        due: Instant::default(),
        scans: 0,
        beams_max: Memory::beams(*which),
    };
    player.give(Input::Connected);
    while let Some((step, after)) = rest.split_first() {
        let mut take = |count: u8| {
            let (taken, after) = after.split_at(usize::from(count).min(after.len()));
            rest = after;
            taken
        };
        match *step {
            0..TIMEOUT => player.give(Input::Bytes(HELP[usize::from(*step)])),
            TIMEOUT => {
                player.now = player.due.min(player.now + Duration::from_millis(60_000));
                player.give(Input::Timeout);
            }
            10..=SUMMED => {
                player.give([Input::Disconnected, Input::Connected, Input::Stop][usize::from(step - 10)]);
            }
            13..=BYTES => {
                player.give(Input::Bytes(&summed(*which, take(step - SUMMED))));
                continue;
            }
            _ => {
                player.now = player.now + Duration::from_millis(1);
                player.give(Input::Bytes(take(step - BYTES)));
                continue;
            }
        }
        rest = after;
    }
    player.scans
}

struct Player<'d> {
    driver: Box<dyn LrfDriver + 'd>,
    now: Instant,
    due: Instant,
    scans: usize,
    beams_max: usize,
}

impl Player<'_> {
    fn give(&mut self, input: Input<'_>) {
        let Input::Bytes(mut rest) = input else {
            let _ = self.driver.handle_input(self.now, input);
            return self.drain();
        };
        for _ in 0..1000 {
            let taken = self.driver.handle_input(self.now, Input::Bytes(rest));
            rest = &rest[taken..];
            self.drain();
            if rest.is_empty() {
                return;
            }
        }
        panic!("bytes not taken");
    }

    fn drain(&mut self) {
        for _ in 0..64 {
            match self.driver.poll_output() {
                Output::Timeout(due) => {
                    self.due = due.max(self.now);
                    return;
                }
                Output::Event(Event::Scan(scan)) => {
                    self.scans += 1;
                    assert!(scan.beams.len() <= self.beams_max, "more beams than fit");
                    assert!(scan.beams.iter().all(is_beam), "no scan");
                }
                _ => {}
            }
        }
        panic!("outputs without end");
    }
}

fn is_beam(beam: &Beam) -> bool {
    beam.bearing_rad.abs() < 3.2 && !matches!(beam.echo, Echo::Hit(range_m) if !range_m.is_finite())
}

/// A conversation of laser `which`, one of [`LASERS`], with its driver as a script: until so many scans have come, from a laser that is on already.
///
/// # Panics
/// If they do not come.
pub fn overheard(which: u8, scans: usize) -> Vec<u8> {
    let mut memory = Memory::new();
    let mut call = Call {
        laser: laser(which),
        script: vec![which],
        on_way: VecDeque::new(),
        now: Instant::from_micros(100_000_000),
    };
    call.laser.power_on(Instant::default());
    let mut driver = memory.driver(which);
    let (mut due, mut heard) = (call.give(driver.as_mut(), Input::Connected, &mut 0), 0);
    for _ in 0..2000 {
        if heard >= scans {
            return call.script;
        }
        call.wait(due);
        let has_come = call.on_way.front().is_some_and(|(at, _)| *at <= call.now);
        match has_come.then(|| call.on_way.pop_front()).flatten() {
            Some((_, bytes)) => {
                for bytes in bytes.chunks(usize::from(u8::MAX - BYTES)) {
                    call.script.push(BYTES + bytes.len() as u8);
                    call.script.extend(bytes);
                    due = call.give(driver.as_mut(), Input::Bytes(bytes), &mut heard);
                }
            }
            None if due <= call.now => {
                call.script.push(TIMEOUT);
                due = call.give(driver.as_mut(), Input::Timeout, &mut heard);
            }
            None => {}
        }
    }
    panic!("laser {which} does not come to {scans} scans");
}

fn laser(which: u8) -> Box<dyn VirtualLrf> {
    let scene = Box::new(Round);
    match which & 3 {
        HOKUYO => Box::new(VirtualHokuyo::new(HokuyoModel::urg_04lx(), scene, 1)),
        SICK => Box::new(VirtualSick::new(SickModel::lms291(), scene, 1)),
        RPLIDAR => Box::new(VirtualRplidar::new(RplidarModel::a2(), scene, 1)),
        _ => Box::new(VirtualLd06::new(LrfErrors::NONE, scene, 1)),
    }
}

/// A line without a rate between a laser and its driver.
struct Call {
    laser: Box<dyn VirtualLrf>,
    script: Vec<u8>,
    on_way: VecDeque<(Instant, Vec<u8>)>,
    now: Instant,
}

impl Call {
    /// Gives `input` to the driver, and what it says to the laser; returns when the driver is due.
    fn give(&mut self, driver: &mut dyn LrfDriver, input: Input<'_>, scans: &mut usize) -> Instant {
        let mut said = Vec::new();
        let mut sink = |output: Output<'_>| match output {
            Output::Transmit(bytes) => said.push(bytes.to_vec()),
            Output::Event(Event::Scan(_)) => *scans += 1,
            _ => {}
        };
        let due = run_input(driver, self.now, input, &mut sink);
        said.iter().for_each(|bytes| self.laser.receive(self.now, bytes));
        due
    }

    /// Waits until something happens to the driver.
    fn wait(&mut self, due: Instant) {
        loop {
            self.laser.timeout(self.now);
            while let Some(emission) = self.laser.poll() {
                self.on_way.push_back((emission.begins, emission.bytes));
            }
            let next = self.on_way.front().map_or(due, |(at, _)| due.min(*at));
            if next <= self.now {
                return;
            }
            self.now = next.min(self.laser.deadline().max(self.now + Duration::from_millis(1)));
        }
    }
}
