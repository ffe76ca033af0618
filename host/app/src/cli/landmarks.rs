//! `lrfslam landmarks`: controls and sightings of landmarks in; path, landmarks, picture and report out.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant as WallInstant};

use anyhow::Context as _;
use clap::{Args, Subcommand, ValueEnum};
use lrfslam_core::config::Section as _;
use lrfslam_core::landmark::detect::DetectConfig;
use lrfslam_core::landmark::{Association, LandmarkConfig};
use lrfslam_core::time::Instant;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::monitor::MonitorArgs;
use super::out::OutArgs;
use super::shared::{SeedArgs, TellArgs};
use super::{Failure, interrupt_flag};
use lrfslam_host::landmarks::mrclam::Ranges;
use lrfslam_host::landmarks::output::{LandmarkReport, write};
use lrfslam_host::landmarks::watch::{show, show_end};
use lrfslam_host::landmarks::{Drive, Filter, laser, mrclam, run::run as run_filter, simulated, victoria};
use lrfslam_host::maps::occupancy::MapConfig;

/// Map point landmarks by EKF-SLAM or FastSLAM.
///
/// Reads a drive of the data sets MRCLAM and Victoria Park, simulates one, or finds reflectors and posts in the scans of a laser. Written are trajectory.tum (the path as it is believed at the end),
/// online.tum (as it was believed on the way), landmarks.csv (with covariances), landmarks.png (with 95 % ellipses) and run.json (with the
/// errors, where the truth is known).
#[derive(Debug, Args)]
pub(super) struct LandmarksArgs {
    #[command(subcommand)]
    filter: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// One Gaussian over robot and landmarks (thesis §4.1).
    Ekf(DriveArgs),
    /// Particles that each have a map (thesis §4.2).
    Fastslam {
        /// Particles.
        #[arg(long, value_name = "COUNT", default_value_t = 100, value_parser = clap::value_parser!(u16).range(1..=10_000))]
        particles: u16,
        #[command(flatten)]
        drive: DriveArgs,
    },
}

#[derive(Debug, Args)]
struct DriveArgs {
    /// Folder of MRCLAM or Victoria Park, or how the names of the files begin, such as data/mrclam7; a laser's log or recording; "sim" simulates a drive.
    #[arg(long, value_name = "DIR|LOG|sim")]
    data: PathBuf,
    /// Robot of MRCLAM.
    #[arg(long, value_name = "N", default_value_t = 1)]
    robot: u8,
    /// What MRCLAM's recorded ranges are taken for.
    #[arg(long, value_enum, default_value_t = RangesArg::Depths)]
    ranges: RangesArg,
    /// True over recorded range of MRCLAM's cameras, from a calibration.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = range_scale)]
    range_scale: f64,
    /// Who says which landmark a sighting is of [default: the sensor, where it does; else joint].
    #[arg(long, value_enum)]
    association: Option<AssociationArg>,
    /// Room for so many landmarks.
    #[arg(long, value_name = "N", default_value_t = 400, value_parser = clap::value_parser!(u16).range(1..=2000))]
    landmarks_max: u16,
    /// Landmarks of a simulated drive.
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = clap::value_parser!(u16).range(1..=2000))]
    posts: u16,
    /// Of a log with odometry: predict motion by matching scans all the same.
    #[arg(long)]
    no_odometry: bool,
    /// Change one value of the configuration in run.json, as KEY=VALUE, or detect.KEY=VALUE; may be given more than once.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Run seeds 1 to COUNT, print a line for each, and write nothing.
    #[arg(long, value_name = "COUNT", conflicts_with_all = ["out", "overwrite"], value_parser = clap::value_parser!(u64).range(1..1000))]
    seeds: Option<u64>,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    out: OutArgs,
    /// Take the drive so many times as fast as it was driven, to watch it [default: as fast as it goes].
    #[arg(long, value_name = "FACTOR", conflicts_with = "seeds", value_parser = pace)]
    pace: Option<f64>,
    #[command(flatten)]
    tell: TellArgs,
    #[command(flatten)]
    monitor: MonitorArgs,
}

/// How keys of the detector begin.
const DETECT: &str = "detect.";

#[derive(Debug, Clone, Copy, ValueEnum)]
enum RangesArg {
    /// Depths along the optical axis.
    Depths,
    /// Distances along the ray.
    Distances,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum AssociationArg {
    /// The sensor says it.
    Known,
    /// The nearest, in Mahalanobis' distance.
    Nearest,
    /// The most sightings that fit together.
    Joint,
}

pub(super) fn run(args: &LandmarksArgs) -> Result<(), Failure> {
    let (filter, args) = match &args.filter {
        Command::Ekf(drive) => (Filter::Ekf, drive),
        Command::Fastslam { particles, drive } => (Filter::Fastslam { particles: *particles }, drive),
    };
    let drive = args.drive().map_err(Failure::Start)?;
    let config = args.config(&drive).map_err(Failure::Start)?;
    if let Some(seeds) = args.seeds {
        return args.table(&drive, &config, filter, seeds);
    }
    let stop = interrupt_flag().map_err(Failure::start)?;
    let mut folder = args.out.folder("landmarks")?;
    let mut watched = args.monitor.watched(("landmarks", drive.name.clone(), None), MapConfig::default(), stop)?;
    watched.open(true, args.tell)?;
    let mut pace = Pace::new(args.pace, stop);
    let done = run_filter(&drive, &config, filter, usize::from(args.landmarks_max), args.seed.seed, |glance| {
        pace.wait(glance.stamp);
        watched.show(|feed| show(feed, glance));
        watched.pause(|feed| show(feed, glance));
        !stop.load(Ordering::Relaxed)
    });
    let done = done.ok_or_else(no_memory)?;
    let report = LandmarkReport::new(&drive, &config, filter, args.seed.seed, &done);
    folder.save(|place| write(place, &drive, &done, &report)).map_err(Failure::Work)?;
    args.tell.print(&report, || summary(&report, folder.named()))?;
    watched.begin_anew();
    let words = format!("done: results in {}", folder.named().display());
    watched.finish(&words, |feed| show_end(feed, &done.estimate, done.batches));
    match stop.load(Ordering::Relaxed) {
        true => Err(Failure::Interrupted(anyhow::anyhow!("the drive was not at its end: results are partial"))),
        false => Ok(()),
    }
}

/// Takes the drive no faster than its pace.
struct Pace {
    /// Times as fast as it was driven; `None`: as fast as it goes.
    pace: Option<f64>,
    /// When the drive began, by its stamps and by the clock of the wall.
    began: Option<(Instant, WallInstant)>,
    stop: &'static AtomicBool,
}

impl Pace {
    fn new(pace: Option<f64>, stop: &'static AtomicBool) -> Self {
        Self { pace, began: None, stop }
    }

    /// Returns when `stamp` is due, or at ctrl-C.
    fn wait(&mut self, stamp: Instant) {
        let Some(pace) = self.pace else { return };
        let (first, began) = *self.began.get_or_insert((stamp, WallInstant::now()));
        let due = (stamp.as_secs_f64() - first.as_secs_f64()) / pace;
        while !self.stop.load(Ordering::Relaxed) && began.elapsed().as_secs_f64() < due {
            std::thread::sleep(Duration::from_secs_f64((due - began.elapsed().as_secs_f64()).clamp(0.0, 0.02)));
        }
    }
}

fn pace(text: &str) -> Result<f64, String> {
    let pace: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.01..=1e6).contains(&pace) { Ok(pace) } else { Err("must lie in 0.01 to 1000000".to_owned()) }
}

fn range_scale(text: &str) -> Result<f64, String> {
    let scale: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.5..=2.0).contains(&scale) { Ok(scale) } else { Err("must lie in 0.5 to 2".to_owned()) }
}

fn no_memory() -> Failure {
    Failure::Start(anyhow::anyhow!("there is no memory for so many landmarks"))
}

impl DriveArgs {
    fn drive(&self) -> anyhow::Result<Drive> {
        if self.data == Path::new("sim") {
            return Ok(simulated::drive(usize::from(self.posts), self.seed.seed));
        }
        if ["inputs.dat", "inputs.dat.gz"].iter().any(|name| self.data.join(name).exists()) {
            return victoria::read(&self.data);
        }
        if laser::is_of_laser(&self.data) {
            let stop = interrupt_flag()?;
            let (name, scans) = (self.data.display().to_string(), laser::scans(&self.data)?);
            let goes_on = |_| !stop.load(Ordering::Relaxed);
            return laser::drive(name, &scans, &self.detect()?, !self.no_odometry, goes_on);
        }
        let ranges = match self.ranges {
            RangesArg::Depths => Ranges::Depths,
            RangesArg::Distances => Ranges::Distances,
        };
        mrclam::read(&self.data, self.robot, ranges, self.range_scale)
    }

    fn config(&self, drive: &Drive) -> anyhow::Result<LandmarkConfig> {
        let mut config: LandmarkConfig = self.changed(drive.config, "")?;
        config.association = match self.association {
            Some(AssociationArg::Known) => Association::Known,
            Some(AssociationArg::Nearest) => Association::Nearest,
            Some(AssociationArg::Joint) => Association::Joint,
            None => config.association,
        };
        anyhow::ensure!(
            drive.has_identities || config.association != Association::Known,
            "the sightings of this drive have no identities: --association nearest or joint"
        );
        config.validate()?;
        Ok(config)
    }

    /// How landmarks are looked for in scans.
    fn detect(&self) -> anyhow::Result<DetectConfig> {
        let config = self.changed(DetectConfig::default(), DETECT)?;
        config.validate()?;
        Ok(config)
    }

    /// `section` with the changes of `--set` whose keys begin with `prefix`.
    fn changed<T: Serialize + DeserializeOwned>(&self, section: T, prefix: &str) -> anyhow::Result<T> {
        let mut table = toml::Table::try_from(section)?;
        for set in &self.set {
            let (key, value) = set.split_once('=').with_context(|| format!("--set {set}: expected KEY=VALUE"))?;
            let Some(key) = key.strip_prefix(prefix).filter(|key| !key.starts_with(DETECT)) else { continue };
            let parsed = toml::from_str::<toml::Table>(&format!("value = {value}")).ok();
            let parsed = parsed.and_then(|mut table| table.remove("value"));
            table.insert(key.to_owned(), parsed.unwrap_or_else(|| toml::Value::String(value.to_owned())));
        }
        table.try_into().with_context(|| format!("--set {}", self.set.join(" --set ")))
    }

    fn table(&self, drive: &Drive, config: &LandmarkConfig, filter: Filter, seeds: u64) -> Result<(), Failure> {
        let mut text = String::from(
            "| seed | path, online, m | path, at the end, m | landmarks, filter's, m | landmarks, at the end, m | found | false |\n|---|---|---|---|---|---|---|\n",
        );
        for seed in 1..=seeds {
            let room = usize::from(self.landmarks_max);
            let done = run_filter(drive, config, filter, room, seed, |_| true).ok_or_else(no_memory)?;
            let report = LandmarkReport::new(drive, config, filter, seed, &done);
            let (end, way) = (&report.errors, &report.online);
            let errors = [way.path_rmse_m, end.path_rmse_m, way.landmarks_rmse_m, end.landmarks_rmse_m];
            let [online, path, filters, landmarks] = errors.map(|error| metres(error, 3));
            let (found, wrong) = (end.landmarks_found, end.landmarks_false);
            let _ = writeln!(text, "| {seed} | {online} | {path} | {filters} | {landmarks} | {found} | {wrong} |");
        }
        super::print(&text)
    }
}

fn metres(error: Option<f64>, digits: usize) -> String {
    error.map_or("-".to_owned(), |error| format!("{error:.digits$}"))
}

fn summary(report: &LandmarkReport, folder: &Path) -> String {
    let seen = &report.sightings;
    let mut text = format!(
        "{}\n{} landmarks; {} sightings matched, {} refused; scale of distances {:.3}, of turns {:.3}; {:.1} s, {} bytes\n",
        report.drive,
        report.landmarks,
        seen.matched,
        seen.refused,
        report.distance_scale,
        report.turn_scale,
        report.wall_s,
        report.memory_bytes,
    );
    if seen.full > 0 {
        let _ = writeln!(text, "{} sightings found no room for a landmark: raise --landmarks-max", seen.full);
    }
    if let Some(path) = report.errors.path_rmse_m {
        let online = metres(report.online.path_rmse_m, 3);
        let _ = writeln!(text, "path: root mean square error {online} m online, {path:.3} m at the end");
    }
    if let Some(misfit) = report.range_misfit_m {
        let _ = writeln!(text, "ranges: {misfit:.3} m from what path and map expect, the median");
    }
    if let Some(landmarks) = report.errors.landmarks_rmse_m {
        let errors = &report.errors;
        let online = metres(report.online.landmarks_rmse_m, 3);
        let (found, wrong) = (errors.landmarks_found, errors.landmarks_false);
        let _ = writeln!(
            text,
            "landmarks: root mean square error {online} m by the filter, {landmarks:.3} m at the end; {found} found, {wrong} false"
        );
    }
    let _ = writeln!(text, "results in {}", folder.display());
    text
}
