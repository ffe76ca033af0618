//! A scan in messages: its beams as the laser took them, a byte or two each.
//!
//! [`RangeScan`](lrfslam_core::scan::RangeScan) → parts that fit a message, each readable by itself → beams. Ranges are told in whole millimetres, which is what the
//! sensors tell; bearings and times as lying evenly, which is how the sensors take them.

use serde::{Deserialize, Serialize};

use super::session::{MAX_MESSAGE, QueueFullError};
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::sweep::{Sweep, SweepMotion};
use lrfslam_core::time::{Duration, Instant};

/// Bytes of a message beside its echoes, at most.
const HEAD: usize = 80;
/// Bytes of the echoes of one part, at most.
const ECHOES: usize = MAX_MESSAGE - HEAD;
/// … and of one beam.
const ECHO: usize = 3;
/// No range is longer, mm: a difference then takes three bytes.
const LONGEST_MM: i32 = 1_000_000;
const INVALID: u32 = 0;
const MISS: u32 = 1;
const FIRST_HIT: u32 = 2;

/// A part of a scan, in the order of its beams.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SweepPart<'a> {
    /// Of the scan, on the robot's clock.
    pub stamp: Instant,
    /// A miss means: nothing nearer than this, m.
    pub range_max_m: f32,
    /// How the robot moved while the scan was taken.
    pub motion: SweepMotion,
    /// Bearing of the part's first beam, rad.
    pub bearing_rad: f32,
    /// From one beam to the next.
    pub bearing_step_rad: f32,
    /// Time of the part's first beam after the stamp.
    pub offset: Duration,
    /// From one beam to the next.
    pub offset_step: Duration,
    /// The scan is complete.
    pub is_last: bool,
    /// Per beam a varint: 0 invalid, 1 a miss, else 2 + the zigzag of its range less that of the part's last hit, mm (0 before the first).
    pub echoes: &'a [u8],
}

/// Bytes that the messages of a scan of so many beams take in a sender's queue, at most.
pub fn bytes_at_most(beams: usize) -> usize {
    let bytes = beams * ECHO;
    bytes + (bytes / (ECHOES - ECHO) + 1) * (HEAD + 2)
}

/// Gives every part of `sweep` to `tell`, in order, until one fails.
///
/// # Errors
/// That of `tell`.
pub fn for_each_part(
    sweep: &Sweep<'_>,
    mut tell: impl FnMut(&SweepPart<'_>) -> Result<(), QueueFullError>,
) -> Result<(), QueueFullError> {
    let beams = sweep.scan.beams;
    let (Some(first), Some(last)) = (beams.first(), beams.last()) else { return Ok(()) };
    let gaps = beams.len().saturating_sub(1).max(1);
    let bearing_step_rad = (last.bearing_rad - first.bearing_rad) / gaps as f32;
    let offset_step = Duration::from_micros((last.offset - first.offset).micros / gaps as i64);
    let mut rest = beams;
    while let Some(first) = rest.first() {
        let mut memory = [0; ECHOES];
        let (taken, bytes) = write(rest, &mut memory);
        rest = rest.get(taken..).unwrap_or_default();
        tell(&SweepPart {
            stamp: sweep.scan.stamp,
            range_max_m: sweep.scan.range_max_m,
            motion: sweep.motion,
            bearing_rad: first.bearing_rad,
            bearing_step_rad,
            offset: first.offset,
            offset_step,
            is_last: rest.is_empty(),
            echoes: memory.get(..bytes).unwrap_or_default(),
        })?;
    }
    Ok(())
}

/// Writes as many beams as fit; returns how many, and the bytes.
fn write(beams: &[Beam], memory: &mut [u8]) -> (usize, usize) {
    let (mut last_mm, mut bytes) = (0, 0);
    for (index, beam) in beams.iter().enumerate() {
        let code = match beam.echo {
            Echo::Invalid => INVALID,
            Echo::Miss => MISS,
            Echo::Hit(range_m) => {
                let range_mm = libm::roundf(range_m * 1000.0).clamp(0.0, LONGEST_MM as f32) as i32;
                let difference = range_mm - last_mm;
                last_mm = range_mm;
                FIRST_HIT + zigzag(difference)
            }
        };
        let room = memory.get_mut(bytes..).filter(|room| room.len() >= ECHO);
        let Some(Ok(written)) = room.map(|room| postcard::to_slice(&code, room)) else { return (index, bytes) };
        bytes += written.len();
    }
    (beams.len(), bytes)
}

fn zigzag(value: i32) -> u32 {
    ((value << 1) ^ (value >> 31)) as u32
}

fn unzigzag(code: u32) -> i32 {
    (code >> 1) as i32 ^ -((code & 1) as i32)
}

impl<'a> SweepPart<'a> {
    /// Its beams; those after a code that is none are left out.
    pub fn beams(&self) -> impl Iterator<Item = Beam> + use<'a> {
        let Self { bearing_rad, bearing_step_rad, offset, offset_step, echoes, .. } = *self;
        let mut rest = echoes;
        let mut range_mm = 0_i32;
        let mut index = 0_i32;
        core::iter::from_fn(move || {
            let (code, after) = postcard::take_from_bytes::<u32>(rest).ok()?;
            rest = after;
            let echo = match code {
                INVALID => Echo::Invalid,
                MISS => Echo::Miss,
                hit => {
                    range_mm = range_mm.saturating_add(unzigzag(hit - FIRST_HIT)).clamp(0, LONGEST_MM);
                    if range_mm > 0 { Echo::Hit(range_mm as f32 * 0.001) } else { Echo::Invalid }
                }
            };
            let beam = Beam {
                bearing_rad: bearing_rad + index as f32 * bearing_step_rad,
                offset: Duration::from_micros(
                    offset.micros.saturating_add(offset_step.micros.saturating_mul(i64::from(index))),
                ),
                echo,
            };
            index = index.saturating_add(1);
            Some(beam)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::message::FromRobot;
    use lrfslam_core::geometry::Pose2;
    use lrfslam_core::scan::RangeScan;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn echo() -> impl Strategy<Value = Echo> {
        prop_oneof![Just(Echo::Invalid), Just(Echo::Miss), (1..81_910_u32).prop_map(|mm| Echo::Hit(mm as f32 * 0.001))]
    }

    proptest! {
        #[test]
        fn beams_come_back_and_every_part_fits_a_message(
            echoes in prop::collection::vec(echo(), 1..1500), first in -3.0..0.0_f32, step in 0.001..0.01_f32,
        ) {
            let beams: Vec<Beam> = echoes.iter().enumerate().map(|(index, &echo)| Beam {
                bearing_rad: first + index as f32 * step,
                offset: Duration::from_micros(98 * index as i64),
                echo,
            }).collect();
            let motion = SweepMotion { displacement: Pose2::new(0.1, 0.0, 0.2), duration: Duration::from_millis(100) };
            let scan = RangeScan { stamp: Instant::from_micros(1_700_000_000_000_000), range_max_m: 5.6, beams: &beams };
            let mut told: Vec<Beam> = Vec::new();
            let (mut bytes, mut complete) = (0, 0);
            for_each_part(&Sweep { scan, robot_from_lrf: Pose2::IDENTITY, motion }, |part| {
                let mut memory = [0; MAX_MESSAGE];
                bytes += postcard::to_slice(&FromRobot::Sweep(*part), &mut memory).unwrap().len() + 2;
                assert_eq!((part.stamp, part.motion), (scan.stamp, motion));
                complete += u32::from(part.is_last);
                told.extend(part.beams());
                Ok(())
            }).unwrap();
            prop_assert_eq!((complete, told.len()), (1, beams.len()));
            prop_assert!(bytes <= bytes_at_most(beams.len()), "{} bytes for {} beams", bytes, beams.len());
            for (told, beam) in told.iter().zip(&beams) {
                prop_assert!((told.bearing_rad - beam.bearing_rad).abs() < 1e-5);
                prop_assert_eq!((told.offset, told.echo), (beam.offset, beam.echo));
            }
        }

        #[test]
        fn any_echoes_are_survived(echoes in prop::collection::vec(any::<u8>(), 0..900), offset in any::<i64>()) {
            let span = Duration::from_micros(offset);
            let part = SweepPart {
                stamp: Instant::default(),
                range_max_m: 8.0,
                motion: SweepMotion::default(),
                bearing_rad: 0.0,
                bearing_step_rad: 0.01,
                offset: span,
                offset_step: span,
                is_last: true,
                echoes: &echoes,
            };
            prop_assert!(part.beams().count() <= echoes.len());
        }
    }
}
