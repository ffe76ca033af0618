//! Scans of your own in; poses, and what is free and what is not, out. Draws the map as text.
//!
//! `cargo run --release --example own_scans`

use std::error::Error;
use std::f32::consts::TAU;

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::grid::Occupancy;
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::slam::{Slam, SlamConfig, SmallPools};
use lrfslam_core::time::{Duration, Instant};

/// Scans a second.
const RATE_HZ: i64 = 10;
const RANGE_MAX_M: f32 = 8.0;
/// Walls, each from one corner to another, m: a room with an alcove, and a pillar.
const WALLS: [[f32; 4]; 12] = [
    [-3.0, -2.0, 5.0, -2.0],
    [5.0, -2.0, 5.0, 1.0],
    [5.0, 1.0, 6.5, 1.0],
    [6.5, 1.0, 6.5, 2.2],
    [6.5, 2.2, 5.0, 2.2],
    [5.0, 2.2, 5.0, 4.0],
    [5.0, 4.0, -3.0, 4.0],
    [-3.0, 4.0, -3.0, -2.0],
    [1.5, 2.0, 2.1, 2.0],
    [2.1, 2.0, 2.1, 2.4],
    [2.1, 2.4, 1.5, 2.4],
    [1.5, 2.4, 1.5, 2.0],
];

fn main() -> Result<(), Box<dyn Error>> {
    let mut pools = Box::new(SmallPools::EMPTY);
    let mut slam = Slam::new(&SlamConfig::small(), 1, pools.lend())?;
    let mut worst_m = 0.0_f32;
    for number in 0..240 {
        let truth = drive(number as f32 / 120.0);
        let beams = measure(truth);
        let stamp = Instant::from_micros(number * 1_000_000 / RATE_HZ);
        let scan = RangeScan { stamp, range_max_m: RANGE_MAX_M, beams: &beams };
        let step = slam.step(&scan, Pose2::IDENTITY)?;
        let robot = step.map_from_robot;
        worst_m = worst_m.max((robot.position() - truth.position()).norm());
        if number % 20 == 0 {
            let degrees = robot.heading.to_degrees();
            println!("{:4.1} s: x {:5.2} m, y {:5.2} m, {degrees:6.1}°", stamp.as_secs_f64(), robot.x, robot.y);
        }
    }
    draw(&slam);
    println!("never more than {worst_m:.3} m from the true path");
    Ok(())
}

/// Where the robot is after so many rounds of a circle of 2 m.
fn drive(rounds: f32) -> Pose2 {
    let angle = TAU * rounds;
    Pose2::new(angle.sin(), 1.0 - angle.cos(), angle)
}

/// What a laser sees there: a beam for each degree ahead.
fn measure(laser: Pose2) -> [Beam; 181] {
    core::array::from_fn(|index| {
        let bearing_rad = (index as f32 - 90.0).to_radians();
        let ahead = Point2::from_polar(1.0, laser.heading + bearing_rad);
        let ranges = WALLS.iter().filter_map(|wall| range_to(wall, laser.position(), ahead));
        let echo = Echo::from_range(ranges.fold(f32::INFINITY, f32::min), RANGE_MAX_M);
        Beam { bearing_rad, offset: Duration::ZERO, echo }
    })
}

/// Where a ray meets a wall, m along it.
fn range_to([x0, y0, x1, y1]: &[f32; 4], from: Point2, ahead: Point2) -> Option<f32> {
    let cross = |a: Point2, b: Point2| a.x * b.y - a.y * b.x;
    let (wall, to) = (Point2::new(x1 - x0, y1 - y0), Point2::new(x0 - from.x, y0 - from.y));
    let range_m = cross(to, wall) / cross(ahead, wall);
    let share = cross(to, ahead) / cross(ahead, wall);
    (range_m > 0.0 && (0.0..=1.0).contains(&share)).then_some(range_m)
}

/// `#` occupied, `.` free: a letter for 2 × 2 squares of the map.
fn draw<const SIDE: usize>(slam: &Slam<'_, SIDE>) {
    for row in (-12..23).rev() {
        let square = |column| {
            let corner = Point2::new(column as f32, row as f32) * 0.2;
            let middles = [(0.05, 0.05), (0.15, 0.05), (0.05, 0.15), (0.15, 0.15)];
            let known = middles.map(|(x, y)| slam.occupancy_at(corner + Point2::new(x, y)));
            match known.into_iter().max() {
                Some(Occupancy::Occupied) => '#',
                Some(Occupancy::Free) => '.',
                _ => ' ',
            }
        };
        println!("{}", (-17..35).map(square).collect::<String>());
    }
}
