//! A small world for tests: walls, what a laser sees of them, and drives.

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::math::normal;
use lrfslam_core::random::RandomStream;
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::sweep::{Sweep, SweepMotion};
use lrfslam_core::time::{Duration, Instant};

use crate::mapping::LowPose;

/// What a laser that looks ahead over 180° sees at `at` between `walls`, each from one point to another, m.
pub(crate) fn sees(walls: &[[f32; 4]], at: Pose2) -> Vec<Beam> {
    let range = |bearing_rad: f32| {
        let (sin, cos) = (at.heading + bearing_rad).sin_cos();
        let hit = |[ax, ay, bx, by]: &[f32; 4]| {
            let (dx, dy, ex, ey) = (bx - ax, by - ay, ax - at.x, ay - at.y);
            let across = cos * dy - sin * dx;
            let (range, along) = ((ex * dy - ey * dx) / across, (ex * sin - ey * cos) / across);
            (range > 0.0 && (0.0..=1.0).contains(&along)).then_some(range)
        };
        walls.iter().filter_map(hit).min_by(f32::total_cmp)
    };
    let beam = |bearing_rad: f32| {
        let echo = range(bearing_rad).map_or(Echo::Miss, Echo::Hit);
        Beam { bearing_rad, offset: Duration::ZERO, echo }
    };
    (-90..=90).map(|degrees| beam((degrees as f32).to_radians())).collect()
}

/// What it saw, `stamp_us` microseconds after the start, taken at once.
pub(crate) fn sweep_of(beams: &[Beam], stamp_us: i64) -> Sweep<'_> {
    let scan = RangeScan { stamp: Instant::from_micros(stamp_us), range_max_m: 30.0, beams };
    Sweep { scan, robot_from_lrf: Pose2::IDENTITY, motion: SweepMotion::default() }
}

/// A room 6 m long, `half_m` to each side, and a corridor 2 m wide and 16 m long out of it with a niche and a corner.
pub(crate) fn room_and_corridor(half_m: f32) -> Vec<[f32; 4]> {
    let outline = |points: &[(f32, f32)]| -> Vec<[f32; 4]> {
        points.windows(2).map(|pair| [pair[0].0, pair[0].1, pair[1].0, pair[1].1]).collect()
    };
    let left = [(0.0, 1.0), (4.0, 1.0), (4.0, 1.6), (5.2, 1.6), (5.2, 1.0), (16.0, 1.0), (16.0, -1.0), (11.0, -1.0)];
    let right = [(11.0, -1.0), (11.0, -1.8), (9.0, -1.8), (9.0, -1.0), (0.0, -1.0), (0.0, -half_m), (-6.0, -half_m)];
    let room = [(-6.0, -half_m), (-6.0, half_m), (0.0, half_m), (0.0, 1.0)];
    [outline(&left), outline(&right), outline(&room)].concat()
}

/// A corridor 2 m wide and 24 m long with doors to both sides, recesses 0.4 m deep.
pub(crate) fn corridor_with_doors() -> Vec<[f32; 4]> {
    let side = |y: f32, recess: f32, doors: &[f32]| {
        let corners = |door: &f32| [(*door, y), (*door, recess), (door + 1.0, recess), (door + 1.0, y)];
        let points = [(-6.0, 0.0), (-6.0, y)].into_iter().chain(doors.iter().flat_map(corners));
        let points: Vec<(f32, f32)> = points.chain([(18.0, y), (18.0, 0.0)]).collect();
        points.windows(2).map(|pair| [pair[0].0, pair[0].1, pair[1].0, pair[1].1]).collect::<Vec<_>>()
    };
    [side(1.0, 1.4, &[-4.5, -2.0, 2.0, 5.5, 7.5, 12.0, 15.0]), side(-1.0, -1.4, &[-3.0, 0.5, 4.0, 9.5, 11.0, 16.0])]
        .concat()
}

/// To and fro along [`corridor_with_doors`] and there once more: where the robot was at each scan of the last way, m.
///
/// * `told_last` — where the low level says it was then
/// * `is_told_last` — and that walls told it so
/// * `noise_m` — standard deviation of a hit
/// * `take` — is given each scan, and what the low level says of it
pub(crate) fn to_and_fro(
    told_last: impl Fn(f32) -> f32,
    is_told_last: bool,
    noise_m: f32,
    mut take: impl FnMut(&Sweep<'_>, &LowPose),
) -> Vec<f32> {
    let walls = corridor_with_doors();
    let mut rng = RandomStream::new(1, 0, 0);
    let mut stamp = 0;
    let mut drive = |x: f32, told_x: f32, is_told: bool| {
        let mut beams = sees(&walls, Pose2::new(x, 0.0, 0.0));
        for beam in &mut beams {
            if let Echo::Hit(range_m) = &mut beam.echo {
                *range_m += noise_m * normal(&mut rng);
            }
        }
        stamp += 200_000;
        let map_from_robot = Pose2::new(told_x, 0.0, 0.0);
        let undetermined = (!is_told).then_some(Point2::new(1.0, 0.0));
        let low = LowPose { map_from_robot, undetermined, is_lost: false, is_blind: false, is_frozen: false };
        take(&sweep_of(&beams, stamp), &low);
    };
    let places: Vec<f32> = (0..=160).map(|step| -4.0 + 0.1 * f32::from(step as u16)).collect();
    places.iter().for_each(|&x| drive(x, x, true));
    places.iter().rev().for_each(|&x| drive(x, x, true));
    places.iter().for_each(|&x| drive(x, told_last(x), is_told_last));
    places
}

/// A low level that takes parts of the way for longer than they are, and others for shorter. As a whole it comes out right, so a closure of eight metres
/// says little; doors do.
pub(crate) fn stretched(x: f32) -> f32 {
    x + 0.12 * (std::f32::consts::FRAC_PI_4 * (x + 4.0)).sin()
}

/// One that is off by as much as a match may lie from where it is thought to be, and comes right four metres farther on.
pub(crate) fn ahead(x: f32) -> f32 {
    if x > 2.0 && x < 6.0 { x + 0.3 } else { x }
}
