//! Are the filters as sure as they may be? Normalised estimation error squared over 50 simulated drives; and what must never happen.

use super::super::ekf::EkfSlam;
use super::super::fast::{FastLandmark, FastMemory, FastParticle, FastSlam};
use super::world::{EkfPools, LANDMARKS, World, config};
use super::*;

const RUNS: u64 = 50;
/// Steps of 0.1 s; once round is 25 s.
const STEPS: usize = 500;
/// Squared errors are taken at these steps.
const TAKEN: [usize; 4] = [50, 150, 300, 499];

/// Mean squared error of so many drives, of 3 degrees of freedom each: its 95 % bounds.
fn bounds() -> [f64; 2] {
    [-1.96, 1.96].map(|deviations| chi_squared(3 * RUNS as usize, deviations) / RUNS as f64)
}

/// Means over the drives at the steps taken.
#[derive(Default)]
struct Told {
    /// Normalised squared error of the pose.
    nees: [f64; TAKEN.len()],
    /// Particles at the start from which those of now come; an EKF has none.
    ancestors: [f64; TAKEN.len()],
    /// 1 / Σ w².
    effective: [f64; TAKEN.len()],
}

fn told(config: &LandmarkConfig, particles: Option<u16>) -> Told {
    let mut told = Told::default();
    for seed in 1..=RUNS {
        let mut world = World::new(config, seed);
        let mut pools = EkfPools::new(LANDMARKS);
        let mut ekf = EkfSlam::new(config, pools.memory()).unwrap();
        let count = usize::from(particles.unwrap_or(1));
        let mut of_particles = vec![FastParticle::UNUSED; count];
        let mut maps = vec![FastLandmark::default(); count * LANDMARKS];
        let memory = FastMemory { particles: &mut of_particles, landmarks: &mut maps };
        let mut fast = FastSlam::new(config, seed, memory).unwrap();
        let mut lines: Vec<usize> = (0..count).collect();
        for step in 0..STEPS {
            let control = world.drive();
            let seen = if step % 5 == 0 { world.look() } else { heapless::Vec::new() };
            if particles.is_some() {
                fast.predict(&control);
                fast.observe(&seen);
                if fast.has_resampled() {
                    lines = fast.particles().iter().map(|particle| lines[usize::from(particle.parent)]).collect();
                }
            } else {
                ekf.predict(&control);
                ekf.observe(&seen, &mut []);
            }
            let (robot, covariance) = match particles {
                Some(_) => (fast.mean(), fast.covariance()),
                None => (ekf.robot(), ekf.robot_covariance()),
            };
            if let Some(place) = TAKEN.iter().position(|taken| *taken == step) {
                told.nees[place] += world.squared_error(&robot, &covariance) / RUNS as f64;
                let distinct = lines.iter().collect::<std::collections::HashSet<_>>().len();
                told.ancestors[place] += distinct as f64 / RUNS as f64;
                let squares: f64 = fast.particles().iter().map(|particle| particle.weight * particle.weight).sum();
                told.effective[place] += 1.0 / squares / RUNS as f64;
            }
        }
    }
    told
}

/// Mean NEES of the pose at the steps taken.
fn nees(config: &LandmarkConfig) -> [f64; TAKEN.len()] {
    told(config, None).nees
}

#[test]
fn the_invariant_ekf_is_consistent() {
    let (found, [low, high]) = (nees(&LandmarkConfig { invariant: true, ..config() }), bounds());
    println!("invariant EKF: NEES {found:.2?} at steps {TAKEN:?}, 95 % bounds {low:.2} to {high:.2}");
    assert!(found.iter().all(|value| (low..=high).contains(value)), "{found:?}");
}

#[test]
fn the_plain_ekf() {
    let (found, [low, high]) = (nees(&LandmarkConfig { invariant: false, ..config() }), bounds());
    println!("plain EKF: NEES {found:.2?} at steps {TAKEN:?}, 95 % bounds {low:.2} to {high:.2}");
}

/// Of 100 particles, or of as many as `LRFSLAM_PARTICLES` lists.
#[test]
#[ignore = "heavy: run by .ci/run"]
fn fast_slam_tells_its_figures() {
    let [low, high] = bounds();
    let counts = std::env::var("LRFSLAM_PARTICLES").unwrap_or("100".to_owned());
    for (name, fast_proposal) in [("1.0", false), ("2.0", true)] {
        for count in counts.split_whitespace().map(|count| count.parse().unwrap()) {
            let told = told(&LandmarkConfig { fast_proposal, ..config() }, Some(count));
            println!("FastSLAM {name}, {count} particles, at steps {TAKEN:?}:");
            println!("    NEES {:.1?}, 95 % bounds {low:.2} to {high:.2}", told.nees);
            println!("    ancestors {:.1?}, effective particles {:.0?}", told.ancestors, told.effective);
        }
    }
}

/// What may come from a broken sensor changes nothing, or at least breaks nothing.
#[test]
fn nonsense_is_refused_and_full_pools_are_counted() {
    let config = config();
    let mut pools = EkfPools::new(2);
    let mut ekf = EkfSlam::new(&config, pools.memory()).unwrap();
    let (mut particles, mut maps) = ([FastParticle::UNUSED; 3], [FastLandmark::default(); 6]);
    let mut fast = FastSlam::new(&config, 1, FastMemory { particles: &mut particles, landmarks: &mut maps }).unwrap();
    let nan = Control::Velocity { forward_m_s: f64::NAN, turn_rad_s: 0.0, seconds: 1.0 };
    assert!(!ekf.predict(&nan) && !fast.predict(&nan));
    let sighting = |range_m, bearing_rad, identity| Sighting { range_m, bearing_rad, identity, noise: None };
    let bad = [sighting(f64::NAN, 0.0, Some(1)), sighting(-1.0, 0.0, Some(1)), sighting(1.0, 0.0, None)];
    assert_eq!((ekf.observe(&bad, &mut []).refused, fast.observe(&bad).began), (3, 0));
    let many = [1, 2, 3].map(|identity| sighting(2.0, f64::from(identity) * 0.4, Some(identity)));
    let mut fates = [Fate::Refused; 3];
    let counts = ekf.observe(&many, &mut fates);
    assert_eq!((counts.began, counts.full), (2, 1));
    assert_eq!(fates, [Fate::Began(0), Fate::Began(1), Fate::Full]);
    let counts = fast.observe(&many);
    assert_eq!((counts.began, counts.full), (2, 1));
    assert!(ekf.robot().iter().chain(fast.mean().iter()).all(|number| number.is_finite()));
}

/// The same inputs and seed give the same bits; another seed gives others.
#[test]
fn runs_repeat_to_the_last_bit() {
    let drive = |seed| {
        let (config, mut world) = (config(), World::new(&config(), 3));
        let (mut particles, mut maps) = (vec![FastParticle::UNUSED; 20], vec![FastLandmark::default(); 20 * LANDMARKS]);
        let memory = FastMemory { particles: &mut particles, landmarks: &mut maps };
        let mut fast = FastSlam::new(&config, seed, memory).unwrap();
        for _ in 0..100 {
            fast.predict(&world.drive());
            fast.observe(&world.look());
        }
        fast.mean().map(f64::to_bits)
    };
    assert_eq!(drive(1), drive(1));
    assert_ne!(drive(1), drive(2));
}

/// Nobody says which landmark is which: the same map comes out, without one too many, for either way of choosing.
#[test]
fn landmarks_are_told_apart_by_where_they_are() {
    for association in [Association::Nearest, Association::Joint] {
        let config = LandmarkConfig { association, gate_deviations: 3.0, ..config() };
        let mut world = World::new(&config, 5);
        let mut pools = EkfPools::new(3 * LANDMARKS);
        let mut ekf = EkfSlam::new(&config, pools.memory()).unwrap();
        let mut seen = [false; LANDMARKS];
        for _ in 0..500 {
            ekf.predict(&world.drive());
            let sightings = world.look();
            sightings.iter().for_each(|sighting| seen[usize::from(sighting.identity.unwrap_or(0))] = true);
            let blind: Vec<Sighting> = sightings.iter().map(|s| Sighting { identity: None, ..*s }).collect();
            ekf.observe(&blind, &mut []);
        }
        let expected = seen.iter().filter(|seen| **seen).count();
        let error = world.squared_error(&ekf.robot(), &ekf.robot_covariance());
        assert!(
            ekf.landmarks().count().abs_diff(expected) <= 2,
            "{association:?}: {} of {expected}",
            ekf.landmarks().count()
        );
        assert!(error < 25.0, "{association:?}: {error}");
    }
}

/// Fifty landmarks fit a microcontroller: 50 KiB for an EKF.
#[test]
fn fifty_landmarks_fit_a_microcontroller() {
    let bytes = super::super::ekf::EkfMemory::bytes(50);
    println!("EKF-SLAM of 50 landmarks: {bytes} bytes");
    assert!(bytes < 52 * 1024, "{bytes}");
}
