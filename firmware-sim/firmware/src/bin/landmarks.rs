//! EKF-SLAM of 50 landmarks in fixed memory: what it takes of flash and RAM, and, run in QEMU, how long a step takes and how deep the stack is.
//!
//! The robot drives in a circle among posts that it can tell apart; every tenth step it sees four of them. At the end a line goes to the host:
//! landmarks in the map, mean time of a prediction and of a batch of four sightings (µs), deepest stack (bytes), error of the pose (mm).
#![no_std]
#![no_main]
#![forbid(unsafe_code)]

use core::fmt::Write as _;

use lrfslam_core::landmark::ekf::{EkfMemory, EkfSlam, Landmark};
use lrfslam_core::landmark::{Control, LandmarkConfig, RobotState, Sighting};
use lrfslam_firmware::board::{Board, stack};
use lrfslam_robot::Ports as _;
use static_cell::ConstStaticCell;

/// Room for so many.
const LANDMARKS: usize = 50;
const LENGTHS: [usize; 3] = EkfMemory::lengths(LANDMARKS);
/// Steps of a tenth of a second: once round.
const STEPS: u32 = 500;
const SEEN: usize = 4;

static MEAN: ConstStaticCell<[f64; LENGTHS[0]]> = ConstStaticCell::new([0.0; LENGTHS[0]]);
static COVARIANCE: ConstStaticCell<[f64; LENGTHS[1]]> = ConstStaticCell::new([0.0; LENGTHS[1]]);
static WORK: ConstStaticCell<[[f64; 4]; LENGTHS[0]]> = ConstStaticCell::new([[0.0; 4]; LENGTHS[0]]);
static RECORDS: ConstStaticCell<[Landmark; LENGTHS[2]]> = ConstStaticCell::new([Landmark::UNUSED; LENGTHS[2]]);

/// Steps once round, and where the robot is after so many: a circle of radius 8 m through the origin.
fn pose(step: u32) -> (f32, f32, f32) {
    let heading = step as f32 / STEPS as f32 * core::f32::consts::TAU;
    let (sin, cos) = lrfslam_core::math::sin_cos(heading);
    (8.0 * sin, 8.0 - 8.0 * cos, heading)
}

/// Post `index`, on a ring round the way, as it is seen after so many steps.
fn seen(index: usize, step: u32) -> Sighting {
    let angle = index as f32 / LANDMARKS as f32 * core::f32::consts::TAU;
    let (sin, cos) = lrfslam_core::math::sin_cos(angle);
    let (x, y, heading) = pose(step);
    let to = lrfslam_core::geometry::Point2::new(11.0 * sin - x, 8.0 - 11.0 * cos - y);
    let bearing_rad = f64::from(lrfslam_core::math::wrap_angle(to.bearing_rad() - heading));
    Sighting { range_m: f64::from(to.norm()), bearing_rad, identity: Some(index as u16), noise: None }
}

fn drive(board: &mut Board) -> Option<heapless::String<160>> {
    let memory =
        EkfMemory { mean: MEAN.take(), covariance: COVARIANCE.take(), work: WORK.take(), landmarks: RECORDS.take() };
    let mut slam = EkfSlam::new(&LandmarkConfig::default(), memory)?;
    let (mut predicting, mut observing, mut batches) = (0, 0, 0_u32);
    for step in 1..=STEPS {
        let begun = board.now();
        let turn_rad = core::f64::consts::TAU / f64::from(STEPS);
        slam.predict(&Control::Odometry { distance_m: 8.0 * turn_rad, turn_rad, seconds: 0.1 });
        predicting += board.now().since(begun).micros;
        if step % 10 == 0 {
            let next = step as usize * LANDMARKS / STEPS as usize;
            let sightings: [Sighting; SEEN] = core::array::from_fn(|ahead| seen((next + ahead) % LANDMARKS, step));
            let begun = board.now();
            slam.observe(&sightings, &mut []);
            observing += board.now().since(begun).micros;
            batches += 1;
            board.feed_watchdog();
        }
    }
    let robot: RobotState = slam.robot();
    let off_mm = 1e3 * lrfslam_core::math::hypot(robot.x as f32, robot.y as f32);
    let mut text = heapless::String::new();
    let (predicting, observing) = (predicting / i64::from(STEPS), observing / i64::from(batches.max(1)));
    let landmarks = slam.landmarks().count();
    let _ = writeln!(text, "done {landmarks} {predicting} {observing} {} {}", stack::used(), off_mm as u32);
    Some(text)
}

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut board = Board::take();
    let text = drive(&mut board).unwrap_or_default();
    board.send_to_host(text.as_bytes());
    loop {
        board.sleep();
    }
}
