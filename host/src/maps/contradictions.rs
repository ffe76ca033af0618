//! Does the map contradict itself? **Walls that stand where another visit saw through.**
//!
//! Scans where they lie now → walls: cells with hits, and the visits that these belong to → every ray again: which walls does it
//! pass that it should have met? A map that is drawn twice has the walls of one visit in the free space of another, however well
//! each scan agreed with what was known when it came.
//!
//! A visit is a stretch of the way. Rays of the visits that saw a wall, or saw one beside it, do not speak against it: they graze it.
//! Where these pass more often than they hit, something moved: that is no wall. Doors, chairs and cars that stood somewhere else do
//! count; they are few. What a place far away has is left out: small errors of the heading move it by a cell.
//!
//! Cost: O(scans × beams taken × cells on a ray), some 0.1 ms a scan. Memory: some 50 bytes for each cell with a hit.

use std::collections::HashMap;

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::grid::{CellIndex, cells_on_ray};
use lrfslam_core::scan::Echo;
use lrfslam_core::sweep::Sweep;

/// Edge of a cell, m: walls of a good map are thinner. This and all that follow were chosen, by trial on maps that no command makes again.
pub const CELL_M: f32 = 0.15;
/// Hits and ways of rays count so far, m.
const REACH_M: f32 = 8.0;
/// A ray says nothing about the last part of its way to a hit, m.
const BEFORE_HIT_M: f32 = 0.3;
/// Way of the robot that is one visit, m.
const VISIT_M: f64 = 8.0;
/// Visits fewer than this apart are the same one.
const VISITS_APART: u32 = 3;
/// A scan counts if the robot has moved so far since the last one, m …
const APART_M: f32 = 0.1;
/// … or turned so far, rad.
const APART_RAD: f32 = 0.2;
/// So many beams of a scan at most.
const BEAMS_MAX: usize = 90;
/// A cell with so many hits is a wall, and so many rays contradict it.
const ENOUGH: u32 = 3;

/// Walls that the robot came back to.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RevisitedWalls {
    /// Cells of walls that two visits could have seen.
    pub cells: u64,
    /// Centres of those that another visit saw through, map frame, m.
    pub contradicted: Vec<Point2>,
}

impl RevisitedWalls {
    /// Length of all, m.
    pub fn length_m(&self) -> f64 {
        self.cells as f64 * f64::from(CELL_M)
    }

    /// Length of those that are contradicted, m.
    pub fn contradicted_m(&self) -> f64 {
        self.contradicted.len() as f64 * f64::from(CELL_M)
    }

    /// Looks for them.
    ///
    /// * `each_scan` — hands out each scan that the map is drawn from, and the robot's pose in the map, in the order of the way
    pub fn find(each_scan: impl Fn(&mut dyn FnMut(&Sweep<'_>, Pose2))) -> Self {
        let mut walls = Walls::default();
        each_ray(&each_scan, |ray| walls.hit(&ray));
        each_ray(&each_scan, |ray| walls.pass(&ray));
        walls.revisited()
    }
}

/// A beam that hit something.
#[derive(Debug, Clone, Copy)]
struct Ray {
    visit: u32,
    from: Point2,
    /// Unit vector.
    ahead: Point2,
    range_m: f32,
}

impl Ray {
    fn at(&self, range_m: f32) -> Point2 {
        self.from + self.ahead * range_m
    }
}

fn each_ray(each_scan: &impl Fn(&mut dyn FnMut(&Sweep<'_>, Pose2)), mut take: impl FnMut(Ray)) {
    let (mut last, mut way_m) = (None::<Pose2>, 0.0_f64);
    each_scan(&mut |sweep, map_from_robot| {
        let moved = last.map(|last| last.between(map_from_robot));
        if moved.is_some_and(|moved| moved.position().norm() < APART_M && moved.heading.abs() < APART_RAD) {
            return;
        }
        last = Some(map_from_robot);
        way_m += moved.map_or(0.0, |moved| f64::from(moved.position().norm()));
        // Far below where numbers of visits would overflow, whatever the poses.
        let visit = (way_m / VISIT_M).min(1e9) as u32;
        let map_from_lrf = map_from_robot * sweep.robot_from_lrf;
        let (from, middle) = (map_from_lrf.position(), sweep.middle_beam());
        let beams = sweep.scan.beams.iter().step_by(sweep.scan.beams.len().div_ceil(BEAMS_MAX).max(1));
        for beam in beams.map(middle) {
            let Echo::Hit(range_m) = beam.echo else { continue };
            let ahead = map_from_lrf.transform(Point2::from_polar(1.0, beam.bearing_rad)) - from;
            take(Ray { visit, from, ahead, range_m });
        }
    });
}

#[derive(Debug, Default)]
struct Walls(HashMap<CellIndex, Wall>);

#[derive(Debug, Default)]
struct Wall {
    hits: u32,
    /// Visits that these belong to, in order.
    visits: Vec<u32>,
    /// Rays that passed, of the same visits …
    own_passes: u32,
    /// … and of others, which saw no wall beside it either.
    passes: u32,
}

impl Wall {
    fn is_of(&self, visit: u32) -> bool {
        let next = self.visits.partition_point(|other| other + VISITS_APART <= visit);
        self.visits.get(next).is_some_and(|other| *other < visit + VISITS_APART)
    }

    /// Two visits saw it, or could have.
    fn is_revisited(&self) -> bool {
        let ends = self.visits.first().zip(self.visits.last());
        self.passes > 0 || ends.is_some_and(|(first, last)| last - first >= VISITS_APART)
    }
}

impl Walls {
    fn hit(&mut self, ray: &Ray) {
        let end = ray.at(ray.range_m);
        if ray.range_m < REACH_M && end.x.is_finite() && end.y.is_finite() {
            let wall = self.0.entry(CellIndex::containing(end, CELL_M)).or_default();
            wall.hits += 1;
            if wall.visits.last() != Some(&ray.visit) {
                wall.visits.push(ray.visit);
            }
        }
    }

    fn pass(&mut self, ray: &Ray) {
        let way_m = (ray.range_m - BEFORE_HIT_M).min(REACH_M);
        if way_m <= 0.0 {
            return;
        }
        for cell in cells_on_ray(ray.from, ray.at(way_m), CELL_M) {
            let Some(wall) = self.0.get(&cell) else { continue };
            let (is_own, is_grazed) = (wall.is_of(ray.visit), self.has_wall_beside(cell, ray.visit));
            if let Some(wall) = self.0.get_mut(&cell) {
                wall.own_passes += u32::from(is_own);
                wall.passes += u32::from(!is_grazed);
            }
        }
    }

    /// The visit has a hit in the cell or in one of those about it.
    fn has_wall_beside(&self, CellIndex { column, row }: CellIndex, visit: u32) -> bool {
        let mut cells = (-1..=1).flat_map(|up| (-1..=1).map(move |right| (up, right)));
        cells.any(|(up, right)| {
            let beside = CellIndex { column: column.saturating_add(right), row: row.saturating_add(up) };
            self.0.get(&beside).is_some_and(|wall| wall.is_of(visit))
        })
    }

    fn revisited(&self) -> RevisitedWalls {
        let mut revisited = RevisitedWalls::default();
        for (cell, wall) in &self.0 {
            if wall.hits < ENOUGH || wall.own_passes > wall.hits || !wall.is_revisited() {
                continue;
            }
            revisited.cells += 1;
            if wall.passes >= ENOUGH {
                let centre = |index: i32| (index as f32 + 0.5) * CELL_M;
                revisited.contradicted.push(Point2::new(centre(cell.column), centre(cell.row)));
            }
        }
        revisited.contradicted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        revisited
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::scan::{Beam, RangeScan};
    use lrfslam_core::time::{Duration, Instant};

    /// What a laser sees in a room from x = -1 to 31, y = -1 to 1, m, with a post of 20 cm at `person`.
    fn beams(robot: Pose2, person: Option<Point2>) -> Vec<Beam> {
        let beam = |number: u16| {
            let bearing_rad = (f32::from(number) - 30.0).to_radians() * 3.0;
            let direction = robot.heading + bearing_rad;
            let until = |from: f32, ahead: f32, low: f32, high: f32| {
                if ahead.abs() < 1e-6 { f32::INFINITY } else { ((if ahead > 0.0 { high } else { low }) - from) / ahead }
            };
            let (x, y) = (direction.cos(), direction.sin());
            let walls_m = until(robot.x, x, -1.0, 31.0).min(until(robot.y, y, -1.0, 1.0));
            let person_m = person.map(|person| person - robot.position()).and_then(|off| {
                let (ahead, aside) = (off.x * x + off.y * y, off.y * x - off.x * y);
                (ahead > 0.0 && aside.abs() < 0.2).then(|| ahead - (0.04 - aside * aside).sqrt())
            });
            let echo = Echo::Hit(person_m.unwrap_or(f32::INFINITY).min(walls_m));
            Beam { bearing_rad, offset: Duration::ZERO, echo }
        };
        (0..=60).map(beam).collect()
    }

    /// There and back twice; `seen` says where a pose lies in the map, and who stands where.
    fn drive(seen: impl Fn(usize, Pose2) -> (Pose2, Option<Point2>)) -> RevisitedWalls {
        let way: Vec<Pose2> = (0..1200)
            .map(|step| match (step / 300 % 2, step % 300) {
                (0, step) => Pose2::new(0.1 * step as f32, 0.0, 0.0),
                (_, step) => Pose2::new(30.0 - 0.1 * step as f32, 0.0, std::f32::consts::PI),
            })
            .collect();
        RevisitedWalls::find(|take| {
            for (number, pose) in way.iter().enumerate() {
                let (map_from_robot, person) = seen(number, *pose);
                let beams = beams(*pose, person);
                let scan = RangeScan { stamp: Instant::default(), range_max_m: 50.0, beams: &beams };
                take(&Sweep::at_rest(scan, Pose2::IDENTITY), map_from_robot);
            }
        })
    }

    #[test]
    fn a_good_map_does_not_contradict_itself() {
        // Off by 3 cm and half a degree, each visit other ones.
        let walls = drive(|number, pose| {
            let off = 0.03 * (number as f32 / 80.0).sin();
            (Pose2::new(pose.x, pose.y + off, pose.heading + 0.3 * off), None)
        });
        assert!(walls.length_m() > 50.0 && walls.contradicted_m() < 0.01 * walls.length_m(), "{walls:?}");
    }

    #[test]
    fn a_room_drawn_twice_does() {
        let walls =
            drive(|number, pose| (Pose2::new(pose.x, pose.y + f32::from(number >= 600) * 0.8, pose.heading), None));
        let share = walls.contradicted_m() / walls.length_m();
        assert!((0.3..0.55).contains(&share), "of each drive the wall that lies in the other's room: {share}");
        let is_wall = |point: &Point2| [1.0, -0.2].iter().any(|y| (point.y - y).abs() < 0.2);
        assert!(walls.contradicted.iter().all(is_wall), "{:?}", walls.contradicted);
    }

    /// Somebody walks ahead of the robot on the way out, and is not there on any other.
    #[test]
    fn who_walks_is_no_wall_and_what_was_moved_is_little() {
        let ahead = |pose: Pose2| Point2::new(pose.x + 1.5, 0.3);
        let walked = drive(|number, pose| (pose, (number < 280).then(|| ahead(pose))));
        assert!(walked.contradicted_m() < 0.02 * walked.length_m(), "{} m", walked.contradicted_m());
        let chair = Point2::new(15.0, 0.6);
        let moved = drive(|number, pose| (pose, (number < 300).then_some(chair)));
        assert!((0.2..2.0).contains(&moved.contradicted_m()), "{} m", moved.contradicted_m());
    }

    #[test]
    fn one_visit_and_no_scan_at_all_say_nothing() {
        let pose_at = |x: f32| Pose2::new(x, 0.0, 0.0);
        let stood = drive(|_, _| (pose_at(3.0), None));
        assert_eq!((stood.cells, RevisitedWalls::find(|_| {})), (0, RevisitedWalls::default()));
        let lost = drive(|_, _| (pose_at(f32::NAN), None));
        let absurd = drive(|number, _| (pose_at(if number % 2 == 0 { 1e37 } else { -1e37 }), None));
        assert_eq!((lost.cells, absurd.contradicted.len()), (0, 0));
    }
}
