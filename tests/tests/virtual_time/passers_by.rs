//! Somebody walks in a corridor that is longer than the laser sees, where he is all that speaks about the way.

use std::path::Path;

use lrfslam_app::config::RunConfig;
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::log::{LogPlan, Pace};
use lrfslam_firmware_sim::lrf_model::LrfModel;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_tests::drives::Drive;

/// One more round in the simulated floor.
const ROUND: [[f64; 2]; 10] = [
    [15.5, 1.5],
    [16.0, 7.1],
    [12.3, 7.6],
    [6.0, 6.0],
    [8.6, 4.2],
    [8.6, 1.6],
    [16.0, 1.8],
    [15.9, 10.4],
    [2.1, 10.5],
    [2.0, 1.5],
];

/// The simulated floor with one person who walks there and back, or more, seen by an LMS200: 8 m; so many rounds.
fn drive_with(person: &str, rounds: usize) -> Drive {
    let worlds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware-sim/worlds");
    let floor = std::fs::read_to_string(worlds.join("floor.toml")).unwrap();
    let scenario = Scenario::parse(&format!("{floor}\n[[person]]\n{person}\n"), "floor.toml", &worlds).unwrap();
    let scenario = scenario.driving_on(&ROUND.repeat(rounds - 1)).unwrap();
    let pace = Pace::Rate { hz: 5.0, seconds: None };
    Drive::new(
        &scenario,
        &LogPlan { lrf: LrfModel::LMS200, pace, snapshot: false, fault: FaultPlan::default(), seed: 1 },
    )
}

/// One in each corridor, all the time. One walks where the robot's way goes, through the robot at last.
fn four_people() -> String {
    let ways = ["[1, 2.2], [15, 2.2]", "[16, 1], [16, 11]", "[15, 10], [2, 10]", "[2.2, 2], [2.2, 10]"];
    let people =
        ways.iter().zip([0.8, 0.9, 1.1, 0.7]).map(|(way, speed)| format!("way = [{way}]\nspeed_mps = {speed}"));
    people.collect::<Vec<_>>().join("\n[[person]]\n")
}

fn check(person: &str, rounds: usize, seeds: &[u64]) {
    let drive = drive_with(person, rounds);
    for &seed in seeds {
        let error = drive.map(&RunConfig::default(), seed, 2).report.absolute_m;
        println!("{person}, seed {seed}: RMSE {:.3} m, worst {:.2} m", error.rmse, error.max);
        assert!(error.rmse < 0.2 && error.max < 1.0, "seed {seed}: {error:?}");
    }
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn who_comes_towards_the_robot_is_not_map() {
    check("way = [[15, 2.2], [1, 2.2]]\nspeed_mps = 1.1", 1, &[1, 2]);
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn who_overtakes_the_robot_is_not_map() {
    check("way = [[1, 2.2], [15, 2.2]]\nspeed_mps = 0.8", 1, &[1, 2]);
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn four_people_who_walk_on_and_on_do_not_wreck_the_map() {
    check(&four_people(), 3, &[1]);
}

/// Unplugged and carried for a minute, in a building that looks nearly the same from its other end: one scan that fits somewhere is no proof.
#[test]
#[ignore = "heavy: run by .ci/run"]
fn who_is_unplugged_and_carried_is_not_where_a_scan_fits() {
    const DRIVEN: usize = 1100;
    let whole = drive_with(&four_people(), 3);
    for carried in [296, 369] {
        let after = &whole.scans[DRIVEN + carried..][..600];
        let scans = whole.scans[..DRIVEN].iter().chain(after).cloned().collect();
        let mapped = Drive { scans, truth: whole.truth.clone() }.map(&RunConfig::default(), 1, 2);
        let error = mapped.believed.absolute_m;
        println!("carried for {carried} scans: {} of 1700 believed, worst {:.2} m", error.count, error.max);
        assert!(error.max < 1.5 && error.count >= DRIVEN - 50, "{carried}: {error:?}");
    }
}
