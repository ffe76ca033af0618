//! The place along an axis that the scene says little about, as along a corridor: what tells it, and where it is.
//!
//! How far the laser sees is no feature of the building, but looks like one. The farthest hits on a corridor's walls lie beyond what has been seen of
//! these walls so far, where no cell is, or one that is half covered; they would all agree better a little farther back. So a robot that
//! drives would be drawn to where it was. Only hits count that have known wall to both sides, or lie on a wall across the axis.

use nalgebra::Matrix3;

use super::objective::{Objective, Summit};
use super::{Chosen, SEARCH_POINTS_MAX, spread};
use crate::geometry::{Point2, Pose2};
use crate::math::{atan2, hypot, sin_cos};
use crate::ndt::{Linearisation, NdtGrid, SHARP_M};

/// An axis about which the matched points say less than this is not fully believed but drawn towards the prediction, where there is a prior.
/// Chosen; the thesis believes every match.
const CONSTRAINT_TRUSTED: f32 = 0.25;
/// Variance along an axis about which nothing is told, m²: more would spill over onto the other axis, as its direction is known to a tenth of a
/// degree. Chosen.
const ALONG_MAX_M2: f32 = 25.0;
/// Hits this near to where the known part of their wall ends tell nothing, m: how far a match may be moved, and a cell. Chosen.
const EDGE_M: f32 = 0.6;
/// Hits are chosen where all of them say less about the axis than this, as along corridors: elsewhere what is left out tells more than it holds
/// back. Chosen.
const TELLING_BELOW: f32 = 0.12;
/// If fewer hits than this tell something, all are asked: what is left of a few hits is noise. Chosen.
const TELLING_MIN: usize = 16;
/// A wall is across the axis if its worth there is greater by this than along itself. Chosen.
const ACROSS_MIN: f32 = 0.15;
/// Climbs begin so far apart about the prediction, m …
const STARTS_APART_M: f32 = 0.15;
/// … up to so many of them to each side. Both chosen.
const STARTS: i16 = 2;
/// Newton steps of a climb, at most …
const STEPS: u16 = 10;
/// … until one is no longer than this, m.
const STEP_MIN_M: f32 = 1e-4;
/// Where the score does not curve downwards its curvature is taken to be this share of what all points together could make it.
const CURVATURE_SHARE_MIN: f32 = 0.2;

/// Where a search has ended.
pub(super) struct Settled {
    pub(super) pose: Pose2,
    /// The weakest one, and how much the scene says about it.
    pub(super) axis: Point2,
    pub(super) constraint: f32,
    /// Of the match along it, m².
    pub(super) variance_m2: f32,
    /// How much the match counts there against the prediction, 0 to 1.
    pub(super) gain: f32,
}

/// Where the robot is along the weakest axis: where the points that tell it say, drawn towards the prediction, the more the less they say.
///
/// A Kalman update on that axis: the prediction has the prior's variance, the match that of [`variance_along`].
///
/// * `walking` — the last so many points are not asked: who walks would take the robot along
#[inline(never)]
pub(super) fn settle(objective: &Objective<'_, '_>, walking: usize, pose: Pose2) -> Settled {
    let standing = objective.points.len().saturating_sub(walking);
    let objective = &Objective { points: objective.points.get(..standing).unwrap_or_default(), ..*objective };
    let (axis, constraint) = weakest_axis(objective, pose);
    let prior = &objective.prior;
    if prior.position <= 0.0 || constraint >= CONSTRAINT_TRUSTED {
        let variance_m2 = variance_along(constraint, objective.points.len());
        return Settled { pose, axis, constraint, variance_m2, gain: 1.0 };
    }
    let mut telling = Chosen::new();
    // Where much is told the edges hold nobody back; and a laser of few beams sees no more than a few hits anyway.
    if constraint < TELLING_BELOW {
        choose_telling(objective.ndt, objective.points, pose, axis, &mut telling);
    }
    let (points, pose) = if telling.len() < TELLING_MIN {
        // Those that walk were in the search.
        (objective.points, if walking > 0 { climb(objective, pose, axis).pose } else { pose })
    } else {
        (telling.as_slice(), climb(&Objective { points: &telling, ..*objective }, pose, axis).pose)
    };
    let [xx, xy, yy] = objective.ndt.constraint(points, pose);
    let constraint = axis.x * axis.x * xx + 2.0 * axis.x * axis.y * xy + axis.y * axis.y * yy;
    let variance_m2 = variance_along(constraint, points.len());
    let gain = 1.0 / (1.0 + variance_m2 * prior.position);
    let back = (gain - 1.0) * departure(prior.predicted, pose, axis);
    Settled { pose: moved(pose, axis, back), axis, constraint, variance_m2, gain }
}

/// The axis that the matched points say least about, and how much they say about it.
#[inline(never)]
fn weakest_axis(objective: &Objective<'_, '_>, pose: Pose2) -> (Point2, f32) {
    let [xx, xy, yy] = objective.ndt.constraint(objective.points, pose);
    // The eigenvector of the larger eigenvalue is at half the angle of (xx − yy, 2 xy); ours stands across it.
    let (sin, cos) = sin_cos(0.5 * atan2(2.0 * xy, xx - yy));
    (Point2::new(-sin, cos), 0.5 * (xx + yy) - hypot(0.5 * (xx - yy), xy))
}

/// Variance along an axis that the scene says little about, m²: that of a wall (4 cm) over the number of points that speak about
/// the axis, which is far too optimistic for very few points and therefore raised by ([`CONSTRAINT_TRUSTED`] / constraint)².
fn variance_along(constraint: f32, points: usize) -> f32 {
    let doubt = CONSTRAINT_TRUSTED / constraint.max(1e-6);
    let speaking = constraint.max(1e-6) * points.max(1) as f32;
    (SHARP_M * SHARP_M / speaking * doubt * doubt).min(ALONG_MAX_M2)
}

/// How far along the axis the known part of a wall goes as seen from the robot, m.
#[derive(Debug, Clone, Copy)]
struct Extent {
    from: f32,
    to: f32,
}

impl Extent {
    const NONE: Self = Self { from: f32::INFINITY, to: f32::NEG_INFINITY };
}

/// Fills `chosen` with those of `points` (robot frame; not all of a great many) that tell something about `axis` (map) at `pose`.
#[inline(never)]
fn choose_telling(ndt: &NdtGrid<'_>, points: &[Point2], pose: Pose2, axis: Point2, chosen: &mut Chosen) {
    spread(points, SEARCH_POINTS_MAX as u16, chosen);
    if chosen.is_empty() {
        // `spread` leaves it empty if there is room for all.
        let _ = chosen.extend_from_slice(points);
    }
    // Left and right of the axis.
    let mut walls = [Extent::NONE; 2];
    for point in chosen.iter() {
        let at = Along::new(ndt, *point, pose, axis);
        if at.is_known
            && !at.is_across
            && let Some(wall) = walls.get_mut(at.side)
        {
            *wall = Extent { from: wall.from.min(at.along_m), to: wall.to.max(at.along_m) };
        }
    }
    chosen.retain(|point| {
        let at = Along::new(ndt, *point, pose, axis);
        let wall = walls.get(at.side).copied().unwrap_or(Extent::NONE);
        at.is_across || (wall.from + EDGE_M..=wall.to - EDGE_M).contains(&at.along_m)
    });
}

/// Where a hit lies, seen along the axis.
struct Along {
    along_m: f32,
    side: usize,
    is_known: bool,
    is_across: bool,
}

impl Along {
    #[inline(never)]
    fn new(ndt: &NdtGrid<'_>, point: Point2, pose: Pose2, axis: Point2) -> Self {
        let in_map = pose.transform(point);
        let from_robot = in_map - pose.position();
        let worth = ndt.worth_at(in_map);
        let [xx, xy, yy] = worth.unwrap_or_default();
        let across = 0.5 * (xx - yy) * (axis.x * axis.x - axis.y * axis.y) + 2.0 * xy * axis.x * axis.y;
        Self {
            along_m: axis.x * from_robot.x + axis.y * from_robot.y,
            side: usize::from(axis.x * from_robot.y - axis.y * from_robot.x >= 0.0),
            is_known: worth.is_some(),
            is_across: across > ACROSS_MIN,
        }
    }
}

/// The best place along `axis`, and its value: the better one of the summits next to `pose` and about the prediction.
fn climb(objective: &Objective<'_, '_>, pose: Pose2, axis: Point2) -> Summit {
    let departure_m = departure(objective.prior.predicted, pose, axis);
    let mut best = climb_from(objective, pose, axis);
    for start in -STARTS..=STARTS {
        let summit = climb_from(objective, moved(pose, axis, f32::from(start) * STARTS_APART_M - departure_m), axis);
        best = if summit.value > best.value { summit } else { best };
    }
    best
}

/// Newton's method along the axis; a step that does not climb is halved.
#[inline(never)]
fn climb_from(objective: &Objective<'_, '_>, start: Pose2, axis: Point2) -> Summit {
    let mut best = Summit { pose: start, value: f32::NEG_INFINITY };
    let mut step_m = 0.0_f32;
    for _ in 0..STEPS {
        let pose = moved(best.pose, axis, step_m);
        let at = objective.ndt.linearise(objective.points, pose);
        let value = at.score - objective.prior.penalty(pose);
        if value > best.value {
            best = Summit { pose, value };
            step_m = newton_step_m(objective, &at, pose, axis);
        } else {
            step_m *= 0.5;
        }
        if step_m.abs() <= STEP_MIN_M {
            break;
        }
    }
    best
}

#[inline(never)]
fn newton_step_m(objective: &Objective<'_, '_>, at: &Linearisation, pose: Pose2, axis: Point2) -> f32 {
    let prior = &objective.prior;
    let slope = axis.x * at.gradient.x + axis.y * at.gradient.y;
    let gradient = slope - prior.position * departure(prior.predicted, pose, axis);
    let along = |matrix: &Matrix3<f32>| {
        let [xx, xy, yy] = [matrix.m11, matrix.m12, matrix.m22];
        axis.x * axis.x * xx + 2.0 * axis.x * axis.y * xy + axis.y * axis.y * yy
    };
    let curvature = along(&at.hessian).max(CURVATURE_SHARE_MIN * along(&at.information));
    gradient / (curvature + prior.position).max(f32::MIN_POSITIVE)
}

/// How far `pose` is from `predicted` along the axis, m.
fn departure(predicted: Pose2, pose: Pose2, axis: Point2) -> f32 {
    axis.x * (pose.x - predicted.x) + axis.y * (pose.y - predicted.y)
}

/// `pose` so far on along the axis.
fn moved(pose: Pose2, axis: Point2, by_m: f32) -> Pose2 {
    Pose2 { x: pose.x + by_m * axis.x, y: pose.y + by_m * axis.y, ..pose }
}

#[cfg(test)]
mod tests;
