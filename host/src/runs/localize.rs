//! A localisation under way: scans in, and at the end a folder with the path, what is known at every scan, and a report.

use std::fmt::Write as _;
use std::path::Path;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::sweep::Sweep;
use lrfslam_core::time::Instant;
use serde::Serialize;

use crate::localize::{KnownMap, LocalizeCounts, Localizer, LocalizerConfig, LocalizerMemory, Located, ON_WALLS_MIN};
use crate::maps::occupancy::{MapConfig, OccupancyMap};
use crate::maps::picture::{PictureNotes, write_picture};
use crate::monitor::{Counts, Feed, Now, State};
use crate::output::{save_file, save_json};
use crate::program::Program;
use crate::results::report::{Ending, Source};
use crate::runs::live::{hits, pose_on, show_high, stiff};
use crate::runs::map::Beside;
use crate::trajectory::{TimedPose, write_trajectory};

const HEADER: &str =
    "scan,time_s,state,x_m,y_m,heading_deg,sigma_x_m,sigma_y_m,sigma_heading_deg,certainty,on_walls,contradicting\n";

/// Name of the picture.
const PICTURE: &str = "localization.png";

/// What a localisation was: `run.json`.
#[derive(Debug, Clone, Serialize)]
pub struct LocalizeReport<C> {
    /// Name and version of the program.
    pub program: Program,
    /// Folder of the map.
    pub map: String,
    /// Version of the program that made the map.
    pub map_program: String,
    /// Where the scans came from.
    #[serde(flatten)]
    pub source: Source,
    /// Every value used.
    pub config: C,
    /// Of the random numbers.
    pub seed: u64,
    /// Pose that the user gave: x, y (m), heading (degrees).
    pub start: Option<[f32; 3]>,
    /// What happened.
    pub localisation: LocalizeCounts,
    /// From the first scan to the first one with a pose that the map's walls confirm, s; none if there is none.
    pub first_found_after_s: Option<f64>,
    /// Not all scans of the log are in the results.
    pub partial: bool,
    /// How the run ended.
    pub ending: Ending,
    /// What ended it early, if anything did.
    pub fault: Option<String>,
}

/// See the [module](self).
#[derive(Debug)]
pub struct LocalizeRun<'m> {
    localizer: Localizer<'m>,
    map: &'m KnownMap,
    path: Vec<TimedPose>,
    table: String,
    scans: u64,
    first: Option<Instant>,
    first_found: Option<Instant>,
}

impl<'m> LocalizeRun<'m> {
    /// A robot somewhere in `map`, or at `start`.
    ///
    /// # Errors
    /// If the memory does not fit the configuration and the map.
    pub fn new(
        (config, seed): (&LocalizerConfig, u64),
        map: &'m KnownMap,
        start: Option<Pose2>,
        memory: &'m mut LocalizerMemory,
    ) -> anyhow::Result<Self> {
        let localizer = Localizer::new(config, seed, map, start, memory)?;
        let (table, path) = (HEADER.to_owned(), Vec::new());
        Ok(Self { localizer, map, path, table, scans: 0, first: None, first_found: None })
    }

    /// Takes the next scan; `None` while the robot has not found itself.
    ///
    /// * `robot_from_lrf` — where the laser sits on the robot
    ///
    /// # Errors
    /// If the scan has too many points for the memory.
    pub fn add_scan(&mut self, scan: &RangeScan<'_>, robot_from_lrf: Pose2) -> anyhow::Result<Option<Located>> {
        let located = self.localizer.add_scan(scan, robot_from_lrf)?;
        self.first.get_or_insert(scan.stamp);
        // Writing to a string cannot fail.
        let _ = write!(self.table, "{},{:.6},", self.scans, scan.stamp.as_secs_f64());
        match &located {
            None => self.table.push_str("searching,,,,,,,0,,\n"),
            Some(located) => {
                // A told start is found when the laser sees the map from there.
                if located.on_walls >= ON_WALLS_MIN {
                    self.first_found.get_or_insert(scan.stamp);
                }
                push_row(&mut self.table, located);
                self.path.push(TimedPose { stamp: scan.stamp, map_from_robot: located.map_from_robot });
            }
        }
        self.scans += 1;
        Ok(located)
    }

    /// Hands what is new to those who look; call it when [`Feed::is_wanted`]. The run does not change.
    ///
    /// * `seen` — the last scan, where the laser sat on the robot, and where that is; `None` if nothing came
    pub fn show(&self, feed: &mut Feed, seen: Option<(&RangeScan<'_>, Pose2, Option<&Located>)>, beside: Beside) {
        let (mut batch, mut cursor) = feed.begin();
        show_high(self.map.high(), true, &mut batch, &mut cursor);
        let own = batch.stretches.len();
        batch.stretches.push(stiff(Pose2::IDENTITY, batch.map_piece));
        // The map is given before the path in it, which comes after all stretches of the map.
        if !batch.has_more {
            if cursor.stretch < own {
                (cursor.stretch, cursor.poses) = (own, 0);
            }
            while let Some(pose) = self.path.get(cursor.poses) {
                let pose = pose_on(pose.stamp, pose.map_from_robot, false, None);
                if !batch.push(&mut cursor, (own, &pose, false), |_| None) {
                    break;
                }
            }
        }
        if self.scans > 0 {
            batch.now = Some(self.now(seen, beside));
        }
        feed.give(batch, cursor);
    }

    fn now(&self, seen: Option<(&RangeScan<'_>, Pose2, Option<&Located>)>, beside: Beside) -> Now {
        let counts = self.localizer.counts();
        let located = match seen {
            Some((.., located)) => located.copied(),
            None => None,
        };
        let map_from_robot = match seen {
            Some(_) => located.map(|located| located.map_from_robot),
            None => self.path.last().map(|pose| pose.map_from_robot),
        };
        Now {
            stamp: seen.map_or(self.first.unwrap_or_default(), |(scan, ..)| scan.stamp),
            map_from_robot,
            low_from_robot: map_from_robot.unwrap_or_default(),
            covariance: located.map(|located| located.covariance.cast()).unwrap_or_default(),
            state: if map_from_robot.is_some() { State::Tracking } else { State::Searching },
            certainty: located.map(|located| located.certainty),
            hits: seen.map_or_else(Vec::new, |(scan, at, _)| hits(&Sweep::at_rest(*scan, at))),
            counts: Counts {
                scans: self.scans,
                lost_scans: counts.searching_scans,
                found: counts.found,
                ..Counts::default()
            },
            health: beside.health,
            late: beside.late,
            ..Now::default()
        }
    }

    /// Scans taken so far.
    pub fn scans(&self) -> u64 {
        self.scans
    }

    /// What happened so far.
    pub fn counts(&self) -> LocalizeCounts {
        self.localizer.counts()
    }

    /// Writes the results as they are now into `folder`.
    ///
    /// * `drawing` — how the map is drawn
    /// * `describe` — completes the report
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write_into<C: Serialize>(
        &self,
        folder: &Path,
        drawing: &MapConfig,
        describe: impl FnOnce(LocalizeCounts, Option<f64>) -> LocalizeReport<C>,
    ) -> anyhow::Result<LocalizeReport<C>> {
        let after = self.first.zip(self.first_found).map(|(first, found)| found.since(first).micros as f64 / 1e6);
        let report = describe(self.localizer.counts(), after);
        // Poses from a start that the laser never confirmed are none.
        let path = if after.is_some() { &self.path[..] } else { &[] };
        write_trajectory(&folder.join("trajectory.tum"), path.to_vec())?;
        save_file(&folder.join("localization.csv"), self.table.as_bytes())?;
        save_json(&folder.join("run.json"), &report)?;
        // The path over the map that it was found in.
        let mut drawn = OccupancyMap::new(*drawing);
        self.map.draw(&mut drawn);
        if let Some(raster) = drawn.raster(drawing.picture_px) {
            let (has_times, found_after_s) = (report.source.has_times(), after.unwrap_or(0.0));
            let notes = PictureNotes { truth: &[], has_times, found_after_s, trust: &[], contradicted: &[] };
            write_picture(&folder.join(PICTURE), &raster, path, &notes)?;
        }
        Ok(report)
    }
}

fn push_row(table: &mut String, located: &Located) {
    let Located { map_from_robot: pose, covariance, certainty, on_walls, contradicting } = located;
    let [x, y, heading] = [0, 1, 2].map(|axis| covariance[(axis, axis)].max(0.0).sqrt());
    let _ = writeln!(
        table,
        "tracking,{:.4},{:.4},{:.3},{x:.4},{y:.4},{:.3},{certainty:.3},{on_walls:.3},{contradicting:.3}",
        pose.x,
        pose.y,
        pose.heading.to_degrees(),
        heading.to_degrees(),
    );
}
