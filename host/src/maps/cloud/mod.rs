//! The 3D map: scans of a tilted laser, carried into the world along the robot's path on a flat floor (thesis §3.3, ch. 5).
//!
//! # Data flow
//! path ([`Track`] of poses) and tilt ([`Track`] of encoder readings) → pose ⊕ mounting ⊕ tilt for every beam
//! ([`Projection`]) → [`Cloud`] → [`thin`] → [`ply`](write_ply), [`pcd`](write_pcd), picture. [`judge_stops`] finds the planes of real stops
//! ([`read_stops`]) and matches them with each other.
//!
//! # Frames
//! As everywhere, x forward, y left, z up. A tilt is the angle by which the laser looks **up** from the horizontal: a rotation by
//! −tilt about the laser's y axis (the thesis has y forward and calls it a rotation about x by β, §4.3.2).

mod edges;
mod judge;
mod nearness;
mod paint;
mod pcd;
mod planes;
mod ply;
mod projection;
mod readings;
mod register;
mod saving;
mod thinning;
mod tilt3d;
mod track;

use lrfslam_core::time::Instant;
use nalgebra::Point3;
use serde::Serialize;

pub use edges::EdgeFilter;
pub use judge::{JudgeError, JudgedStops, RegistrationReport, StopReport, Surface, SurfaceFit, judge_stops};
pub use nearness::Nearness;
pub use paint::Paint;
pub use pcd::write_pcd;
pub use planes::{Plane, PlaneConfig, PlaneFit, find_planes, floor_of};
pub use ply::write_ply;
pub use projection::{Projection, TiltMounting, planar};
pub use readings::read_tilt;
pub use register::{RegisterConfig, level_from_lrf};
pub use saving::{CloudLook, write_cloud};
pub use thinning::thin;
pub use tilt3d::{Stop, Tilt3dError, TiltedScan, read_stops};
pub use track::Track;

/// Something that a beam hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudPoint {
    /// In the map, m.
    pub position: Point3<f32>,
    /// When the beam was measured.
    pub stamp: Instant,
}

/// Points, in the order in which they were measured.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cloud {
    /// What was hit.
    pub points: Vec<CloudPoint>,
    /// What became of the beams.
    pub counts: CloudCounts,
}

/// What became of the beams.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct CloudCounts {
    /// Beams that hit something.
    pub hits: usize,
    /// Of these, left out as mixed pixels: see [`EdgeFilter`].
    pub mixed: usize,
    /// Of these, left out because no pose or tilt is known at their time.
    pub unplaced: usize,
}

impl Cloud {
    /// Adds everything of `other`.
    pub fn append(&mut self, other: Self) {
        self.points.extend(other.points);
        self.counts.hits += other.counts.hits;
        self.counts.mixed += other.counts.mixed;
        self.counts.unplaced += other.counts.unplaced;
    }
}
