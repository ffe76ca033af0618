//! How things stand in words and numbers: what a page, a terminal and a script read alike.

use serde::Serialize;

use super::batch::{Counts, Health, State};
use super::rates::Sample;
use super::words::Mood;
use crate::maps::occupancy::MapConfig;

/// What does not change over a run.
#[derive(Debug, Clone, Default)]
pub struct About {
    /// What runs: the command, such as `map`.
    pub what: String,
    /// Where the scans come from: a log, a laser, a robot.
    pub source: String,
    /// Robots whose maps have the same name drive in the same map frame; of a map made before, its folder.
    pub frame: Option<String>,
    /// How the map is drawn.
    pub map: MapConfig,
}

/// How things stand. Lengths in m, angles in rad, map frame.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Status {
    /// See [`About::what`].
    pub what: String,
    /// See [`About::source`].
    pub source: String,
    /// See [`About::frame`].
    pub frame: Option<String>,
    /// In plain words; the first is what matters most.
    pub words: Vec<String>,
    /// How good that is.
    pub mood: Mood,
    /// x, y, heading; `None` while nobody knows.
    pub pose: Option<[f32; 3]>,
    /// Covariance of the position: xx, xy, yy, m²; and of the heading, rad².
    pub covariance: [f32; 4],
    /// Unit vector along which the position is a guess.
    pub undetermined: Option<[f32; 2]>,
    /// Probability that the position is right, where it is known.
    pub certainty: Option<f32>,
    /// The robot is in a piece of map that is not joined to the map.
    pub is_apart: bool,
    /// Time of the last scan, s.
    pub time_s: f64,
    /// Scans taken.
    pub scans: u64,
    /// Scans that fitted nowhere.
    pub lost_scans: u64,
    /// Loops closed.
    pub closures: u64,
    /// Pieces of map that are not joined to it.
    pub pieces_apart: u64,
    /// Length of the path of this run, m.
    pub way_m: f32,
    /// The latest rates.
    pub rates: Option<Sample>,
    /// Damaged telegrams or frames, restarts of the laser, scans missed; `None` where nothing is known of them.
    pub health: Option<[u64; 3]>,
    /// What the run said last, the newest first.
    pub news: Vec<String>,
    /// It may be paused.
    pub can_pause: bool,
    /// It is.
    pub is_paused: bool,
    /// It is over, and how it ended.
    pub ended: Option<String>,
    /// How often walls have moved: a loop was closed.
    pub snaps: u64,
}

impl Status {
    pub(super) fn new(about: &About) -> Self {
        let About { what, source, frame, .. } = about.clone();
        Self { what, source, frame, ..Self::default() }
    }

    pub(super) fn count(&mut self, counts: &Counts, health: Option<Health>) {
        (self.scans, self.lost_scans) = (counts.scans, counts.lost_scans);
        (self.closures, self.pieces_apart) = (counts.closures, counts.pieces_apart);
        self.health = health.map(|health| [health.damaged, health.restarts, health.missed]);
    }

    /// Says it in words.
    pub(super) fn say(&mut self, state: State, silent_s: f32) {
        let (words, mood) = super::words::words(self, state, silent_s);
        (self.words, self.mood) = (words, mood);
    }
}
