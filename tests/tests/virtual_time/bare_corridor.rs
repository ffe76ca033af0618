//! A ring of corridor whose walls are bare for longer than the laser sees: nothing there tells how far the robot has come, and it has to know that.

use std::path::Path;

use lrfslam_app::config::RunConfig;
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::log::{LogPlan, Pace};
use lrfslam_firmware_sim::lrf_model::LrfModel;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_tests::drives::Drive;

const SEEDS: [u64; 3] = [1, 2, 3];

/// Once round, 300 m, and 25 m on, with an LMS200: 8 m. The robot starts along a wall, or turns by 20° before it sets out.
fn drive(is_askew: bool) -> Drive {
    let worlds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware-sim/worlds");
    let ring = std::fs::read_to_string(worlds.join("ring.toml")).unwrap();
    let turned = ring.replace("route = [[3, 0],", "route = [[3, 0], [3.8, 0.3], [4.6, 0],");
    assert_ne!(ring, turned);
    let scenario = Scenario::parse(if is_askew { &turned } else { &ring }, "ring.toml", &worlds).unwrap();
    let pace = Pace::Rate { hz: 5.0, seconds: None };
    Drive::new(
        &scenario,
        &LogPlan { lrf: LrfModel::LMS200, pace, snapshot: false, fault: FaultPlan::default(), seed: 1 },
    )
}

fn config(levels: u16, particles: u16) -> RunConfig {
    let mut config = RunConfig::default();
    config.hierarchy.levels = levels;
    config.particles.particles = particles;
    config
}

/// RMSE of the path, and the largest error at a place revisited, m, by seed.
fn errors(drive: &Drive, config: &RunConfig, seeds: &[u64]) -> Vec<[f64; 2]> {
    let of = |seed: &u64| {
        let report = drive.map(config, *seed, 2).report;
        [report.absolute_m.rmse, report.revisit_m.max]
    };
    let errors: Vec<[f64; 2]> = seeds.iter().map(of).collect();
    println!("RMSE and worst at a place revisited, m: {errors:.2?}");
    errors
}

fn mean_rmse(errors: &[[f64; 2]]) -> f64 {
    errors.iter().map(|[rmse, _]| rmse).sum::<f64>() / errors.len() as f64
}

/// With short pieces of a wall for features it was 16.5 m off.
#[test]
#[ignore = "heavy: run by .ci/run"]
fn a_corridor_askew_to_the_map_is_passed_as_any() {
    let mean = mean_rmse(&errors(&drive(true), &config(1, 1), &SEEDS));
    assert!(mean < 2.0, "{mean} m");
}

/// Weighed, those that lag would win: at 6c39e9e the mean of `prove --only ring-1,ring-1-one` is 0.96 and 0.66 m.
#[test]
#[ignore = "heavy: run by .ci/run"]
fn particles_do_not_lag_where_nothing_tells_the_way() {
    let drive = drive(false);
    let [fifty, one] = [50, 1].map(|particles| mean_rmse(&errors(&drive, &config(1, particles), &SEEDS)));
    assert!(fifty < 0.68 && fifty < 1.1 * one, "50 particles {fifty} m, one {one} m");
}

/// Nearly all of a corridor's points fit everywhere along it; with that for a doubt the ring stayed open by 1 to 2 m. One seed of five may (rows `ring…`).
#[test]
#[ignore = "heavy: run by .ci/run"]
fn a_ring_of_corridor_closes() {
    let drive = drive(false);
    for particles in [1, 50] {
        let errors = errors(&drive, &config(2, particles), &[1, 2, 3, 4, 5]);
        let closed = errors.iter().filter(|[_, revisit]| *revisit < 0.25).count();
        assert!(closed >= 4, "{particles} particles: {errors:?}");
    }
}
