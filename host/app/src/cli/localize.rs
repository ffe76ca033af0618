//! `lrfslam localize`: scans and a saved map in; the robot's path in that map out, and how sure it is.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::Args;
use lrfslam_core::geometry::Pose2;

use super::Failure;
use super::continuing::{ReadAhead, in_words};
use super::laser::{EndArgs, LaserArgs, interrupt_flag, say};
use super::live_scans::ended;
use super::map::{open_scans, stem};
use super::monitor::{MonitorArgs, Watched};
use super::out::{OutArgs, SaveArgs};
use super::progress::Progress;
use super::record::TopicArgs;
use super::shared::{ConfigArgs, LOG, MAP, START, SeedArgs, TellArgs};
use super::summary::source_lines;
use crate::config::LocalizeReport;
use crate::config::RunConfig;
use lrfslam_host::localize::{KnownMap, LocalizeCounts, LocalizerMemory, Located};
use lrfslam_host::mapping::saved_map::SavedMap;
use lrfslam_host::output::ResultFolder;
use lrfslam_host::plural::count;
use lrfslam_host::program::Program;
use lrfslam_host::results::report::Ending;
use lrfslam_host::runs::localize::LocalizeRun;
use lrfslam_host::runs::map::Beside;
use lrfslam_host::runs::scans::Scans;
use lrfslam_host::scans::log::LogScan;

/// Find and track the robot in a map that was made before; the map is not changed.
///
/// Written are trajectory.tum (the robot's pose in the map for every scan at which it is known), localization.csv (for every scan: pose, standard
/// deviations, and the probability that the position is right), localization.png (the path over the map) and run.json.
///
/// The scans are those of a log or a recording, or with --lrf and --port those of a laser now, until ctrl-C.
#[derive(Debug, Args)]
pub(super) struct LocalizeArgs {
    #[arg(help = LOG, required_unless_present = "LaserArgs", conflicts_with = "LaserArgs")]
    log: Option<PathBuf>,
    #[command(flatten)]
    topic: TopicArgs,
    #[command(flatten)]
    laser: Option<LaserArgs>,
    #[command(flatten)]
    end: EndArgs,
    #[arg(long, value_name = "DIR", help = MAP)]
    map: PathBuf,
    #[arg(long, value_name = "X,Y,DEG", help = START, value_parser = start, allow_hyphen_values = true)]
    start: Option<Start>,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    save: SaveArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    tell: TellArgs,
    #[command(flatten)]
    monitor: MonitorArgs,
}

/// Where a robot starts in a saved map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Start {
    /// Where it was last.
    End,
    /// A pose.
    At(Pose2),
}

impl Start {
    /// The pose, if one was said.
    pub(super) fn told(self) -> Option<Pose2> {
        match self {
            Self::End => None,
            Self::At(pose) => Some(pose),
        }
    }

    pub(super) fn pose(self, map: &KnownMap) -> Pose2 {
        match self {
            Self::End => map.last_pose(),
            Self::At(pose) => pose,
        }
    }
}

pub(super) fn start(text: &str) -> Result<Start, String> {
    if text == "end" {
        return Ok(Start::End);
    }
    let numbers: Option<Vec<f32>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, degrees]) if [x, y, degrees].iter().all(|number| number.abs() <= 1e4) => {
            Ok(Start::At(Pose2::new(x, y, degrees.to_radians())))
        }
        _ => Err("expected \"end\", or x, y in metres and a heading in degrees, such as 1.5,-2,90".to_owned()),
    }
}

pub(super) fn run(args: &LocalizeArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    let saved = SavedMap::read(&args.map).map_err(Failure::start)?;
    let config = RunConfig::of_saved(&saved, &args.map).map_err(Failure::start)?;
    let config = args.config.load_over(config, [])?;
    let map = KnownMap::new(&saved, &config.mapping().high_slam()).map_err(|error| not_whole(&args.map, &error))?;
    let start = args.start.map(|start| start.pose(&map));
    let localizer = config.localizer();
    let mut memory = LocalizerMemory::new(&localizer);
    let run = LocalizeRun::new((&localizer, args.seed.seed), &map, start, &mut memory).map_err(Failure::Start)?;
    let watched = args.monitor.watched(args.names(), config.map, stop)?;
    let (scans, folder) = args.open(&config, stop, &watched)?;
    watched.open(scans.is_log(), args.tell)?;
    let mut scans = ReadAhead::new(scans, args.end);
    scans.wait(stop)?;
    Localization { args, saved: &saved, config, start, run, scans, folder, watched, fault: None }.run(stop)
}

impl LocalizeArgs {
    /// What the live page calls it: command, source, and the map whose frame it is in.
    fn names(&self) -> (&'static str, String, Option<String>) {
        let laser = self.laser.as_ref().map(LaserArgs::name);
        let log = self.log.as_ref().map(|log| log.display().to_string());
        ("localize", log.or(laser).unwrap_or_default(), Some(self.map.display().to_string()))
    }

    /// The scans, and where the results go.
    fn open(
        &self,
        config: &RunConfig,
        stop: &'static AtomicBool,
        watched: &Watched,
    ) -> Result<(Scans, ResultFolder), Failure> {
        match (&self.log, &self.laser) {
            (Some(log), _) => {
                let scans = open_scans(log, self.topic.log_options(config), stop, watched.sayer(self.tell))?;
                let mut folder = self.out.folder(&stem(log, "localized"))?;
                scans.recording().iter().for_each(|file| folder.keep(file));
                Ok((scans, folder))
            }
            (None, Some(laser)) => {
                let scans = laser.scans(config.log_options().range_max_m, stop, watched.sayer(self.tell))?;
                Ok((scans, self.out.folder("localized")?))
            }
            (None, None) => Err(Failure::start(anyhow::anyhow!("neither a log nor a laser"))),
        }
    }
}

pub(super) fn not_whole(folder: &Path, error: &impl std::fmt::Display) -> Failure {
    let file = folder.join(lrfslam_host::mapping::saved_map::FILE_NAME);
    Failure::Start(anyhow::anyhow!("{}: damaged: {error}", file.display()))
}

/// Scans on their way through a map.
struct Localization<'a> {
    args: &'a LocalizeArgs,
    saved: &'a SavedMap,
    config: RunConfig,
    start: Option<Pose2>,
    run: LocalizeRun<'a>,
    scans: ReadAhead,
    folder: ResultFolder,
    watched: Watched,
    fault: Option<anyhow::Error>,
}

impl Localization<'_> {
    fn run(mut self, stop: &AtomicBool) -> Result<(), Failure> {
        let progress = Progress::new(self.scans.scans(), self.args.tell.is_quiet());
        let mut is_known = None;
        while let Some(scan) = self.scans.next() {
            match scan.and_then(|scan| self.add_scan(&scan)) {
                Ok(located) => self.tell_changes(&mut is_known, located.as_ref()),
                Err(fault) => {
                    self.fault = Some(fault);
                    break;
                }
            }
            if self.folder.is_due(self.args.save.every()) || self.watched.is_asked_to_save() {
                let saved = self.save(Ending::Running);
                self.folder.news(&saved).iter().for_each(|news| say(news));
            }
            progress.set(self.run.scans());
        }
        progress.clear();
        self.finish(stop)
    }

    fn add_scan(&mut self, scan: &LogScan) -> anyhow::Result<Option<Located>> {
        let robot_from_lrf = scan.robot_from_lrf.unwrap_or_else(|| self.config.robot_from_lrf());
        let located = self.run.add_scan(&scan.scan(), robot_from_lrf)?;
        let Self { run, watched, .. } = self;
        watched.show(|feed| run.show(feed, Some((&scan.scan(), robot_from_lrf, located.as_ref())), Beside::default()));
        watched.pause(|feed| run.show(feed, None, Beside::default()));
        Ok(located)
    }

    /// Of a laser now: that the robot is found, and that it is lost.
    fn tell_changes(&mut self, is_known: &mut Option<bool>, located: Option<&Located>) {
        if !self.scans.scans().is_live() || is_known.replace(located.is_some()) == Some(located.is_some()) {
            return;
        }
        self.args.tell.say(&match located {
            Some(located) => format!("the robot is at {} in the map", in_words(located.map_from_robot)),
            None => "looking where in the map the robot is: it has to drive a few metres".to_owned(),
        });
    }

    fn save(&mut self, ending: Ending) -> anyhow::Result<LocalizeReport> {
        let source = self.scans.scans().source(ending != Ending::Running);
        let (args, saved, config, start) = (self.args, self.saved, self.config, self.start);
        let fault = self.fault.as_ref().map(|error| format!("{error:#}"));
        let describe = |localisation, first_found_after_s| LocalizeReport {
            program: Program::THIS,
            map: args.map.display().to_string(),
            map_program: saved.program.clone(),
            source,
            config,
            seed: args.seed.seed,
            start: start.map(|pose| [pose.x, pose.y, pose.heading.to_degrees()]),
            localisation,
            first_found_after_s,
            partial: ending != Ending::Complete,
            ending,
            fault,
        };
        self.folder.save(|stage| self.run.write_into(stage, &config.map, describe))
    }

    fn finish(mut self, stop: &AtomicBool) -> Result<(), Failure> {
        self.scans.scans().end();
        let ending = self.scans.ending(self.fault.is_some(), stop);
        let report = self.save(ending).map_err(Failure::Work)?;
        self.args.tell.print(&report, || summary(&report, self.folder.named()))?;
        let words = ended(ending, self.folder.named());
        self.watched.finish(&words, |feed| self.run.show(feed, None, Beside::default()));
        let partial = format!("partial results are in {}", self.folder.named().display());
        match (ending, self.fault) {
            (_, Some(fault)) => Err(Failure::Work(fault.context(partial))),
            (Ending::Interrupted, None) => Err(Failure::Interrupted(anyhow::anyhow!(partial))),
            _ if report.first_found_after_s.is_none() => {
                let map = self.args.map.display();
                Err(Failure::NotFound(anyhow::anyhow!("the robot has not found itself in the map in {map}")))
            }
            _ => Ok(()),
        }
    }
}

fn summary(report: &LocalizeReport, out: &Path) -> String {
    let LocalizeCounts { tracked_scans, searching_scans, searches, found, lost } = report.localisation;
    let times = |number| count(number, "time");
    let scans = count(tracked_scans + searching_scans, "scan");
    let mut text = match report.first_found_after_s {
        None => scans,
        Some(_) => format!("{scans}, pose known at {tracked_scans}"),
    };
    // Writing to a string cannot fail.
    let _ = match report.first_found_after_s {
        None if report.start.is_some() && searches == 0 => {
            writeln!(text, "\nwhat the laser sees from the told start is nowhere in the map: the start is wrong")
        }
        None => {
            let searched = times(searches);
            writeln!(text, "\nthe robot has not found itself in the map (searched for {searched})")
        }
        Some(_) if report.start.is_some() => writeln!(text, "; lost {}, found again {}", times(lost), times(found)),
        Some(after_s) => {
            writeln!(text, "; found after {after_s:.1} s; found {}, lost {}", times(found), times(lost))
        }
    };
    text.push_str(&source_lines(&report.source));
    let state = if report.partial { "partial results" } else { "results" };
    let _ = writeln!(text, "{state} in {}", out.display());
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_is_a_pose_or_the_end() {
        assert_eq!(start("end"), Ok(Start::End));
        assert_eq!(start("1.5, -2,90"), Ok(Start::At(Pose2::new(1.5, -2.0, std::f32::consts::FRAC_PI_2))));
        for wrong in ["", "1,2", "1,2,3,4", "a,b,c", "1,2,nan", "1,2,inf"] {
            assert!(start(wrong).unwrap_err().contains("expected \"end\""), "{wrong}");
        }
    }
}
