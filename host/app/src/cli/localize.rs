//! `lrfslam localize`: a log and a saved map in; the robot's path in that map out, and how sure it is.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use lrfslam_core::geometry::Pose2;

use super::Failure;
use super::laser::interrupt_flag;
use super::map::{input, open_log, progress_bar, stem};
use super::out::OutArgs;
use super::shared::{ConfigArgs, MAP, START, SeedArgs, TellArgs};
use super::summary::log_lines;
use lrfslam_host::config::RunConfig;
use lrfslam_host::localize::{KnownMap, LocalizeCounts, LocalizerMemory};
use lrfslam_host::mapping::saved_map::SavedMap;
use lrfslam_host::program::Program;
use lrfslam_host::results::report::{Ending, Source};
use lrfslam_host::runs::localize::{LocalizeReport, LocalizeRun};
use lrfslam_host::scans::log::LogReader;

/// Find and track the robot in a map that was made before; the map is not changed.
///
/// Written are trajectory.tum (the robot's pose in the map for every scan at which it is known), localization.csv (for every scan: pose, standard
/// deviations, and the probability that the position is right), localization.png (the path over the map) and run.json.
#[derive(Debug, Args)]
pub(super) struct LocalizeArgs {
    /// The log; - reads it from standard input.
    log: PathBuf,
    #[arg(long, value_name = "DIR", help = MAP)]
    map: PathBuf,
    #[arg(long, value_name = "X,Y,DEG", help = START, value_parser = start, allow_hyphen_values = true)]
    start: Option<Start>,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    tell: TellArgs,
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
    let config = args.config.load_over(saved.config, [])?;
    let map = KnownMap::new(&saved, &config).map_err(|error| not_whole(&args.map, &error))?;
    let mut log = open_log(&args.log, config.log_options()).map_err(Failure::start)?;
    let start = args.start.map(|start| start.pose(&map));
    let mut memory = LocalizerMemory::new(&config);
    let mut run = LocalizeRun::new((&config, args.seed.seed), &map, start, &mut memory).map_err(Failure::Start)?;
    let mut folder = args.out.folder(&stem(&args.log, "localized"))?;
    let progress = progress_bar(log.size_bytes(), args.tell.is_quiet());
    let (ending, fault) = locate_scans(&mut log, &mut run, &config, (&progress, stop));
    progress.finish_and_clear();
    let source = Source::Log { input: input(&args.log, &mut log), log: log.counts(), range_max_m: log.range_max_m() };
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
        fault: fault.as_ref().map(|error| format!("{error:#}")),
    };
    let report = folder.save(|stage| run.write_into(stage, describe)).map_err(Failure::Work)?;
    args.tell.print(&report, || summary(&report, folder.named()))?;
    let partial = || format!("partial results are in {}", folder.named().display());
    match (ending, fault) {
        (_, Some(fault)) => Err(Failure::Work(fault.context(partial()))),
        (Ending::Interrupted, None) => Err(Failure::Interrupted(anyhow::anyhow!(partial()))),
        _ if report.first_found_after_s.is_none() => {
            let map = args.map.display();
            Err(Failure::NotFound(anyhow::anyhow!("the robot has not found itself in the map in {map}")))
        }
        _ => Ok(()),
    }
}

pub(super) fn not_whole(folder: &Path, error: &impl std::fmt::Display) -> Failure {
    let file = folder.join(lrfslam_host::mapping::saved_map::FILE_NAME);
    Failure::Start(anyhow::anyhow!("{}: damaged: {error}", file.display()))
}

fn locate_scans(
    log: &mut LogReader,
    run: &mut LocalizeRun<'_>,
    config: &RunConfig,
    (progress, stop): (&indicatif::ProgressBar, &AtomicBool),
) -> (Ending, Option<anyhow::Error>) {
    let bytes_read = log.bytes_read();
    for scan in log.by_ref() {
        let located = scan.map_err(anyhow::Error::new).and_then(|scan| {
            let robot_from_lrf = scan.robot_from_lrf.unwrap_or_else(|| config.robot_from_lrf());
            run.add_scan(&scan.scan(), robot_from_lrf)
        });
        if let Err(fault) = located {
            return (Ending::Failed, Some(fault));
        }
        if stop.load(Ordering::Relaxed) {
            return (Ending::Interrupted, None);
        }
        let rate = run.scans() as f64 / progress.elapsed().as_secs_f64().max(1e-6);
        progress.set_message(format!("{rate:.0} scans/s"));
        progress.set_position(bytes_read.get());
    }
    (Ending::Complete, None)
}

fn summary(report: &LocalizeReport, out: &Path) -> String {
    let LocalizeCounts { tracked_scans, searching_scans, searches, found, lost } = report.localisation;
    let mut text = format!("{} scans, pose known at {tracked_scans}", tracked_scans + searching_scans);
    // Writing to a string cannot fail.
    let _ = match report.first_found_after_s {
        None => writeln!(text, "\nthe robot has not found itself in the map ({searches} searches)"),
        Some(_) if report.start.is_some() => writeln!(text, "; lost {lost} times, found again {found} times"),
        Some(after_s) => writeln!(text, "; found after {after_s:.1} s; found {found} times, lost {lost} times"),
    };
    if let Source::Log { log, .. } = &report.source {
        text.push_str(&log_lines(log));
    }
    let _ = writeln!(text, "results in {}", out.display());
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
