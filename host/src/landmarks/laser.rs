//! A drive from a laser's scans: reflectors and posts are what is seen, odometry or scan matching what moved the robot.
//!
//! log or recording → scans, with brightness where a recorded laser tells it → a [control](Control) from scan to scan →
//! [detections](detect) of one scan every [`SIGHTINGS_APART_S`] → [`Drive`].

use std::path::Path;

use anyhow::ensure;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::landmark::detect::{DetectConfig, Detection, detect};
use lrfslam_core::landmark::{Association, Control, LandmarkConfig, Sighting};
use lrfslam_core::laser_odometry::LaserOdometry;
use lrfslam_core::scan::{Beam, RangeScan};
use lrfslam_core::slam::SlamConfig;
use lrfslam_core::sweep::{Sweep, SweepMotion};
use lrfslam_core::time::Instant;
use lrfslam_lrf::driver::{Event, Output, run_input};

use super::{Drive, Event as DriveEvent, What};
use crate::mapping::{MapperMemory, MemoryConfig};
use crate::output::RECORDING;
use crate::runs::scans::read_scans;
use crate::scans::driver::LaserMemory;
use crate::scans::live::taken;
use crate::scans::log::{LogOptions, LogScan};
use crate::scans::recording::{Entry, RecordingReader};

/// Landmarks are looked for so often, s: what is wrong with a sighting is much the same in the next scan.
pub const SIGHTINGS_APART_S: f64 = 0.2;
/// Landmarks of one scan at most.
const DETECTIONS_MAX: usize = 64;

/// A scan, and how bright each of its echoes is if the laser tells.
#[derive(Debug, Clone, PartialEq)]
pub struct BrightScan {
    /// The scan.
    pub scan: LogScan,
    /// 0 to 255, of each beam; or empty.
    pub brightness: Vec<u8>,
}

/// True if `place` is a log, a recording, or the folder of one.
pub fn is_of_laser(place: &Path) -> bool {
    place.is_file() || place.join(RECORDING).is_file()
}

/// The scans of a log or a recording.
///
/// # Errors
/// If it cannot be read.
pub fn scans(place: &Path) -> anyhow::Result<Vec<BrightScan>> {
    let file = if place.is_dir() { place.join(RECORDING) } else { place.to_owned() };
    if let Ok(mut reader) = RecordingReader::open(&file) {
        let mut scans = Vec::new();
        while of_one_driver(&mut reader, &mut scans) {}
        return Ok(scans);
    }
    let scans = read_scans(&file, LogOptions::default())?;
    Ok(scans.into_iter().map(|scan| BrightScan { scan, brightness: Vec::new() }).collect())
}

/// What one program recorded; true if another one's part follows.
fn of_one_driver(reader: &mut RecordingReader, scans: &mut Vec<BrightScan>) -> bool {
    let mut memory = LaserMemory::default();
    let options = reader.header().lrf.clone();
    let mut driver = options.driver(&mut memory);
    let mut brightness = Vec::new();
    for (now, entry) in reader {
        if entry == Entry::GoesOn {
            return true;
        }
        let Some(input) = entry.input() else { continue };
        let mut sink = |output: Output<'_>| match output {
            Output::Event(Event::Brightness(levels)) => brightness = levels.to_vec(),
            Output::Event(Event::Scan(scan)) => {
                let number = scans.len() as u64 + 1;
                scans.push(BrightScan { scan: taken(&scan, number), brightness: std::mem::take(&mut brightness) });
            }
            _ => {}
        };
        run_input(driver.as_mut(), now, input, &mut sink);
    }
    false
}

/// Makes a drive of scans: by their odometry if they have it and `uses_odometry`, else by matching.
///
/// # Errors
/// If there are no scans, or one has more points than there is memory for.
pub fn drive(
    name: String,
    scans: &[BrightScan],
    config: &DetectConfig,
    uses_odometry: bool,
    mut watch: impl FnMut(f64) -> bool,
) -> anyhow::Result<Drive> {
    ensure!(!scans.is_empty(), "{name}: there is no scan");
    let by_odometry = uses_odometry && scans.iter().all(|scan| scan.scan.map_from_robot_odometry.is_some());
    let slam = SlamConfig::default();
    let mut memory = MapperMemory::of_matching(&slam, &MemoryConfig::default());
    let mut matcher = LaserOdometry::new(&slam.laser_odometry(), 1, memory.lend_odometry())?;
    let mut events = Events::default();
    for (index, bright) in scans.iter().enumerate() {
        if !watch(index as f64 / scans.len() as f64) {
            break;
        }
        let scan = bright.scan.scan();
        let robot_from_lrf = bright.scan.robot_from_lrf.unwrap_or_default();
        let (map_from_robot, motion) = match bright.scan.map_from_robot_odometry.filter(|_| by_odometry) {
            Some(pose) => (pose, SweepMotion::default()),
            None => {
                let report = matcher.step(&scan, robot_from_lrf, None)?;
                (report.matched.map_from_robot, report.motion)
            }
        };
        events.move_to(scan.stamp, map_from_robot);
        events.look(config, &Sweep { scan, robot_from_lrf, motion }, &bright.brightness);
    }
    let mount = scans.first().and_then(|scan| scan.scan.robot_from_lrf).unwrap_or_default();
    Ok(Drive {
        name,
        events: events.events,
        truth: Vec::new(),
        has_headings: true,
        landmarks: Vec::new(),
        config: landmark_config(by_odometry, mount),
        detect: Some(*config),
        has_identities: false,
    })
}

/// The drive so far.
#[derive(Default)]
struct Events {
    events: Vec<DriveEvent>,
    last: Option<(Instant, Pose2)>,
    looked: Option<Instant>,
}

impl Events {
    fn move_to(&mut self, stamp: Instant, map_from_robot: Pose2) {
        if let Some((before, from)) = self.last.replace((stamp, map_from_robot)) {
            let control = control(from.between(map_from_robot), f64::from(stamp.since(before).as_secs_f32()));
            self.events.push(DriveEvent { stamp, what: What::Control(control) });
        }
    }

    fn look(&mut self, config: &DetectConfig, sweep: &Sweep<'_>, brightness: &[u8]) {
        let stamp = sweep.scan.stamp;
        let is_due = |looked| f64::from(stamp.since(looked).as_secs_f32()) >= SIGHTINGS_APART_S;
        if self.looked.is_none_or(is_due) {
            self.looked = Some(stamp);
            self.events.push(DriveEvent { stamp, what: What::Sightings(sightings(config, sweep, brightness)) });
        }
    }
}

/// The way along the arc, and the turn. What goes sideways is no way of a robot with wheels, and is left out.
fn control(step: Pose2, seconds: f64) -> Control {
    let (x, y, turn) = (f64::from(step.x), f64::from(step.y), f64::from(step.heading));
    let (sin, cos) = (0.5 * turn).sin_cos();
    let chord = x * cos + y * sin;
    let sinc = if turn.abs() > 1e-6 { sin / (0.5 * turn) } else { 1.0 };
    Control::Odometry { distance_m: chord / sinc, turn_rad: turn, seconds: seconds.max(0.0) }
}

/// The landmarks in a scan, as they are seen in the middle of its sweep.
fn sightings(config: &DetectConfig, sweep: &Sweep<'_>, brightness: &[u8]) -> Vec<Sighting> {
    let levels = brightness.iter().copied().chain(std::iter::repeat(0));
    let mut seen: Vec<(Beam, u8)> = sweep.scan.beams.iter().map(sweep.middle_beam()).zip(levels).collect();
    // Turns of a mirror that are interlaced may overtake one another in a robot that turns.
    seen.sort_by(|a, b| a.0.bearing_rad.total_cmp(&b.0.bearing_rad));
    let (beams, levels): (Vec<Beam>, Vec<u8>) = seen.into_iter().unzip();
    let mut found = [Detection::default(); DETECTIONS_MAX];
    let result = detect(config, &RangeScan { beams: &beams, ..sweep.scan }, &levels, &mut found);
    found[..result.count].iter().map(Detection::sighting).collect()
}

/// Matching knows its scale, and errs by some millimetres in each step; odometry errs with the way.
fn landmark_config(by_odometry: bool, robot_from_lrf: Pose2) -> LandmarkConfig {
    let shared = LandmarkConfig {
        lrf_x_m: robot_from_lrf.x,
        lrf_y_m: robot_from_lrf.y,
        lrf_heading_deg: robot_from_lrf.heading.to_degrees(),
        sighting_hold_s: 0.5,
        association: Association::Joint,
        gate_deviations: 3.0,
        confirm_sightings: 5,
        confirm_batches: 50,
        ..LandmarkConfig::default()
    };
    if by_odometry {
        return LandmarkConfig { alpha_3: 0.05, ..shared };
    }
    LandmarkConfig {
        alpha_1: 0.02,
        alpha_2: 0.0,
        alpha_3: 0.01,
        alpha_4: 0.02,
        step_noise_m: 0.005,
        step_noise_deg: 0.1,
        distance_scale_deviation: 0.0,
        turn_scale_deviation: 0.0,
        ..shared
    }
}
