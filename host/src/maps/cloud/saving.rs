//! A cloud as files: for other programs, and to look at.

use std::path::Path;

use anyhow::Context as _;

use super::{CloudPoint, Paint, write_pcd, write_ply};
use crate::maps::picture::{CloudView, cloud_png};
use crate::output::{save_by, save_file};

/// How a cloud looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudLook {
    /// What the colours say.
    pub paint: Paint,
    /// Points above this height are left out of the picture, m.
    pub cut_above_m: f64,
    /// Where the picture is seen from.
    pub view: CloudView,
}

/// Writes `cloud.ply`, `cloud.pcd` and `cloud.png` into `folder`.
///
/// # Errors
/// If a file cannot be written; it is named.
pub fn write_cloud(folder: &Path, points: &[CloudPoint], look: &CloudLook) -> anyhow::Result<()> {
    let CloudLook { paint, cut_above_m, view } = look;
    let coloured = paint.apply(points);
    save_by(&folder.join("cloud.ply"), |out| write_ply(&coloured, out))?;
    save_by(&folder.join("cloud.pcd"), |out| write_pcd(&coloured, out))?;
    let low = |point: &&CloudPoint| f64::from(point.position.z) <= *cut_above_m;
    let shown: Vec<CloudPoint> = points.iter().filter(low).copied().collect();
    let picture = cloud_png(&paint.apply(&shown), view, paint.scale(&shown).as_ref());
    save_file(&folder.join("cloud.png"), &picture.context("cloud.png cannot be drawn")?)
}
