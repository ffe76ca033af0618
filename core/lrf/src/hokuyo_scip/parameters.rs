//! What a sensor says of itself: the `PP` lines, and what follows from them.

use core::f32::consts::PI;
use core::fmt::Write;

use super::code;
use super::command::{Acquire, Encoding};
use super::reply::Reply;
use lrfslam_scan::time::Duration;

/// Longest model name kept, bytes.
pub const MAX_MODEL: usize = 64;

/// How a family writes "no range" among its ranges.
///
/// Source: manual of each, as listed by the makers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RangeCodes {
    /// URG, UBG, UHG: 0..=19 are errors; 0 means far *or* weak, so nothing is known to be free.
    Urg,
    /// UTM, UXM, UST: 1 means no object in range; 65533 too on the newer ones, and 65534 an abnormal value.
    Utm,
}

/// The lines of `PP`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SensorParameters {
    /// `MODL`.
    pub model: heapless::String<MAX_MODEL>,
    /// `DMIN`: smallest distance, mm.
    pub distance_min_mm: u32,
    /// `DMAX`: largest distance, mm.
    pub distance_max_mm: u32,
    /// `ARES`: steps per turn.
    pub steps_per_turn: u16,
    /// `AMIN`: first step of the field of view.
    pub step_min: u16,
    /// `AMAX`: last step of the field of view.
    pub step_max: u16,
    /// `AFRT`: the step that looks ahead.
    pub step_front: u16,
    /// `SCAN`: motor speed, turns per minute.
    pub turns_per_minute: u16,
}

impl SensorParameters {
    /// Reads a `PP` reply; lines with keys not known here are skipped, their order does not matter.
    ///
    /// * returns `None` if a line is missing or the numbers make no sensor: no steps, a field of view that is empty or wider
    ///   than a turn, no range, no motion.
    pub fn parse(reply: &Reply<'_>) -> Option<Self> {
        let text = |key: &str| reply.info().find(|line| line.key == key).map(|line| line.value);
        let number = |key: &str| text(key).and_then(|value| value.trim().parse::<u32>().ok());
        let step = |key: &str| number(key).and_then(|value| u16::try_from(value).ok());
        let parameters = Self {
            model: cut(text("MODL")?),
            distance_min_mm: number("DMIN")?,
            distance_max_mm: number("DMAX")?,
            steps_per_turn: step("ARES")?,
            step_min: step("AMIN")?,
            step_max: step("AMAX")?,
            step_front: step("AFRT")?,
            turns_per_minute: step("SCAN")?,
        };
        parameters.is_sane().then_some(parameters)
    }

    fn is_sane(&self) -> bool {
        (16..=36_000).contains(&self.steps_per_turn)
            && self.step_min <= self.step_max
            && self.step_max <= self.steps_per_turn
            && self.step_front <= self.steps_per_turn
            && self.distance_min_mm < self.distance_max_mm
            && self.distance_max_mm < 1 << 18
            && (1..=12_000).contains(&self.turns_per_minute)
    }

    /// Writes the body of the reply, sums included; `out` may refuse.
    ///
    /// # Errors
    /// Only if `out` fails.
    pub fn emit(&self, out: &mut impl Write) -> core::fmt::Result {
        emit_info(out, "MODL", &self.model)?;
        for (key, value) in [
            ("DMIN", self.distance_min_mm),
            ("DMAX", self.distance_max_mm),
            ("ARES", u32::from(self.steps_per_turn)),
            ("AMIN", u32::from(self.step_min)),
            ("AMAX", u32::from(self.step_max)),
            ("AFRT", u32::from(self.step_front)),
            ("SCAN", u32::from(self.turns_per_minute)),
        ] {
            let mut text = heapless::String::<10>::new();
            write!(text, "{value}")?;
            emit_info(out, key, &text)?;
        }
        Ok(())
    }

    /// Bearing of a step, rad, counter-clockwise, 0 ahead. Fractions are the middles of clusters.
    pub fn bearing_rad(&self, step: f32) -> f32 {
        (step - f32::from(self.step_front)) * (2.0 * PI / f32::from(self.steps_per_turn))
    }

    /// One turn of the mirror.
    pub fn turn(&self) -> Duration {
        Duration::from_micros(60_000_000 / i64::from(self.turns_per_minute.max(1)))
    }

    /// Time from the stamp, which is taken at step 0, to `step`.
    pub fn step_time(&self, step: u16) -> Duration {
        Duration::from_micros(self.turn().micros * i64::from(step) / i64::from(self.steps_per_turn.max(1)))
    }

    /// The whole field of view, three characters a value.
    pub fn full_view(&self) -> Acquire {
        Acquire { encoding: Encoding::Long, multi_echo: false, first: self.step_min, last: self.step_max, cluster: 1 }
    }

    /// How this model writes "no range".
    pub fn range_codes(&self) -> RangeCodes {
        let is_urg = ["URG", "UBG", "UHG"].iter().any(|family| self.model.starts_with(family));
        if is_urg { RangeCodes::Urg } else { RangeCodes::Utm }
    }
}

/// Writes `KEY:value;S` and a line feed; the sum is over the bytes before the semicolon (capture: all 135 lines of three devices).
///
/// # Errors
/// Only if `out` fails.
pub fn emit_info(out: &mut impl Write, key: &str, value: &str) -> core::fmt::Result {
    let sum = [key, ":", value].iter().fold(0_u8, |sum, part| part.bytes().fold(sum, u8::wrapping_add));
    let sum = char::from(code::sum(&[sum]));
    writeln!(out, "{key}:{value};{sum}")
}

/// As much of `text` as fits, cut at a character.
pub(super) fn cut<const N: usize>(text: &str) -> heapless::String<N> {
    let mut kept = heapless::String::new();
    let _ = text.chars().try_for_each(|character| kept.push(character));
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::String;

    const URG: &str = "MODL:URG-04LX(Hokuyo Automatic Co.,Ltd.);N\nDMIN:20;4\nDMAX:5600;_\nARES:1024;\\\nAMIN:44;7\nAMAX:725;o\nAFRT:384;6\nSCAN:600;e\n";
    const UTM: &str = "MODL:UTM-30LX(Hokuyo Automatic Co.,Ltd.);U\nDMIN:23;7\nDMAX:60000;J\nARES:1440;^\nAMIN:0;?\nAMAX:1080;Z\nAFRT:540;0\nSCAN:2400;U\n";

    fn parse(body: &str) -> Option<SensorParameters> {
        let frame = std::format!("PP\n00P\n{}", body.trim_end());
        SensorParameters::parse(&Reply::parse(frame.as_bytes()).unwrap())
    }

    #[test]
    fn captured_parameters_are_read_and_written_back() {
        for text in [URG, UTM] {
            let mut out = String::new();
            parse(text).unwrap().emit(&mut out).unwrap();
            assert_eq!(out, text);
        }
    }

    #[test]
    fn angles_and_times_are_those_of_the_models() {
        let urg = parse(URG).unwrap();
        assert!((urg.bearing_rad(44.0).to_degrees() + 119.53).abs() < 0.01);
        assert!((urg.bearing_rad(725.0).to_degrees() - 119.88).abs() < 0.01);
        assert_eq!((urg.turn().micros, urg.step_time(1024).micros), (100_000, 100_000));
        assert_eq!((urg.range_codes(), urg.full_view().value_counts()), (RangeCodes::Urg, (682, 682)));
        let utm = parse(UTM).unwrap();
        assert!((utm.bearing_rad(0.0).to_degrees() + 135.0).abs() < 1e-3);
        assert_eq!((utm.turn().micros, utm.range_codes()), (25_000, RangeCodes::Utm));
    }

    #[test]
    fn lines_of_newer_devices_and_any_order_do_no_harm() {
        let mut lines: std::vec::Vec<&str> = URG.lines().rev().collect();
        lines.push("PROT:SCIP 2.2;?");
        assert_eq!(parse(&lines.join("\n")), parse(URG));
    }

    #[test]
    fn nonsense_is_no_sensor() {
        for (from, to) in
            [("ARES:1024", "ARES:0"), ("AMAX:725", "AMAX:20"), ("SCAN:600", "SCAN:0"), ("DMIN:20", "DMIM:20")]
        {
            assert_eq!(parse(&URG.replace(from, to)), None, "{to}");
        }
    }
}
