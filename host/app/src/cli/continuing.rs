//! A log that goes on in a map made before: where it begins there, verified before anything is written.

use std::path::Path;

use lrfslam_core::geometry::Pose2;

use super::Failure;
use super::localize::{Start, not_whole};
use lrfslam_host::config::RunConfig;
use lrfslam_host::localize::{KnownMap, ScansAhead, StartFit, StartJudge};
use lrfslam_host::mapping::saved_map::SavedMap;
use lrfslam_host::scans::log::{LogError, LogReader, LogScan};

/// A log whose first scans can be looked at before they are taken.
pub(super) struct ReadAhead {
    log: LogReader,
    ahead: Vec<LogScan>,
    taken: usize,
    fault: Option<LogError>,
}

impl ReadAhead {
    pub(super) fn new(log: LogReader) -> Self {
        Self { log, ahead: Vec::new(), taken: 0, fault: None }
    }

    pub(super) fn log(&mut self) -> &mut LogReader {
        &mut self.log
    }
}

impl ScansAhead for ReadAhead {
    fn scan(&mut self, index: usize) -> anyhow::Result<Option<&LogScan>> {
        while self.ahead.len() <= index && self.fault.is_none() {
            match self.log.next() {
                Some(Ok(scan)) => self.ahead.push(scan),
                // It is told when the mapping gets there.
                Some(Err(error)) => self.fault = Some(error),
                None => break,
            }
        }
        Ok(self.ahead.get(index))
    }
}

impl Iterator for ReadAhead {
    type Item = Result<LogScan, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(scan) = self.ahead.get_mut(self.taken) {
            self.taken += 1;
            let beams = std::mem::take(&mut scan.beams);
            return Some(Ok(LogScan { beams, ..scan.clone() }));
        }
        self.fault.take().map(Err).or_else(|| self.log.next())
    }
}

/// A start that fewer of the known points contradict than this is right; with more, another place may fit much better.
const CLEAN: f32 = 0.03;

/// Where the log begins in the map `saved` in `folder`.
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
    let map = KnownMap::new(saved, config).map_err(|error| not_whole(folder, &error))?;
    let judge = StartJudge::new(config, seed, &map);
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
            Err(refusal(folder, &first, &format!("it fits at {0}: --start {0}", in_words(found.start))))
        }
        (None, _) => Err(refusal(folder, &first, "nor is it found anywhere else in the map")),
    }
}

fn refusal(folder: &Path, fit: &StartFit, instead: &str) -> Failure {
    let StartFit { told, jumps, way_m, on_walls, contradicting, .. } = fit;
    Failure::NotFound(anyhow::anyhow!(
        "the log does not fit the map in {} at {}: {}along its first {way_m:.1} m, {:.0} % of what it sees is on the map's walls, and {:.0} % stands where \
         the map is free; {instead}. Nothing was written (--trust-start with --start believes it all the same)",
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
