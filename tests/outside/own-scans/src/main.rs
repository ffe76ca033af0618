//! A robot that drives round a box in a hall of 9 m by 7 m, by its own made-up scans.

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::slam::SmallPools;
use own_scans::{BEAMS, Robot, bearing_rad};

/// Corners of the hall, of the box and of a cupboard at the wall: left, right, bottom, top, m.
const BOXES: [[f32; 4]; 3] = [[-4.55, 4.55, -3.55, 3.55], [-0.95, 0.85, -0.75, 0.85], [2.05, 3.15, 2.95, 3.65]];
/// Scans for one round.
const ROUND: usize = 300;

fn main() {
    let mut memory = Box::new(SmallPools::EMPTY);
    let mut robot = Robot::new(&mut memory).expect("memory for the configuration");
    let start = truth(0);
    let (mut worst_m, mut lost) = (0.0_f32, 0);
    for step in 0..2 * ROUND {
        let place = robot.see(&scan(truth(step))).expect("memory for a scan");
        let true_pose = start.between(truth(step));
        worst_m = worst_m.max((place.pose.position() - true_pose.position()).norm());
        lost += u32::from(place.is_lost);
        if step % 100 == 0 {
            println!("x {:5.2} m, y {:5.2} m, score {:.2}", place.pose.x, place.pose.y, place.score);
        }
    }
    println!("at most {worst_m:.3} m off, {lost} scans lost");
    assert!(worst_m < 0.1 && lost == 0);
    let at = |x: f32, y: f32| start.inverse().transform(Point2::new(x, y));
    let (way, wall, inside, outside) = (at(2.4, 0.4), at(0.84, 0.25), at(0.0, 0.0), at(0.0, -5.0));
    assert!(robot.is_free(way.x, way.y) && !robot.is_free(wall.x, wall.y));
    assert!(robot.is_occupied(wall.x, wall.y) && !robot.is_occupied(way.x, way.y));
    for unknown in [inside, outside] {
        assert!(!robot.is_free(unknown.x, unknown.y) && !robot.is_occupied(unknown.x, unknown.y));
    }
    println!("the way round is free, the box is occupied, what is inside is not known");
}

/// Counter-clockwise on a circle of 2.2 m.
fn truth(step: usize) -> Pose2 {
    let angle = std::f32::consts::TAU * step as f32 / ROUND as f32;
    Pose2::new(2.2 * angle.cos(), 2.2 * angle.sin(), angle + std::f32::consts::FRAC_PI_2)
}

fn scan(laser: Pose2) -> [f32; BEAMS] {
    std::array::from_fn(|index| {
        let (sin, cos) = (laser.heading + bearing_rad(index)).sin_cos();
        let sides = BOXES.iter().flat_map(|[left, right, bottom, top]| {
            let upright = [left, right].map(|x| {
                let range_m = (x - laser.x) / cos;
                (range_m, laser.y + range_m * sin, bottom, top)
            });
            let level = [bottom, top].map(|y| {
                let range_m = (y - laser.y) / sin;
                (range_m, laser.x + range_m * cos, left, right)
            });
            upright.into_iter().chain(level)
        });
        let met = sides.filter(|(range_m, at, low, high)| *range_m > 0.0 && at >= *low && at <= *high);
        met.map(|(range_m, ..)| range_m).fold(f32::INFINITY, f32::min)
    })
}
