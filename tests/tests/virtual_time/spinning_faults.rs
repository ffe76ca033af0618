//! Lasers that spin, on a virtual clock, under faults: no beam that comes out is wrong, but where nothing can be checked.
//!
//! The table of docs/lasers.md: `cargo test -p lrfslam-tests --test virtual_time spinning_faults -- --nocapture`

use lrfslam_core::scan::Beam;
use lrfslam_core::time::Duration;
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::lrf_model::LrfErrors;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_firmware_sim::virtual_lrf::ldrobot::VirtualLd06;
use lrfslam_firmware_sim::virtual_lrf::rplidar::{RplidarModel, VirtualRplidar};
use lrfslam_lrf::driver::{Counters, LrfDriver};
use lrfslam_lrf::ldrobot::LdrobotDriver;
use lrfslam_lrf::rplidar::{self, RplidarConfig, RplidarDriver};
use lrfslam_tests::scenes::{Round, is_round};
use lrfslam_tests::{Rig, RigReport};

#[derive(Debug, Clone, Copy, PartialEq)]
enum Model {
    RplidarA2,
    RplidarC1,
    RplidarA1Old,
    Ld06,
}

const MODELS: [Model; 4] = [Model::RplidarA2, Model::RplidarC1, Model::RplidarA1Old, Model::Ld06];

fn device(model: Model) -> Box<dyn VirtualLrf> {
    let rplidar = match model {
        Model::RplidarA2 => RplidarModel::a2(),
        Model::RplidarC1 => RplidarModel::c1(),
        Model::RplidarA1Old => RplidarModel::a1_old(),
        Model::Ld06 => return Box::new(VirtualLd06::new(LrfErrors::NONE, Box::new(Round), 1)),
    };
    Box::new(VirtualRplidar::new(rplidar.with_errors(LrfErrors::NONE), Box::new(Round), 1))
}

fn driver(model: Model, beams: &mut [Beam]) -> Box<dyn LrfDriver + '_> {
    match model {
        Model::Ld06 => Box::new(LdrobotDriver::new(Duration::ZERO, beams)),
        _ => Box::new(RplidarDriver::new(RplidarConfig::default(), beams)),
    }
}

/// * `damage` — chance per write; `unplug_s` — from one unplugging to the next, 0 for never
fn run(model: Model, damage: f32, unplug_s: i64, seconds: i64) -> (RigReport, Counters) {
    let mut beams = vec![Beam::BLANK; rplidar::driver::BEAM_MEMORY];
    let unplug_every = Duration::from_micros(unplug_s * 1_000_000);
    let plan = FaultPlan { damage, unplug_every, unplugged_for: Duration::from_millis(1500) };
    let rig = Rig::new(driver(model, &mut beams), device(model), |_| None);
    let mut rig = rig.judged_by(is_round).with_faults(plan, 7);
    rig.run_for(Duration::from_micros(seconds * 1_000_000));
    println!(
        "{model:?} damage {damage} unplug {unplug_s} s: {} turns published in {seconds} s, {} of them wrong, {} incomplete, {} refused, {} restarts, {} faults",
        rig.report.published + rig.report.damaged,
        rig.report.damaged,
        rig.counters().incomplete,
        rig.counters().damaged,
        rig.counters().restarts,
        rig.report.faults,
    );
    (rig.report.clone(), rig.counters())
}

/// * `turns` — that each laser makes under each plan of faults
fn all_faults(turns: i64) {
    for model in MODELS {
        // Whole turns a second; those of the old RPLIDAR are 5.5.
        let per_second = if model == Model::RplidarA1Old { 5 } else { 10 };
        let seconds = turns / per_second;
        for (damage, unplug_s) in [(0.0, 0), (0.001, 0), (0.01, 0), (0.1, 0), (0.0, 20), (0.01, 20)] {
            let (report, counters) = run(model, damage, unplug_s, seconds);
            let published = i64::from(report.published);
            if damage == 0.0 && unplug_s == 0 {
                assert!(published >= turns * 9 / 10, "{model:?}: {published}");
                assert_eq!((report.damaged, counters.incomplete, counters.damaged), (0, 0, 0), "{model:?}");
            }
            // Distances of the old mode have no sum: a damaged one cannot be seen. Its groups of eight samples are a write each, 250 a second.
            let (wrong, least) = match model {
                Model::RplidarA1Old if damage < 0.1 => (published / 5, seconds),
                Model::RplidarA1Old => (i64::MAX, 0),
                _ => (0, seconds),
            };
            let found = i64::from(report.damaged);
            assert!(found <= wrong, "{model:?} at {damage}: {found} wrong of {published}");
            assert!(published >= least, "{model:?} at {damage}: {published} {:?}", report.events);
        }
    }
}

#[test]
fn spinning_lasers_survive_faults_and_no_wrong_beam_comes_out() {
    all_faults(600);
}

#[test]
#[ignore = "minutes; run with --ignored"]
fn spinning_lasers_survive_faults_over_a_hundred_thousand_scans() {
    all_faults(100_000);
}
