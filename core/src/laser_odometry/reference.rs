//! What scans are matched against: how it grows, what stays out of it, and how it begins anew.

#[cfg(feature = "witnesses")]
use super::witnesses;
use super::{LaserOdometry, Reference, walls};
use crate::filter::{self, PointCapacityError};
use crate::geometry::{Point2, Pose2};
use crate::ndt::{InsertReport, NdtGrid};
use crate::scan::{Echo, RangeScan};
use crate::sweep::Sweep;
use crate::time::Instant;

/// The recent scans are those of so much way, m: chosen, so that the way back out of a dead end is matched against the way in.
const RECENT_WAY_M: f32 = 60.0;

/// A scan that is kept: it will be removed from the reference again, or is a witness.
#[derive(Debug, Clone, Copy, Default)]
pub struct KeyScan {
    pub(super) taken: Taken,
    pub(super) count: usize,
    /// Way until it was taken, m.
    way_m: f32,
}

/// When and where a scan was taken, and how far and finely it sees.
#[derive(Debug, Clone, Copy, Default)]
#[cfg_attr(not(feature = "witnesses"), expect(dead_code, reason = "witnesses alone ask"))]
pub(super) struct Taken {
    pub(super) at: Instant,
    pub(super) map_from_robot: Pose2,
    /// Where the laser was, robot frame.
    pub(super) eye: Point2,
    /// Range of the farthest hit, m: what a laser is said to reach is often more than it does.
    pub(super) farthest_m: f32,
    /// Angle from beam to beam, rad.
    pub(super) beam_rad: f32,
}

impl Taken {
    /// * `robot_from_lrf` — where the laser sits on the robot
    pub(super) fn new(scan: &RangeScan<'_>, robot_from_lrf: Pose2, map_from_robot: Pose2) -> Self {
        let fan = scan.beams.first().zip(scan.beams.last()).map_or(0.0, |(a, b)| (b.bearing_rad - a.bearing_rad).abs());
        Self {
            at: scan.stamp,
            map_from_robot,
            eye: robot_from_lrf.position(),
            farthest_m: scan
                .beams
                .iter()
                .fold(0.0, |most, beam| if let Echo::Hit(range_m) = beam.echo { range_m.max(most) } else { most }),
            beam_rad: fan / scan.beams.len().saturating_sub(1).max(1) as f32,
        }
    }
}

impl LaserOdometry<'_> {
    /// Puts the robot at `map_from_robot` and forgets the reference; to be followed by [`refer_to`](Self::refer_to). What is known of
    /// its motion stays.
    ///
    /// For a high level that has corrected the map.
    pub fn restart_at(&mut self, map_from_robot: Pose2) {
        self.ndt.clear();
        (self.key_count, self.turn) = (0, 0);
        self.key_scans.fill(KeyScan::default());
        self.map_from_robot = map_from_robot;
        self.map_from_key = map_from_robot;
    }

    /// Puts the robot at `map_from_robot` in the reference of `drawn`, which gets this one's for it. What is known of its motion stays.
    ///
    /// * `drawn` — of the same configuration; has been told what to refer to since it was [begun anew](Self::restart_at)
    pub fn go_on_in(&mut self, drawn: &mut Self, map_from_robot: Pose2) {
        core::mem::swap(&mut self.ndt, &mut drawn.ndt);
        core::mem::swap(&mut self.key_points, &mut drawn.key_points);
        core::mem::swap(&mut self.key_scans, &mut drawn.key_scans);
        (self.key_count, self.turn) = (drawn.key_count, drawn.turn);
        self.map_from_robot = map_from_robot;
        self.map_from_key = map_from_robot;
    }

    /// Extends the reference by a scan that was taken at `map_from_scan`; returns how many points found no room.
    ///
    /// # Errors
    /// [`PointCapacityError`] if the scan has more points than the memory lent; nothing has changed then.
    pub fn refer_to(&mut self, sweep: &Sweep<'_>, map_from_scan: Pose2) -> Result<u32, PointCapacityError> {
        let count = self.hits_of(sweep)?;
        let hits = self.hits.get(..count).unwrap_or_default();
        let points = filter::thin(&self.config.filter, hits, self.points)?.len();
        if self.config.odometry.reference != Reference::WholeMap {
            return Ok(self.ndt.insert(hits, map_from_scan).dropped);
        }
        let hits = hits.len();
        Ok(self.extend_map(Taken::new(&sweep.scan, sweep.robot_from_lrf, map_from_scan), (points, hits), false).dropped)
    }

    /// Cells of the reference that count now stay as they are; see [`NdtGrid::freeze`](crate::ndt::NdtGrid::freeze). For a robot in a map that shall not change.
    pub fn freeze_reference(&mut self) {
        self.ndt.freeze();
    }

    /// Moves those of the current points that may walk behind the others; returns how many these are. None without witnesses.
    #[cfg(feature = "witnesses")]
    pub(super) fn part_walking(&mut self, taken: &Taken, (points, hits): (usize, usize)) -> usize {
        if self.config.odometry.reference != Reference::WholeMap {
            return 0;
        }
        let hits = self.hits.get(..hits).unwrap_or_default();
        let walking = witnesses::walking(hits, taken, self.key_scans, self.key_points);
        walking.part(self.points.get_mut(..points).unwrap_or_default())
    }

    /// The same without witnesses: nobody can tell.
    #[cfg(not(feature = "witnesses"))]
    pub(super) fn part_walking(&mut self, _: &Taken, _: (usize, usize)) -> usize {
        0
    }

    /// Puts the current points into beam order again, as witnesses are kept.
    pub(super) fn put_in_order(&mut self, hits: usize) {
        // They had room before.
        let _ = filter::thin(&self.config.filter, self.hits.get(..hits).unwrap_or_default(), self.points);
    }

    /// Puts the current scan into the reference, and takes the oldest out where the reference is a few scans only.
    pub(super) fn extend(&mut self, taken: Taken, (points, hits): (usize, usize)) -> InsertReport {
        let map_from_robot = taken.map_from_robot;
        // What a reference begins with is drawn as it is: else who sees far hits alone would have nothing to be matched with.
        let stands = self.ndt.tiles_used() > 0 && !self.is_key(map_from_robot);
        self.way_m += self.map_from_key.between(map_from_robot).position().norm();
        self.map_from_key = map_from_robot;
        if self.config.odometry.reference == Reference::WholeMap {
            return self.extend_map(taken, (points, hits), stands);
        }
        self.let_go_behind();
        let reference = self.config.odometry.reference;
        let hits = self.hits.get(..hits).unwrap_or_default();
        let Self { ndt, key_points, key_scans, .. } = self;
        if let Some((key, memory)) = next_slot(key_scans, key_points, &mut self.key_count) {
            key.remove_from(ndt, memory, reference);
            key.keep(memory, hits, taken);
            key.way_m = self.way_m;
        }
        if reference == Reference::RecentScans {
            walls::between(hits, |wall| {
                ndt.insert(wall, map_from_robot);
            });
        }
        ndt.insert(hits, map_from_robot)
    }

    /// Of the last scans, those that are too far behind leave the reference.
    fn let_go_behind(&mut self) {
        let reference = self.config.odometry.reference;
        let Self { ndt, key_points, key_scans, way_m, .. } = self;
        let room = key_points.len().checked_div(key_scans.len()).unwrap_or(0).max(1);
        let behind = *way_m - RECENT_WAY_M;
        for (index, key) in key_scans.iter_mut().enumerate().filter(|(_, key)| key.way_m < behind) {
            let memory = key_points.get(index * room..).unwrap_or_default();
            key.remove_from(ndt, memory, reference);
        }
    }

    /// The same for the whole map: what moves is not map.
    ///
    /// * `stands` — it was taken where the last one was, and is not what the reference begins with
    #[cfg(feature = "witnesses")]
    pub(super) fn extend_map(&mut self, taken: Taken, (points, hits): (usize, usize), stands: bool) -> InsertReport {
        let points = self.points.get(..points).unwrap_or_default();
        let hits = self.hits.get_mut(..hits).unwrap_or_default();
        let Self { ndt, key_points, key_scans, .. } = self;
        let standing = witnesses::keep_standing(hits, &taken, key_scans, key_points);
        let hits = hits.get(..standing).unwrap_or_default();
        // Without witnesses all is map: what a ray goes through would depend on what is in memory far away.
        if !key_scans.is_empty() {
            ndt.look_through(hits, taken.eye, taken.map_from_robot, self.turn);
        }
        self.turn = self.turn.wrapping_add(1);
        let newest = self.key_count.checked_sub(1).and_then(|index| key_scans.get(index % key_scans.len().max(1)));
        let is_due =
            newest.is_none_or(|newest| witnesses::is_due(newest.taken.map_from_robot.between(taken.map_from_robot)));
        if is_due && let Some((witness, memory)) = next_slot(key_scans, key_points, &mut self.key_count) {
            witness.keep(memory, points, taken);
        }
        draw(ndt, hits, taken.map_from_robot, stands)
    }

    /// The same for the whole map: all that is seen.
    #[cfg(not(feature = "witnesses"))]
    pub(super) fn extend_map(&mut self, taken: Taken, (_, hits): (usize, usize), stands: bool) -> InsertReport {
        draw(&mut self.ndt, self.hits.get(..hits).unwrap_or_default(), taken.map_from_robot, stands)
    }
}

/// Draws hits, and the walls between and beside them, in the map.
///
/// * `stands` — the robot has not moved since the last scan that was drawn: of a wall that a beam meets at one place only, too much of that place
///   would be seen
fn draw(ndt: &mut NdtGrid<'_>, hits: &[Point2], map_from_robot: Pose2, stands: bool) -> InsertReport {
    let mut inserted = InsertReport::default();
    let mut insert = |hits: &[Point2]| inserted += ndt.insert(hits, map_from_robot);
    if stands {
        walls::near(hits, &mut insert)
    } else {
        insert(hits)
    }
    walls::between(hits, |wall| {
        ndt.insert(wall, map_from_robot);
    });
    if !stands {
        walls::beside(hits, |wall| ndt.fill(wall, map_from_robot));
    }
    inserted
}

impl KeyScan {
    /// Takes the scan, whose points are at the front of `memory`, out of the reference.
    fn remove_from(&mut self, ndt: &mut NdtGrid<'_>, memory: &[Point2], reference: Reference) {
        let points = memory.get(..self.count).unwrap_or_default();
        let map_from_robot = self.taken.map_from_robot;
        ndt.remove(points, map_from_robot);
        if reference == Reference::RecentScans {
            walls::between(points, |wall| ndt.remove(wall, map_from_robot));
        }
        self.count = 0;
    }

    /// Becomes the scan with these `points`, as far as there is `memory` for them.
    pub(super) fn keep(&mut self, memory: &mut [Point2], points: &[Point2], taken: Taken) {
        *self = Self { taken, count: points.len().min(memory.len()), ..*self };
        memory.iter_mut().zip(points).for_each(|(to, from)| *to = *from);
    }
}

/// The place of the oldest scan that is kept, with the memory for its points; `None` if none is kept.
fn next_slot<'s>(
    scans: &'s mut [KeyScan],
    points: &'s mut [Point2],
    count: &mut usize,
) -> Option<(&'s mut KeyScan, &'s mut [Point2])> {
    let room = points.len().checked_div(scans.len())?;
    let slot = *count % scans.len();
    *count += 1;
    Some((scans.get_mut(slot)?, points.chunks_mut(room.max(1)).nth(slot)?))
}
