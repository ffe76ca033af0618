//! Finding closures: places that the robot has come back to, verified strictly.
//!
//! The submap of the latest segments is searched in the submaps of older ones, within what the graph leaves uncertain. A wrong
//! closure wrecks a map, a missing one is mostly found a segment later; so every doubt is a refusal:
//!
//! 1. its pose is the best of the whole window ([`CorrelationGrid`]), and there is no second one nearly as good elsewhere;
//! 2. enough points lie on the other's walls, and few in its free space, both ways ([`Submap::agreement`]);
//! 3. the walls that meet determine every axis ([`NdtGrid::constraint`]); along one that few of them speak of, as in a corridor, the
//!    closure pulls weakly;
//! 4. if the window was wide, a second segment must say the same ([`Closer::confirmed`]);
//! 5. the graph can be solved with it ([`super::pose_graph`]).

use lrfslam_core::de::{DeConfig, Member};
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::matcher::{MatcherConfig, Prediction, ScanMatcher, SearchConfig};
use lrfslam_core::ndt::{DirectoryEntry, NdtConfig, NdtGrid, NdtTile};
use nalgebra::{Matrix3, Vector3};

use super::correlation::{CorrelationGrid, Excluded, SearchWindow};
use super::pose_graph::Edge;
use super::submap::{POINTS_APART_M, Submap};
use crate::pose_f64::PoseF64;

lrfslam_core::config! {
    /// Closing of loops.
    pub struct ClosureConfig {
        /// Look for places that the robot has come back to.
        enabled: bool = true;
        /// Hits farther away are not used for it, m.
        range_max_m: f32 = 20.0, in 1.0..=200.0;
    }
}

/// Share of points that must lie on the other's walls: chosen, strict.
const ON_WALLS_MIN: f32 = 0.6;
/// Share of points in known places that may stand in free space: chosen.
pub(crate) const CONTRADICTING_MAX: f32 = 0.1;
/// A second pose with this share of the best one's score is a doubt …
const SECOND_SHARE_MAX: f32 = 0.85;
/// … unless so many times more of the points fit nowhere there, …
const SECOND_MISFITS_MIN: f32 = 2.0;
/// … and so many more, as a share of all: nearly all of a corridor's points fit everywhere along it. All three chosen.
const SECOND_MISFITS_MORE: f32 = 0.05;
/// Points of the submap that are used.
const QUERY_POINTS: usize = 300;
/// A second pose so far from the best one, m …
const SECOND_APART_M: f32 = 1.0;
/// … or so far turned, rad, is another one.
const SECOND_APART_RAD: f32 = 0.2;
/// The optimum of the cells is that of the search if it is nearer than this, m …
const REFINED_WITHIN_M: f32 = 0.3;
/// … and this, rad.
const REFINED_WITHIN_RAD: f32 = 0.05;
/// Least worth of the walls that meet for any axis, 0 to 0.5; see [`NdtGrid::constraint`]. Below that the axis is weak …
const CONSTRAINT_MIN: f32 = 0.06;
/// … and below this nothing is known of it: no closure. Both chosen.
const CONSTRAINT_NONE: f32 = 0.015;
/// A closure that moves the robot by more than this, m, needs a second one that agrees …
const ALONE_M: f32 = 1.0;
/// … within this, m …
const AGREEMENT_M: f32 = 0.4;
/// … and this, degrees.
const AGREEMENT_DEG: f32 = 3.0;
/// Standard deviation of a closure's position, m: chosen, that of two submaps put together …
const SIGMA_M: f32 = 0.05;
/// … along a weak axis, m …
const SIGMA_WEAK_M: f32 = 0.3;
/// … and of its heading, degrees.
const SIGMA_DEG: f32 = 0.3;

/// A place that the robot may have come back to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closure {
    /// Node of the older place.
    pub older: usize,
    /// Node of the newer one.
    pub newer: usize,
    /// The newer seen from the older.
    pub older_from_newer: PoseF64,
    /// By how much that moves the newer node, m.
    pub moves_m: f32,
    /// Unit vector, frame of the older node, along which the walls say little.
    pub weak_axis: Option<Point2>,
}

/// Where one submap lies in another.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// The one's frame in the other's.
    pub pose: Pose2,
    /// See [`Closure::weak_axis`].
    pub weak_axis: Option<Point2>,
}

impl Closure {
    /// True if it would still move the newer node so far that it needs a second one.
    ///
    /// * `nodes` — the graph's nodes
    pub fn contradicts(&self, nodes: &[PoseF64]) -> bool {
        let told = nodes[self.older].between(nodes[self.newer]);
        told.between(self.older_from_newer).distance_m() > f64::from(ALONE_M)
    }

    /// As an edge of the graph.
    pub fn edge(&self) -> Edge {
        let inverse_square = |sigma: f32| 1.0 / (f64::from(sigma) * f64::from(sigma));
        let position = inverse_square(SIGMA_M);
        let heading = inverse_square(SIGMA_DEG.to_radians());
        let mut information = Matrix3::from_diagonal(&Vector3::new(position, position, heading));
        if let Some(axis) = self.weak_axis {
            let axis = Vector3::new(f64::from(axis.x), f64::from(axis.y), 0.0);
            information -= axis * axis.transpose() * (position - inverse_square(SIGMA_WEAK_M)).max(0.0);
        }
        Edge { from: self.older, to: self.newer, from_to: self.older_from_newer, information, is_closure: true }
    }
}

/// How hard a pose is searched for: the wider the window, the more is saved by asking less.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// A pose with a smaller mean likelihood of the points is not looked for.
    pub likelihood_min: f32,
    /// Points that are used.
    pub points: usize,
    /// A second pose with this share of the best one's score is a doubt …
    pub second_share_max: f32,
    /// … unless so many times more of the points fit nowhere there; `None`: even then.
    pub second_misfits_min: Option<f32>,
}

impl Effort {
    /// The best pose of `query` in the window, if there is no other one nearly as good.
    fn search(&self, grid: &CorrelationGrid, query: &[Point2], window: &SearchWindow) -> Option<Pose2> {
        let points: Vec<Point2> = thinned(query, self.points);
        let best = grid.search(&points, window, self.likelihood_min, None)?;
        let excluded = Excluded { pose: best.pose, distance_m: SECOND_APART_M, heading_rad: SECOND_APART_RAD };
        let second = grid.search(&points, window, self.doubt_from(best.share), Some(excluded));
        second.is_none().then_some(best.pose)
    }

    /// The mean likelihood from which on a second pose is a doubt about the best one, which has the likelihood `best`.
    fn doubt_from(&self, best: f32) -> f32 {
        let by_misfits = |times: f32| (1.0 - times * (1.0 - best)).min(best - SECOND_MISFITS_MORE);
        (self.second_share_max * best).max(self.second_misfits_min.map_or(0.0, by_misfits))
    }
}

/// How hard a place is searched for to close a loop.
const CLOSING: Effort = Effort {
    likelihood_min: 0.5 * ON_WALLS_MIN,
    points: QUERY_POINTS,
    second_share_max: SECOND_SHARE_MAX,
    second_misfits_min: Some(SECOND_MISFITS_MIN),
};

/// Side of a cell of a place's NDT, in distances between the points of a submap, at least: so many of a wall's lie in it, and a cell counts from three on.
/// Wider ones blur what tells the place along a corridor.
const CELL_MIN: f32 = 3.0;
/// Tiles along the side of the directory of a place's NDT.
const DIRECTORY_SIDE: usize = 256;

/// Searches submaps in submaps; holds the memory for it.
#[derive(Debug)]
pub struct Closer {
    ndt: NdtConfig,
    directory: Vec<DirectoryEntry>,
    tiles: Vec<NdtTile>,
    /// Closures that wait for a second one.
    waiting: Vec<Closure>,
}

impl Closer {
    /// One that has found nothing yet.
    pub fn new(ndt: &NdtConfig) -> Self {
        let ndt = NdtConfig { grids: 4, cell_size_m: ndt.cell_size_m.max(CELL_MIN * POINTS_APART_M), ..*ndt };
        Self {
            directory: vec![DirectoryEntry::default(); ndt.directories() * DIRECTORY_SIDE * DIRECTORY_SIDE],
            ndt,
            tiles: vec![NdtTile::EMPTY; 32768],
            waiting: Vec::new(),
        }
    }

    /// Finds `query` in `place`; its pose there, if nothing speaks against it.
    pub fn find(&mut self, query: &Submap, place: &Submap, window: &SearchWindow) -> Option<Place> {
        let grid = CorrelationGrid::new(place.points())?;
        self.find_on(&grid, query, place, window, CLOSING)
    }

    /// The same; `grid` is that of `place`, for one that is searched more than once.
    pub fn find_on(
        &mut self,
        grid: &CorrelationGrid,
        query: &Submap,
        place: &Submap,
        window: &SearchWindow,
        effort: Effort,
    ) -> Option<Place> {
        let coarse = effort.search(grid, query.points(), window)?;
        self.find_near(query, place, coarse)
    }

    /// Finds `query` in `place` where it is known to be about, `coarse`; its pose there, if it is near and nothing speaks against it.
    pub fn find_near(&mut self, query: &Submap, place: &Submap, coarse: Pose2) -> Option<Place> {
        let found = self.refine(query, place, coarse)?;
        let near = coarse.between(found.pose);
        let is_near = near.position().norm() < REFINED_WITHIN_M && near.heading.abs() < REFINED_WITHIN_RAD;
        (is_near && self.agree(query, place, found.pose)).then_some(found)
    }

    /// The optimum of the NDT near `coarse`, if something is known about every axis.
    fn refine(&mut self, query: &Submap, place: &Submap, coarse: Pose2) -> Option<Place> {
        let mut ndt = NdtGrid::new(&self.ndt, &mut self.directory, &mut self.tiles).ok()?;
        let reach_m = query.points().iter().map(|point| point.norm()).fold(0.0, f32::max) + 1.0;
        let near = |point: &&Point2| (**point - coarse.position()).norm() <= reach_m;
        ndt.insert(&place.points().iter().filter(near).copied().collect::<Vec<_>>(), Pose2::IDENTITY);
        let matcher = MatcherConfig { prior_position_m: 0.0, prior_heading_deg: 0.0, ..MatcherConfig::default() };
        let mut none: [Member<3>; 0] = [];
        let matcher = ScanMatcher::new(&SearchConfig::default(), &DeConfig::default(), &matcher, &mut none);
        let prediction = Prediction::usual(coarse, 0.0);
        let pose = matcher.align_locally(&ndt, query.points(), &prediction);
        let [xx, xy, yy] = ndt.constraint(query.points(), pose);
        let spread = (0.5 * (xx - yy)).hypot(xy);
        let constraint = 0.5 * (xx + yy) - spread;
        // The direction of the smaller eigenvalue.
        let heading = 0.5 * xy.atan2(0.5 * (xx - yy)) + std::f32::consts::FRAC_PI_2;
        let axis = Point2::from_polar(1.0, heading);
        let weak_axis = (constraint < CONSTRAINT_MIN).then_some(axis);
        (constraint >= CONSTRAINT_NONE).then_some(Place { pose, weak_axis })
    }

    fn agree(&self, query: &Submap, place: &Submap, pose: Pose2) -> bool {
        let there = place.agreement(query.points(), pose);
        let back = query.agreement(place.points(), pose.inverse());
        there.on_walls >= ON_WALLS_MIN
            && there.contradicting <= CONTRADICTING_MAX
            && back.contradicting <= CONTRADICTING_MAX
    }

    /// The closures that may be believed now that `closure` has been found: itself if it moves little, itself and another one that says
    /// the same, or none; then it waits.
    ///
    /// * `nodes` — the graph's nodes
    pub fn confirmed(&mut self, closure: Closure, nodes: &[PoseF64]) -> Vec<Closure> {
        if closure.moves_m <= ALONE_M {
            return vec![closure];
        }
        let agrees = |other: &Closure| {
            other.newer != closure.newer && {
                let error = discrepancy(other, &closure, nodes);
                error.distance_m() <= f64::from(AGREEMENT_M)
                    && error.heading.abs() <= f64::from(AGREEMENT_DEG.to_radians())
            }
        };
        let Some(index) = self.waiting.iter().rposition(agrees) else {
            self.waiting.push(closure);
            return Vec::new();
        };
        vec![self.waiting.remove(index), closure]
    }

    /// Those of the waiting closures that are not `worth` it wait no more, and are returned.
    pub fn keep_waiting(&mut self, worth: impl Fn(&Closure) -> bool) -> Vec<Closure> {
        self.waiting.extract_if(.., |closure| !worth(closure)).collect()
    }
}

/// How far two closures disagree: round from the one older node over both newer ones to the other.
fn discrepancy(a: &Closure, b: &Closure, nodes: &[PoseF64]) -> PoseF64 {
    let between = |from: usize, to: usize| nodes[from].between(nodes[to]);
    let by_a = a.older_from_newer.then(between(a.newer, b.newer));
    let by_b = between(a.older, b.older).then(b.older_from_newer);
    by_a.between(by_b)
}

/// Every n-th point, so that about `count` are left.
fn thinned(points: &[Point2], count: usize) -> Vec<Point2> {
    points.iter().copied().step_by((points.len() / count).max(1)).collect()
}

#[cfg(test)]
mod tests {
    use lrfslam_core::math::normal;
    use lrfslam_core::random::RandomStream;

    use super::*;

    /// The walls of a corridor of 40 m along x, with recesses 0.3 m deep and 1 m wide at `doors` to both sides; every point is off by a centimetre or two.
    fn corridor(doors: &[f32], seed: u64) -> Vec<Point2> {
        let mut rng = RandomStream::new(seed, 0, 0);
        let mut off = || 0.015 * normal(&mut rng);
        let wall = |x: f32| if doors.iter().any(|door| (x - door).abs() < 0.5) { 1.75 } else { 1.45 };
        (0..400)
            .map(|i| 0.1 * i as f32)
            .flat_map(|x| [(x, wall(x)), (x, -wall(x))])
            .map(|(x, y)| Point2::new(x + off(), y + off()))
            .collect()
    }

    /// Where the stretch from 14 to 26 m, seen again, is searched from 1 m beside; its frame is at 20 m.
    fn found(effort: Effort, doors: &[f32]) -> Option<Pose2> {
        let again = corridor(doors, 2).into_iter().filter(|point| (14.0..26.0).contains(&point.x));
        let query: Vec<Point2> = again.map(|point| point - Point2::new(20.0, 0.0)).collect();
        let window = SearchWindow { centre: Pose2::new(21.0, 0.0, 0.0), distance_m: 8.0, heading_rad: 0.1 };
        effort.search(&CorrelationGrid::new(&corridor(doors, 1)).unwrap(), &query, &window)
    }

    #[test]
    fn a_door_tells_where_in_a_corridor() {
        let pose = found(CLOSING, &[16.0, 19.0, 23.5]).expect("nowhere else are there doors so far apart");
        assert!((pose.x - 20.0).abs() < 0.15 && pose.y.abs() < 0.1, "{pose:?}");
        let by_share = Effort { second_misfits_min: None, ..CLOSING };
        assert!(found(by_share, &[16.0, 19.0, 23.5]).is_none(), "bare walls fit everywhere");
    }

    #[test]
    fn what_moves_the_robot_far_waits_for_a_second_one_or_is_dropped() {
        let closure = |newer, moves_m| Closure {
            older: 0,
            newer,
            older_from_newer: PoseF64::new(newer as f64 + 2.0, 0.0, 0.0),
            moves_m,
            weak_axis: None,
        };
        let nodes: Vec<PoseF64> = (0..9).map(|k| PoseF64::new(f64::from(k), 0.0, 0.0)).collect();
        let mut closer = Closer::new(&NdtConfig::default());
        assert_eq!(closer.confirmed(closure(5, 0.5), &nodes).len(), 1);
        assert!(closer.confirmed(closure(6, 2.0), &nodes).is_empty());
        assert_eq!(closer.confirmed(closure(7, 2.0), &nodes).len(), 2);
        assert!(closer.keep_waiting(|_| false).is_empty());
        assert!(closer.confirmed(closure(8, 2.0), &nodes).is_empty());
        assert!(closer.keep_waiting(|closure| closure.newer >= 8).is_empty());
        let dropped = closer.keep_waiting(|_| false);
        assert!(dropped.len() == 1 && dropped[0].contradicts(&nodes));
        let moved: Vec<PoseF64> = nodes.iter().map(|node| PoseF64::new(1.2 * node.x, 0.0, 0.0)).collect();
        assert!(!dropped[0].contradicts(&moved), "others have moved the robot there meanwhile");
    }

    #[test]
    fn a_bare_corridor_and_doors_all_alike_do_not() {
        assert!(found(CLOSING, &[]).is_none());
        let alike: Vec<f32> = (0..14).map(|i| 3.0 * i as f32).collect();
        assert!(found(CLOSING, &alike).is_none());
    }
}
