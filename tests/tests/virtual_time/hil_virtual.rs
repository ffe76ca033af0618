//! Hardware in the loop on a virtual clock: each model, each fault, whatever the state it is found in.
//!
//! The long run, 100000 scans a model and fault rate: `cargo test --release -p lrfslam-tests --test virtual_time hil_virtual -- --ignored --nocapture`

use lrfslam_core::scan::Beam;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_firmware_sim::virtual_lrf::sick::{SickModel, VirtualSick};
use lrfslam_lrf::driver::{BaudPolicy, LrfDriver};
use lrfslam_lrf::hokuyo_scip::{self, HokuyoConfig, HokuyoDriver};
use lrfslam_lrf::sick_lms::{self, OperatingMode, SickConfig, SickDriver, Variant};
use lrfslam_tests::{Rig, oracle};

const SECOND: i64 = 1_000_000;

/// What a driver borrows.
struct Memory {
    bytes: Vec<u8>,
    beams: Vec<Beam>,
}

impl Memory {
    fn new() -> Self {
        Self {
            bytes: vec![0; hokuyo_scip::driver::FRAME_MEMORY],
            beams: vec![Beam::BLANK; hokuyo_scip::driver::BEAM_MEMORY],
        }
    }

    fn sick(&mut self, config: SickConfig) -> Box<dyn LrfDriver + '_> {
        let bytes = &mut self.bytes[..sick_lms::driver::TELEGRAM_MEMORY];
        Box::new(SickDriver::new(config, bytes, &mut self.beams[..sick_lms::driver::BEAM_MEMORY]))
    }

    fn hokuyo(&mut self, config: HokuyoConfig) -> Box<dyn LrfDriver + '_> {
        Box::new(HokuyoDriver::new(config, &mut self.bytes, &mut self.beams))
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Model {
    Lms200,
    Lms291,
    Urg,
    Utm,
}

const MODELS: [Model; 4] = [Model::Lms200, Model::Lms291, Model::Urg, Model::Utm];

fn sick(model: SickModel) -> VirtualSick {
    VirtualSick::new(model, Box::new(Scenario::load("room").expect("comes with the program").scene()), 11)
}

fn hokuyo(model: HokuyoModel) -> VirtualHokuyo {
    VirtualHokuyo::new(model, Box::new(Scenario::load("room").expect("comes with the program").scene()), 11)
}

/// A rig with the model at its power-up rate, and the fastest rate that it is used with.
fn rig(model: Model, memory: &mut Memory) -> Rig<'_> {
    let raise = |baud| BaudPolicy::Raise(baud);
    match model {
        Model::Lms200 | Model::Lms291 => {
            let device = if model == Model::Lms200 { SickModel::lms200() } else { SickModel::lms291() };
            let variant = Some(Variant::DEG_180_BY_1);
            let config = SickConfig { baud: raise(500_000), variant, ..SickConfig::default() };
            Rig::new(memory.sick(config), Box::new(sick(device)), oracle::sick)
        }
        Model::Urg => {
            let config = HokuyoConfig { baud: raise(115_200), ..HokuyoConfig::default() };
            Rig::new(memory.hokuyo(config), Box::new(hokuyo(HokuyoModel::urg_04lx())), |write| {
                oracle::hokuyo(write, false)
            })
        }
        Model::Utm => {
            Rig::new(memory.hokuyo(HokuyoConfig::default()), Box::new(hokuyo(HokuyoModel::utm_30lx())), |write| {
                oracle::hokuyo(write, true)
            })
        }
    }
}

fn plan(damage: f32, unplug_s: i64) -> FaultPlan {
    FaultPlan {
        damage,
        unplug_every: Duration::from_micros(unplug_s * SECOND),
        unplugged_for: Duration::from_millis(1500),
    }
}

fn seconds(span: Duration) -> f64 {
    span.micros as f64 / 1e6
}

#[test]
fn every_model_streams_what_its_line_allows_and_loses_nothing() {
    for (model, per_minute) in
        [(Model::Lms200, 4490..=4501), (Model::Lms291, 4490..=4501), (Model::Urg, 295..=301), (Model::Utm, 2395..=2401)]
    {
        let mut memory = Memory::new();
        let mut rig = rig(model, &mut memory);
        rig.time_to_scan(Duration::from_micros(20 * SECOND)).expect("a scan within 20 s");
        let before = rig.report.published;
        rig.run_for(Duration::from_micros(60 * SECOND));
        let report = &rig.report;
        assert!(per_minute.contains(&(report.published - before)), "{model:?}: {}", report.published - before);
        assert!(report.damaged == 0 && report.sent - report.published <= 1, "{model:?}: {report:?}");
        rig.stop();
        assert!(rig.report.events.last().unwrap().contains("laser_off: true"), "{:?}", rig.report.events);
        let sent = rig.report.sent;
        rig.run_for(Duration::from_micros(5 * SECOND));
        assert_eq!(rig.report.sent, sent, "{model:?} still sends");
    }
}

#[test]
fn urg_on_usb_sends_every_turn() {
    let mut memory = Memory::new();
    let config = HokuyoConfig { baud: BaudPolicy::AtLeast(115_200), ..HokuyoConfig::default() };
    let device = Box::new(hokuyo(HokuyoModel::urg_04lx_usb()));
    let mut rig = Rig::new(memory.hokuyo(config), device, |write| oracle::hokuyo(write, false));
    rig.time_to_scan(Duration::from_micros(20 * SECOND)).expect("a scan within 20 s");
    let before = rig.report.published;
    rig.run_for(Duration::from_micros(60 * SECOND));
    assert!((599..=601).contains(&(rig.report.published - before)), "{}", rig.report.published - before);
    assert!(
        rig.report.events.iter().any(|said| said.contains("Streaming { baud: 0, period: Duration { micros: 100000 }"))
    );
}

#[test]
fn half_degree_scans_come_by_turns_or_whole() {
    for each_turn in [true, false] {
        let mut memory = Memory::new();
        let config = SickConfig { baud: BaudPolicy::Raise(500_000), each_turn, ..SickConfig::default() };
        let mut rig = Rig::new(memory.sick(config), Box::new(sick(SickModel::lms200())), oracle::sick);
        rig.run_for(Duration::from_micros(20 * SECOND));
        let before = rig.report.published;
        rig.run_for(Duration::from_micros(10 * SECOND));
        let rate = (rig.report.published - before) / 10;
        assert_eq!(rate, if each_turn { 75 } else { 37 });
        assert_eq!(rig.report.damaged, 0);
    }
}

#[test]
fn sick_is_found_in_any_state_and_at_any_rate() {
    for baud in [9_600, 19_200, 38_400, 500_000] {
        for mode in [
            OperatingMode::OnRequest,
            OperatingMode::StreamAll,
            OperatingMode::StreamPartial,
            OperatingMode::Installation(*b"SICK_LMS"),
        ] {
            for old_firmware in [false, true] {
                let model = SickModel::lms200();
                let mut device = sick(if old_firmware { model.with_old_firmware() } else { model });
                device.set_baud(baud);
                device.set_mode(mode);
                // Half a telegram that another program left behind.
                device.receive(Instant::default(), &[0x02, 0x00, 0x0A, 0x00, 0x20]);
                let mut memory = Memory::new();
                let mut rig = Rig::new(memory.sick(SickConfig::default()), Box::new(device), oracle::sick);
                let took = rig.time_to_scan(Duration::from_micros(30 * SECOND));
                let took = took.unwrap_or_else(|| panic!("{mode:?} at {baud}: {:?}", rig.report.events));
                assert!(seconds(took) < 15.0, "{mode:?} at {baud}: {} s, {:?}", seconds(took), rig.report.events);
                assert_eq!(rig.report.damaged, 0);
            }
        }
    }
}

#[test]
fn hokuyo_is_found_in_any_state_and_at_any_rate() {
    for (model, rates, is_utm) in [
        (HokuyoModel::urg_04lx(), &[19_200, 57_600, 115_200, 750_000][..], false),
        (HokuyoModel::urg_04lx_usb(), &[19_200], false),
        (HokuyoModel::utm_30lx(), &[0], true),
    ] {
        for baud in rates {
            for left_behind in [
                "",
                "MD00",
                "SCIP2.0\n",
                "SCIP2.0\nMD0044072501000\n",
                "SCIP2.0\nTM0\n",
                "TM0\n",
                "MD0044072501000\n",
                "BM\n",
                "GD0044",
            ] {
                let mut device = hokuyo(model.clone());
                device.set_baud(*baud);
                let mut now = Instant::default();
                for line in left_behind.split_inclusive('\n') {
                    device.receive(now, line.as_bytes());
                    now = now + Duration::from_millis(200);
                    device.timeout(now);
                    while device.poll().is_some() {}
                }
                let mut memory = Memory::new();
                let oracle = if is_utm {
                    |write: &[u8]| oracle::hokuyo(write, true)
                } else {
                    |write: &[u8]| oracle::hokuyo(write, false)
                };
                let mut rig = Rig::new(memory.hokuyo(HokuyoConfig::default()), Box::new(device), oracle);
                rig.now = now;
                let took = rig.time_to_scan(Duration::from_micros(30 * SECOND));
                let took = took.unwrap_or_else(|| panic!("{left_behind:?} at {baud}: {:?}", rig.report.events));
                assert!(seconds(took) < 12.0, "{left_behind:?} at {baud}: {} s", seconds(took));
                assert_eq!(rig.report.damaged, 0);
            }
        }
    }
}

#[test]
fn bytes_one_at_a_time_give_the_same_scans() {
    for model in MODELS {
        let run = |piece| {
            let mut memory = Memory::new();
            let mut rig = rig(model, &mut memory);
            rig.piece = piece;
            rig.run_for(Duration::from_micros(10 * SECOND));
            (rig.report.published, rig.report.damaged, rig.report.events.clone())
        };
        assert_eq!(run(1), run(0), "{model:?}");
    }
}

#[test]
fn restart_of_the_sensor_is_survived() {
    for model in MODELS {
        let mut memory = Memory::new();
        let mut rig = rig(model, &mut memory);
        rig.time_to_scan(Duration::from_micros(20 * SECOND)).unwrap();
        let now = rig.now;
        rig.device().power_on(now);
        rig.run_for(Duration::from_micros(SECOND / 2));
        let took = rig.time_to_scan(Duration::from_micros(60 * SECOND));
        assert!(took.is_some() && rig.report.damaged == 0, "{model:?}: {:?}", rig.report.events);
    }
}

#[test]
fn sensor_clock_may_wrap() {
    let mut memory = Memory::new();
    let mut device = hokuyo(HokuyoModel::utm_30lx());
    device.set_clock(16_777_216 - 20_000);
    let mut rig =
        Rig::new(memory.hokuyo(HokuyoConfig::default()), Box::new(device), |write| oracle::hokuyo(write, true));
    rig.run_for(Duration::from_micros(60 * SECOND));
    assert_eq!(rig.counters().restarts, 0, "{:?}", rig.report.events);
    assert!(rig.report.published > 2300);
    let late = rig.now.since(rig.report.last_stamp);
    assert!((0..60_000).contains(&late.micros), "{late:?}");
}

#[test]
fn stamps_are_the_time_of_the_sweep() {
    for (model, sweep_us, wire_us) in
        [(Model::Lms200, 6_667, 7_440), (Model::Urg, 70_800, 185_500), (Model::Utm, 18_750, 3_372)]
    {
        let mut memory = Memory::new();
        let mut rig = rig(model, &mut memory);
        rig.time_to_scan(Duration::from_micros(20 * SECOND)).unwrap();
        rig.run_for(Duration::from_micros(10 * SECOND));
        rig.time_to_scan(Duration::from_micros(SECOND)).unwrap();
        let late = rig.now.since(rig.report.last_stamp).micros - sweep_us - wire_us;
        assert!((-1500..5500).contains(&late), "{model:?}: {late} us");
    }
}

/// One fault run: asserts that nothing damaged came out, and says what did.
fn fault_run(model: Model, damage: f32, unplug_s: i64, scans: u32) {
    let mut memory = Memory::new();
    let mut rig = rig(model, &mut memory).with_faults(plan(damage, unplug_s), 7);
    rig.run_until_sent(scans);
    let counters = rig.counters();
    let report = &rig.report;
    println!(
        "{model:?} damage {damage} unplug {unplug_s} s: {} sent, {} arrived whole, {} published, {} damaged published, {} faults, {} refused, {} restarts, longest gap {:.1} s, plugged in to scan {:.1} s median {:.1} s longest, {:.0} s",
        report.sent,
        report.whole,
        report.published,
        report.damaged,
        report.faults,
        counters.damaged,
        counters.restarts,
        seconds(report.longest_gap),
        report.recovery().0,
        report.recovery().1,
        rig.now.as_secs_f64(),
    );
    assert_eq!(report.damaged, 0);
    let lost_whole = report.whole.saturating_sub(report.published);
    let allowed = if unplug_s > 0 { report.sent / 5 } else { report.sent / 20 };
    assert!(lost_whole <= allowed, "{lost_whole} whole scans were not published");
    assert!(seconds(report.longest_gap) < 30.0);
}

fn all_faults(scans: u32) {
    for model in MODELS {
        for (damage, unplug_s) in [(0.01, 0), (0.1, 0), (0.0, 20), (0.01, 20)] {
            fault_run(model, damage, unplug_s, scans);
        }
    }
}

#[test]
fn faults_are_survived_and_nothing_damaged_comes_out() {
    all_faults(1500);
}

#[test]
#[ignore = "minutes; run in release with --ignored"]
fn faults_are_survived_over_a_hundred_thousand_scans() {
    all_faults(100_000);
}
