//! A filter on a computer, and an endless corridor with pillars for it to drive along. Shared by benchmark and example.

use lrfslam_core::ancestry::Node;
use lrfslam_core::distributed_map::{MapMemory, Tile, TileHeader, TileId};
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::low_slam::{LowSlam, LowSlamConfigs, LowSlamMemory};
use lrfslam_core::math::{normal, sin_cos};
use lrfslam_core::motion::{MatchedMotion, ScanMatchingMotion, ScanMatchingMotionConfig};
use lrfslam_core::particles::{Particle, Sample};
use lrfslam_core::random::RandomStream;
use lrfslam_core::rays::Ray;
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::sweep::Sweep;
use lrfslam_core::time::{Duration, Instant};

pub const SIDE: usize = 16;
pub const RANGE_MAX_M: f32 = 8.0;

/// Leaks the memory for a filter: a benchmark ends soon.
pub fn filter(config: &LowSlamConfigs, tiles: usize) -> LowSlam<'static, SIDE> {
    let particles = usize::from(config.filter.particles);
    let samples = particles * usize::from(config.filter.samples_per_particle);
    let memory = LowSlamMemory {
        map: MapMemory {
            tiles: vec![Tile::UNSEEN; tiles].leak(),
            headers: vec![TileHeader::default(); tiles].leak(),
            node_tiles: vec![TileId::NONE; 2 * particles].leak(),
            directory: vec![TileId::NONE; 1 << 16].leak(),
            ages: &mut [],
        },
        nodes: vec![Node::default(); 2 * particles].leak(),
        particles: vec![Particle::default(); particles].leak(),
        samples: vec![Sample::default(); samples].leak(),
        rays: vec![Ray::default(); 1100].leak(),
        window: vec![TileId::NONE; 32 * 32].leak(),
    };
    LowSlam::new(config, 1, memory).expect("memory fits together")
}

/// Range from `from` in direction `angle`: walls at y = ±2 m, a pillar every 3 m, now on this side, now on that.
pub fn cast(from: Point2, angle: f32) -> f32 {
    let (sin, cos) = sin_cos(angle);
    let mut range = if sin > 0.0 { (2.0 - from.y) / sin } else { (-2.0 - from.y) / sin };
    let first = (from.x / 3.0) as i32 - 4;
    for k in first..first + 9 {
        let low_x = 3.0 * k as f32 + 0.37 * (k.rem_euclid(5)) as f32;
        let low_y = if k.rem_euclid(2) == 0 { 1.2 } else { -1.7 };
        let slab = |at: f32, d: f32, low: f32, size: f32| {
            let (a, b) = ((low - at) / d, (low + size - at) / d);
            (a.min(b), a.max(b))
        };
        let (x, y) = (slab(from.x, cos, low_x, 0.4), slab(from.y, sin, low_y, 0.5));
        let (enter, leave) = (x.0.max(y.0), x.1.min(y.1));
        if enter > 0.0 && enter < leave {
            range = range.min(enter);
        }
    }
    range
}

/// 180 beams over half a circle from `pose`, with 1 cm of noise.
pub fn beams_at(pose: Pose2, step: u32) -> Vec<Beam> {
    let mut rng = RandomStream::new(99, step, 0);
    (0..180)
        .map(|i| {
            let bearing_rad = (i as f32 - 89.5).to_radians();
            let range_m = cast(pose.position(), pose.heading + bearing_rad) + 0.01 * normal(&mut rng);
            Beam { bearing_rad, offset: Duration::ZERO, echo: Echo::from_range(range_m, RANGE_MAX_M) }
        })
        .collect()
}

pub fn as_sweep(beams: &[Beam]) -> Sweep<'_> {
    Sweep::at_rest(RangeScan { stamp: Instant::default(), range_max_m: RANGE_MAX_M, beams }, Pose2::IDENTITY)
}

/// Where the robot is at a step: along the corridor, swaying.
pub fn pose_at(step: u32) -> Pose2 {
    let phase = 0.05 * step as f32;
    let (sin, cos) = sin_cos(phase);
    Pose2::new(0.1 * step as f32, 0.5 * sin, 0.25 * cos)
}

/// The motion up to a step as a matcher might report it, a little off.
pub fn motion_at(step: u32) -> ScanMatchingMotion {
    let mut rng = RandomStream::new(98, step, 0);
    let (before, now) = (pose_at(step.saturating_sub(1)), pose_at(step));
    let error = Pose2::new(0.01 * normal(&mut rng), 0.01 * normal(&mut rng), 0.005 * normal(&mut rng));
    let matched = MatchedMotion { previous_from_robot: before.between(now) * error, ..Default::default() };
    ScanMatchingMotion::new(&ScanMatchingMotionConfig::default(), &matched)
}
