//! A recorded log through virtual laser, robot and link: the host has the beams and the times of the log.

use std::path::Path;

use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::virtual_lrf::SensorModel;
use lrfslam_firmware_sim::virtual_lrf::recording::RecordedScan;
use lrfslam_host::robot::{Sweeps, Told};
use lrfslam_host::scans::log::{LogOptions, LogReader, LogScan};
use lrfslam_robot::wire::message::FromRobot;
use lrfslam_robot::wire::session::Progress;
use lrfslam_robot::{LaserConfig, LaserFamily, ReportConfig, RobotConfig};
use lrfslam_tests::data;
use lrfslam_tests::robot_rig::{Build, HostDisk, LineFaults, RobotRig};

/// Scans that are compared.
const SCANS: usize = 30;
/// From scan to scan, a rate that all lasers here have.
const INTERVAL_MS: i64 = 200;

/// When a scan was taken, and its beams: none if the robot did not believe it.
type ScanHeard = (Instant, Option<Vec<Beam>>);

/// Scans as the host has them.
#[derive(Default)]
struct ScansHeard {
    parts: Sweeps,
    scans: Vec<ScanHeard>,
    progress: Option<Progress>,
}

impl HostDisk for ScansHeard {
    fn take(&mut self, told: &Told<'_>) {
        self.progress = Some(Progress { next: told.at.next.wrapping_add(1), ..told.at });
        match told.message() {
            Some(FromRobot::Sweep(part)) => self.parts.take_part(&part),
            Some(FromRobot::Scan(pose)) => {
                let sweep = self.parts.taken_at(pose.stamp);
                assert!(sweep.is_some() || pose.is_lost, "a scan without its beams: {pose:?}");
                self.scans.push((pose.stamp, sweep.map(|sweep| sweep.scan().beams.to_vec())));
            }
            _ => {}
        }
    }

    fn progress(&self) -> Option<Progress> {
        self.progress
    }
}

fn log(path: &Path) -> Vec<LogScan> {
    let reader = LogReader::open(path, LogOptions::default()).expect("a log");
    reader.take(SCANS).collect::<Result<_, _>>().expect("whole lines")
}

/// What the host hears of them.
fn heard(scans: &[LogScan]) -> Vec<ScanHeard> {
    let laser = SensorModel::of(&scans[0].beams, scans[0].range_max_m).expect("a laser that is known");
    let wanted = match laser {
        SensorModel::Sick(_) => LaserConfig { family: LaserFamily::Sick, baud: 500_000, cluster: 1 },
        SensorModel::Hokuyo(_) => LaserConfig { family: LaserFamily::Hokuyo, baud: 0, cluster: 1 },
    };
    let report = ReportConfig { sweep_distance_m: 0.0, sweep_rotation_deg: 0.0 };
    let config = RobotConfig { laser: wanted, report, ..RobotConfig::default() };
    let recorded = scans.iter().enumerate().map(|(index, scan)| RecordedScan {
        after: Duration::from_millis(index as i64 * INTERVAL_MS),
        beams: scan.beams.clone(),
    });
    let device = laser.say(recorded.collect());
    let memory = Box::new(|| Build::Standard.memory(&[]));
    let mut rig = RobotRig::with(ScansHeard::default(), memory, device, &config);
    rig.set_faults(LineFaults::all(0.01), 1);
    rig.start();
    rig.run_for(Duration::from_millis(6000));
    rig.plug_laser(true);
    while rig.disk.scans.len() < scans.len() {
        assert!(rig.now.micros < 60_000_000, "{} scans, {:?}", rig.disk.scans.len(), rig.status);
        rig.step();
    }
    assert_eq!(rig.tally.scans as usize, scans.len());
    rig.disk.scans
}

/// The direction, 1/100 degree, and what was measured there, mm; 0 invalid, -1 nothing.
fn readings(beams: &[Beam]) -> Vec<(i32, i32)> {
    let reading = |beam: &Beam| {
        let range_mm = match beam.echo {
            Echo::Hit(range_m) => (range_m * 1000.0).round() as i32,
            Echo::Miss => -1,
            Echo::Invalid => 0,
        };
        ((beam.bearing_rad.to_degrees() * 100.0).round() as i32, range_mm)
    };
    beams.iter().map(reading).collect()
}

/// * `unit_mm` — of the laser that it is played by, where the log is finer
fn check(path: &Path, unit_mm: i32) {
    let scans = log(path);
    let heard = heard(&scans);
    for ((stamp, beams), (index, scan)) in heard.iter().zip(scans.iter().enumerate()) {
        let name = format!("{}: scan {index}", path.display());
        let late_us = stamp.since(heard[0].0).micros - index as i64 * INTERVAL_MS * 1000;
        assert!(late_us.abs() < 2000, "{name} is {late_us} us late");
        let Some(beams) = beams else { continue };
        let (wanted, mut told) = (readings(&scan.beams), readings(beams));
        // An LMS2xx has a beam more than logs of 180.
        let extra = told.split_off(wanted.len());
        assert!(extra.iter().all(|(_, range_mm)| *range_mm == 0) && extra.len() <= 1, "{name}: {extra:?}");
        for (told, wanted) in told.iter().zip(wanted) {
            assert!(
                (told.0 - wanted.0).abs() <= 1 && (told.1 - wanted.1).abs() <= unit_mm / 2,
                "{name}: {told:?}, not {wanted:?}"
            );
        }
    }
    let told = heard.iter().filter(|(_, beams)| beams.is_some()).count();
    assert!(told >= SCANS - 3, "{}: {told} scans with their beams", path.display());
}

#[test]
fn simulated_sick() {
    check(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/floor.log.gz"), 10);
}

#[test]
fn recorded_sick_and_urg() {
    for name in ["intel.log.gz", "aces.log.gz", "loop5.log.gz", "urg04lx-exp2.dat.gz"] {
        let Some(log) = data::path(&format!("logs/{name}")) else { continue };
        check(&log, 1);
    }
}
