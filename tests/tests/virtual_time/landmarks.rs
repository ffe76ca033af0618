//! Landmarks from a serial laser's bytes: a virtual SICK drives through a hall with reflectors, and its recording becomes a map of them.

use std::path::Path;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::landmark::detect::DetectConfig;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::cable::{Cable, resample};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_firmware_sim::virtual_lrf::sick::{SickModel, VirtualSick};
use lrfslam_host::landmarks::errors::{LandmarkErrors, errors};
use lrfslam_host::landmarks::run::run;
use lrfslam_host::landmarks::{Drive, Filter, TrueLandmark, laser};
use lrfslam_host::scans::driver::LaserMemory;
use lrfslam_host::scans::family::{LrfFamily, LrfOptions};
use lrfslam_host::scans::recording::{RecordPlan, Recorder, RecordingHeader};
use lrfslam_host::trajectory::TimedPose;
use lrfslam_lrf::driver::{Event, Input, LrfDriver, Output, run_input};

/// A simulated drive, s: once round the hall of 24 m by 16 m.
const SECONDS: i64 = 115;
const WORLD: &str = "reflectors";

/// A driver at a virtual laser, and everything that passes between them recorded.
struct Session<'d> {
    now: Instant,
    driver: Box<dyn LrfDriver + Send + 'd>,
    laser: VirtualSick,
    cable: Cable,
    /// Bytes on their way to the laser, when they are there, and at which rate.
    sent: Vec<(Instant, Vec<u8>, u32)>,
    baud: u32,
    deadline: Instant,
    recorder: Recorder,
}

impl Session<'_> {
    fn give(&mut self, input: Input<'_>) {
        self.recorder.input(self.now, input).unwrap();
        let mut outputs = Vec::new();
        let mut found = false;
        let (mut rate, now) = (self.baud, self.now);
        self.deadline = run_input(self.driver.as_mut(), now, input, &mut |output| match output {
            Output::Transmit(bytes) => outputs.push((bytes.to_vec(), rate)),
            Output::SetBaud(baud) => rate = baud,
            Output::Event(Event::Found { .. }) => found = true,
            _ => {}
        });
        self.baud = rate;
        if found {
            self.recorder.begin(LrfFamily::SickLms2xx).unwrap();
        }
        for (bytes, baud) in outputs {
            let took = Duration::from_micros(bytes.len() as i64 * 10_000_000 / i64::from(baud.max(1)));
            self.sent.push((now + took, bytes, baud));
        }
    }

    fn run_until(&mut self, end: Instant) {
        self.give(Input::Connected);
        while self.now < end {
            let arrival = self.cable.next_arrival(self.now, Duration::from_millis(5));
            let sent = self.sent.iter().map(|sent| sent.0).min();
            let next = self.deadline.min(self.laser.deadline());
            self.now = self.now.max(arrival.into_iter().chain(sent).fold(next, Instant::min));
            for (_, bytes, baud) in self.sent.extract_if(.., |sent| sent.0 <= self.now).collect::<Vec<_>>() {
                let heard = self.laser.baud(self.now).map_or(bytes.clone(), |rate| resample(&bytes, baud, rate));
                self.laser.receive(self.now, &heard);
            }
            self.laser.timeout(self.now);
            while let Some(emission) = self.laser.poll() {
                self.cable.push(emission);
            }
            let bytes = self.cable.arrived(self.now, self.baud);
            if !bytes.is_empty() {
                self.give(Input::Bytes(&bytes));
            }
            if self.now >= self.deadline {
                self.give(Input::Timeout);
            }
        }
        self.recorder.finish().unwrap();
    }
}

/// Records the drive into `file`.
fn record(scenario: &Scenario, file: &Path) {
    let options =
        LrfOptions { brightness: true, whole_scans: true, baud: 38_400, ..LrfOptions::new(LrfFamily::SickLms2xx) };
    let header = RecordingHeader { program: "test".to_owned(), port: "virtual".to_owned(), lrf: options.clone() };
    let mut memory = LaserMemory::default();
    let mut session = Session {
        now: Instant::default(),
        driver: options.driver(&mut memory),
        laser: VirtualSick::new(SickModel::lms291(), Box::new(scenario.scene()), 1),
        cable: Cable::default(),
        sent: Vec::new(),
        baud: 9600,
        deadline: Instant::default(),
        recorder: Recorder::new(&RecordPlan::new(file), header).unwrap(),
    };
    session.run_until(Instant::from_micros(SECONDS * 1_000_000));
}

/// The drive with its truth: places of reflectors, and where the laser was.
fn with_truth(mut drive: Drive, scenario: &Scenario, reflectors: &[[f64; 2]]) -> Drive {
    let pose = |index: i64| {
        let stamp = Instant::from_micros(index * 100_000);
        let at = scenario.drive().pose(stamp);
        TimedPose { stamp, map_from_robot: Pose2::new(at.x as f32, at.y as f32, at.heading as f32) }
    };
    drive.truth = (0..SECONDS * 10).map(pose).collect();
    drive.landmarks = (0..).zip(reflectors).map(|(identity, [x, y])| TrueLandmark { identity, x: *x, y: *y }).collect();
    drive
}

/// Reflectors of the world file, read as any program would.
fn reflectors() -> Vec<[f64; 2]> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware-sim/worlds");
    let text = std::fs::read_to_string(folder.join(format!("{WORLD}.toml"))).unwrap();
    let mut centre = [0.0, 0.0];
    let mut found = Vec::new();
    for line in text.lines() {
        if let Some(numbers) = line.strip_prefix("centre = [").and_then(|rest| rest.strip_suffix("]")) {
            let (x, y) = numbers.split_once(", ").unwrap();
            centre = [x.parse().unwrap(), y.parse().unwrap()];
        }
        if line == "reflector = true" {
            found.push(centre);
        }
    }
    found
}

fn mapped(drive: &Drive, filter: Filter) -> LandmarkErrors {
    let done = run(drive, &drive.config, filter, 60, 1, |_| true).unwrap();
    let errors = errors(drive, done.estimate.best_path(), &done.estimate.landmarks);
    println!("{filter:?}: {errors:?}, {:?}", done.counts);
    errors
}

/// Reflectors alone, by their brightness, and nobody says which is which; the robot has no odometry.
#[test]
fn reflectors_are_mapped_from_the_bytes_of_a_serial_laser() {
    let scenario = Scenario::load(WORLD).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("laser.rec");
    record(&scenario, &file);
    let scans = laser::scans(&file).unwrap();
    assert!(scans.len() > 400, "{}", scans.len());
    assert!(scans.iter().all(|scan| scan.brightness.len() == scan.scan.beams.len()));
    let config = DetectConfig { posts: false, ..DetectConfig::default() };
    let drive = laser::drive(WORLD.to_owned(), &scans, &config, true, |_| true).unwrap();
    let reflectors = reflectors();
    let drive = with_truth(drive, &scenario, &reflectors);
    let ekf = mapped(&drive, Filter::Ekf);
    assert_eq!((ekf.landmarks_found, ekf.landmarks_false), (reflectors.len(), 0));
    assert!(ekf.landmarks_rmse_m.unwrap() < 0.03 && ekf.path_rmse_m.unwrap() < 0.03, "{ekf:?}");
}
