//! The drawing thread's work: batches in, the scene out.
//!
//! A scan is drawn once, where it lies when it comes. When stretches of path move, because a loop was closed, all are drawn again, but seldom
//! enough to keep that below a share of the time.

use std::time::{Duration as WallDuration, Instant as WallInstant};

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::time::Instant;

use super::batch::{Batch, Now, State};
use super::layers::{APART, Layers, MAP};
use super::rates::{Rates, Sample};
use super::scene::{PathPoint, Scene};
use super::status::{About, Status};
use super::track::Track;
use crate::mapping::high::Stretch;

/// From one sending of changed tiles to the next.
const TILES_EVERY: WallDuration = WallDuration::from_millis(150);
/// A map is drawn again after so many times what it took the last time.
const REST: u32 = 8;
/// Points of the path are so far apart, m.
const PATH_STEP_M: f32 = 0.05;
/// Hits of a scan and particles that are sent, at most.
const POINTS_MAX: usize = 2000;

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Drawer {
    about: About,
    pub status: Status,
    track: Track,
    layers: Layers,
    /// Stretches as the map was drawn, and the pieces that were map and apart.
    drawn: Vec<Stretch>,
    drawn_pieces: (usize, usize),
    /// The piece that the robot is in.
    here: usize,
    now: Option<Now>,
    hits: Vec<(f32, f32, u8)>,
    closures: Vec<[usize; 2]>,
    cloud: Vec<[f32; 3]>,
    rates: Rates,
    sample: Option<Sample>,
    /// Poses before this one are in the path that was sent.
    pathed: usize,
    last_point: Option<Point2>,
    begins_anew: bool,
    has_news: bool,
    has_moved: bool,
    tiles_sent: WallInstant,
    redraw_due: WallInstant,
    /// When the last scan was counted.
    heard: WallInstant,
}

impl Drawer {
    pub fn new(about: About) -> Self {
        let at = WallInstant::now();
        Self {
            status: Status::new(&about),
            track: Track::default(),
            layers: Layers::new(about.map),
            drawn: Vec::new(),
            drawn_pieces: (0, 0),
            here: 0,
            now: None,
            hits: Vec::new(),
            closures: Vec::new(),
            cloud: Vec::new(),
            rates: Rates::default(),
            sample: None,
            pathed: 0,
            last_point: None,
            begins_anew: false,
            has_news: true,
            has_moved: false,
            tiles_sent: at,
            redraw_due: at,
            heard: at,
            about,
        }
    }

    /// Somebody looks again: what was not asked for was not silence.
    pub fn wake(&mut self) {
        (self.heard, self.has_news) = (WallInstant::now(), true);
    }

    /// Takes a batch, and draws its scans where they lie now.
    pub fn take(&mut self, batch: Batch) {
        if batch.begins_anew {
            let ended = self.status.ended.take();
            *self = Self { begins_anew: true, ..Self::new(self.about.clone()) };
            self.status.ended = ended;
        }
        let first = self.track.take(&batch);
        self.here = self.track.stretches.last().map_or(0, |stretch| stretch.piece);
        if let Some(now) = batch.now {
            self.take_now(now);
        }
        self.draw_scans(first);
        self.has_moved |= self.track.has_moved_since(&self.drawn) || self.pieces() != self.drawn_pieces;
        let known = self.drawn.len();
        self.drawn.extend(self.track.stretches.iter().skip(known));
        if self.drawn_pieces == (0, 0) && first == 0 {
            self.drawn_pieces = self.pieces();
        }
        self.closures = batch.closures;
        self.cloud.extend(batch.cloud);
        self.has_news = true;
    }

    /// A batch would have to wait.
    pub fn has_work(&self) -> bool {
        self.has_news
    }

    fn pieces(&self) -> (usize, usize) {
        (self.track.map_piece, self.here)
    }

    fn layer(&self, piece: usize) -> Option<u8> {
        let (map, here) = self.pieces();
        if piece == map { Some(MAP) } else { (piece == here).then_some(APART) }
    }

    fn take_now(&mut self, mut now: Now) {
        let is_same = |before: &Now| before.counts.scans == now.counts.scans && now.hits.is_empty();
        if self.now.as_ref().is_some_and(is_same) {
            return;
        }
        if self.now.as_ref().is_none_or(|before| before.counts.scans != now.counts.scans) {
            self.heard = WallInstant::now();
        }
        if let Some(before) = &self.now {
            // Not every scan is a step of the filter, nor is every one matched.
            now.effective_sample_size = now.effective_sample_size.or(before.effective_sample_size);
            if now.hits.is_empty() && now.covariance == nalgebra::Matrix3::zeros() {
                now.covariance = before.covariance;
                now.undetermined = now.undetermined.or(before.undetermined);
            }
        }
        self.sample = self.rates.take(&now, self.status.is_paused).or(self.sample);
        let layer = self.layer(self.here).unwrap_or(MAP);
        let fit = |hit: &Point2| {
            let hit = now.map_from_robot?.transform(*hit);
            Some((hit.x, hit.y, self.layers.fit(layer, hit) as u8))
        };
        let thinned = now.hits.iter().step_by(now.hits.len().div_ceil(POINTS_MAX).max(1));
        self.hits = thinned.filter_map(fit).collect();
        self.now = Some(now);
    }

    fn draw_scans(&mut self, first: usize) {
        let mut beams = Vec::new();
        for given in &self.track.poses[first..] {
            let layer = self.layer(self.track.piece(given));
            let scan = given.pose.scan.filter(|_| !given.pose.is_lost);
            let Some((layer, scan)) = layer.zip(scan) else { continue };
            if let Some(sweep) = self.track.scans.sweep(scan as usize, &mut beams) {
                self.layers.insert(layer, &sweep, self.track.place(given));
            }
        }
    }

    /// Puts all that is new into the scene, which `publish` lends.
    pub fn draw(&mut self, publish: impl FnOnce(&mut dyn FnMut(&mut Scene))) {
        let redraws = self.has_moved && WallInstant::now() >= self.redraw_due;
        let tiles_due = self.layers.has_touched() && self.tiles_sent.elapsed() >= TILES_EVERY;
        self.refresh_status();
        if !self.has_news && !redraws && !tiles_due {
            return;
        }
        let all = redraws.then(|| self.redraw());
        let touched = if tiles_due && !redraws { self.layers.take_touched() } else { Vec::new() };
        if tiles_due || redraws {
            self.tiles_sent = WallInstant::now();
        }
        let mut all = Some(all);
        publish(&mut |scene| {
            scene.advance();
            if std::mem::take(&mut self.begins_anew) {
                scene.clear();
            }
            touched.iter().for_each(|(key, cells)| scene.put_tile(*key, cells.clone()));
            if let Some(tiles) = all.take().flatten() {
                let changed = scene.put_all_tiles(tiles);
                self.status.snaps += u64::from(changed > 0);
            }
            self.put_path(scene, redraws);
            self.put_rest(scene);
        });
        self.has_news = false;
    }

    /// Draws the whole map anew; returns its tiles.
    fn redraw(&mut self) -> std::collections::BTreeMap<super::layers::TileKey, Box<[u8]>> {
        let begun = WallInstant::now();
        self.layers = Layers::new(self.about.map);
        self.draw_scans(0);
        let tiles = self.layers.take_all();
        self.drawn.clone_from(&self.track.stretches);
        (self.drawn_pieces, self.has_moved) = (self.pieces(), false);
        self.redraw_due = WallInstant::now() + REST * begun.elapsed();
        tiles
    }

    fn put_path(&mut self, scene: &mut Scene, is_replaced: bool) {
        if is_replaced {
            scene.path.clear();
            scene.path_began = scene.revision();
            (self.pathed, self.last_point, self.status.way_m) = (0, None, 0.0);
        }
        // A stamp since 1970 is too large for what is sent.
        let began = self.track.poses.first().map_or(Instant::default(), |first| first.pose.stamp);
        for given in &self.track.poses[self.pathed..] {
            let pose = self.track.place(given);
            let moved_m = self.last_point.map_or(f32::INFINITY, |last| (pose.position() - last).norm());
            if given.is_old || moved_m < PATH_STEP_M {
                continue;
            }
            self.last_point = Some(pose.position());
            self.status.way_m += if moved_m.is_finite() { moved_m } else { 0.0 };
            scene.path.push(PathPoint {
                x_m: pose.x,
                y_m: pose.y,
                time_s: given.pose.stamp.since(began).micros as f32 / 1e6,
                is_trusted: !given.pose.is_lost && self.track.piece(given) == self.track.map_piece,
                changed: scene.revision(),
            });
        }
        self.pathed = self.track.poses.len();
    }

    fn put_rest(&mut self, scene: &mut Scene) {
        let changed = scene.revision();
        let start = |k: usize| self.track.stretches.get(k).map(|stretch| stretch.map_from_start);
        let ends = |[a, b]: &[usize; 2]| {
            let (a, b) = (start(*a)?, start(*b)?);
            Some([a.x, a.y, b.x, b.y].map(|value| value as f32))
        };
        let closures: Vec<_> = self.closures.iter().filter_map(ends).collect();
        if closures != scene.closures.is {
            (scene.closures.is, scene.closures.changed) = (closures, changed);
        }
        if self.hits != scene.scan.is {
            (scene.scan.is, scene.scan.changed) = (self.hits.clone(), changed);
        }
        if let Some(now) = &self.now {
            let map_from_low = now.map_from_robot.map(|pose| pose * now.low_from_robot.inverse());
            let particle = |(pose, weight): &(Pose2, f32)| {
                let pose = map_from_low? * *pose;
                Some([pose.x, pose.y, pose.heading, *weight])
            };
            let particles: Vec<_> = now.particles.iter().take(POINTS_MAX).filter_map(particle).collect();
            if particles != scene.particles.is {
                (scene.particles.is, scene.particles.changed) = (particles, changed);
            }
            if now.landmarks != scene.landmarks.is {
                (scene.landmarks.is, scene.landmarks.changed) = (now.landmarks.clone(), changed);
            }
        }
        scene.cloud.extend(self.cloud.drain(..).map(|point| (point, changed)));
        scene.status.clone_from(&self.status);
        if let Some(sample) = self.sample.take() {
            self.status.rates = Some(sample);
            scene.add_sample(sample);
        }
    }

    /// Takes over what is known now; a change of it is news.
    fn refresh_status(&mut self) {
        let silent_s = self.heard.elapsed().as_secs() as f32;
        let said = |status: &Status| (status.words.clone(), status.news.clone());
        let before = said(&self.status);
        let state = self.now.as_ref().map_or(State::Tracking, |now| now.state);
        if let Some(now) = &self.now {
            self.status.count(&now.counts, now.health);
            let map_from_low = now.map_from_robot.map(|pose| pose.heading - now.low_from_robot.heading);
            let turned = Pose2::new(0.0, 0.0, map_from_low.unwrap_or(0.0));
            let c = turned_covariance(now, turned);
            self.status.pose = now.map_from_robot.map(|pose| [pose.x, pose.y, pose.heading]);
            self.status.covariance = c;
            self.status.undetermined = now.undetermined.map(|axis| turned.transform(axis)).map(|axis| [axis.x, axis.y]);
            (self.status.certainty, self.status.time_s) = (now.certainty, now.stamp.as_secs_f64());
        }
        self.status.is_apart = self.here != self.track.map_piece;
        self.status.say(state, silent_s);
        self.has_news |= before != said(&self.status);
    }
}

/// xx, xy, yy and heading's in the map's axes.
fn turned_covariance(now: &Now, turned: Pose2) -> [f32; 4] {
    let (sin, cos) = turned.heading.sin_cos();
    let [xx, xy, yy] = [(0, 0), (0, 1), (1, 1)].map(|place| now.covariance[place]);
    let along = cos * cos * xx - 2.0 * sin * cos * xy + sin * sin * yy;
    let across = sin * sin * xx + 2.0 * sin * cos * xy + cos * cos * yy;
    let mixed = sin * cos * (xx - yy) + (cos * cos - sin * sin) * xy;
    [along, mixed, across, now.covariance[(2, 2)]]
}
