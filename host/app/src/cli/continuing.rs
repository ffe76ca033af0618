//! Scans that go on in a map made before: where they begin there, verified before anything is written.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::Instant;

use super::Failure;
use super::laser::{EndArgs, source_failure};
use super::localize::{Start, not_whole, start};
use super::shared::START;
use crate::config::RunConfig;
use lrfslam_host::localize::{KnownMap, ScansAhead, StartFit, StartJudge};
use lrfslam_host::mapping::saved_map::SavedMap;
use lrfslam_host::results::report::Ending;
use lrfslam_host::runs::scans::Scans;
use lrfslam_host::scans::log::LogScan;

/// Scans that are wanted, whose first ones can be looked at before they are taken.
pub(super) struct ReadAhead {
    scans: Scans,
    end: EndArgs,
    ahead: VecDeque<LogScan>,
    /// Stamps of the first scan and the last one, and how many there were.
    read: (Option<[Instant; 2]>, usize),
    fault: Option<anyhow::Error>,
}

impl ReadAhead {
    pub(super) fn new(scans: Scans, end: EndArgs) -> Self {
        Self { scans, end, ahead: VecDeque::new(), read: (None, 0), fault: None }
    }

    pub(super) fn scans(&mut self) -> &mut Scans {
        &mut self.scans
    }

    /// Waits for the first scan.
    ///
    /// # Errors
    /// If none comes.
    pub(super) fn wait(&mut self, stop: &AtomicBool) -> Result<(), Failure> {
        if self.read_to(0) {
            return Ok(());
        }
        let nothing = || anyhow::anyhow!("no scan came: no results were written");
        Err(match self.fault.take() {
            Some(fault) => source_failure(fault),
            None if stop.load(Ordering::Relaxed) => Failure::Interrupted(nothing()),
            None => Failure::Work(nothing()),
        })
    }

    /// How it ended, now that nothing more is taken.
    pub(super) fn ending(&self, has_failed: bool, stop: &AtomicBool) -> Ending {
        // A laser goes on until ctrl-C; what has an end of its own is ended early by it.
        let has_end = !self.scans.is_live() || self.end.has_end();
        let is_early = stop.load(Ordering::Relaxed) && has_end && !self.scans.is_at_end() && !self.is_enough();
        match (has_failed, is_early) {
            (true, _) => Ending::Failed,
            (false, true) => Ending::Interrupted,
            (false, false) => Ending::Complete,
        }
    }

    fn is_enough(&self) -> bool {
        let (ends, count) = self.read;
        let seconds = ends.map_or(0.0, |[first, last]| last.since(first).micros as f64 * 1e-6);
        self.end.is_reached(count, seconds)
    }

    /// Scan `index`, of those that are not taken yet, has been read.
    fn read_to(&mut self, index: usize) -> bool {
        while self.ahead.len() <= index && self.fault.is_none() && !self.is_enough() {
            match self.scans.next() {
                Some(Ok(scan)) => {
                    let (ends, count) = self.read;
                    self.read = (Some([ends.map_or(scan.stamp, |[first, _]| first), scan.stamp]), count + 1);
                    self.ahead.push_back(scan);
                }
                // It is told when the mapping gets there.
                Some(Err(fault)) => self.fault = Some(fault),
                None => break,
            }
        }
        index < self.ahead.len()
    }
}

impl ScansAhead for ReadAhead {
    fn scan(&mut self, index: usize) -> anyhow::Result<Option<&LogScan>> {
        self.read_to(index);
        Ok(self.ahead.get(index))
    }
}

impl Iterator for ReadAhead {
    type Item = anyhow::Result<LogScan>;

    fn next(&mut self) -> Option<Self::Item> {
        self.read_to(0);
        self.ahead.pop_front().map(Ok).or_else(|| self.fault.take().map(Err))
    }
}

/// A map to go on with.
#[derive(Debug, Args)]
pub(super) struct ContinueArgs {
    /// Go on with a map made before: its path, scans and configuration stay, and the new ones are added. Results go to --out.
    #[arg(long = "continue", value_name = "DIR")]
    pub(super) continued: Option<PathBuf>,
    #[arg(long, value_name = "X,Y,DEG", help = START, requires = "continued", allow_hyphen_values = true, value_parser = start)]
    pub(super) start: Option<Start>,
    /// Believe --start without a look at the map: for a robot that begins where the map knows little.
    #[arg(long, requires = "start")]
    pub(super) trust_start: bool,
}

/// A start that fewer of the known points contradict than this is right; with more, another place may fit much better.
const CLEAN: f32 = 0.03;

/// Where the scans begin in the map `saved` in `folder`.
///
/// # Errors
/// If it does not fit the map there, or is nowhere to be found in it.
pub(super) fn verified_start(
    saved: &SavedMap,
    folder: &Path,
    (config, seed): (&RunConfig, u64),
    told: Option<Start>,
    scans: &mut ReadAhead,
) -> Result<Pose2, Failure> {
    let map = KnownMap::new(saved, &config.mapping().high_slam()).map_err(|error| not_whole(folder, &error))?;
    let localizer = config.localizer();
    let judge = StartJudge::new(&localizer, config.robot_from_lrf(), seed, &map);
    let start = told.unwrap_or(Start::End);
    let first = judge.follow(start.pose(&map), scans).map_err(Failure::Start)?;
    if first.fits && first.contradicting <= CLEAN {
        return Ok(first.start);
    }
    let found = judge.find(scans).map_err(Failure::Start)?.filter(|found| found.fits);
    let is_better = |found: &StartFit| found.contradicting < 0.5 * first.contradicting;
    if first.fits && !found.as_ref().is_some_and(is_better) {
        return Ok(first.start);
    }
    match (found, told) {
        // Nobody vouches for this one.
        (Some(found), None) if found.contradicting <= CLEAN => Ok(found.start),
        (Some(found), _) => {
            Err(refusal(folder, &first, &format!("it fits at {0}: --start {0}", in_words(found.start)), scans))
        }
        (None, _) => Err(refusal(folder, &first, "nor is it found anywhere else in the map", scans)),
    }
}

fn refusal(folder: &Path, fit: &StartFit, instead: &str, scans: &ReadAhead) -> Failure {
    let StartFit { told, jumps, way_m, on_walls, contradicting, .. } = fit;
    let written = if scans.scans.is_live() { "No map was written" } else { "Nothing was written" };
    Failure::NotFound(anyhow::anyhow!(
        "the drive does not fit the map in {} at {}: {}along its first {way_m:.1} m, {:.0} % of what it sees is on the map's walls, and {:.0} % stands where \
         the map is free; {instead}. {written} (--trust-start with --start believes it all the same)",
        folder.display(),
        in_words(*told),
        if *jumps { "it fits some way off; " } else { "" },
        100.0 * on_walls,
        100.0 * contradicting
    ))
}

/// As `--start` takes it.
pub(super) fn in_words(pose: Pose2) -> String {
    format!("{:.2},{:.2},{:.1}", pose.x, pose.y, pose.heading.to_degrees())
}
