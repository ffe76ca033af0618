//! A session with an LD06 or LD19: it listens; there is nothing to say.

use super::packet::{POINTS, Packet, PacketDecoder, STAMP_PERIOD_MS};
use crate::clock::{ClockOffset, Stamp, StampUnwrapper};
use crate::dialogue::{DialogueBase, Pending, State, departure};
use crate::driver::{BaudRates, Cause, Counters, Identity, Input, LrfDriver, Output, Step};
use crate::turn::{Sample, TurnAssembler, sample_time};
use lrfslam_scan::time::{Duration, Instant};
use lrfslam_scan::{Beam, Echo};

/// The beam memory to lend: a turn at the slowest speed, 5 Hz.
pub const BEAM_MEMORY: usize = 1000;
/// The only rate, bit/s.
const BAUD: u32 = 230_400;
/// Nothing farther is measured, m (manual: 12).
const RANGE_MAX_M: f32 = 12.0;
/// Nothing nearer is measured, mm (manual: 0.02 m).
const DISTANCE_MIN_MM: u16 = 20;
/// Packets of which one at least is read in time, to follow the sensor's clock: 2.7 s.
const WINDOW: u16 = 1024;
/// Packets come every 2.7 ms.
const SILENCE: Duration = Duration::from_millis(2000);
/// Samples are 0.4 to 0.9 degrees apart; a lost packet leaves 4.8 at the slowest speed.
const HOLE_DEG: f32 = 3.0;

/// What it does instead of asking.
const LISTENING: State<()> = State::Asking(());

/// Driver for LD06 and LD19.
#[derive(Debug)]
pub struct LdrobotDriver<'a> {
    decoder: PacketDecoder,
    base: DialogueBase<()>,
    turns: TurnAssembler<'a>,
    latency: Duration,
    stamps: StampUnwrapper,
    offset: ClockOffset,
    last_ms: i64,
    packet_began: Instant,
}

impl<'a> LdrobotDriver<'a> {
    /// A driver that waits for [`Input::Connected`].
    ///
    /// * `latency` — subtracted from every stamp; `beams` — [`BEAM_MEMORY`] of them
    pub fn new(latency: Duration, beams: &'a mut [Beam]) -> Self {
        Self {
            decoder: PacketDecoder::default(),
            base: DialogueBase { rates: BaudRates::new([BAUD]), ..DialogueBase::default() },
            turns: TurnAssembler::new(beams, HOLE_DEG),
            latency,
            stamps: StampUnwrapper::new(STAMP_PERIOD_MS),
            offset: ClockOffset::over(WINDOW),
            last_ms: 0,
            packet_began: Instant::default(),
        }
    }

    fn listen(&mut self, now: Instant) {
        self.decoder.forget();
        self.turns.forget();
        self.stamps = StampUnwrapper::new(STAMP_PERIOD_MS);
        self.offset = ClockOffset::over(WINDOW);
        self.base.set_rate();
        self.base.state = LISTENING;
        self.base.wait(now, SILENCE);
    }

    fn take(&mut self, now: Instant, bytes: &[u8]) -> usize {
        let mut taken = 0;
        while self.base.outbox.is_empty() && self.base.state != State::Idle {
            let rest = bytes.get(taken..).unwrap_or(b"");
            if rest.is_empty() {
                return taken;
            }
            if !self.decoder.is_inside_packet() {
                self.packet_began = now;
            }
            let (count, packet) = self.decoder.feed(rest);
            taken += count;
            if let Some(packet) = packet {
                self.on_packet(now, &packet);
            }
        }
        if self.base.state == State::Idle { bytes.len() } else { taken }
    }

    fn on_packet(&mut self, now: Instant, packet: &Packet) {
        let stamp_ms = match self.stamps.unwrap(u32::from(packet.stamp_ms)) {
            Stamp::At(stamp_ms) => stamp_ms,
            Stamp::Reset => return self.restart(now, Cause::Reset),
            Stamp::Stuck => return self.restart(now, Cause::StuckClock),
        };
        if self.base.state != State::Streaming {
            self.begin_streaming(now, packet);
        } else if turned_deg(stamp_ms - self.last_ms, packet).is_none_or(|degrees| degrees > 180) {
            // Nobody knows how often it turned meanwhile. A smaller loss shows as a hole.
            self.turns.spoil();
        }
        self.last_ms = stamp_ms;
        self.base.wait(now, SILENCE);
        let left = departure(self.packet_began, now, super::packet::PACKET, BAUD);
        let end = self.offset.stamp(left, stamp_ms, Duration::ZERO);
        let each = each_sample(packet);
        let samples = packet.points.iter().enumerate().map(|(index, point)| Sample {
            clockwise_deg: packet.angle_deg(index),
            at: sample_time(end, index, POINTS, each),
            echo: echo(point.distance_mm),
        });
        if self.turns.add(samples) {
            self.base.announce_scan();
        }
    }

    fn begin_streaming(&mut self, now: Instant, packet: &Packet) {
        let period = Duration::from_micros(360_000_000 / i64::from(packet.speed_degps.max(1)));
        self.base.identity = Identity {
            model: heapless::String::try_from("LD06 or LD19").unwrap_or_default(),
            angle_min_rad: -core::f32::consts::PI,
            angle_max_rad: core::f32::consts::PI,
            turn: period,
            range_max_m: RANGE_MAX_M,
            ..Identity::default()
        };
        self.base.found();
        self.base.outbox.push(Pending::Identified);
        self.base.begin_streaming(now, BAUD, period, SILENCE);
    }

    fn restart(&mut self, now: Instant, cause: Cause) {
        let step = if self.base.state == State::Streaming { Step::Stream } else { Step::Find };
        self.base.begin_anew(now, step, cause, "");
        self.listen(now);
    }
}

/// How far it turns in so many ms, degrees; `None` if they are negative.
fn turned_deg(ms: i64, packet: &Packet) -> Option<i64> {
    (ms >= 0).then_some(ms * i64::from(packet.speed_degps) / 1000)
}

/// Time from one sample to the next: the angle between them at the speed of turning.
fn each_sample(packet: &Packet) -> Duration {
    let step_deg = packet.span_deg() / (POINTS - 1) as f32;
    Duration::from_micros((step_deg * 1e6 / f32::from(packet.speed_degps.max(1))) as i64)
}

/// What a distance says; 0 also stands for a weak return, so it frees nothing.
fn echo(distance_mm: u16) -> Echo {
    if distance_mm < DISTANCE_MIN_MM {
        Echo::Invalid
    } else {
        Echo::from_range(f32::from(distance_mm) / 1000.0, RANGE_MAX_M)
    }
}

impl LrfDriver for LdrobotDriver<'_> {
    fn handle_input(&mut self, now: Instant, input: Input<'_>) -> usize {
        match input {
            Input::Bytes(bytes) => return self.take(now, bytes),
            Input::Timeout if self.base.patience.is_over(now) => {
                let cause = if self.base.state == State::Streaming { Cause::Silent } else { Cause::NoReply };
                self.restart(now, cause);
            }
            Input::Timeout => {}
            Input::Connected => {
                self.base.back_off.reset();
                self.listen(now);
            }
            Input::Disconnected => self.base.unplugged(),
            // It cannot be told to stop.
            Input::Stop => self.base.stopped(false),
        }
        0
    }

    fn poll_output(&mut self) -> Output<'_> {
        self.base.poll_output(|| self.turns.scan(self.latency, RANGE_MAX_M))
    }

    fn counters(&self) -> Counters {
        self.base.counters(self.decoder.damaged(), self.turns.incomplete())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::driver::{Event, drain, run_bytes};
    use crate::ldrobot::Point;
    use std::vec::Vec;

    /// Packet `index` of a sensor that turns ten times a second: 12 samples by 0.8 degrees.
    fn packet(index: i64) -> [u8; 47] {
        let cdeg = |sample: i64| ((index * 12 + sample) * 80 % 36_000) as u16;
        let stamp_ms = ((index * 12 * 1_000_000 / 4500) / 1000 % STAMP_PERIOD_MS) as u16;
        let points = core::array::from_fn(|sample| Point { distance_mm: 1000 + sample as u16, intensity: 200 });
        Packet { speed_degps: 3600, start_cdeg: cdeg(0), points, end_cdeg: cdeg(11), stamp_ms }.emit()
    }

    fn run(damaged: Option<i64>) -> (u32, u32, u32, usize) {
        run_with(|index, bytes| {
            let mut bytes = bytes.to_vec();
            bytes[20] ^= if damaged == Some(index) { 4 } else { 0 };
            bytes
        })
    }

    /// Scans of two seconds through a line that does this to each packet; the driver's damaged and incomplete; beams without measurement.
    fn run_with(mut line: impl FnMut(i64, &[u8]) -> Vec<u8>) -> (u32, u32, u32, usize) {
        let mut beams = [Beam::BLANK; BEAM_MEMORY];
        let mut driver = LdrobotDriver::new(Duration::ZERO, &mut beams);
        let _ = driver.handle_input(Instant::default(), Input::Connected);
        drain(&mut driver, &mut |_| {});
        let (mut scans, mut invalid) = (0, 0);
        for index in 0..750 {
            let bytes = line(index, &packet(index));
            let now = Instant::from_micros(index * 12 * 1_000_000 / 4500 + 3000);
            run_bytes(&mut driver, now, &bytes, &mut |output| {
                if let Output::Event(Event::Scan(scan)) = output {
                    scans += 1;
                    assert!((449..=451).contains(&scan.beams.len()), "{}", scan.beams.len());
                    invalid += scan.beams.iter().filter(|beam| beam.echo == Echo::Invalid).count();
                    let sweep = scan.beams.last().unwrap().offset.micros;
                    assert!((sweep - 99_800).abs() < 3000, "{sweep}");
                    assert!(scan.beams.windows(2).all(|pair| pair[0].bearing_rad > pair[1].bearing_rad));
                }
            });
        }
        let counters = driver.counters();
        (scans, counters.damaged, counters.incomplete, invalid)
    }

    #[test]
    fn whole_turns_come_out() {
        assert_eq!(run(None), (19, 0, 0, 0));
    }

    #[test]
    fn damaged_packet_is_a_hole_in_its_turn() {
        assert_eq!(run(Some(100)), (19, 1, 1, 12));
    }

    /// Without a trace but the gap.
    #[test]
    fn lost_packet_is_a_hole_in_its_turn() {
        assert_eq!(run_with(|index, bytes| if index == 100 { vec![] } else { bytes.to_vec() }), (19, 0, 1, 12));
    }

    #[test]
    fn longer_loss_costs_the_turn() {
        let lost = |index, bytes: &[u8]| if (100..125).contains(&index) { vec![] } else { bytes.to_vec() };
        let (scans, _, incomplete, _) = run_with(lost);
        assert_eq!((scans, incomplete), (18, 1));
    }

    #[test]
    fn silence_is_told() {
        let mut beams = [Beam::BLANK; BEAM_MEMORY];
        let mut driver = LdrobotDriver::new(Duration::ZERO, &mut beams);
        let _ = driver.handle_input(Instant::default(), Input::Connected);
        let deadline = drain(&mut driver, &mut |_| {});
        let _ = driver.handle_input(deadline, Input::Timeout);
        let mut said = std::string::String::new();
        drain(&mut driver, &mut |output| {
            if let Output::Event(Event::Trouble(trouble)) = output {
                said = std::format!("{trouble}");
            }
        });
        assert!(said.starts_with("finding the laser range finder: no reply at 230400 baud"), "{said}");
    }
}
