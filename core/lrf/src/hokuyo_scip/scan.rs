//! A reply with ranges → beams.

use super::command::Acquire;
use super::parameters::{RangeCodes, SensorParameters};
use super::reply::{FrameError, Reply};
use lrfslam_scan::{Beam, Echo};

/// A scan whose every line was checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScanHeader {
    /// Sensor's clock when the mirror passed step 0, ms, 24 bits.
    pub stamp_ms: u32,
    /// Number of beams written.
    pub beams: usize,
}

/// Reads the scan in `reply` into `beams`; offsets count from the stamp, bearings from straight ahead.
///
/// A cluster's beam looks along the middle of its steps, at the time of its first.
///
/// # Errors
/// Any [`FrameError`]; `beams` may then be partly overwritten. [`FrameError::BadCount`] also if they are too few.
pub fn read_scan(
    reply: &Reply<'_>,
    parameters: &SensorParameters,
    acquire: &Acquire,
    beams: &mut [Beam],
) -> Result<ScanHeader, FrameError> {
    let stamp_ms = reply.stamp_ms()?;
    let stride = acquire.stride();
    let mut values = reply.values(acquire)?;
    let mut count = 0_u16;
    for (beam, value) in beams.iter_mut().zip(&mut values) {
        let step = acquire.first.saturating_add(count.saturating_mul(stride));
        *beam = Beam {
            bearing_rad: parameters.bearing_rad(f32::from(step) + 0.5 * f32::from(stride - 1)),
            offset: parameters.step_time(step),
            echo: echo(value.range, parameters),
        };
        count = count.saturating_add(1);
    }
    let (floor, ceil) = acquire.value_counts();
    let data_left = values.next().is_some() || chars_left_over(reply, acquire, count);
    if data_left || (count != floor && count != ceil) {
        return Err(FrameError::BadCount);
    }
    Ok(ScanHeader { stamp_ms, beams: usize::from(count) })
}

/// True if a single-echo reply has characters beyond its `count` values: a byte too many, or a value cut short.
fn chars_left_over(reply: &Reply<'_>, acquire: &Acquire, count: u16) -> bool {
    let mut lines = reply.body.split(|byte| *byte == b'\n').skip(1);
    let characters: usize = lines.by_ref().map(|line| line.len().saturating_sub(1)).sum();
    !acquire.multi_echo && characters != usize::from(count) * acquire.encoding.width()
}

/// What a number on the wire says.
///
/// Source: manuals; a URG's 0 also stands for a weak return, so it frees nothing.
pub fn echo(range_mm: u32, parameters: &SensorParameters) -> Echo {
    // Whatever DMIN says, the codes of all models lie below 20.
    let smallest = parameters.distance_min_mm.max(20);
    match parameters.range_codes() {
        RangeCodes::Utm if matches!(range_mm, 1 | 65_533) => Echo::Miss,
        RangeCodes::Utm if range_mm == 65_534 => Echo::Invalid,
        _ if range_mm < smallest => Echo::Invalid,
        _ if range_mm >= parameters.distance_max_mm => Echo::Miss,
        _ => Echo::Hit(range_mm as f32 / 1000.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hokuyo_scip::command::Encoding;
    use lrfslam_scan::time::Duration;

    fn model(name: &str, min: u32, max: u32) -> SensorParameters {
        SensorParameters {
            model: name.try_into().unwrap(),
            distance_min_mm: min,
            distance_max_mm: max,
            steps_per_turn: 1024,
            step_min: 44,
            step_max: 725,
            step_front: 384,
            turns_per_minute: 600,
        }
    }

    #[test]
    fn codes_are_no_ranges() {
        let urg = model("URG-04LX(Hokuyo)", 20, 5600);
        for code in 0..20 {
            assert_eq!(echo(code, &urg), Echo::Invalid, "URG {code}");
        }
        assert_eq!(echo(20, &urg), Echo::Hit(0.02));
        let utm = model("UTM-30LX(Hokuyo)", 23, 60_000);
        assert_eq!(
            [0, 1, 2, 3, 4, 5].map(|code| echo(code, &utm) == Echo::Miss),
            [false, true, false, false, false, false]
        );
        assert_eq!([60_000, 65_533, 65_534].map(|code| echo(code, &utm)), [Echo::Miss, Echo::Miss, Echo::Invalid]);
    }

    #[test]
    fn one_value_becomes_one_beam_ahead() {
        let reply = Reply::parse(b"GD0384038401\n00P\n00000\n0EX=").unwrap();
        let urg = model("URG", 20, 5600);
        let acquire = Acquire { encoding: Encoding::Long, multi_echo: false, first: 384, last: 384, cluster: 1 };
        let mut beams = [Beam { bearing_rad: 9.0, offset: Duration::ZERO, echo: Echo::Invalid }; 2];
        let header = read_scan(&reply, &urg, &acquire, &mut beams).unwrap();
        assert_eq!(header, ScanHeader { stamp_ms: 0, beams: 1 });
        assert_eq!((beams[0].bearing_rad, beams[0].echo, beams[0].offset.micros), (0.0, Echo::Hit(1.384), 37_500));
        let two = Acquire { last: 385, ..acquire };
        assert_eq!(read_scan(&reply, &urg, &two, &mut beams), Err(FrameError::BadCount));
    }
}
