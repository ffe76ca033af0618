//! How the simulated robot moves: in circles, or along a route within its limits.
//!
//! A route is driven once, when the [`Drive`] is made, in steps of [`STEP`]; where the robot is at any time is then read between
//! two steps. It turns and drives at the same time, slows down for corners and stands at stops, as a real one does.

use std::f64::consts::PI;

use lrfslam_core::time::{Duration, Instant};
use serde::Deserialize;

use crate::tilt::{Sweep, TiltPlan};
use crate::world::building::{PartFault, Place, check};

/// From one computed pose to the next.
pub const STEP: Duration = Duration::from_millis(5);
const STEP_S: f64 = 0.005;
/// A corner without a stop counts as reached from here, m.
const CORNER_REACH_M: f64 = 0.3;
/// A stop counts as reached from here, m.
const STOP_REACH_M: f64 = 0.01;
/// The robot drives on only when the corner lies ahead within this angle; else it turns on the spot first, rad.
const AHEAD_RAD: f64 = 0.5;
/// How much of the angle to the corner is turned per second, 1/s.
const STEERING: f64 = 3.0;
/// The longest drive, s: a route that takes longer is refused.
pub(crate) const LONGEST_S: f64 = 108_000.0;

/// The robot of a world file: where it starts, what it can, and where it goes.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RobotPlan {
    /// Start without a route, m.
    pub start_m: Place,
    /// Start heading, degrees; with a route, towards its second corner if not said.
    pub start_deg: Option<f64>,
    /// Forward speed, m/s; with a route, the highest.
    pub speed_mps: f64,
    /// Turn rate, degrees per second, counter-clockwise; with a route, the highest either way.
    pub turn_degps: f64,
    /// Most change of speed, m/s².
    pub acceleration_mps2: f64,
    /// Most change of turn rate, degrees per second².
    pub turn_acceleration_degps2: f64,
    /// Corners to pass, from the start to the end, m.
    pub route: Vec<Place>,
    /// Where it stands still on the way.
    pub stop: Vec<Stop>,
    /// Where the laser is on the robot: x ahead, y left, z up from the floor, m.
    pub laser_m: [f64; 3],
}

impl Default for RobotPlan {
    fn default() -> Self {
        Self {
            start_m: [0.0; 2],
            start_deg: None,
            speed_mps: 0.0,
            turn_degps: 0.0,
            acceleration_mps2: 0.5,
            turn_acceleration_degps2: 120.0,
            route: Vec::new(),
            stop: Vec::new(),
            laser_m: [0.0, 0.0, 0.3],
        }
    }
}

/// A stop on the way.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    /// At which corner of the route, counted from 0.
    pub corner: usize,
    /// How long, s; at least as long as the sweep takes.
    #[serde(default)]
    pub seconds: f64,
    /// The laser is tilted meanwhile.
    pub sweep: Option<Sweep>,
}

/// Position (m) and heading (rad, not wrapped) on the floor.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FloorPose {
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
    /// rad, counter-clockwise from +x.
    pub heading: f64,
}

/// A robot's motion: see the [module](self). By default it stands at the origin.
#[derive(Debug, Clone, Default)]
pub struct Drive {
    motion: Motion,
    tilt: TiltPlan,
}

#[derive(Debug, Clone)]
enum Motion {
    /// Constant speed (m/s) and turn rate (rad/s) from a pose.
    Arc { start: FloorPose, speed_mps: f64, turn_radps: f64 },
    /// A pose every [`STEP`].
    Steps(Vec<FloorPose>),
}

impl Default for Motion {
    fn default() -> Self {
        Self::Arc { start: FloorPose::default(), speed_mps: 0.0, turn_radps: 0.0 }
    }
}

impl Drive {
    /// Plans the drive.
    ///
    /// # Errors
    /// If limits are missing or the route cannot be driven within them.
    pub fn new(plan: &RobotPlan) -> Result<Self, PartFault> {
        if plan.route.is_empty() {
            check(plan.stop.is_empty(), "stop", "a route on which to stop")?;
            let [x, y] = plan.start_m;
            let start = FloorPose { x, y, heading: plan.start_deg.unwrap_or(0.0).to_radians() };
            let motion = Motion::Arc { start, speed_mps: plan.speed_mps, turn_radps: plan.turn_degps.to_radians() };
            return Ok(Self { motion, tilt: TiltPlan::default() });
        }
        check_plan(plan)?;
        Driver::new(plan).drive()
    }

    /// Where the robot is; at its last place after the end.
    pub fn pose(&self, at: Instant) -> FloorPose {
        match &self.motion {
            Motion::Arc { start, speed_mps, turn_radps } => start.after(at.as_secs_f64(), *speed_mps, *turn_radps),
            Motion::Steps(steps) => {
                let micros = at.micros.max(0);
                let index = (micros / STEP.micros) as usize;
                let part = (micros % STEP.micros) as f64 / STEP.micros as f64;
                match (steps.get(index), steps.get(index + 1)) {
                    (Some(from), Some(to)) => from.towards(to, part),
                    _ => steps.last().copied().unwrap_or_default(),
                }
            }
        }
    }

    /// When the route ends; `None` without one.
    pub fn end(&self) -> Option<Instant> {
        match &self.motion {
            Motion::Arc { .. } => None,
            Motion::Steps(steps) => Some(Instant::from_micros(steps.len() as i64 * STEP.micros)),
        }
    }

    /// How the laser is tilted, when.
    pub fn tilt(&self) -> &TiltPlan {
        &self.tilt
    }

    /// `count` times, evenly spread over the way from start to end: a turn of 1 rad counts as much as 3 m.
    pub fn spread(&self, count: usize) -> Vec<Instant> {
        const METRES_PER_RAD: f64 = 3.0;
        let Motion::Steps(steps) = &self.motion else { return Vec::new() };
        let lengths: Vec<f64> = steps
            .windows(2)
            .scan(0.0, |sum, pair| {
                let step_m = (pair[1].x - pair[0].x).hypot(pair[1].y - pair[0].y);
                *sum += step_m + METRES_PER_RAD * (pair[1].heading - pair[0].heading).abs();
                Some(*sum)
            })
            .collect();
        let total = lengths.last().copied().unwrap_or(0.0);
        let gaps = count.saturating_sub(1).max(1) as f64;
        let at = |index: usize| lengths.partition_point(|length| *length < total * index as f64 / gaps);
        (0..count).map(|index| Instant::from_micros(at(index) as i64 * STEP.micros)).collect()
    }
}

impl FloorPose {
    /// After `seconds` at constant speed and turn rate: an arc.
    fn after(&self, seconds: f64, speed_mps: f64, turn_radps: f64) -> Self {
        let heading = self.heading + turn_radps * seconds;
        let (dx, dy) = if turn_radps.abs() < 1e-9 {
            (speed_mps * seconds * self.heading.cos(), speed_mps * seconds * self.heading.sin())
        } else {
            let radius = speed_mps / turn_radps;
            (radius * (heading.sin() - self.heading.sin()), radius * (self.heading.cos() - heading.cos()))
        };
        Self { x: self.x + dx, y: self.y + dy, heading }
    }

    fn towards(&self, other: &Self, part: f64) -> Self {
        let between = |a: f64, b: f64| a + (b - a) * part;
        Self { x: between(self.x, other.x), y: between(self.y, other.y), heading: between(self.heading, other.heading) }
    }
}

fn check_plan(plan: &RobotPlan) -> Result<(), PartFault> {
    check(plan.route.len() >= 2, "route", "at least two corners")?;
    check(plan.start_m == [0.0; 2], "start_m", "either a start or a route, which starts at its first corner")?;
    for (key, value) in [
        ("speed_mps", plan.speed_mps),
        ("turn_degps", plan.turn_degps),
        ("acceleration_mps2", plan.acceleration_mps2),
        ("turn_acceleration_degps2", plan.turn_acceleration_degps2),
    ] {
        check(value > 0.0 && value.is_finite(), key, "a positive limit for the route")?;
    }
    let apart = plan.route.windows(2).all(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]) > 1e-3);
    check(apart, "route", "corners that differ from the one before")?;
    for stop in &plan.stop {
        check(stop.corner < plan.route.len(), "stop.corner", "the number of a corner of the route, from 0")?;
        check((0.0..=LONGEST_S).contains(&stop.seconds), "stop.seconds", "a time in s")?;
        stop.sweep.as_ref().map_or(Ok(()), Sweep::check)?;
    }
    Ok(())
}

/// What drives a route, step by step.
struct Driver<'p> {
    plan: &'p RobotPlan,
    pose: FloorPose,
    speed_mps: f64,
    turn_radps: f64,
    steps: Vec<FloorPose>,
    tilt: TiltPlan,
}

impl<'p> Driver<'p> {
    fn new(plan: &'p RobotPlan) -> Self {
        let ([x, y], [x1, y1]) = (plan.route[0], plan.route[1]);
        let heading = plan.start_deg.map_or((y1 - y).atan2(x1 - x), f64::to_radians);
        let pose = FloorPose { x, y, heading };
        Self { plan, pose, speed_mps: 0.0, turn_radps: 0.0, steps: vec![pose], tilt: TiltPlan::default() }
    }

    fn drive(mut self) -> Result<Drive, PartFault> {
        let last = self.plan.route.len() - 1;
        self.stand(0);
        for corner in 1..=last {
            let stops = corner == last || self.plan.stop.iter().any(|stop| stop.corner == corner);
            while !self.has_reached(corner, stops) {
                self.step(corner, stops);
                let within = (self.steps.len() as f64) < LONGEST_S / STEP_S;
                check(within, "route", "a way that can be driven within 30 h and within the limits")?;
            }
            if stops {
                self.halt();
                self.stand(corner);
            }
        }
        Ok(Drive { motion: Motion::Steps(self.steps), tilt: self.tilt })
    }

    fn distance_m(&self, corner: usize) -> f64 {
        let [x, y] = self.plan.route[corner];
        (x - self.pose.x).hypot(y - self.pose.y)
    }

    fn has_reached(&self, corner: usize, stops: bool) -> bool {
        self.distance_m(corner) <= if stops { STOP_REACH_M } else { CORNER_REACH_M }
    }

    /// Drives on towards a corner.
    fn step(&mut self, corner: usize, stops: bool) {
        let plan = self.plan;
        let [x, y] = plan.route[corner];
        let off = wrap((y - self.pose.y).atan2(x - self.pose.x) - self.pose.heading);
        let turn_max = plan.turn_degps.to_radians();
        let turn_change = plan.turn_acceleration_degps2.to_radians();
        // Slow enough to stop turning when the corner is ahead.
        let braking = (2.0 * turn_change * off.abs()).sqrt();
        let turn = (STEERING * off.abs()).min(turn_max).min(braking).copysign(off);
        let distance_m = self.distance_m(corner);
        let ahead = if off.abs() < AHEAD_RAD { 1.0 - off.abs() / AHEAD_RAD } else { 0.0 };
        let braking = if stops { (2.0 * plan.acceleration_mps2 * distance_m).sqrt() } else { f64::INFINITY };
        // At a corner where it turns, it may not be faster than its turn rate can bend the way.
        let bend = if stops { f64::INFINITY } else { self.bend_speed(corner, distance_m) };
        let speed = (plan.speed_mps * ahead).min(braking).min(bend).max(if ahead > 0.0 { 0.01 } else { 0.0 });
        self.advance(speed, turn);
    }

    /// The speed from which the corner's speed can still be reached, m/s.
    fn bend_speed(&self, corner: usize, distance_m: f64) -> f64 {
        let route = &self.plan.route;
        let [from, at, to] = [route[corner - 1], route[corner], route[corner + 1]];
        let turn = wrap((to[1] - at[1]).atan2(to[0] - at[0]) - (at[1] - from[1]).atan2(at[0] - from[0]));
        let corner_mps = self.plan.speed_mps * (1.0 - turn.abs() / AHEAD_RAD).max(0.15);
        (corner_mps.powi(2) + 2.0 * self.plan.acceleration_mps2 * (distance_m - CORNER_REACH_M).max(0.0)).sqrt()
    }

    /// One step towards a speed and a turn rate, within the limits of their change.
    fn advance(&mut self, speed_mps: f64, turn_radps: f64) {
        let limit = |from: f64, to: f64, change: f64| from + (to - from).clamp(-change * STEP_S, change * STEP_S);
        let turn_change = self.plan.turn_acceleration_degps2.to_radians();
        self.speed_mps = limit(self.speed_mps, speed_mps, self.plan.acceleration_mps2);
        self.turn_radps = limit(self.turn_radps, turn_radps, turn_change);
        self.pose = self.pose.after(STEP_S, self.speed_mps, self.turn_radps);
        self.steps.push(self.pose);
    }

    fn halt(&mut self) {
        while self.speed_mps != 0.0 || self.turn_radps != 0.0 {
            self.advance(0.0, 0.0);
        }
    }

    fn stand(&mut self, corner: usize) {
        for stop in self.plan.stop.iter().filter(|stop| stop.corner == corner) {
            let begins_s = self.steps.len() as f64 * STEP_S;
            let swept_s = stop.sweep.as_ref().map_or(0.0, |sweep| self.tilt.add(begins_s, sweep));
            let count = (stop.seconds.max(swept_s) / STEP_S).ceil() as usize;
            self.steps.extend(std::iter::repeat_n(self.pose, count));
        }
    }
}

/// An angle in (−π, π].
pub(crate) fn wrap(angle: f64) -> f64 {
    let wrapped = angle.rem_euclid(2.0 * PI);
    if wrapped > PI { wrapped - 2.0 * PI } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan() -> RobotPlan {
        RobotPlan {
            route: vec![[0.0, 0.0], [5.0, 0.0], [5.0, 4.0], [0.0, 4.0]],
            speed_mps: 0.8,
            turn_degps: 60.0,
            stop: vec![Stop { corner: 2, seconds: 3.0, sweep: None }],
            ..RobotPlan::default()
        }
    }

    fn poses(drive: &Drive) -> Vec<FloorPose> {
        let end = drive.end().unwrap().micros / STEP.micros;
        (0..=end).map(|step| drive.pose(Instant::from_micros(step * STEP.micros))).collect()
    }

    #[test]
    fn circle_comes_round() {
        let plan = RobotPlan { speed_mps: 1.0, turn_degps: 90.0, ..RobotPlan::default() };
        let pose = Drive::new(&plan).unwrap().pose(Instant::from_micros(2_000_000));
        assert!(pose.x.abs() < 1e-9 && (pose.y - 4.0 / PI).abs() < 1e-9 && (pose.heading - PI).abs() < 1e-9);
    }

    #[test]
    fn route_is_driven_within_all_limits() {
        let poses = poses(&Drive::new(&plan()).unwrap());
        let speeds: Vec<f64> = poses.windows(2).map(|p| (p[1].x - p[0].x).hypot(p[1].y - p[0].y) / STEP_S).collect();
        let turns: Vec<f64> = poses.windows(2).map(|p| (p[1].heading - p[0].heading) / STEP_S).collect();
        let most = |values: &[f64]| values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let change = |values: &[f64]| values.windows(2).fold(0.0_f64, |most, v| most.max((v[1] - v[0]).abs() / STEP_S));
        assert!(most(&speeds) <= 0.8 + 1e-6 && most(&speeds) > 0.79, "{}", most(&speeds));
        assert!(most(&turns) <= 60_f64.to_radians() + 1e-6 && most(&turns) > 0.5);
        assert!(change(&speeds) <= 0.5 + 1e-3, "{}", change(&speeds));
        assert!(change(&turns) <= 120_f64.to_radians() + 1e-3, "{}", change(&turns));
    }

    #[test]
    fn route_passes_its_corners_and_stands_at_its_stops() {
        let poses = poses(&Drive::new(&plan()).unwrap());
        for [x, y] in plan().route {
            let nearest = poses.iter().map(|pose| (pose.x - x).hypot(pose.y - y)).fold(f64::INFINITY, f64::min);
            assert!(nearest <= CORNER_REACH_M, "{nearest} from {x} {y}");
        }
        let stood = poses.windows(2).filter(|p| p[0] == p[1] && (p[0].x - 5.0).hypot(p[0].y - 4.0) < 0.02).count();
        assert!((599..=601).contains(&stood), "{stood}");
        let end = poses.last().unwrap();
        assert!(end.x.hypot(end.y - 4.0) < 0.02);
    }

    #[test]
    fn spread_times_are_evenly_apart_on_the_way() {
        let drive = Drive::new(&plan()).unwrap();
        let places: Vec<FloorPose> = drive.spread(30).iter().map(|at| drive.pose(*at)).collect();
        assert_eq!(places.len(), 30);
        let gaps: Vec<f64> = places
            .windows(2)
            .map(|p| (p[1].x - p[0].x).hypot(p[1].y - p[0].y) + 3.0 * (p[1].heading - p[0].heading).abs())
            .collect();
        let (low, high) = gaps.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), g| (l.min(*g), h.max(*g)));
        assert!(high - low < 0.06, "{low} to {high}");
    }

    #[test]
    fn plans_that_cannot_be_driven_are_refused() {
        let fault = |plan: RobotPlan| Drive::new(&plan).unwrap_err().key;
        assert_eq!(fault(RobotPlan { speed_mps: 0.0, ..plan() }), "speed_mps");
        assert_eq!(fault(RobotPlan { route: vec![[0.0, 0.0]], ..plan() }), "route");
        assert_eq!(fault(RobotPlan { stop: vec![Stop { corner: 9, ..Stop::default() }], ..plan() }), "stop.corner");
        assert_eq!(fault(RobotPlan { stop: vec![Stop::default()], ..RobotPlan::default() }), "stop");
    }
}
