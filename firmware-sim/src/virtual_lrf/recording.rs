//! Scans of a real laser, for a virtual one of its kind to say again: each once, in order, at the pace at which they were taken.

use std::collections::VecDeque;

use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};

use crate::lrf_model::{RangeMeter, Reading};
use crate::scene::Scene;

/// A beam is the one of a direction if it is no farther from it, degrees: less than half of any laser's resolution.
const SAME_DEG: f64 = 0.05;

/// One scan of a real laser.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedScan {
    /// When its sweep begins, from that of the first scan on; no less than the one before.
    pub after: Duration,
    /// In order of bearing, counter-clockwise.
    pub beams: Vec<Beam>,
}

impl RecordedScan {
    /// What it says of a direction; where it has no beam, that nothing could be measured.
    fn reading(&self, bearing_rad: f64) -> Reading {
        let same_rad = SAME_DEG.to_radians();
        let first = self.beams.partition_point(|beam| f64::from(beam.bearing_rad) < bearing_rad - same_rad);
        let beam = self.beams.get(first).filter(|beam| f64::from(beam.bearing_rad) <= bearing_rad + same_rad);
        match beam.map(|beam| beam.echo) {
            Some(Echo::Hit(range_m)) => Reading::Range(f64::from(range_m)),
            Some(Echo::Miss) => Reading::Nothing,
            Some(Echo::Invalid) | None => Reading::Failed(0),
        }
    }
}

/// Scans that are still to be said, and since when they are.
#[derive(Debug, Default)]
pub(super) struct Recording {
    scans: VecDeque<RecordedScan>,
    began: Option<Instant>,
}

impl Recording {
    /// The laser streams from `at` on: the first time, with the first scan; later, those of the time meanwhile are lost.
    fn stream_from(&mut self, at: Instant) {
        let began = *self.began.get_or_insert(at);
        self.scans.drain(..self.scans.partition_point(|scan| began + scan.after < at));
    }

    fn next_at(&self) -> Option<Instant> {
        Some(self.began? + self.scans.front()?.after)
    }
}

/// What a virtual laser looks at.
pub(super) enum Sight {
    /// A world, through a meter that errs.
    World(Box<dyn Scene>, RangeMeter),
    /// What a real one has seen.
    Recording(Recording),
}

impl Sight {
    pub(super) fn recorded(scans: Vec<RecordedScan>) -> Self {
        Self::Recording(Recording { scans: scans.into(), began: None })
    }

    pub(super) fn measure(&mut self, at: Instant, bearing_rad: f64) -> Reading {
        match self {
            Sight::World(scene, meter) => meter.measure(scene.as_ref(), at, bearing_rad),
            Sight::Recording(recording) => {
                recording.scans.front().map_or(Reading::Failed(0), |scan| scan.reading(bearing_rad))
            }
        }
    }

    /// A ray in this direction meets a reflector; recordings do not tell.
    pub(super) fn is_reflector(&self, at: Instant, bearing_rad: f64) -> bool {
        match self {
            Sight::World(scene, _) => scene.is_reflector(at, bearing_rad),
            Sight::Recording(_) => false,
        }
    }

    pub(super) fn is_recording(&self) -> bool {
        matches!(self, Sight::Recording(_))
    }

    /// When the next scan begins: `mirror_at` in a world, which is seen at any time; never when all of a recording is said.
    pub(super) fn next_at(&self, mirror_at: Instant) -> Option<Instant> {
        match self {
            Sight::World(..) => Some(mirror_at),
            Sight::Recording(recording) => recording.next_at(),
        }
    }

    /// The laser streams from `at` on.
    pub(super) fn stream_from(&mut self, at: Instant) {
        if let Sight::Recording(recording) = self {
            recording.stream_from(at);
        }
    }

    /// The scan was said.
    pub(super) fn advance(&mut self) {
        if let Sight::Recording(recording) = self {
            let _ = recording.scans.pop_front();
        }
    }
}

/// True if all `beams` lie on the grid of directions `first_deg` + i · `step_deg`, up to `last_deg`.
pub(super) fn are_on_grid(beams: &[Beam], first_deg: f64, step_deg: f64, last_deg: f64) -> bool {
    !beams.is_empty()
        && beams.iter().all(|beam| {
            let bearing_deg = f64::from(beam.bearing_rad).to_degrees();
            let steps = (bearing_deg - first_deg) / step_deg;
            let is_inside = (first_deg - SAME_DEG..=last_deg + SAME_DEG).contains(&bearing_deg);
            is_inside && (steps - steps.round()).abs() * step_deg <= SAME_DEG
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beams(first_deg: f32, step_deg: f32, count: u16) -> Vec<Beam> {
        let bearing = |index: u16| (first_deg + f32::from(index) * step_deg).to_radians();
        let beam = |index| Beam { bearing_rad: bearing(index), offset: Duration::ZERO, echo: Echo::Hit(1.0) };
        (0..count).map(beam).collect()
    }

    #[test]
    fn a_direction_is_read_where_a_beam_looks_and_nowhere_else() {
        let mut scan = RecordedScan { after: Duration::ZERO, beams: beams(-1.0, 1.0, 3) };
        (scan.beams[0].echo, scan.beams[1].echo) = (Echo::Miss, Echo::Invalid);
        let said = [-2.0_f64, -1.0, 0.0, 1.0, 1.5, 2.0].map(|bearing_deg| scan.reading(bearing_deg.to_radians()));
        use Reading::{Failed, Nothing, Range};
        assert_eq!(said, [Failed(0), Nothing, Failed(0), Range(1.0), Failed(0), Failed(0)]);
    }

    #[test]
    fn what_was_taken_while_nobody_listened_is_lost() {
        let scan = |ms| RecordedScan { after: Duration::from_millis(ms), beams: Vec::new() };
        let mut recording = Recording { scans: [0, 200, 400, 600].map(scan).into(), began: None };
        let at = |ms: i64| Instant::from_micros(ms * 1000);
        assert_eq!(recording.next_at(), None, "not asked for yet");
        recording.stream_from(at(5000));
        assert_eq!(recording.next_at(), Some(at(5000)));
        recording.stream_from(at(5300));
        assert_eq!(recording.next_at(), Some(at(5400)));
    }
}
