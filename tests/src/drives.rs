//! Drives of a simulated robot, as the scans of its log and the true path.

use lrfslam_core::time::Duration;
use lrfslam_firmware_sim::log::{LogFiles, LogPlan, write_log};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_host::mapping::high::HighCounts;
use lrfslam_host::runs::map::{MapRun, RunMemory};
use lrfslam_host::scans::log::{LogOptions, LogReader, LogScan};
use lrfslam_host::trajectory::{TimedPose, read_trajectory};
use lrfslam_lab::evaluation::{TruthReport, evaluate_truth};

use lrfslam_app::config::RunConfig;

/// How far in time a pose may be from the true one's, as with `lrfslam eval`.
const TOLERANCE: Duration = Duration::from_millis(50);
/// Length of the stretches that `lrfslam eval` judges drift by, m.
const STRETCH_M: f64 = 10.0;

/// What a robot saw, and where it was.
#[derive(Debug)]
pub struct Drive {
    /// In the order in which they were taken.
    pub scans: Vec<LogScan>,
    /// The true path.
    pub truth: Vec<TimedPose>,
}

/// What became of a drive that was mapped.
#[derive(Debug)]
pub struct Mapped {
    /// Where the robot was at each scan.
    pub path: Vec<TimedPose>,
    /// The path over the true one.
    pub report: TruthReport,
    /// The same of the poses that the run believes.
    pub believed: TruthReport,
    /// What the high level did; nothing if there is none.
    pub counts: Option<HighCounts>,
}

impl Drive {
    /// Drives the robot of `scenario`.
    ///
    /// # Panics
    /// If the plan does not go with the world.
    pub fn new(scenario: &Scenario, plan: &LogPlan) -> Self {
        let folder = tempfile::tempdir().expect("a folder for the log");
        let (mut log, mut truth) = (Vec::new(), Vec::new());
        let mut files = LogFiles { log: &mut log, truth: &mut truth, tilted: None, tilt: None };
        write_log(scenario, plan, &mut files).expect("the plan goes with the world");
        let written = |name: &str, bytes: &[u8]| {
            let file = folder.path().join(name);
            std::fs::write(&file, bytes).expect("a file in the folder");
            file
        };
        let log = LogReader::open(&written("drive.log", &log), LogOptions::default()).expect("the log can be read");
        let scans = log.map(|scan| scan.expect("every scan can be read")).collect();
        let truth = read_trajectory(&written("drive.tum", &truth)).expect("the path can be read");
        Self { scans, truth }
    }

    /// Maps it on so many threads.
    ///
    /// # Panics
    /// If its scans do not go with the configuration.
    pub fn map(&self, config: &RunConfig, seed: u64, threads: usize) -> Mapped {
        let mapping = config.mapping();
        let mut memory = RunMemory::new(&mapping, threads);
        let mut run = MapRun::new(&mapping, seed, &mut memory).expect("the memory is that of the configuration");
        for scan in &self.scans {
            run.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or_default(), None).expect("the scan fits");
        }
        run.finish();
        let path = run.trajectory();
        let judge = |path: &[TimedPose]| evaluate_truth(path, &self.truth, TOLERANCE, STRETCH_M);
        let report = judge(&path).expect("the path has the log's times");
        let believed = judge(&run.trusted_trajectory()).expect("the first pose is believed");
        Mapped { path, report, believed, counts: run.high_counts() }
    }
}
