//! Real scans of a tilted SICK in the format of 3DTK: stops of a robot, each swept from below to above.
//!
//! A folder holds `scanNNN.3d` (a line `x y z` for each beam, cm, slice after slice) and `scanNNN.pose` (position in cm, then
//! rotations in degrees), plain or gzip. The frame is left-handed: x right, y up, z ahead. A point at 3275.9 cm or more is
//! "nothing", one at the origin no measurement. A slice is recognised by its beams running from the right to the left; its
//! tilt follows from them, as all lie in one plane. There are no times: slices are stamped one second apart.
//!
//! Source: 3DTK's documentation of its `uos` format; its pose is Rx · Ry · Rz, in its own frame.
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use std::path::{Path, PathBuf};

use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::time::{Duration, Instant};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::{Cloud, EdgeFilter, Projection, TiltMounting, Track};
use crate::input::table::{TableError, read_table};
use crate::input::text::fault;

/// From here on a range means "nothing seen", m: the highest nine codes of 15 bits of mm are errors (SICK LMS2xx manual).
const RANGE_MAX_M: f64 = 32.759;
/// Points of one slice lie in a plane through the laser to this, m.
const FLAT_M: f64 = 0.02;

/// One scan of a tilted laser.
#[derive(Debug, Clone, PartialEq)]
pub struct TiltedScan {
    /// Its time.
    pub stamp: Instant,
    /// How far the laser looked up, rad.
    pub tilt_rad: f64,
    /// A miss means: nothing nearer than this, m.
    pub range_max_m: f32,
    /// In order of bearing.
    pub beams: Vec<Beam>,
}

/// Everything seen from one place.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    /// Name of its file, without folder and ending.
    pub name: String,
    /// Where the laser was, by the `.pose` file.
    pub map_from_lrf: Isometry3<f64>,
    /// From below to above.
    pub slices: Vec<TiltedScan>,
}

/// Why stops cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Tilt3dError {
    /// The folder cannot be listed.
    #[error("{folder}: cannot be read: {source}")]
    Folder {
        /// Name of the folder, as given.
        folder: String,
        /// Why.
        source: std::io::Error,
    },
    /// Nothing of the format in it.
    #[error("{folder}: no scanNNN.3d or scanNNN.3d.gz in it: expected 3DTK's format")]
    NoScan {
        /// Name of the folder, as given.
        folder: String,
    },
    /// A file that is not as it should be.
    #[error(transparent)]
    Table(#[from] TableError),
    /// A pose file with another number of lines.
    #[error("{file}: {lines} lines, expected 2: position and rotations")]
    PoseLines {
        /// Name of the file.
        file: String,
        /// Found.
        lines: usize,
    },
    /// The points are not the beams of a tilted laser.
    #[error("{file}: point {point}: {what}")]
    NotTilted {
        /// Name of the file.
        file: String,
        /// From 1: the line, if there are no comments.
        point: usize,
        /// What was expected.
        what: String,
    },
}

/// Reads all stops of `folder`, in the order of their names.
///
/// # Errors
/// The first thing that is wrong, with file and line.
pub fn read_stops(folder: &Path) -> Result<Vec<Stop>, Tilt3dError> {
    let name = folder.display().to_string();
    let unreadable = |source| Tilt3dError::Folder { folder: name.clone(), source };
    let mut scans = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        scans.extend(stem_of_scan(&path).map(|stem| (stem, path)));
    }
    scans.sort();
    if scans.is_empty() {
        return Err(Tilt3dError::NoScan { folder: name });
    }
    let mut clock = 0;
    scans.into_iter().map(|(stem, path)| read_stop(folder, stem, &path, &mut clock)).collect()
}

/// `scan000` of `scan000.3d` and `scan000.3d.gz`.
fn stem_of_scan(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?;
    let stem = name.strip_suffix(".gz").unwrap_or(name).strip_suffix(".3d")?;
    stem.starts_with("scan").then(|| stem.to_owned())
}

fn read_stop(folder: &Path, name: String, path: &Path, clock: &mut i64) -> Result<Stop, Tilt3dError> {
    let map_from_lrf = read_pose(&pose_file(folder, &name))?;
    let points: Vec<Vector3<f64>> = read_triples(path, "x y z")?.into_iter().map(|point| point / 100.0).collect();
    let not_tilted = |(point, what)| Tilt3dError::NotTilted { file: path.display().to_string(), point, what };
    let mut slices = Vec::new();
    let mut first = 0;
    for points in slices_of(&points).map_err(not_tilted)? {
        let tilt_rad = tilt_of(points).map_err(|(point, what)| not_tilted((first + point, what)))?;
        slices.push(slice(points, tilt_rad, Instant::from_micros(*clock * 1_000_000)));
        *clock += 1;
        first += points.len();
    }
    Ok(Stop { name, map_from_lrf, slices })
}

fn pose_file(folder: &Path, stem: &str) -> PathBuf {
    let plain = folder.join(format!("{stem}.pose"));
    let packed = folder.join(format!("{stem}.pose.gz"));
    if packed.exists() && !plain.exists() { packed } else { plain }
}

fn read_triples(path: &Path, columns: &'static str) -> Result<Vec<Vector3<f64>>, TableError> {
    read_table(path, columns, |words| match words.left() {
        3 => Ok(Vector3::new(words.finite("1")?, words.finite("2")?, words.finite("3")?)),
        found => Err(fault("count".to_owned(), "3 columns", Some(&format!("{found} columns")))),
    })
}

fn read_pose(path: &Path) -> Result<Isometry3<f64>, Tilt3dError> {
    let rows = read_triples(path, "x y z")?;
    let &[position_cm, angles_deg] = rows.as_slice() else {
        return Err(Tilt3dError::PoseLines { file: path.display().to_string(), lines: rows.len() });
    };
    let [x, y, z] = [angles_deg.x, angles_deg.y, angles_deg.z].map(f64::to_radians);
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle).into_inner();
    let theirs = about(Vector3::x_axis(), x) * about(Vector3::y_axis(), y) * about(Vector3::z_axis(), z);
    let ours = Rotation3::from_matrix_unchecked(OURS_FROM_THEIRS * theirs * OURS_FROM_THEIRS.transpose());
    let position = OURS_FROM_THEIRS * position_cm / 100.0;
    Ok(Isometry3::from_parts(position.into(), UnitQuaternion::from_rotation_matrix(&ours)))
}

/// Forward is their z, left their −x, up their y.
const OURS_FROM_THEIRS: Matrix3<f64> = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0);

/// Cuts the points where the beams start again at the right.
fn slices_of(points: &[Vector3<f64>]) -> Result<Vec<&[Vector3<f64>]>, (usize, String)> {
    // From their +x (right), 0 to π; a beam without measurement has no direction and starts nothing.
    let direction = |point: &Vector3<f64>| if is_measured(point) { point.y.hypot(point.z).atan2(point.x) } else { 0.0 };
    let mut before = 0.0;
    let starts_anew = |_: &Vector3<f64>, point: &Vector3<f64>| {
        let here = direction(point);
        let anew = is_measured(point) && here < before - 1.0;
        before = if is_measured(point) { here } else { before };
        !anew
    };
    let slices: Vec<&[Vector3<f64>]> = points.chunk_by(starts_anew).collect();
    let expected = slices.first().map_or(0, |slice| slice.len());
    let mut first = 0;
    for slice in &slices {
        if slice.len() != expected {
            let what = format!("a slice of {} beams starts here, expected {expected} as in the first", slice.len());
            return Err((first + 1, what));
        }
        first += slice.len();
    }
    Ok(slices)
}

fn is_measured(point: &Vector3<f64>) -> bool {
    point.norm() > 1e-6
}

/// The angle by which the plane of a slice's points looks up.
fn tilt_of(points: &[Vector3<f64>]) -> Result<f64, (usize, String)> {
    let sum: Vector3<f64> = points.iter().sum();
    let tilt_rad = sum.y.atan2(sum.z);
    let (sin, cos) = tilt_rad.sin_cos();
    let off = |point: &Vector3<f64>| (sin * point.z - cos * point.y).abs() > FLAT_M;
    match points.iter().position(off) {
        None => Ok(tilt_rad),
        Some(index) => {
            Err((index + 1, "it lies off the plane of its slice: expected beams of a tilted laser".to_owned()))
        }
    }
}

fn slice(points: &[Vector3<f64>], tilt_rad: f64, stamp: Instant) -> TiltedScan {
    let beam = |point: &Vector3<f64>| {
        let range_m = point.norm();
        let bearing_rad = (-point.x).atan2(point.y.hypot(point.z));
        let echo = Echo::from_range(range_m as f32, RANGE_MAX_M as f32);
        let echo = if is_measured(point) { echo } else { Echo::Invalid };
        Beam { bearing_rad: bearing_rad as f32, offset: Duration::ZERO, echo }
    };
    TiltedScan { stamp, tilt_rad, range_max_m: RANGE_MAX_M as f32, beams: points.iter().map(beam).collect() }
}

impl Stop {
    /// What was seen from here, carried into the frame in which the laser is at `frame_from_lrf` when it looks ahead.
    pub fn cloud(&self, frame_from_lrf: Isometry3<f64>, edges: Option<EdgeFilter>) -> Cloud {
        let readings = self.slices.iter().map(|slice| (slice.stamp, slice.tilt_rad));
        let stands = self.slices.iter().map(|slice| (slice.stamp, frame_from_lrf));
        let gap = Duration::from_millis(1000);
        let projection = Projection {
            mounting: TiltMounting::default(),
            path: Track::new(stands, gap),
            tilt: Track::new(readings, gap),
            edges,
        };
        let mut cloud = Cloud::default();
        for TiltedScan { stamp, range_max_m, beams, .. } in &self.slices {
            projection.add(&RangeScan { stamp: *stamp, range_max_m: *range_max_m, beams }, &mut cloud);
        }
        cloud
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use std::fs;

    /// Two slices of three beams: looking down by 45° and level; the right beam first.
    const SCAN: &str = "100 0 0\n0 -70.710678 70.710678\n-100 0 0\n200 0 0\n0 0 3276.7\n-200 0 0\n";

    fn stops(scan: &str, pose: &str) -> Result<Vec<Stop>, Tilt3dError> {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("scan007.3d"), scan).unwrap();
        fs::write(folder.path().join("scan007.pose"), pose).unwrap();
        read_stops(folder.path())
    }

    #[test]
    fn slices_tilts_and_beams_are_those_of_the_file() {
        let stops = stops(SCAN, "0 0 0\n0 0 0\n").unwrap();
        let [stop] = stops.as_slice() else { panic!("{stops:?}") };
        assert_eq!((stop.name.as_str(), stop.slices.len()), ("scan007", 2));
        assert!((stop.slices[0].tilt_rad + std::f64::consts::FRAC_PI_4).abs() < 1e-6);
        let bearings: Vec<f32> =
            stop.slices[1].beams.iter().map(|beam| beam.bearing_rad.to_degrees().round()).collect();
        assert_eq!(bearings, [-90.0, 0.0, 90.0]);
        assert_eq!(
            stop.slices[1].beams.iter().map(|b| b.echo).collect::<Vec<_>>(),
            [Echo::Hit(2.0), Echo::Miss, Echo::Hit(2.0)]
        );
        // The cloud is the file again, in our frame: ahead and down, right, left.
        let points: Vec<_> = stop.cloud(Isometry3::identity(), None).points.iter().map(|p| p.position).collect();
        let half = 0.5_f32.sqrt();
        let expected = [
            Point3::new(0.0, -1.0, 0.0),
            Point3::new(half, 0.0, -half),
            Point3::new(0.0, 1.0, 0.0),
            Point3::new(0.0, -2.0, 0.0),
            Point3::new(0.0, 2.0, 0.0),
        ];
        assert!(points.iter().zip(expected).all(|(a, b)| (a - b).norm() < 1e-5), "{points:?}");
        assert_eq!(points.len(), expected.len());
    }

    #[test]
    fn pose_is_turned_into_our_frame() {
        // Left-handed about y (up): positive turns ahead to the right. About x (right): positive looks down.
        let pose = |text: &str| stops(SCAN, text).unwrap()[0].map_from_lrf;
        let turned = pose("10 20 300\n0 90 0\n");
        assert!((turned * Point3::origin() - Point3::new(3.0, -0.1, 0.2)).norm() < 1e-9);
        assert!((turned * Vector3::x() + Vector3::y()).norm() < 1e-9, "{}", turned * Vector3::x());
        assert!((pose("0 0 0\n90 0 0\n") * Vector3::x() + Vector3::z()).norm() < 1e-9);
    }

    #[test]
    fn wrong_files_are_named_with_the_place() {
        let text = |scan: &str, pose: &str| stops(scan, pose).unwrap_err().to_string();
        assert!(
            text("1 2\n", "0 0 0\n0 0 0\n")
                .ends_with("scan007.3d: line 1: field count: expected 3 columns, found \"2 columns\"")
        );
        assert!(text("1 2 x\n", "0 0 0\n0 0 0\n").contains("scan007.3d: line 1: field 3"));
        assert!(text(SCAN, "0 0 0\n").ends_with("scan007.pose: 1 lines, expected 2: position and rotations"));
        let short = SCAN.trim_end().rsplit_once('\n').unwrap().0;
        assert!(text(short, "0 0 0\n0 0 0\n").contains("point 4: a slice of 2 beams starts here, expected 3"));
        assert!(
            text("100 0 0\n0 50 100\n0 -50 100\n-100 0 0\n", "0 0 0\n0 0 0\n")
                .contains("point 2: it lies off the plane")
        );
        let empty = tempfile::tempdir().unwrap();
        assert!(read_stops(empty.path()).unwrap_err().to_string().contains("no scanNNN.3d"));
        assert!(read_stops(&empty.path().join("none")).unwrap_err().to_string().contains("cannot be read"));
    }
}
