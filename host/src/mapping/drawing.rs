//! The corrected map is drawn beside the one in use, a part with every scan: the robot does not wait for it.
//!
//! Correction → the scans that it names wait → with every scan of the laser some of them are drawn, and what the laser sees meanwhile waits
//! behind them → when none waits any more the low level changes over, pose and map at once.
//!
//! # Invariants
//! * What is drawn with a scan depends on the scans and their stamps alone, and not on the computer: results are the same everywhere.
//! * Until it changes over, the low level goes on in the old map, where that map has its walls.
//! * More is drawn with every scan than can come in: it ends.

use std::collections::VecDeque;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::slam::Slam;
use lrfslam_core::time::Duration;

use super::Correction;
use super::memory::SIDE;
use crate::scans::store::ScanStore;

/// Beams drawn for a second from scan to scan: about a microsecond each on a computer, a quarter of its time. Chosen.
const BEAMS_PER_S: i64 = 250_000;
/// Scans count as at least so far apart …
const INTERVAL_MIN: Duration = Duration::from_millis(10);
/// … and at most so far. Both chosen.
const INTERVAL_MAX: Duration = Duration::from_millis(1000);
/// Scans drawn with each at least: one more than can come in.
const SCANS_MIN: usize = 2;

/// A map that is drawn to go on in; see the [module](self).
#[derive(Debug)]
pub(super) struct Beside<'m> {
    slam: Slam<'m, SIDE>,
    drawing: Option<Drawing>,
}

#[derive(Debug)]
struct Drawing {
    /// Where the scans that are not drawn yet were taken in the corrected map, and their places in the store.
    waiting: VecDeque<(Pose2, u32)>,
    /// The corrected map's frame as seen from the map in use.
    corrected_from_map: Pose2,
}

/// Beams that may be drawn with a scan that comes so long after the one before.
fn beams_in(interval: Duration) -> usize {
    let micros = interval.micros.clamp(INTERVAL_MIN.micros, INTERVAL_MAX.micros);
    (BEAMS_PER_S * micros / 1_000_000) as usize
}

impl<'m> Beside<'m> {
    pub(super) fn new(slam: Slam<'m, SIDE>) -> Self {
        Self { slam, drawing: None }
    }

    /// Begins to draw; false if that is little enough to be done at once.
    ///
    /// * `map_from_robot` — where the robot is in the map in use
    /// * `interval` — from the scan before to the latest one
    pub(super) fn begin(
        &mut self,
        correction: &Correction,
        map_from_robot: Pose2,
        (scans, interval): (&ScanStore, Duration),
    ) -> bool {
        let beams: usize = correction.reference.iter().map(|(_, scan)| scans.beams(*scan as usize)).sum();
        if beams <= beams_in(interval) {
            return false;
        }
        self.slam.restart_at(correction.map_from_robot);
        let waiting = correction.reference.iter().copied().collect();
        let corrected_from_map = correction.map_from_robot * map_from_robot.inverse();
        self.drawing = Some(Drawing { waiting, corrected_from_map });
        true
    }

    /// What was begun is not needed any more.
    pub(super) fn stop(&mut self) {
        self.drawing = None;
    }

    /// A scan that has come in meanwhile; `map_from_robot` as for [`begin`](Self::begin).
    pub(super) fn add(&mut self, scan: u32, map_from_robot: Pose2) {
        if let Some(Drawing { waiting, corrected_from_map }) = &mut self.drawing {
            waiting.push_back((*corrected_from_map * map_from_robot, scan));
        }
    }

    /// Draws as many scans as there is time for; returns how many points and squares found no room.
    ///
    /// # Errors
    /// If a scan has more points or beams than there is memory for.
    pub(super) fn draw(&mut self, scans: &ScanStore, interval: Duration) -> anyhow::Result<u32> {
        let Some(drawing) = &mut self.drawing else { return Ok(0) };
        let (mut drawn, mut left) = (0, beams_in(interval));
        let (mut dropped, mut beams) = (0, Vec::new());
        while let Some((_, scan)) = drawing.waiting.front() {
            let needed = scans.beams(*scan as usize);
            if drawn >= SCANS_MIN && needed > left {
                break;
            }
            if let Some((map_from_scan, scan)) = drawing.waiting.pop_front()
                && let Some(sweep) = scans.sweep(scan as usize, &mut beams)
            {
                dropped += self.slam.refer_to(&sweep, map_from_scan)?;
            }
            (drawn, left) = (drawn + 1, left.saturating_sub(needed));
        }
        Ok(dropped)
    }

    /// Has `slam` go on in the map if all of it is drawn, and returns where it does; `map_from_robot` as for [`begin`](Self::begin).
    pub(super) fn change_over(&mut self, slam: &mut Slam<'m, SIDE>, map_from_robot: Pose2) -> Option<Pose2> {
        let Drawing { corrected_from_map, .. } = self.drawing.take_if(|drawing| drawing.waiting.is_empty())?;
        let corrected_from_robot = corrected_from_map * map_from_robot;
        slam.go_on_in(&mut self.slam, corrected_from_robot);
        Some(corrected_from_robot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::mapper::Mapper;
    use crate::mapping::{LowLevel, MapperMemory, MappingConfig};
    use lrfslam_core::scan::{Beam, Echo, RangeScan};
    use lrfslam_core::sweep::Sweep;
    use lrfslam_core::time::Instant;

    const PERIOD: Duration = Duration::from_millis(200);

    /// What a laser at `pose` sees of a room of 12 × 8 m about the origin.
    fn seen_at(pose: Pose2) -> Vec<Beam> {
        let range = |bearing: f32| {
            let (sin, cos) = (pose.heading + bearing).sin_cos();
            let x = (6.0_f32.copysign(cos) - pose.x) / cos;
            let y = (4.0_f32.copysign(sin) - pose.y) / sin;
            x.min(y)
        };
        let bearings = (-180..=180).map(|half_degree| (0.5 * half_degree as f32).to_radians());
        let offset = Duration::ZERO;
        bearings.map(|bearing_rad| Beam { bearing_rad, offset, echo: Echo::Hit(range(bearing_rad)) }).collect()
    }

    /// Rounds in the middle of the room, a scan each 0.1 m.
    fn way(scans: usize) -> impl Iterator<Item = Pose2> {
        (0..scans).map(|k| {
            let (sin, cos) = (0.1 * k as f32).sin_cos();
            Pose2::new(cos, sin, (0.1 * k as f32 + 1.6).rem_euclid(std::f32::consts::TAU))
        })
    }

    fn scan(index: usize, beams: &[Beam]) -> RangeScan<'_> {
        let stamp = Instant::from_micros(PERIOD.micros * index as i64);
        RangeScan { stamp, range_max_m: 20.0, beams }
    }

    /// The scans of a way, and a correction that names them.
    fn drive(scans: usize) -> (ScanStore, Correction) {
        let mut store = ScanStore::default();
        let placed = way(scans).enumerate().map(|(index, pose)| {
            let beams = seen_at(pose);
            (pose, store.add(&Sweep::at_rest(scan(index, &beams), Pose2::IDENTITY)))
        });
        let reference: Vec<(Pose2, u32)> = placed.collect();
        let map_from_robot = reference.last().map_or(Pose2::IDENTITY, |(pose, _)| *pose);
        (store, Correction { map_from_robot, reference })
    }

    fn memory() -> MapperMemory {
        MappingConfig::default().mapper_memory(1)
    }

    fn beside(memory: &mut MapperMemory) -> Beside<'_> {
        let (odometry, particles) = memory.beside.as_mut().expect("a map is drawn beside by default");
        let memory = lrfslam_core::slam::SlamMemory { odometry: odometry.lend(), particles: particles.lend().0 };
        Beside::new(Slam::new(&MappingConfig::default().slam, 1, memory).unwrap())
    }

    fn waiting(beside: &Beside<'_>) -> usize {
        beside.drawing.as_ref().map_or(0, |drawing| drawing.waiting.len())
    }

    /// Scans drawn with each scan of the laser until none waits; one comes in with each.
    fn drawn(interval: Duration) -> Vec<usize> {
        let (store, correction) = drive(400);
        let mut memory = memory();
        let mut beside = beside(&mut memory);
        assert!(beside.begin(&correction, correction.map_from_robot, (&store, interval)));
        let mut drawn = Vec::new();
        while waiting(&beside) > 0 {
            beside.add(0, Pose2::IDENTITY);
            let before = waiting(&beside);
            assert_eq!(beside.draw(&store, interval).unwrap(), 0);
            drawn.push(before - waiting(&beside));
        }
        drawn
    }

    /// Counted, not timed: 361 beams a scan, 0.2 s of 250 000 beams a second.
    #[test]
    fn no_scan_has_more_drawn_than_its_share() {
        let share = 50_000 / 361;
        assert_eq!(drawn(PERIOD), [share, share, 400 + 3 - 2 * share]);
        assert_eq!(
            drawn(Duration::from_millis(25))[..20],
            [6_250 / 361; 20],
            "a faster laser has less drawn with each"
        );
    }

    #[test]
    fn it_ends_however_fast_scans_come() {
        let drawn = drawn(Duration::ZERO);
        assert!(drawn.iter().all(|scans| (2..=7).contains(scans)), "{drawn:?}");
    }

    /// The robot goes on in its old map, which lies elsewhere, until the new one is drawn; then at once where that has it.
    #[test]
    fn the_low_level_goes_on_in_its_old_map_until_the_new_one_is_drawn() {
        let (store, correction) = drive(400);
        let mut memory = memory();
        let mut mapper = Mapper::new(&MappingConfig::default().slam, 1, &mut memory).unwrap();
        let robot = correction.map_from_robot;
        let beams = seen_at(robot);
        let mut found = Vec::new();
        for index in 0..12 {
            let (step, _) = mapper.add_scan(&scan(400 + index, &beams), Pose2::IDENTITY, None).unwrap();
            let taken = match index {
                4 => mapper.begin_correction(&correction, &store).unwrap(),
                _ => mapper.go_on_correcting(None, &store).unwrap(),
            };
            found.push((step.odometry.matched.map_from_robot, taken));
        }
        let apart = |a: Pose2, b: Pose2| a.between(b).position().norm() + a.between(b).heading.abs();
        let changed: Vec<usize> = (0..12).filter(|index| found[*index].1.is_some()).collect();
        assert_eq!(changed, [7], "400 scans in three parts, after the scan that corrects");
        for (index, (pose, taken)) in found.iter().enumerate() {
            let expected = if index <= 7 { Pose2::IDENTITY } else { robot };
            assert!(apart(*pose, expected) < 0.02, "scan {index}: {pose:?}");
            assert!(taken.is_none_or(|pose| apart(pose, robot) < 0.02), "scan {index}: {taken:?}");
        }
        let restarted = mapper.correct(&correction, &store).unwrap();
        assert_eq!(restarted, robot);
    }

    /// What is little is drawn at once: the next scan is matched in the corrected map.
    #[test]
    fn a_small_map_is_changed_at_once() {
        let (store, correction) = drive(100);
        let mut memory = memory();
        let mut mapper = Mapper::new(&MappingConfig::default().slam, 1, &mut memory).unwrap();
        let beams = seen_at(correction.map_from_robot);
        for index in 0..2 {
            mapper.add_scan(&scan(100 + index, &beams), Pose2::IDENTITY, None).unwrap();
        }
        assert_eq!(mapper.begin_correction(&correction, &store).unwrap(), Some(correction.map_from_robot));
        let (step, _) = mapper.add_scan(&scan(102, &beams), Pose2::IDENTITY, None).unwrap();
        assert!(step.odometry.matched.map_from_robot.between(correction.map_from_robot).position().norm() < 0.02);
    }
}
