//! What watchers see, every part with the revision at which it changed last.

use std::collections::BTreeMap;
use std::time::{SystemTime, UNIX_EPOCH};

use super::layers::TileKey;
use super::rates::{SAMPLES_MAX, Sample};
use super::status::Status;

/// A point of the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PathPoint {
    pub x_m: f32,
    pub y_m: f32,
    /// Since the first pose.
    pub time_s: f32,
    /// The scan there fits, and the point lies in the map.
    pub is_trusted: bool,
    pub changed: u64,
}

/// What is replaced whole, and when it was.
#[derive(Debug, Default)]
pub(super) struct Part<T> {
    pub is: T,
    pub changed: u64,
}

/// See the [module](self).
#[derive(Debug, Default)]
pub(super) struct Scene {
    instance: u64,
    revision: u64,
    pub cell_size_m: f32,
    /// All that was sent before is void since then.
    pub began: u64,
    pub tiles: BTreeMap<TileKey, Part<Box<[u8]>>>,
    pub path: Vec<PathPoint>,
    /// When the path was last replaced.
    pub path_began: u64,
    /// Ends of closures: x, y, x, y.
    pub closures: Part<Vec<[f32; 4]>>,
    /// Hits of the latest scan: x, y, and how they fit.
    pub scan: Part<Vec<(f32, f32, u8)>>,
    /// x, y, heading, weight.
    pub particles: Part<Vec<[f32; 4]>>,
    /// x, y, and covariance: xx, xy, yy.
    pub landmarks: Part<Vec<[f32; 5]>>,
    /// Points of the 3D map, and when each came.
    pub cloud: Vec<([f32; 3], u64)>,
    pub samples: Vec<(Sample, u64)>,
    pub status: Status,
}

impl Scene {
    pub fn new(cell_size_m: f32) -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        // Two starts of a program do not have the same one; a page keeps it in a double.
        let instance = (since.as_micros() as u64 ^ u64::from(std::process::id()) << 32) & ((1 << 52) - 1);
        Self { instance, cell_size_m, ..Self::default() }
    }

    pub fn instance(&self) -> u64 {
        self.instance
    }

    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Begins the next revision; what changes from now on is part of it.
    pub fn advance(&mut self) -> u64 {
        self.revision += 1;
        self.revision
    }

    /// Nothing of what was there holds any more.
    pub fn clear(&mut self) {
        let revision = self.revision;
        let status = std::mem::take(&mut self.status);
        *self = Self { instance: self.instance, cell_size_m: self.cell_size_m, ..Self::default() };
        (self.revision, self.began, self.path_began, self.status) = (revision, revision, revision, status);
    }

    /// Puts a tile; one that is as it was has not changed.
    pub fn put_tile(&mut self, key: TileKey, cells: Box<[u8]>) {
        let changed = self.revision;
        match self.tiles.get_mut(&key) {
            Some(tile) if tile.is == cells => {}
            Some(tile) => *tile = Part { is: cells, changed },
            None if cells.is_empty() => {}
            None => {
                self.tiles.insert(key, Part { is: cells, changed });
            }
        }
    }

    /// These are all tiles; returns how many have changed.
    pub fn put_all_tiles(&mut self, mut all: BTreeMap<TileKey, Box<[u8]>>) -> usize {
        for key in self.tiles.keys() {
            all.entry(*key).or_default();
        }
        all.into_iter().for_each(|(key, cells)| self.put_tile(key, cells));
        self.tiles.values().filter(|tile| tile.changed == self.revision).count()
    }

    pub fn add_sample(&mut self, sample: Sample) {
        if self.samples.len() >= SAMPLES_MAX {
            self.samples.remove(0);
        }
        self.samples.push((sample, self.revision));
        self.status.rates = Some(sample);
    }
}
