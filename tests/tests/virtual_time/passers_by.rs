//! Somebody walks in a corridor that is longer than the laser sees, where he is all that speaks about the way.

use std::path::Path;

use lrfslam_app::config::RunConfig;
use lrfslam_firmware_sim::log::{LogPlan, Pace};
use lrfslam_firmware_sim::lrf_model::LrfModel;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_tests::drives::Drive;

/// The simulated floor with one person who walks there and back, seen by an LMS200: 8 m.
fn drive_with(person: &str) -> Drive {
    let worlds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware-sim/worlds");
    let floor = std::fs::read_to_string(worlds.join("floor.toml")).unwrap();
    let scenario = Scenario::parse(&format!("{floor}\n[[person]]\n{person}\n"), "floor.toml", &worlds).unwrap();
    let pace = Pace::Rate { hz: 5.0, seconds: None };
    Drive::new(&scenario, &LogPlan { lrf: LrfModel::LMS200, pace, snapshot: false, seed: 1 })
}

fn check(person: &str) {
    let drive = drive_with(person);
    for seed in [1, 2] {
        let error = drive.map(&RunConfig::default(), seed, 2).report.absolute_m;
        println!("{person}, seed {seed}: RMSE {:.3} m, worst {:.2} m", error.rmse, error.max);
        assert!(error.rmse < 0.2 && error.max < 1.0, "seed {seed}: {error:?}");
    }
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn who_comes_towards_the_robot_is_not_map() {
    check("way = [[15, 2.2], [1, 2.2]]\nspeed_mps = 1.1");
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn who_overtakes_the_robot_is_not_map() {
    check("way = [[1, 2.2], [15, 2.2]]\nspeed_mps = 0.8");
}
