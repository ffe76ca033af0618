//! Drives as CARMEN logs, with the truth beside them.
//!
//! A `ROBOTLASER1` line for every scan, under the time of the middle of its sweep. The poses on the line are those of a bad odometry:
//! it counts 3 % too far and turns 3 % too little, and its heading drifts at random. The truth is the robot's pose in the world at
//! the same times, as TUM. Scans of a tilted laser go to a log of their own, with the encoder's readings.

use std::io::{self, Write};

use lrfslam_core::geometry::Pose2;
use lrfslam_core::math;
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};
use rand_pcg::Pcg32;

use crate::drive::{Drive, FloorPose, LONGEST_S};
use crate::fault::{FaultLink, FaultPlan};
use crate::lrf_model::{LrfModel, SimulatedLrf};
use crate::scenario::Scenario;
use crate::tilt::Encoder;

/// Which scans of a drive are taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pace {
    /// Until the end, so many a second; without an end, for so many seconds.
    Rate {
        /// Scans per second, up to the laser's own rate.
        hz: f64,
        /// Where the drive is to end, s.
        seconds: Option<f64>,
    },
    /// So many, evenly spread over the way.
    Count(usize),
}

/// How a log is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogPlan {
    /// The laser.
    pub lrf: LrfModel,
    /// Which scans are taken.
    pub pace: Pace,
    /// All beams of a scan leave at once, from where the robot is in the middle of the sweep.
    pub snapshot: bool,
    /// What goes wrong on the laser's line. A telegram that comes damaged fails its check sum: its scan is missing.
    pub fault: FaultPlan,
    /// Of all errors.
    pub seed: u64,
}

/// A plan that cannot be followed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The robot has no route, so that its drive has no end.
    #[error("the world's robot has no route: say how many seconds it is to drive")]
    Endless,
    /// The robot has no route to spread scans over.
    #[error("the world's robot has no route: scans cannot be spread over it")]
    NoRoute,
    /// More scans a second than the laser takes.
    #[error("{name} takes {most} scans a second: a rate above 0 and up to that is expected, found {found}")]
    Rate {
        /// The laser.
        name: &'static str,
        /// Its rate, Hz.
        most: f64,
        /// What was asked for, Hz.
        found: f64,
    },
    /// A drive of no length, or a longer one than any route may take.
    #[error("a drive of 0 to {LONGEST_S} s is expected, found {0}")]
    Seconds(f64),
    /// More scans than a laser takes in the longest drive.
    #[error("at most {most} scans are expected, which is {LONGEST_S} s of the laser, found {found}")]
    Count {
        /// So many fit.
        most: usize,
        /// What was asked for.
        found: usize,
    },
    /// A file cannot be written.
    #[error("the log cannot be written")]
    Write(#[from] io::Error),
}

/// Where a log goes.
pub struct LogFiles<'w> {
    /// Scans of the level laser.
    pub log: &'w mut dyn Write,
    /// The robot's true poses, TUM.
    pub truth: &'w mut dyn Write,
    /// Scans of the tilted laser, if wanted.
    pub tilted: Option<&'w mut dyn Write>,
    /// The encoder's readings, lines `t tilt`, s and rad, if wanted.
    pub tilt: Option<&'w mut dyn Write>,
}

/// What was written.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LogReport {
    /// Scans of the level laser.
    pub scans: usize,
    /// Scans of the tilted laser, whether written or not.
    pub tilted: usize,
    /// Scans that the line lost.
    pub lost: usize,
    /// Length of the way, m.
    pub way_m: f64,
    /// Time of the last scan, s.
    pub seconds: f64,
}

/// Drives the robot of `scenario` and writes what its laser sees.
///
/// # Errors
/// See [`LogError`].
pub fn write_log(scenario: &Scenario, plan: &LogPlan, files: &mut LogFiles<'_>) -> Result<LogReport, LogError> {
    let times = times(scenario.drive(), plan)?;
    let scene = scenario.scene();
    let mut lrf = SimulatedLrf::new(plan.lrf, plan.seed);
    let [ahead, left, _] = scenario.robot.laser_m;
    let robot_from_lrf = Pose2::new(ahead as f32, left as f32, 0.0);
    let half_sweep = Duration::from_micros(plan.lrf.sweep().micros / 2);
    let mut odometry = Odometry::new(plan.seed);
    let mut link = FaultLink::new(plan.fault.damage, plan.seed);
    let mut report = LogReport::default();
    writeln!(files.log, "# Simulated drive, {}. The poses are a bad odometry's.", plan.lrf.name)?;
    for start in &times {
        let middle = *start + half_sweep;
        let beams = if plan.snapshot { lrf.snapshot(&scene, middle) } else { lrf.sweep(&scene, *start) };
        let pose = scenario.drive().pose(middle);
        report.way_m += odometry.move_to(pose);
        report.seconds = middle.as_secs_f64();
        if plan.fault.is_unplugged(middle) || !link.passes(middle) {
            report.lost += 1;
            continue;
        }
        let line = scan_line(&plan.lrf, &beams, odometry.pose, robot_from_lrf, middle);
        // A sweep that is tilted only in part is of no use to a map of the plane either.
        let tilt = scenario.drive().tilt();
        if tilt.tilt_rad(*start) == 0.0 && tilt.tilt_rad(*start + plan.lrf.sweep()) == 0.0 {
            report.scans += 1;
            files.log.write_all(line.as_bytes())?;
            write_tum(files.truth, middle, pose)?;
        } else {
            report.tilted += 1;
            files.tilted.as_mut().map_or(Ok(()), |out| out.write_all(line.as_bytes()))?;
        }
    }
    if let (Some(out), Some(last)) = (&mut files.tilt, times.last()) {
        for (at, tilt_rad) in Encoder::default().readings(scenario.drive().tilt(), *last + plan.lrf.sweep()) {
            writeln!(out, "{:.6} {tilt_rad:.6}", at.as_secs_f64())?;
        }
    }
    Ok(report)
}

/// When scans begin.
fn times(drive: &Drive, plan: &LogPlan) -> Result<Vec<Instant>, LogError> {
    match plan.pace {
        Pace::Count(count) => {
            let most = (LONGEST_S * plan.lrf.rate_hz) as usize;
            if count > most {
                return Err(LogError::Count { most, found: count });
            }
            let times = drive.spread(count);
            if times.is_empty() { Err(LogError::NoRoute) } else { Ok(times) }
        }
        Pace::Rate { hz, seconds } => {
            if !(hz > 0.0 && hz <= plan.lrf.rate_hz) {
                return Err(LogError::Rate { name: plan.lrf.name, most: plan.lrf.rate_hz, found: hz });
            }
            if let Some(seconds) = seconds.filter(|seconds| !(0.0..=LONGEST_S).contains(seconds)) {
                return Err(LogError::Seconds(seconds));
            }
            let end = drive.end().map(|end| end.as_secs_f64());
            let seconds = seconds.map_or(end, |most| Some(end.map_or(most, |end| end.min(most))));
            let count = (seconds.ok_or(LogError::Endless)? * hz).floor().max(0.0) as i64;
            Ok((0..=count).map(|scan| Instant::from_secs_f64(scan as f64 / hz)).collect())
        }
    }
}

/// One `ROBOTLASER1` line. Source: the comment block that CARMEN's logger writes at the head of its files.
fn scan_line(lrf: &LrfModel, beams: &[Beam], robot: Pose2, robot_from_lrf: Pose2, at: Instant) -> String {
    use std::fmt::Write as _;
    let mut line = String::with_capacity(beams.len() * 6 + 200);
    let [_, longest] = lrf.range_m;
    let (first, view, step) = (lrf.bearing_rad(0), lrf.field_of_view_deg.to_radians(), lrf.resolution_deg.to_radians());
    // Writing to a string cannot fail.
    let _ = write!(line, "ROBOTLASER1 0 {first:.6} {view:.6} {step:.8} {longest:.2} 0.01 0 {}", beams.len());
    for beam in beams {
        let _ = match beam.echo {
            Echo::Hit(range_m) => write!(line, " {range_m:.3}"),
            Echo::Miss => write!(line, " {longest:.2}"),
            Echo::Invalid => write!(line, " 0"),
        };
    }
    let lrf = robot * robot_from_lrf;
    let time = at.as_secs_f64();
    let _ = write!(
        line,
        " 0 {:.4} {:.4} {:.5} {:.4} {:.4} {:.5}",
        lrf.x, lrf.y, lrf.heading, robot.x, robot.y, robot.heading
    );
    let _ = writeln!(line, " 0 0 0 0 0 {time:.6} sim {time:.6}");
    line
}

/// One line of a TUM file.
fn write_tum(out: &mut dyn Write, at: Instant, pose: FloorPose) -> io::Result<()> {
    let (qz, qw) = (pose.heading / 2.0).sin_cos();
    writeln!(out, "{:.6} {:.6} {:.6} 0 0 0 {qz:.9} {qw:.9}", at.as_secs_f64(), pose.x, pose.y)
}

/// What wheels would have counted.
struct Odometry {
    pose: Pose2,
    last: Option<FloorPose>,
    rng: Pcg32,
}

impl Odometry {
    fn new(seed: u64) -> Self {
        Self { pose: Pose2::IDENTITY, last: None, rng: Pcg32::new(seed, 0x0D0) }
    }

    /// Counts a move; returns its length, m.
    fn move_to(&mut self, pose: FloorPose) -> f64 {
        let Some(last) = self.last.replace(pose) else { return 0.0 };
        let (sin, cos) = last.heading.sin_cos();
        let (dx, dy) = (pose.x - last.x, pose.y - last.y);
        let way_m = dx.hypot(dy);
        let drift_rad = 0.01 * (way_m as f32).sqrt() * math::normal(&mut self.rng);
        let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
        let turn = 0.97 * (pose.heading - last.heading) as f32 + drift_rad;
        self.pose = self.pose * Pose2::new(1.03 * ahead as f32, left as f32, turn);
        way_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const WORLD: &str = "[[room]]\nfrom = [0, 0]\nto = [6, 4]\n[robot]\nroute = [[1, 1], [4, 1], [4, 3]]\nspeed_mps = 0.5\nturn_degps = 45\n\
         stop = [{ corner = 0, sweep = { to_deg = 30, rate_degps = 30 } }]\n";

    fn plan(pace: Pace) -> LogPlan {
        LogPlan { lrf: LrfModel::LMS200, pace, snapshot: false, fault: FaultPlan::default(), seed: 1 }
    }

    fn written(plan: &LogPlan) -> Result<(LogReport, [String; 4]), LogError> {
        let scenario = Scenario::parse(WORLD, "test", Path::new("")).unwrap();
        let mut files: [Vec<u8>; 4] = Default::default();
        let [log, truth, tilted, tilt] = &mut files;
        let report = write_log(&scenario, plan, &mut LogFiles { log, truth, tilted: Some(tilted), tilt: Some(tilt) })?;
        Ok((report, files.map(|file| String::from_utf8(file).unwrap())))
    }

    #[test]
    fn log_truth_and_tilt_belong_together() {
        let (report, [log, truth, tilted, tilt]) = written(&plan(Pace::Rate { hz: 5.0, seconds: None })).unwrap();
        let scans: Vec<&str> = log.lines().filter(|line| line.starts_with("ROBOTLASER1")).collect();
        assert_eq!((scans.len(), truth.lines().count()), (report.scans, report.scans));
        assert!((tilted.lines().count() as i64 - 10).abs() <= 1, "two seconds of sweep at 5 Hz");
        for (scan, truth) in scans.iter().zip(truth.lines()) {
            let time = scan.split(' ').next_back().unwrap();
            assert_eq!(Some(time), truth.split(' ').next());
        }
        let steepest =
            tilt.lines().map(|line| line.split(' ').nth(1).unwrap().parse::<f64>().unwrap()).fold(0.0, f64::max);
        assert!((steepest - 30_f64.to_radians()).abs() < 0.01, "{steepest}");
        assert!((report.way_m - 5.0).abs() < 0.3, "{}", report.way_m);
    }

    #[test]
    fn same_seed_same_bytes() {
        let pace = Pace::Count(12);
        assert_eq!(written(&plan(pace)).unwrap().1, written(&plan(pace)).unwrap().1);
        assert_ne!(written(&plan(pace)).unwrap().1, written(&LogPlan { seed: 2, ..plan(pace) }).unwrap().1);
        let report = written(&plan(pace)).unwrap().0;
        assert_eq!(report.scans + report.tilted, 12);
    }

    #[test]
    fn lost_scans_are_missing_and_the_others_as_they_were() {
        let pace = Pace::Rate { hz: 20.0, seconds: None };
        let (whole, [all, ..]) = written(&plan(pace)).unwrap();
        let fault = FaultPlan::parse("damage=0.05,unplug=6").unwrap();
        let (holed, [some, truth, ..]) = written(&LogPlan { fault, ..plan(pace) }).unwrap();
        assert_eq!(holed.scans + holed.tilted + holed.lost, whole.scans + whole.tilted);
        assert!((30 + 5..30 * 4).contains(&holed.lost), "{} lost of {}", holed.lost, whole.scans);
        assert_eq!((some.lines().count(), truth.lines().count()), (holed.scans + 1, holed.scans));
        let all: Vec<&str> = all.lines().collect();
        assert!(some.lines().all(|line| all.contains(&line)));
    }

    #[test]
    fn impossible_paces_are_refused() {
        let error = written(&plan(Pace::Rate { hz: 80.0, seconds: None })).unwrap_err();
        assert_eq!(
            error.to_string(),
            "lms200 takes 75 scans a second: a rate above 0 and up to that is expected, found 80"
        );
        for seconds in [f64::INFINITY, f64::NAN, 1e308, -1.0] {
            let error = written(&plan(Pace::Rate { hz: 5.0, seconds: Some(seconds) })).unwrap_err().to_string();
            assert!(error.starts_with("a drive of 0 to 108000 s is expected, found "), "{error}");
        }
        let error = written(&plan(Pace::Count(usize::MAX))).unwrap_err().to_string();
        assert!(error.starts_with("at most 8100000 scans are expected"), "{error}");
        let room = Scenario::load("room").unwrap();
        let [mut log, mut truth]: [Vec<u8>; 2] = Default::default();
        let mut files = LogFiles { log: &mut log, truth: &mut truth, tilted: None, tilt: None };
        let endless = write_log(&room, &plan(Pace::Rate { hz: 5.0, seconds: None }), &mut files);
        assert!(matches!(endless, Err(LogError::Endless)));
        let spread = write_log(&room, &plan(Pace::Count(5)), &mut files);
        assert!(matches!(spread, Err(LogError::NoRoute)));
    }
}
