//! Scan matching: the pose at which a scan agrees best with an NDT, found by differential evolution (thesis §4.4.1).
//!
//! Prediction → local optimum near it → DE over the whole search box, starting from both → polished by Newton steps →
//! [`Match`] with score, covariance and the axis that the scene leaves undetermined.
//!
//! Everything is in the robot's frame: points come with the mounting of the laser already applied, so that the result
//! is the robot's displacement and not the laser's (thesis §4.4 warns of the difference).

mod along;
mod covariance;
mod objective;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix3, Vector3};
use rand_core::Rng;

use crate::de::{self, Bounds, DeConfig, Member};
use crate::geometry::{Point2, Pose2};
use crate::math::{clamp, hypot};
use crate::ndt::NdtGrid;
use along::Settled;
use covariance::{NOTHING_KNOWN, covariance};
use objective::{Objective, Prior, Summit};

/// Most points that `search_points` can ask for.
const SEARCH_POINTS_MAX: usize = 256;
/// Some of a scan's points. Lent by whoever needs them: a microcontroller's stack has no room for copies.
type Chosen = heapless::Vec<Point2, SEARCH_POINTS_MAX>;
/// Candidates of the search that are polished, best first, each apart from the others. Chosen: the true optimum is among the first
/// three where a search finds it at all.
const NEWTON_STARTS: usize = 3;
/// Candidates farther from one another than this, m, …
const APART_M: f32 = 0.05;
/// … or than this, rad, climb to optima of their own.
const APART_RAD: f32 = 0.01;
/// An axis about which the matched points say less than this is reported as undetermined: 0 for parallel walls without any feature,
/// 0.5 for walls in all directions seen as sharply as the laser can. Chosen.
pub const CONSTRAINT_MIN: f32 = 0.03;
/// A robot that is not where it was expected is searched for so far in every direction, m: chosen for a robot that is carried a step.
const LOST_DISTANCE_M: f32 = 2.0;
/// And so far to each side, degrees: chosen.
const LOST_ROTATION_DEG: f32 = 100.0;
/// Newton steps of a match without a search, at most: it converges in a few.
const LOCAL_STEPS: u16 = 50;

crate::config! {
    /// Box around the prediction in which a match is searched (thesis table 4.4), robot frame.
    pub struct SearchConfig {
        /// Backward, m. Thesis table 4.4: 0.50.
        backward_m: f32 = 0.5, in 0.0..=10.0;
        /// Forward, m. Thesis table 4.4: 1.00.
        forward_m: f32 = 1.0, in 0.0..=10.0;
        /// To each side, m. Thesis table 4.4: 0.25.
        lateral_m: f32 = 0.25, in 0.0..=10.0;
        /// To each side, degrees. Thesis table 4.4: 20.
        rotation_deg: f32 = 20.0, in 0.0..=180.0;
    }
}

crate::config! {
    /// Scan matcher.
    pub struct MatcherConfig {
        /// Points that the search looks at, at most, spread evenly over the scan; what it finds is polished with all of them. Time of
        /// the search is in proportion. 0: all, as the thesis does.
        search_points: u16 = 0, in 0..=256;
        /// Newton steps that polish the result of the search; 0 takes DE's answer as it is, as the thesis does.
        newton_steps: u16 = 12, in 0..=100;
        /// Spread of the prediction's error per scan along and across, m: how far the robot is expected to depart from its
        /// predicted motion. Counts against distant matches. 0 switches it off, as the thesis does.
        prior_position_m: f32 = 0.15, in 0.0..=100.0;
        /// The same for the heading, degrees.
        prior_heading_deg: f32 = 10.0, in 0.0..=360.0;
    }
}

crate::config! {
    /// What is done when a scan agrees with the reference much less than the scans before it.
    pub struct RecoveryConfig {
        /// A score per point below this share of the usual one means that the robot is not where it was expected. 0 switches
        /// recovery off, as the thesis does.
        lost_share: f32 = 0.5, in 0.0..=1.0;
        /// Population of the wider search that follows.
        population: u16 = 300, in 4..=1000;
        /// And as many generations.
        generations: u16 = 60, in 1..=1000;
        /// Points that this search looks at, as `matcher.search_points` for the usual one. 0: all.
        search_points: u16 = 0, in 0..=256;
    }
}

impl SearchConfig {
    /// The box `times` as large, all the way round at most.
    fn wider(&self, times: f32) -> Self {
        Self {
            backward_m: times * self.backward_m,
            forward_m: times * self.forward_m,
            lateral_m: times * self.lateral_m,
            rotation_deg: (times * self.rotation_deg).min(180.0),
        }
    }
}

/// Where a scan was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Pose of the robot at which the scan agrees best with the reference.
    pub map_from_robot: Pose2,
    /// Eq. (4.42) there: 0 to the number of points.
    pub score: f32,
    /// Score per point, 0 to 1.
    pub score_per_point: f32,
    /// A − score, eq. (4.43).
    pub fitness: f32,
    /// Generations that DE used.
    pub generations: u16,
    /// True if the fitness fell below DE's `stop_fitness`.
    pub converged: bool,
    /// Covariance of (x, y, heading), map frame; m², m rad, rad². Of the match against its reference: not of the reference's own
    /// place, nor of a match at a wrong optimum.
    pub covariance: Matrix3<f32>,
    /// How much the scene says about its least determined axis, 0 (nothing) to 0.5; see [`NdtGrid::constraint`].
    pub constraint: f32,
    /// That axis: a unit vector in the map.
    pub weakest_axis: Point2,
    /// Direction in the map (unit vector) about which the scene says nothing, e.g. along a featureless corridor.
    pub undetermined: Option<Point2>,
    /// How much the match counts along that axis, 0 (the prediction alone) to 1.
    pub gain: f32,
}

impl Match {
    /// No match: nothing is known about the robot but that it was last at `map_from_robot`.
    pub(crate) fn none(map_from_robot: Pose2) -> Self {
        Self {
            map_from_robot,
            score: 0.0,
            score_per_point: 0.0,
            fitness: 0.0,
            generations: 0,
            converged: false,
            covariance: Matrix3::from_diagonal_element(NOTHING_KNOWN),
            constraint: 0.0,
            weakest_axis: Point2::default(),
            undetermined: None,
            gain: 0.0,
        }
    }
}

/// What a scan is matched from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Where the robot is expected.
    pub map_from_robot: Pose2,
    /// A of eq. (4.43): the score that a perfect match of this many points would reach.
    pub score_expected: f32,
    /// The robot may be so many times as far from there as the box of the configuration says.
    pub spread: f32,
    /// How far from there it is likely to be.
    pub prior: PriorSpread,
    /// The last so many points are of what may walk: they say nothing about an axis about which the others say little.
    pub walking: usize,
}

impl Prediction {
    /// Box and prior as the configuration has them.
    pub fn usual(map_from_robot: Pose2, score_expected: f32) -> Self {
        Self {
            map_from_robot,
            score_expected,
            spread: 1.0,
            prior: PriorSpread { position: 1.0, heading: 1.0 },
            walking: 0,
        }
    }
}

/// How wide the prior of a match is: so many times the configured deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PriorSpread {
    /// In position.
    pub position: f32,
    /// In heading.
    pub heading: f32,
}

impl PriorSpread {
    /// No place is likelier than another one.
    pub const NONE: Self = Self { position: f32::INFINITY, heading: f32::INFINITY };
}

/// How a place is searched for.
struct Effort {
    search: SearchConfig,
    de: DeConfig,
    /// At most so many of the scan; 0: all.
    points: u16,
}

/// Matches scans; see the [module](self).
#[derive(Debug)]
pub struct ScanMatcher<'m> {
    search: SearchConfig,
    de: DeConfig,
    config: MatcherConfig,
    population: &'m mut [Member<3>],
}

impl<'m> ScanMatcher<'m> {
    /// `population` is the memory for DE: `de.population` members, or fewer if that is all there is.
    pub fn new(search: &SearchConfig, de: &DeConfig, config: &MatcherConfig, population: &'m mut [Member<3>]) -> Self {
        Self { search: *search, de: *de, config: *config, population }
    }

    /// Finds `points` (robot frame) in `ndt`, in the box of table 4.4 about the prediction.
    pub fn align(
        &mut self,
        ndt: &NdtGrid<'_>,
        points: &[Point2],
        prediction: &Prediction,
        rng: &mut impl Rng,
    ) -> Match {
        let prior = Prior::new(&self.config, prediction);
        let (search, de) = (self.search.wider(prediction.spread), self.de);
        let effort = Effort { search, de, points: self.config.search_points };
        self.search_and_polish(&effort, &Objective::new(ndt, points, prior), prediction, rng)
    }

    /// Finds `points` in a wider box: for a robot that is not where it was expected. To prefer no place in it, see [`PriorSpread::NONE`].
    pub fn align_anywhere(
        &mut self,
        ndt: &NdtGrid<'_>,
        points: &[Point2],
        prediction: &Prediction,
        recovery: &RecoveryConfig,
        rng: &mut impl Rng,
    ) -> Match {
        let prior = Prior::new(&self.config, prediction);
        let search = SearchConfig {
            backward_m: LOST_DISTANCE_M,
            forward_m: LOST_DISTANCE_M,
            lateral_m: LOST_DISTANCE_M,
            rotation_deg: LOST_ROTATION_DEG,
        }
        .wider(prediction.spread);
        let de = DeConfig { population: recovery.population, generations: recovery.generations, ..self.de };
        let effort = Effort { search, de, points: recovery.search_points };
        self.search_and_polish(&effort, &Objective::new(ndt, points, prior), prediction, rng)
    }

    /// Local optimum near the prediction, the best of the box, and of these two, polished, the better one.
    fn search_and_polish(
        &mut self,
        effort: &Effort,
        objective: &Objective<'_, '_>,
        prediction: &Prediction,
        rng: &mut impl Rng,
    ) -> Match {
        let steps = self.config.newton_steps;
        let near = objective.climb(prediction.map_from_robot, steps);
        let outcome = self.search_box(effort, objective, prediction, near.pose, rng);
        let [forward, lateral, rotation] = outcome.best.genes;
        let found = prediction.map_from_robot * Pose2::new(forward, lateral, rotation);
        let mut best = Summit { pose: found, value: f32::NEG_INFINITY };
        if steps > 0 {
            best = if near.value > best.value { near } else { best };
            for start in candidates(self.population, outcome.population) {
                let [forward, lateral, rotation] = start;
                let summit = objective.climb(prediction.map_from_robot * Pose2::new(forward, lateral, rotation), steps);
                best = if summit.value > best.value { summit } else { best };
            }
        }
        report(objective, prediction, &along::settle(objective, prediction.walking, best.pose), &outcome)
    }

    /// Newton from the prediction alone, without the search: what scan matching is without DE.
    pub fn align_locally(&self, ndt: &NdtGrid<'_>, points: &[Point2], prediction: &Prediction) -> Pose2 {
        let prior = Prior::new(&self.config, prediction);
        Objective::new(ndt, points, prior).climb(prediction.map_from_robot, LOCAL_STEPS).pose
    }

    /// DE over the box of table 4.4, in the robot's frame about the prediction.
    fn search_box(
        &mut self,
        Effort { search, de, points }: &Effort,
        objective: &Objective<'_, '_>,
        prediction: &Prediction,
        near: Pose2,
        rng: &mut impl Rng,
    ) -> de::Outcome<3> {
        let rotation = search.rotation_deg.to_radians();
        let bounds = Bounds {
            low: [-search.backward_m, -search.lateral_m, -rotation],
            high: [search.forward_m, search.lateral_m, rotation],
        };
        let step = prediction.map_from_robot.between(near);
        let mut start = [step.x, step.y, step.heading];
        for (gene, (low, high)) in start.iter_mut().zip(bounds.low.iter().zip(&bounds.high)) {
            *gene = clamp(*gene, *low, *high);
        }
        let expected = prediction.score_expected;
        let mut chosen = Chosen::new();
        spread(objective.points, *points, &mut chosen);
        let objective = if chosen.is_empty() { *objective } else { objective.of_some(&chosen) };
        de::minimise(de, &bounds, start, self.population, rng, |genes, limit| {
            let [forward, lateral, rotation] = *genes;
            let pose = prediction.map_from_robot * Pose2 { x: forward, y: lateral, heading: rotation };
            expected - objective.value(pose, expected - limit)
        })
    }
}

/// What the search has found.
fn report(
    objective: &Objective<'_, '_>,
    prediction: &Prediction,
    &Settled { pose, axis, constraint, variance_m2, gain }: &Settled,
    outcome: &de::Outcome<3>,
) -> Match {
    let (at, scatter) = objective.ndt.linearise_with_scatter(objective.points, pose);
    let count = objective.points.len().max(1) as f32;
    let undetermined = (constraint < CONSTRAINT_MIN).then_some(axis);
    let mut covariance = covariance(&at, &scatter);
    if let Some(axis) = undetermined {
        // Cells cut a smooth wall up and make an optimum where the scene has none: what the scene says is all there is.
        let along = Vector3::new(axis.x, axis.y, 0.0);
        covariance += along * along.transpose() * variance_m2;
    }
    Match {
        map_from_robot: pose,
        score: at.score,
        score_per_point: at.score / count,
        fitness: prediction.score_expected - at.score,
        generations: outcome.generations,
        converged: outcome.converged,
        covariance,
        constraint,
        weakest_axis: axis,
        undetermined,
        gain,
    }
}

/// The best members of a population that lie apart from one another, best first.
fn candidates(population: &[Member<3>], size: usize) -> heapless::Vec<[f32; 3], NEWTON_STARTS> {
    let mut chosen = heapless::Vec::<[f32; 3], NEWTON_STARTS>::new();
    for _ in 0..NEWTON_STARTS {
        let apart = |member: &&Member<3>| chosen.iter().all(|other| is_apart(&member.genes, other));
        let best = population.iter().take(size).filter(apart).min_by(|a, b| a.fitness.total_cmp(&b.fitness));
        // There is room for as many as the loop has rounds.
        let Some(Ok(())) = best.map(|member| chosen.push(member.genes)) else { break };
    }
    chosen
}

/// Too far apart for Newton's method to climb to the same optimum as a matter of course.
fn is_apart(a: &[f32; 3], b: &[f32; 3]) -> bool {
    let ([ax, ay, ah], [bx, by, bh]) = (a, b);
    hypot(ax - bx, ay - by) > APART_M || (ah - bh).abs() > APART_RAD
}

/// Fills `chosen` with so many of the points, spread evenly; none if all are to be looked at.
fn spread(points: &[Point2], count: u16, chosen: &mut Chosen) {
    let count = usize::from(count).min(SEARCH_POINTS_MAX);
    let every = if count < points.len() { count } else { 0 };
    for point in (0..every).filter_map(|i| points.get(i * points.len() / every)) {
        // There is room for as many as `count` may be.
        let _ = chosen.push(*point);
    }
}
