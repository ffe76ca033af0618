//! Writes the example log: a robot with a laser drives once round a floor of rooms and a corridor, and back to its start.
//!
//! `cargo run --release -p lrfslam-firmware-sim --example drive_log | gzip -9n > examples/floor.log.gz`
//!
//! CARMEN format; 180 beams, 5 Hz, 1 cm of noise, no odometry worth the name: the pose on each line drifts on purpose, the
//! true one stands in a comment line before it.

use std::io::{self, BufWriter, Write};

use lrfslam_core::geometry::Pose2;
use lrfslam_core::math::normal;
use lrfslam_core::time::Instant;
use lrfslam_firmware_sim::scene::{FlatWorld, Robot, Scene};
use rand_core::SeedableRng;
use rand_pcg::Pcg32;

/// Outline of the floor with the rooms' walls (doors are gaps), and what stands in them, m.
const FLOOR: &str = "
[[polygon]]
points = [[0,0],[18,0],[18,12],[0,12]]
[[polygon]]
points = [[4,3],[8,3],[8,3.15],[4.15,3.15],[4.15,8.85],[7,8.85],[7,9],[4,9]]
[[polygon]]
points = [[9.2,3],[14,3],[14,6.5],[13.85,6.5],[13.85,3.15],[9.2,3.15]]
[[polygon]]
points = [[13.85,7.7],[14,7.7],[14,9],[8.2,9],[8.2,8.85],[13.85,8.85]]
[[polygon]]
points = [[9,5.9],[10.5,5.9],[10.5,6.6],[9,6.6]]
[[polygon]]
points = [[0,5.2],[0.6,5.2],[0.6,6.4],[0,6.4]]
[[polygon]]
points = [[16.9,1.1],[17.3,1.1],[17.3,1.5],[16.9,1.5]]
[[polygon]]
points = [[11,11.4],[12.2,11.4],[12.2,12],[11,12]]
";

/// Corners of the way, m: round the corridor, into the room through its door, and home.
const WAY: [(f64, f64); 11] = [
    (2.0, 1.5),
    (15.5, 1.5),
    (16.0, 7.1),
    (12.3, 7.6),
    (6.0, 6.0),
    (8.6, 4.2),
    (8.6, 1.6),
    (16.0, 1.8),
    (15.9, 10.4),
    (2.1, 10.5),
    (2.0, 1.5),
];
const STEP_M: f64 = 0.08;
const TURN_RAD: f64 = 0.09;

fn main() -> io::Result<()> {
    let mut out = BufWriter::new(io::stdout().lock());
    let mut rng = Pcg32::seed_from_u64(2011);
    writeln!(
        out,
        "# A simulated floor, for trying lrfslam out. Comment lines `# true x y theta` give the pose of the next scan."
    )?;
    let mut odometry = Pose2::IDENTITY;
    let mut last: Option<Pose2> = None;
    for (index, [x, y, heading]) in poses().into_iter().enumerate() {
        let robot = Robot { start_m: [x, y], start_deg: heading.to_degrees(), ..Robot::default() };
        let world = FlatWorld::from_toml(FLOOR).map_err(io::Error::other)?.with_robot(robot);
        let truth = Pose2::new(x as f32, y as f32, heading as f32);
        if let Some(last) = last {
            let step = last.between(truth);
            odometry = odometry * Pose2::new(step.x * 1.03, step.y, step.heading * 0.97 + 0.001 * normal(&mut rng));
        }
        last = Some(truth);
        writeln!(out, "# true {x:.4} {y:.4} {heading:.5}")?;
        write!(out, "FLASER 180")?;
        for beam in 0..180 {
            let bearing = (f64::from(beam) - 90.0).to_radians();
            let range =
                world.range_m(Instant::default(), bearing).map_or(81.83, |r| r + 0.01 * f64::from(normal(&mut rng)));
            write!(out, " {:.2}", range.clamp(0.05, 81.83))?;
        }
        let (pose, time) = (odometry, index as f64 * 0.2);
        let pose = format!("{:.4} {:.4} {:.5}", pose.x, pose.y, pose.heading);
        writeln!(out, " {pose} {pose} {time:.3} floor {time:.3}")?;
    }
    out.flush()
}

/// Straight from corner to corner, turning on the spot, standing for two seconds at the start.
fn poses() -> Vec<[f64; 3]> {
    let mut heading = 0.0_f64;
    let mut poses = vec![[WAY[0].0, WAY[0].1, heading]; 10];
    for ends in WAY.windows(2) {
        let ((x0, y0), (x1, y1)) = (ends[0], ends[1]);
        let (dx, dy) = (x1 - x0, y1 - y0);
        let turn = f64::from(lrfslam_core::math::wrap_angle((dy.atan2(dx) - heading) as f32));
        let turns = (turn.abs() / TURN_RAD).ceil() as usize;
        poses.extend((1..=turns).map(|i| [x0, y0, heading + turn * i as f64 / turns as f64]));
        heading += turn;
        let steps = (dx.hypot(dy) / STEP_M).ceil() as usize;
        poses.extend(
            (1..=steps).map(|i| (i as f64 / steps as f64, heading)).map(|(s, h)| [x0 + s * dx, y0 + s * dy, h]),
        );
    }
    poses
}
