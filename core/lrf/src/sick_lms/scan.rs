//! A measurement → beams, each with its own time: full scans below 1° come from several mirror turns.

use core::f32::consts::PI;

use super::measurement::{Measurement, Part, RawEcho, ValueFormat};
use super::request::Variant;
use lrfslam_scan::time::Duration;
use lrfslam_scan::{Beam, Echo};

/// One turn of the mirror: 75 Hz.
pub const TURN: Duration = Duration::from_micros(13_333);

/// What is needed to read a measurement's angles, times and ranges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScanLayout {
    /// Field of view and resolution.
    pub variant: Variant,
    /// Bits of a value.
    pub format: ValueFormat,
}

/// Why a measurement is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ScanError {
    /// Not as many values as the field of view and resolution give.
    #[error("wrong number of values")]
    WrongCount,
    /// Values outside the field of view, or a mirror turn that this resolution does not have.
    #[error("values that do not exist at this resolution")]
    WrongPart,
    /// The memory lent for beams is too small.
    #[error("more beams than fit")]
    TooManyBeams,
}

/// Beams of one measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanShape {
    /// Number of beams written.
    pub beams: usize,
    /// From the first beam's mirror turn to the end of the last one's sweep.
    pub sweep: Duration,
    /// Ranges from here on are misses, m.
    pub range_max_m: f32,
}

impl ScanLayout {
    /// Reads `measurement` into `beams`; offsets count from the moment when the first mirror turn passes 0° of the sensor's
    /// own scale, bearings from straight ahead (its 90°).
    ///
    /// # Errors
    /// As [`ScanError`] says; `beams` is then unchanged.
    pub fn read(&self, measurement: &Measurement<'_>, beams: &mut [Beam]) -> Result<ScanShape, ScanError> {
        let grid = self.grid(measurement)?;
        let beams = beams.get_mut(..measurement.len()).ok_or(ScanError::TooManyBeams)?;
        let per_metre = measurement.unit.per_metre();
        for ((beam, raw), place) in beams.iter_mut().zip(measurement.raw_values()).zip(grid) {
            let echo = match self.format.read(raw) {
                RawEcho::Range(0) | RawEcho::Error => Echo::Invalid,
                RawEcho::BeyondMaximum => Echo::Miss,
                RawEcho::Range(range) => Echo::Hit(f32::from(range) / per_metre),
            };
            *beam = Beam { bearing_rad: bearing_rad(place.angle_cdeg), offset: place.time(), echo };
        }
        let turns = if matches!(measurement.part, Part::Turn(_)) { 1 } else { self.variant.turns() };
        let end_cdeg = (self.variant.start_deg() + self.variant.angle_deg) * 100;
        Ok(ScanShape {
            beams: measurement.len(),
            sweep: Place { angle_cdeg: end_cdeg, turn: turns - 1 }.time(),
            range_max_m: f32::from(self.format.beyond_maximum()) / per_metre,
        })
    }

    /// Where each value lies.
    fn grid(&self, measurement: &Measurement<'_>) -> Result<impl Iterator<Item = Place> + use<>, ScanError> {
        let variant = self.variant;
        let resolution = variant.resolution_cdeg.max(1);
        let start = variant.start_deg() * 100;
        let count = measurement.len();
        let (first, step, expected) = match measurement.part {
            Part::Turn(quarter) => {
                let offset = u16::from(quarter) * 25;
                if offset >= 100 || !offset.is_multiple_of(resolution) {
                    return Err(ScanError::WrongPart);
                }
                (start + offset, 100, usize::from(variant.values_of_turn(quarter)))
            }
            Part::Subrange(first, last) | Part::MeanSubrange(_, first, last) | Part::Remission(first, last) => {
                if first == 0 || last > variant.values() {
                    return Err(ScanError::WrongPart);
                }
                (start + (first - 1) * resolution, resolution, count)
            }
            _ => (start, resolution, usize::from(variant.values())),
        };
        if count != expected {
            return Err(ScanError::WrongCount);
        }
        let turns = 100 / resolution.min(100);
        let is_turn = matches!(measurement.part, Part::Turn(_));
        Ok((0_u16..).map(move |index| {
            let angle_cdeg = first.saturating_add(index.saturating_mul(step));
            let turn = if is_turn { 0 } else { (angle_cdeg - start) / resolution % turns };
            Place { angle_cdeg, turn }
        }))
    }
}

/// Angle of a value on the sensor's own scale, and the mirror turn that measured it.
#[derive(Clone, Copy)]
struct Place {
    angle_cdeg: u16,
    turn: u16,
}

impl Place {
    fn time(self) -> Duration {
        let within = TURN.micros * i64::from(self.angle_cdeg) / 36_000;
        Duration::from_micros(TURN.micros * i64::from(self.turn) + within)
    }
}

fn bearing_rad(angle_cdeg: u16) -> f32 {
    (f32::from(angle_cdeg) - 9000.0) * (PI / 18_000.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sick_lms::config_block::Unit;
    use crate::sick_lms::measurement::count_word;
    use std::vec::Vec;

    fn payload(count: u16, turn: Option<u8>) -> Vec<u8> {
        let mut bytes = vec![0xB0];
        bytes.extend(count_word(count, Unit::Millimetre, turn).to_le_bytes());
        (0..count).for_each(|value| bytes.extend((1000 + value).to_le_bytes()));
        bytes
    }

    fn layout(angle_deg: u16, resolution_cdeg: u16) -> ScanLayout {
        ScanLayout { variant: Variant { angle_deg, resolution_cdeg }, format: ValueFormat::of_mode(0).unwrap() }
    }

    fn read(layout: ScanLayout, payload: &[u8]) -> Result<(ScanShape, Vec<Beam>), ScanError> {
        let mut beams = vec![Beam::BLANK; 401];
        let shape = layout.read(&Measurement::parse(payload).unwrap(), &mut beams)?;
        beams.truncate(shape.beams);
        Ok((shape, beams))
    }

    #[test]
    fn half_degree_scan_is_a_comb_of_two_turns() {
        let (shape, beams) = read(layout(180, 50), &payload(361, None)).unwrap();
        assert_eq!((beams[0].offset.micros, beams[1].offset.micros, beams[2].offset.micros), (0, 13_333 + 18, 37));
        assert!((beams[180].bearing_rad).abs() < 1e-6 && (beams[360].bearing_rad - PI / 2.0).abs() < 1e-6);
        assert_eq!((shape.sweep.micros, shape.range_max_m), (13_333 + 6666, 8.183));
    }

    #[test]
    fn a_turn_on_its_own_has_one_sweep() {
        let (shape, beams) = read(layout(180, 50), &payload(180, Some(2))).unwrap();
        assert!((beams[0].bearing_rad.to_degrees() + 89.5).abs() < 1e-4);
        assert_eq!((beams[0].offset.micros, beams[1].offset.micros, shape.sweep.micros), (18, 55, 6666));
        assert_eq!(read(layout(180, 50), &payload(180, Some(1))), Err(ScanError::WrongPart));
    }

    #[test]
    fn quarter_degree_scan_has_four_turns() {
        let (_, beams) = read(layout(100, 25), &payload(401, None)).unwrap();
        let turns: Vec<i64> = beams[..5].iter().map(|beam| beam.offset.micros / TURN.micros).collect();
        assert_eq!(turns, [0, 1, 2, 3, 0]);
        assert!((beams[0].bearing_rad.to_degrees() + 50.0).abs() < 1e-4);
    }

    #[test]
    fn wrong_count_is_refused() {
        assert_eq!(read(layout(180, 100), &payload(361, None)), Err(ScanError::WrongCount));
        assert_eq!(read(layout(100, 100), &payload(0, None)), Err(ScanError::WrongCount));
    }
}
