//! Earlier scans as witnesses: was a place free when they were taken?
//!
//! Who walks beside the robot stands where a moment ago nothing was. Such hits stay out of the reference, or it would
//! hold the robot back. A scan is a star-shaped free space about the laser, bounded by its hits; a hit well inside the free
//! space of two earlier scans, and near the border of none, moves; so does one that stands in the robot's frame where it stood for two
//! of them, though the robot has moved. What stands still is soon seen by them too, and then it is map.
//!
//! The same is asked before a scan is matched: who walks where somebody stood before him would draw the robot along a corridor in which nothing else
//! tells the place. So [what may walk](walking) says nothing about an axis about which the rest says little: what stands alone where one of them would have
//! seen it and did not. What comes into view round a corner, or where the laser's reach ends, may be a wall that has long been map.
//!
//! Where beams return nothing no witness has seen a place free. What [stands alone](super::lone) there may walk, and in a corridor longer
//! than the laser sees it is all that speaks about the way: it is map only once two of them have seen it stand.

#[cfg(test)]
mod tests;

use core::cell::Cell;

use super::KeyScan;
use super::lone::Objects;
use super::reference::Taken;
use crate::geometry::{Point2, Pose2};
use crate::time::{Duration, Instant};

/// A place nearer than this to what a witness saw is no longer free, m: more than errors of pose and range.
const CLEARANCE_M: f32 = 0.3;
/// Between two hits farther apart than this a witness has seen nothing, tangent of 0.06 rad: some beams of most lasers.
const GAP_TAN: f32 = 0.060_072_1;
/// Hits to each side of a place's bearing whose distance counts.
const NEIGHBOURS: usize = 3;
/// What the robot carries along, or what escorts it, is so near to where it was, as the robot sees it, m.
const CARRIED_M: f32 = 0.1;
/// So many witnesses must have seen a place free. Chosen.
const WITNESSES_MIN: usize = 2;
/// What stands alone has stood if it was so near to here, m …
const STOOD_M: f32 = 0.2;
/// … so long ago: who walks goes a metre in it. Both chosen.
const STOOD_FOR: Duration = Duration::from_millis(1000);
/// A robot that goes more than this share of how far it sees in a second cannot wait: it has passed what it sees before that has stood. Chosen.
const PASSED_SHARE: f32 = 0.2;
/// More witnesses than may be configured are not asked.
const WITNESSES_MAX: usize = 16;
/// Objects that may walk, at most; more are a crowd, and no corridor is bare then. Chosen.
const WALKING_MAX: usize = 8;
/// Points are the middle of a few hits: those of an object are so near to it, m.
const AROUND_M: f32 = 0.15;
/// A witness is taken after so much travel, m …
const APART_M: f32 = 0.5;
/// … or so much rotation, degrees. Both chosen, so that who keeps up with the robot has left his place.
const APART_DEG: f32 = 20.0;

/// What a witness says of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Testimony {
    /// It was free.
    Free,
    /// Something was near.
    Near,
    /// Not seen.
    None,
}

/// True if the robot has gone far enough since the last witness for another one.
pub(super) fn is_due(step: Pose2) -> bool {
    step.position().norm() >= APART_M || step.heading.abs() >= APART_DEG.to_radians()
}

/// True if the robot is slow enough to wait until what stands alone has been seen to stand. Told by the way since the newest witness that is behind:
/// stamps may come in bursts, and scans a millisecond apart say nothing of its speed.
fn can_wait(taken: &Taken, witnesses: &[KeyScan]) -> bool {
    let way_m = |from: &Taken| from.map_from_robot.between(taken.map_from_robot).position().norm();
    let taken_then = || witnesses.iter().filter(|witness| witness.count > 0).map(|witness| &witness.taken);
    // Who stands before the laser takes its view, not its reach.
    let farthest_m = taken_then().fold(taken.farthest_m, |most, then| then.farthest_m.max(most));
    let behind = taken_then().filter(|then| way_m(then) >= APART_M).max_by_key(|then| then.at);
    behind.is_none_or(|then| {
        let seconds = taken.at.since(then.at).as_secs_f32();
        seconds <= 0.0 || way_m(then) <= PASSED_SHARE * farthest_m * seconds
    })
}

/// Moves those of `hits` (robot frame, in beam order) that do not move to the front, in order; returns how many these are.
///
/// * `taken` — their scan
/// * `witnesses` — with the hits of each, robot frame, in beam order
pub(super) fn keep_standing(
    hits: &mut [Point2],
    taken: &Taken,
    witnesses: &[KeyScan],
    witness_points: &[Point2],
) -> usize {
    if witnesses.is_empty() {
        return hits.len();
    }
    let outlines = outlines(witnesses, witness_points);
    let mut objects = can_wait(taken, witnesses).then(|| Objects::new(taken)).flatten();
    let mut kept = 0;
    for index in 0..hits.len() {
        let is_alone = objects.as_mut().is_some_and(|objects| objects.is_alone(hits, index));
        let Some(hit) = hits.get(index).copied() else { break };
        let place = Place { in_map: taken.map_from_robot.transform(hit), in_robot: hit, is_alone };
        let moves = place.moves(taken.at, &outlines);
        if let Some(slot) = hits.get_mut(kept).filter(|_| !moves) {
            *slot = hit;
            kept += 1;
        }
    }
    kept
}

/// Objects that stand alone where a moment ago nothing was, as circles in the robot's frame.
#[derive(Debug, Default)]
pub(super) struct Walking {
    objects: heapless::Vec<(Point2, f32), WALKING_MAX>,
}

impl Walking {
    /// Moves those of `points` that are of these objects behind the others, which stay in order; returns how many these are.
    pub(super) fn part(&self, points: &mut [Point2]) -> usize {
        if self.objects.is_empty() {
            return 0;
        }
        let mut standing = 0;
        for index in 0..points.len() {
            let Some(point) = points.get(index).copied() else { break };
            if !self.objects.iter().any(|(centre, radius_m)| (point - *centre).norm() <= *radius_m) {
                points.swap(standing, index);
                standing += 1;
            }
        }
        points.len() - standing
    }
}

/// What stands alone among `hits` (robot frame, in beam order) where a witness would have seen it and did not, and has not been seen to stand, were the robot
/// where it is expected.
///
/// * `taken` — their scan, at that place
/// * `witnesses` — with the hits of each, robot frame, in beam order
pub(super) fn walking(hits: &[Point2], taken: &Taken, witnesses: &[KeyScan], witness_points: &[Point2]) -> Walking {
    let mut walking = Walking::default();
    if witnesses.is_empty() || !can_wait(taken, witnesses) {
        return walking;
    }
    let Some(mut objects) = Objects::new(taken) else { return walking };
    let outlines = outlines(witnesses, witness_points);
    let mut index = 0;
    while index < hits.len() && !walking.objects.is_full() {
        let is_alone = objects.is_alone(hits, index);
        let end = objects.end().max(index + 1);
        let object = hits.get(index..end).unwrap_or_default();
        if is_alone && let Some((first, last)) = object.first().zip(object.last()) {
            let centre = (*first + *last) * 0.5;
            let came = |hit: &Point2| {
                let in_map = taken.map_from_robot.transform(*hit);
                let (mut stood, mut missed) = (0, 0);
                for outline in &outlines {
                    stood += usize::from(outline.saw_stand(in_map, taken.at));
                    missed += usize::from(outline.missed(in_map, taken.at));
                }
                stood < WITNESSES_MIN && missed > 0
            };
            let walking_hits = object.iter().filter(|hit| came(hit)).count();
            if 2 * walking_hits > object.len() {
                // Cannot fail: it is not full.
                let _ = walking.objects.push((centre, 0.5 * (*last - *first).norm() + AROUND_M));
            }
        }
        index = end;
    }
    walking
}

/// What they say of `in_map` together: what one of them saw there is there.
pub(super) fn say(in_map: Point2, outlines: &[Outline<'_>]) -> Testimony {
    let mut says = Testimony::None;
    for outline in outlines {
        match outline.testimony(outline.place(in_map)) {
            Testimony::Near => return Testimony::Near,
            Testimony::Free => says = Testimony::Free,
            Testimony::None => {}
        }
    }
    says
}

/// What each of the witnesses saw.
///
/// * `points` — the hits of each, robot frame, in beam order
pub(super) fn outlines<'a>(
    witnesses: &'a [KeyScan],
    points: &'a [Point2],
) -> heapless::Vec<Outline<'a>, WITNESSES_MAX> {
    let room = points.len().checked_div(witnesses.len()).unwrap_or(0).max(1);
    let mut outlines = heapless::Vec::new();
    for (witness, points) in witnesses.iter().zip(points.chunks(room)).take(WITNESSES_MAX) {
        // Cannot fail: there is room for as many.
        let _ = outlines.push(Outline::new(&witness.taken, points.get(..witness.count).unwrap_or_default()));
    }
    outlines
}

/// Where a hit is.
struct Place {
    in_map: Point2,
    in_robot: Point2,
    /// Nothing is beside it.
    is_alone: bool,
}

impl Place {
    fn moves(&self, now: Instant, outlines: &[Outline<'_>]) -> bool {
        let (mut free, mut carried, mut stood) = (0, 0, 0);
        for outline in outlines {
            if self.is_alone {
                stood += usize::from(outline.saw_stand(self.in_map, now));
            } else {
                match outline.testimony(outline.place(self.in_map)) {
                    Testimony::Free => free += 1,
                    Testimony::Near => return false,
                    Testimony::None => {}
                }
            }
            carried += usize::from(outline.is_on(self.in_robot - outline.taken.eye));
        }
        carried >= WITNESSES_MIN || if self.is_alone { stood < WITNESSES_MIN } else { free >= WITNESSES_MIN }
    }
}

/// The hits of a scan as seen from its laser, and the lines between them.
pub(super) struct Outline<'a> {
    pub(super) taken: &'a Taken,
    pub(super) points: &'a [Point2],
    /// Where on the [way round](way_round) the first one is.
    start: f32,
    /// Index of the first hit behind the last place in the map …
    after_place: Cell<usize>,
    /// … and behind the last one in the robot's frame. The next place is mostly near.
    after_carried: Cell<usize>,
}

impl<'a> Outline<'a> {
    /// * `points` — its hits, robot frame, in beam order
    pub(super) fn new(taken: &'a Taken, points: &'a [Point2]) -> Self {
        let start = points.first().map_or(0.0, |first| way_round(*first - taken.eye));
        Self { taken, points, start, after_place: Cell::default(), after_carried: Cell::default() }
    }

    /// Beams go round once, counter-clockwise, from the first one on: how far round a point is, in quarters of a turn.
    fn turned(&self, point: Point2) -> f32 {
        let quarters = way_round(point) - self.start;
        // The first one again, but for rounding.
        let before_first = -1e-3;
        if quarters < before_first {
            quarters + 4.0
        } else if quarters >= 4.0 + before_first {
            quarters - 4.0
        } else {
            quarters
        }
    }

    /// Index of the first hit behind the bearing of `place`, looked for about where that of the last one was.
    fn after(&self, place: Point2, last: &Cell<usize>) -> usize {
        let bearing = self.turned(place);
        let is_before = |point: &Point2| self.turned(*point - self.taken.eye) <= bearing;
        last.set(partition_point_near(self.points, last.get(), is_before));
        last.get()
    }

    /// Neighbouring hits about index `after`, as seen from the laser, each with the index of its first one.
    fn lines(&self, after: usize) -> impl Iterator<Item = (usize, Point2, Point2)> {
        let first = after.saturating_sub(NEIGHBOURS);
        let near = self.points.get(first..self.points.len().min(after + NEIGHBOURS)).unwrap_or_default();
        near.windows(2).enumerate().filter_map(move |(index, pair)| {
            let &[a, b] = pair else { return None };
            Some((first + index, a - self.taken.eye, b - self.taken.eye))
        })
    }

    /// A place in the map as seen from its laser.
    pub(super) fn place(&self, in_map: Point2) -> Point2 {
        self.taken.map_from_robot.inverse().transform(in_map) - self.taken.eye
    }

    /// True if something was at a place in the map so long before `now` that it has stood.
    fn saw_stand(&self, in_map: Point2, now: Instant) -> bool {
        now.since(self.taken.at) >= STOOD_FOR && self.has_hit_at(self.place(in_map))
    }

    /// True if nothing was at a place in the map so long before `now`, though it would have been seen there.
    fn missed(&self, in_map: Point2, now: Instant) -> bool {
        let place = self.place(in_map);
        let after = self.after(place, &self.after_place);
        let before = after.checked_sub(1).and_then(|index| self.points.get(index));
        let Some((a, b)) = before.zip(self.points.get(after)) else { return false };
        let (a, b) = (*a - self.taken.eye, *b - self.taken.eye);
        let is_seen = see_between(a, b);
        let sees_m = if is_seen { a.norm().min(b.norm()) } else { self.taken.farthest_m };
        now.since(self.taken.at) >= STOOD_FOR && place.norm() + CLEARANCE_M < sees_m && !self.has_hit_at(place)
    }

    /// True if something was hit at `place`; the line between two hits is nothing that was.
    fn has_hit_at(&self, place: Point2) -> bool {
        let mut lines = self.lines(self.after(place, &self.after_place));
        lines.any(|(_, a, b)| (place - a).norm() < STOOD_M || (place - b).norm() < STOOD_M)
    }

    /// True if a hit stood at `place`.
    fn is_on(&self, place: Point2) -> bool {
        self.lines(self.after(place, &self.after_carried)).any(|(_, a, b)| {
            let is_seen = see_between(a, b);
            distance(place, a, if is_seen { b } else { a }) < CARRIED_M
        })
    }

    /// What the scan says of `place`, as seen from its laser.
    pub(super) fn testimony(&self, place: Point2) -> Testimony {
        let after = self.after(place, &self.after_place);
        let mut says = Testimony::None;
        for (index, a, b) in self.lines(after) {
            let is_seen = see_between(a, b);
            if distance(place, a, if is_seen { b } else { a }) < CLEARANCE_M || (place - b).norm() < CLEARANCE_M {
                return Testimony::Near;
            }
            if index + 1 == after && is_seen && is_before(place, a, b) {
                says = Testimony::Free;
            }
        }
        says
    }
}

/// As `partition_point` of a slice, looked for about `near`, twice as far each time: O(log of how far it is from there).
fn partition_point_near<T>(items: &[T], near: usize, is_before: impl Fn(&T) -> bool) -> usize {
    let says = |index: usize| items.get(index).map(&is_before);
    let near = near.min(items.len());
    let (mut low, mut high, mut reach) = (0, items.len(), 1_usize);
    if says(near) == Some(true) {
        low = near + 1;
        while let Some(is_before) = says(near.saturating_add(reach)) {
            if !is_before {
                high = near + reach;
                break;
            }
            low = near + reach + 1;
            reach = reach.saturating_mul(2);
        }
    } else {
        high = near;
        while let Some(is_before) = near.checked_sub(reach).and_then(says) {
            if is_before {
                low = near - reach + 1;
                break;
            }
            high = near - reach;
            reach = reach.saturating_mul(2);
        }
    }
    low + items.get(low..high).unwrap_or_default().partition_point(is_before)
}

/// How far round a direction is in quarters of a turn, counter-clockwise, −1 (right) to 3: in the order of bearings, at less cost.
fn way_round(point: Point2) -> f32 {
    let size = point.x.abs() + point.y.abs();
    let side = if size > 0.0 { point.y / size } else { 0.0 };
    if point.x < 0.0 { 2.0 - side } else { side }
}

/// True if the scan saw what is between two hits beside each other, as seen from its laser.
fn see_between(a: Point2, b: Point2) -> bool {
    let (cross, dot) = (a.x * b.y - a.y * b.x, a.x * b.x + a.y * b.y);
    dot > 0.0 && cross <= GAP_TAN * dot
}

/// Distance of a point from the line between `a` and `b`.
fn distance(point: Point2, a: Point2, b: Point2) -> f32 {
    let (line, to) = (b - a, point - a);
    let length2 = line.x * line.x + line.y * line.y;
    let share = if length2 > 0.0 { ((to.x * line.x + to.y * line.y) / length2).clamp(0.0, 1.0) } else { 0.0 };
    (to - line * share).norm()
}

/// True if `point` is on the origin's side of the line through `a` and `b`.
fn is_before(point: Point2, a: Point2, b: Point2) -> bool {
    let line = b - a;
    let side = |from: Point2| line.x * (from.y - a.y) - line.y * (from.x - a.x);
    side(point) * side(Point2::default()) > 0.0
}
