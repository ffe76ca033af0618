//! The simulated side: a robot that drives in a building with a laser on a pseudo-terminal, and the truth about it.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Instant as WallInstant, SystemTime, UNIX_EPOCH};

use crate::cli::demo::{DemoArgs, DemoLrf};
use anyhow::{Context as _, Result, anyhow};
use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::lrf_model::LrfModel;
use lrfslam_firmware_sim::pty;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::scene::{RobotScene, Scene};
use lrfslam_firmware_sim::tilt::Encoder;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::HokuyoModel;
use lrfslam_firmware_sim::virtual_lrf::sick::SickModel;
use lrfslam_firmware_sim::virtual_lrf::{SensorModel, VirtualLrf};
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::scans::family::{LrfFamily, LrfOptions};
use lrfslam_host::scans::link::Address;
use lrfslam_host::scans::live::LiveLaser;

/// Time by which a scan's stamp may be off: what is nearer to a tilt than this counts as tilted.
const STAMP_ERROR: Duration = Duration::from_millis(30);

/// See the [module](self).
pub struct SimulatedRobot {
    /// Building and drive.
    pub scenario: Scenario,
    port: PathBuf,
    /// Of the folder that the port is in.
    _folder: tempfile::TempDir,
    clock: PatientClock,
    departure: Departure,
    stop: Arc<AtomicBool>,
    served: Receiver<Result<()>>,
}

/// Longest step of the simulator's clock; what is beyond has been slept, µs.
const STEP_MAX: i64 = 30_000;

/// The simulator's time: that of the wall, but it stands still while the computer is too busy to run the simulator at all.
///
/// Else scans that were late by the computer's fault would look as if the robot had moved without being seen.
#[derive(Debug, Clone)]
struct PatientClock {
    /// When it was zero, µs since 1970.
    zero_micros: i64,
    /// From when to when it stood still, µs since its zero.
    stood: Arc<Mutex<Vec<[i64; 2]>>>,
}

impl PatientClock {
    fn new() -> Self {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { zero_micros: unix.as_micros() as i64, stood: Arc::default() }
    }

    /// The clock as the simulator reads it, again and again.
    fn running(&self) -> impl FnMut() -> Instant + use<> {
        let (clock, started, mut last) = (self.clone(), WallInstant::now(), 0);
        move || {
            let now = started.elapsed().as_micros() as i64;
            if now - last > STEP_MAX {
                clock.stood.lock().unwrap_or_else(PoisonError::into_inner).push([last + STEP_MAX, now]);
            }
            last = now;
            clock.time(Instant::from_micros(clock.zero_micros + now))
        }
    }

    /// The simulator's time at a stamp of the host.
    fn time(&self, stamp: Instant) -> Instant {
        let wall = stamp.micros.saturating_sub(self.zero_micros);
        let stood = self.stood.lock().unwrap_or_else(PoisonError::into_inner);
        let slept: i64 = stood.iter().map(|[from, to]| (wall.min(*to) - from).max(0)).sum();
        Instant::from_micros(wall - slept)
    }
}

/// When the drive begins on the simulator's clock, µs; until the laser is heard, never.
#[derive(Debug, Clone)]
struct Departure(Arc<AtomicI64>);

impl Departure {
    /// Time on the drive's own clock; its start before it begins.
    fn drive_time(&self, at: Instant) -> Instant {
        let begins = self.0.load(Ordering::Relaxed);
        Instant::from_micros(at.micros.saturating_sub(begins).max(0))
    }
}

/// The scene on the simulator's clock: the robot stands until the drive begins.
struct WaitingScene {
    scene: RobotScene,
    departure: Departure,
}

impl Scene for WaitingScene {
    fn range_m(&self, at: Instant, bearing_rad: f64) -> Option<f64> {
        self.scene.range_m(self.departure.drive_time(at), bearing_rad)
    }
}

impl SimulatedRobot {
    /// Switches the laser on; the robot stands until [`depart`](Self::depart).
    pub fn start(scenario: Scenario, args: &DemoArgs) -> Result<Self> {
        let folder = tempfile::tempdir().context("a folder for the pseudo-terminal")?;
        let port = folder.path().join("laser");
        let departure = Departure(Arc::new(AtomicI64::new(i64::MAX)));
        let scene = Box::new(WaitingScene { scene: scenario.scene(), departure: departure.clone() });
        let mut device = device(args.lrf, scene, args.seed.seed);
        let clock = PatientClock::new();
        let mut running = clock.running();
        let stop = Arc::new(AtomicBool::new(false));
        let (sender, served) = channel();
        let (link, off, seed) = (port.clone(), stop.clone(), args.seed.seed);
        std::thread::spawn(move || {
            let done = pty::serve(device.as_mut(), &link, FaultPlan::default(), seed, &mut running, &off);
            // Nobody listens only if the demonstration has failed already.
            let _ = sender.send(done.map(|_| ()));
        });
        Ok(Self { scenario, port, _folder: folder, clock, departure, stop, served })
    }

    /// How the mapper reaches the laser.
    pub fn laser(&self, args: &DemoArgs) -> LiveLaser {
        let (family, baud, variant) = match args.lrf {
            DemoLrf::Lms200 | DemoLrf::Lms200Far | DemoLrf::Lms291 | DemoLrf::Lms200Noisy => {
                (LrfFamily::SickLms2xx, 500_000, Some((180, 50)))
            }
            DemoLrf::Urg04lxUg01 | DemoLrf::Utm30lx => (LrfFamily::Hokuyo, 0, None),
        };
        let options = LrfOptions { baud, variant, cluster: 1, ..LrfOptions::new(family) };
        LiveLaser::new(Address::Serial(self.port.display().to_string()), options)
    }

    /// Lets the robot drive off, half a second after a scan stamped `stamp`.
    pub fn depart(&self, stamp: Instant) {
        self.departure.0.store(self.clock.time(stamp).micros + 500_000, Ordering::Relaxed);
    }

    /// Time on the drive's clock of a stamp on the host's.
    pub fn drive_time(&self, stamp: Instant) -> Instant {
        self.departure.drive_time(self.clock.time(stamp))
    }

    /// True if the laser is level for the whole of a scan from `begin` to `end`, stamps on the host's clock.
    pub fn is_level(&self, begin: Instant, end: Instant) -> bool {
        let early = Instant::from_micros(begin.micros - STAMP_ERROR.micros);
        let tilt = self.scenario.drive().tilt();
        [early, begin, end, end + STAMP_ERROR].into_iter().all(|at| tilt.tilt_rad(self.drive_time(at)) == 0.0)
    }

    /// Where the robot truly is in the building.
    pub fn pose(&self, stamp: Instant) -> PoseF64 {
        let pose = self.scenario.drive().pose(self.drive_time(stamp));
        PoseF64::new(pose.x, pose.y, pose.heading)
    }

    /// What the tilt's encoder read, on the drive's clock.
    pub fn tilt_readings(&self) -> Vec<(Instant, f64)> {
        let drive = self.scenario.drive();
        drive.end().map_or_else(Vec::new, |end| Encoder::default().readings(drive.tilt(), end).collect())
    }

    /// Where the laser sits on the robot, in the plane.
    pub fn robot_from_lrf(&self) -> Pose2 {
        let [ahead, left, _] = self.scenario.robot.laser_m;
        Pose2::new(ahead as f32, left as f32, 0.0)
    }

    /// Ends the simulation; says if it had failed.
    pub fn switch_off(&self) -> Result<()> {
        self.stop.store(true, Ordering::Relaxed);
        self.served.recv().map_err(|_| anyhow!("the simulated laser has died"))?.context("the simulated laser")
    }
}

fn device(lrf: DemoLrf, scene: Box<dyn Scene>, seed: u64) -> Box<dyn VirtualLrf> {
    let noisy = SickModel::lms200().with_errors(LrfModel::URG_04LX_UG01.errors);
    let model = match lrf {
        DemoLrf::Lms200 => SensorModel::Sick(SickModel::lms200()),
        DemoLrf::Lms200Far => SensorModel::Sick(SickModel::lms200_3016()),
        DemoLrf::Lms291 => SensorModel::Sick(SickModel::lms291()),
        DemoLrf::Lms200Noisy => SensorModel::Sick(noisy),
        DemoLrf::Urg04lxUg01 => SensorModel::Hokuyo(HokuyoModel::urg_04lx_ug01()),
        DemoLrf::Utm30lx => SensorModel::Hokuyo(HokuyoModel::utm_30lx()),
    };
    model.seeing(scene, seed, None)
}
