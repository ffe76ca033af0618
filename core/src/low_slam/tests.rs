use super::*;
use crate::ancestry::{AncestryMemoryError, Node};
use crate::distributed_map::{MapMemory, Tile, TileHeader, TileId};
use crate::math::{normal, sin_cos};
use crate::motion::{MatchedMotion, ScanMatchingMotion, ScanMatchingMotionConfig};
use crate::scan::{Beam, Echo, RangeScan};
use crate::time::{Duration, Instant};
use std::vec;
use std::vec::Vec;

const SIDE: usize = 8;

/// Memory for a filter of `particles` and `tiles`.
struct Memory {
    tiles: Vec<Tile<SIDE>>,
    headers: Vec<TileHeader>,
    node_tiles: Vec<TileId>,
    directory: Vec<TileId>,
    nodes: Vec<Node>,
    particles: Vec<Particle>,
    samples: Vec<Sample>,
    rays: Vec<Ray>,
    window: Vec<TileId>,
}

const WINDOW: usize = 32 * 32;

impl Memory {
    fn new(particles: usize, samples: usize, tiles: usize) -> Self {
        Self {
            tiles: vec![Tile::UNSEEN; tiles],
            headers: vec![TileHeader::default(); tiles],
            node_tiles: vec![TileId::NONE; 2 * particles],
            directory: vec![TileId::NONE; 1024],
            nodes: vec![Node::default(); 2 * particles],
            particles: vec![Particle::default(); particles],
            samples: vec![Sample::default(); samples],
            rays: vec![Ray::default(); 181],
            window: vec![TileId::NONE; WINDOW],
        }
    }

    fn lend(&mut self) -> LowSlamMemory<'_, SIDE> {
        LowSlamMemory {
            map: MapMemory {
                tiles: &mut self.tiles,
                headers: &mut self.headers,
                node_tiles: &mut self.node_tiles,
                directory: &mut self.directory,
                ages: &mut [],
            },
            nodes: &mut self.nodes,
            particles: &mut self.particles,
            samples: &mut self.samples,
            rays: &mut self.rays,
            window: &mut self.window,
        }
    }
}

fn configs(particles: u16) -> LowSlamConfigs {
    LowSlamConfigs {
        filter: LowSlamConfig { particles, particles_min: particles, ..Default::default() },
        map: ParticleMapConfig { square_size_m: 0.1, ..Default::default() },
        ..Default::default()
    }
}

/// Range from `from` in direction `angle` in a room with a pillar.
fn cast(from: Point2, angle: f32) -> f32 {
    let (sin, cos) = sin_cos(angle);
    let wall = |at: f32, d: f32, low: f32, high: f32| if d > 0.0 { (high - at) / d } else { (low - at) / d };
    let room = wall(from.x, cos, -3.0, 5.0).min(wall(from.y, sin, -2.0, 3.0));
    let pillar = |at: f32, d: f32, low: f32, high: f32| {
        let (a, b) = ((low - at) / d, (high - at) / d);
        (a.min(b), a.max(b))
    };
    let (x, y) = (pillar(from.x, cos, 2.0, 2.6), pillar(from.y, sin, 1.0, 1.5));
    let (enter, leave) = (x.0.max(y.0), x.1.min(y.1));
    if enter > 0.0 && enter < leave { enter.min(room) } else { room }
}

/// Where the map's origin is in the room: its squares do not line up with the walls.
const ROOM_FROM_MAP: Pose2 = Pose2 { x: 0.03, y: 0.04, heading: 0.35 };

/// 180 beams from `pose`, with 1 cm of noise.
fn scan_at(pose: Pose2, step: u32) -> Vec<Beam> {
    let pose = ROOM_FROM_MAP * pose;
    let mut rng = RandomStream::new(99, step, 0);
    (0..180)
        .map(|i| {
            let bearing_rad = (i as f32 - 90.0) * 0.0262;
            let range_m = cast(pose.position(), pose.heading + bearing_rad) + 0.01 * normal(&mut rng);
            Beam { bearing_rad, offset: Duration::ZERO, echo: Echo::from_range(range_m, 20.0) }
        })
        .collect()
}

fn as_sweep(beams: &[Beam]) -> Sweep<'_> {
    Sweep::at_rest(RangeScan { stamp: Instant::default(), range_max_m: 20.0, beams }, Pose2::IDENTITY)
}

/// True poses of a robot that drives in circles.
fn path(steps: u32) -> impl Iterator<Item = Pose2> {
    core::iter::successors(Some(Pose2::IDENTITY), |pose| Some(*pose * Pose2::new(0.08, 0.0, 0.1))).take(steps as usize)
}

/// The motion between two poses with a bias, as a matcher might report it, and a spread that covers it.
fn biased(before: Pose2, now: Pose2) -> ScanMatchingMotion {
    let config = ScanMatchingMotionConfig { forward_m: 0.02, lateral_m: 0.02, heading_deg: 1.0, ..Default::default() };
    let reported = before.between(now) * Pose2::new(0.005, 0.003, 0.004);
    ScanMatchingMotion::new(&config, &MatchedMotion { previous_from_robot: reported, ..Default::default() })
}

/// Drives a filter along the path and calls `observe` after each step.
fn drive(
    config: &LowSlamConfigs,
    memory: &mut Memory,
    steps: u32,
    threads: usize,
    mut observe: impl FnMut(&LowSlam<'_, SIDE>, &FilterReport, Pose2),
) {
    let mut slam = LowSlam::new(config, 5, memory.lend()).unwrap();
    let mut before = Pose2::IDENTITY;
    for (step, pose) in path(steps).enumerate() {
        let beams = scan_at(pose, step as u32);
        let motion = biased(before, pose);
        let report = if threads == 1 {
            slam.step(&as_sweep(&beams), &motion)
        } else {
            slam.step_with(&as_sweep(&beams), &motion, |weighing, samples, _| on_threads(threads, weighing, samples))
        };
        observe(&slam, &report.unwrap(), pose);
        before = pose;
    }
}

fn on_threads(threads: usize, weighing: &Weighing<'_, '_, SIDE>, samples: &mut [Sample]) {
    std::thread::scope(|scope| {
        let mut rest = samples;
        for part in 0..threads {
            let range = weighing.share(part, threads);
            let (own, others) = rest.split_at_mut(weighing.samples_of(range.clone()));
            rest = others;
            scope.spawn(move || {
                let mut slots = vec![TileId::NONE; WINDOW];
                weighing.weigh(range, own, &mut Window::new(&mut slots).unwrap());
            });
        }
        assert!(rest.is_empty());
    });
}

fn distance(a: Pose2, b: Pose2) -> f32 {
    (a.position() - b.position()).norm()
}

#[test]
fn the_filter_corrects_a_biased_motion() {
    let (mut reckoned, mut before, mut worst) = (Pose2::IDENTITY, Pose2::IDENTITY, 0.0_f32);
    drive(&configs(60), &mut Memory::new(60, 60, 8000), 120, 1, |_, report, pose| {
        reckoned = reckoned * before.between(pose) * Pose2::new(0.005, 0.003, 0.004);
        before = pose;
        worst = worst.max(distance(report.map_from_robot, pose));
        assert_eq!((report.squares_left_out, report.dropped, report.rays_cut), (0, 0, 0));
    });
    assert!(distance(reckoned, before) > 0.3, "dead reckoning is off by {}", distance(reckoned, before));
    assert!(worst < 0.1, "the filter is off by up to {worst} m");
}

#[test]
fn threads_change_no_bit() {
    let config = LowSlamConfigs {
        filter: LowSlamConfig { particles: 20, samples_per_particle: 3, ..configs(20).filter },
        ..configs(20)
    };
    let run = |threads| {
        let mut history = Vec::new();
        drive(&config, &mut Memory::new(20, 60, 6000), 25, threads, |slam, report, _| {
            history.push((*report, slam.particles().to_vec(), slam.samples().to_vec()));
        });
        history
    };
    let alone = run(1);
    assert_eq!(alone, run(2));
    assert_eq!(alone, run(7));
}

#[test]
fn parents_and_leaves_are_told_truly() {
    let mut before: Vec<Particle> = Vec::new();
    drive(&configs(40), &mut Memory::new(40, 40, 8000), 60, 1, |slam, report, _| {
        let now = slam.particles();
        assert_eq!(now.len(), report.particles);
        assert!(report.nodes < 2 * now.len().max(1) && report.depth < now.len());
        for (index, particle) in now.iter().enumerate() {
            assert_eq!(slam.ancestry().particle(particle.node), Some(index));
            assert!(before.is_empty() || usize::from(particle.parent) < before.len());
            assert!(particle.draws > 0);
        }
        assert!(now.is_sorted_by_key(|particle| particle.parent));
        before = now.to_vec();
    });
}

#[test]
fn few_particles_where_all_agree_and_all_of_them_where_an_axis_is_open() {
    let mut config = configs(40);
    config.filter.particles_min = 6;
    let mut memory = Memory::new(40, 40, 8000);
    let mut slam = LowSlam::new(&config, 5, memory.lend()).unwrap();
    let mut step = |step: u32, undetermined| {
        let beams = scan_at(Pose2::IDENTITY, step);
        let still = MatchedMotion { previous_from_robot: Pose2::IDENTITY, undetermined };
        let motion = ScanMatchingMotion::new(&ScanMatchingMotionConfig::default(), &still);
        slam.step(&as_sweep(&beams), &motion).unwrap()
    };
    let particles: Vec<usize> = (0..6).map(|i| step(i, None).particles).collect();
    assert!(particles.iter().all(|count| (1..=6).contains(count)), "{particles:?}");
    step(6, Some(Point2::new(1.0, 0.0)));
    assert_eq!(step(7, Some(Point2::new(1.0, 0.0))).samples, 40, "the next scan finds all of them");
    assert_eq!(step(8, None).samples, 40, "who is too many goes when weights tell who");
}

/// Particles that have gone less far see more of what they know: weights would draw the robot back, step by step.
#[test]
fn an_open_axis_is_not_weighed() {
    let mut memory = Memory::new(40, 40, 8000);
    let mut slam = LowSlam::new(&configs(40), 5, memory.lend()).unwrap();
    let mut size_after = |step: u32, undetermined| {
        let beams = scan_at(Pose2::IDENTITY, step);
        let matched = MatchedMotion { previous_from_robot: Pose2::new(0.05, 0.0, 0.0), undetermined };
        let config = ScanMatchingMotionConfig { undetermined_m: 0.1, ..ScanMatchingMotionConfig::default() };
        slam.step(&as_sweep(&beams), &ScanMatchingMotion::new(&config, &matched)).unwrap().effective_sample_size
    };
    size_after(0, None);
    for step in 1..8 {
        let size = size_after(step, Some(Point2::new(1.0, 0.0)));
        assert!((size - 40.0).abs() < 0.01, "{size}");
    }
    let size = size_after(8, None);
    assert!(size < 30.0, "what the scene tells then counts: {size}");
}

#[test]
fn resampling_after_every_scan_keeps_all_draws_and_no_weight() {
    let mut config = configs(30);
    config.filter.samples_per_particle = 2;
    let mut first = true;
    drive(&config, &mut Memory::new(30, 60, 6000), 30, 1, |slam, report, _| {
        assert!(report.resampled || first);
        first = false;
        assert_eq!(slam.particles().iter().map(|particle| particle.draws).sum::<u16>(), 30);
        assert!(slam.particles().iter().all(|particle| particle.log_weight == 0.0));
    });
}

#[test]
fn with_few_tiles_the_least_likely_go_and_the_report_says_so() {
    let (mut dropped, mut worst) = (0, 0.0_f32);
    drive(&configs(40), &mut Memory::new(40, 40, 500), 120, 1, |slam, report, pose| {
        dropped += report.dropped;
        worst = worst.max(distance(report.map_from_robot, pose));
        assert!(report.particles >= 1 && report.tiles <= slam.map().tiles_max());
        for (index, particle) in slam.particles().iter().enumerate() {
            assert_eq!(slam.ancestry().particle(particle.node), Some(index));
        }
        assert!(report.nodes < 2 * report.particles);
    });
    assert!(dropped > 0 && worst < 0.3, "{dropped} dropped, off by up to {worst} m");
}

#[test]
fn with_no_room_for_even_one_map_it_goes_on_and_says_so() {
    let mut left_out = 0;
    drive(&configs(8), &mut Memory::new(8, 8, 20), 30, 1, |_, report, _| {
        left_out += report.squares_left_out;
        assert!(report.particles >= 1 && report.map_from_robot.is_finite());
    });
    assert!(left_out > 1000);
}

#[test]
fn few_nodes_or_samples_mean_fewer_particles() {
    let mut memory = Memory::new(10, 10, 100);
    memory.nodes.truncate(6);
    let slam = LowSlam::new(&configs(100), 1, memory.lend()).unwrap();
    assert_eq!(slam.particles_max(), 3);
    let mut memory = Memory::new(10, 10, 100);
    memory.nodes.truncate(1);
    assert!(matches!(
        LowSlam::new(&configs(100), 1, memory.lend()),
        Err(LowSlamMemoryError::Ancestry(AncestryMemoryError(1)))
    ));
}

#[test]
fn a_scan_with_too_many_beams_changes_nothing() {
    let mut memory = Memory::new(10, 10, 1000);
    let mut slam = LowSlam::new(&configs(10), 1, memory.lend()).unwrap();
    let beams = scan_at(Pose2::IDENTITY, 0);
    let motion = biased(Pose2::IDENTITY, Pose2::IDENTITY);
    slam.step(&as_sweep(&beams), &motion).unwrap();
    let (before, tiles) = (slam.particles().to_vec(), slam.map().tiles_used());
    let twice: Vec<Beam> = beams.iter().chain(&beams).copied().collect();
    assert_eq!(slam.step(&as_sweep(&twice), &motion), Err(RayCapacityError { capacity: 181 }));
    assert_eq!((slam.particles(), slam.map().tiles_used()), (&before[..], tiles));
}

#[test]
fn numbers_without_meaning_do_not_stop_it() {
    struct Wild;
    impl Motion for Wild {
        fn sample(&self, _: Pose2, rng: &mut impl rand_core::Rng) -> Pose2 {
            let pick = [f32::NAN, f32::INFINITY, 1e30, -1e9, 3.0][rng.next_u32() as usize % 5];
            Pose2 { x: pick, y: 0.0, heading: 0.0 }
        }
    }
    let mut memory = Memory::new(10, 10, 1000);
    let mut slam = LowSlam::new(&configs(10), 1, memory.lend()).unwrap();
    let beams = scan_at(Pose2::IDENTITY, 0);
    for _ in 0..20 {
        let report = slam.step(&as_sweep(&beams), &Wild).unwrap();
        assert!(report.particles >= 1);
    }
    let empty = slam.step(&as_sweep(&[]), &Wild).unwrap();
    assert_eq!(empty.rays, 0);
}

#[test]
fn pools_of_a_microcontroller_are_enough_for_a_room() {
    let mut pools = std::boxed::Box::new(LowSlamPools::<SIDE, 3264, 1024, 32, 64, 32, 682, 1024>::EMPTY);
    assert!(size_of_val(&*pools) <= 512 * 1024);
    let mut slam = LowSlam::new(&configs(32), 1, pools.lend()).unwrap();
    assert_eq!(slam.particles_max(), 32);
    let (mut before, mut worst) = (Pose2::IDENTITY, 0.0_f32);
    for (step, pose) in path(60).enumerate() {
        let beams = scan_at(pose, step as u32);
        let report = slam.step(&as_sweep(&beams), &biased(before, pose)).unwrap();
        assert_eq!((report.squares_left_out, report.rays_cut), (0, 0));
        worst = worst.max(distance(report.map_from_robot, pose));
        before = pose;
    }
    assert!(worst < 0.15, "off by up to {worst} m");
}

mod stretches;
