//! The map as ROS's map_server reads it: `map.pgm` and `map.yaml`.
//!
//! P5 PGM, row 0 on top: free 254, unknown 205, occupied 0. The YAML gives the edge of a pixel (m) and the pose of the
//! lower left pixel's lower left corner. Source: ROS wiki, map_server, map format ("trinary").
//!
//! A pixel x is occupied with p = (255 − x) / 255: above `occupied_thresh` it is a wall, below `free_thresh` it is free.
//! Unknown 205 has p = 0.19608, so `free_thresh` is 0.196, as ROS's map_saver writes it.

use std::path::Path;

use crate::maps::occupancy::{Occupancy, Raster};
use crate::output::save_file;

/// Longer side of `map.pgm`, pixels, at most; 0.05 m to a pixel that is 800 m.
pub const PGM_SIDE_MAX: u32 = 16_000;

/// The image as a binary PGM file.
fn pgm(raster: &Raster) -> Vec<u8> {
    let mut bytes = format!("P5\n{} {}\n255\n", raster.width, raster.height).into_bytes();
    bytes.extend(raster.pixels.iter().map(|occupancy| match occupancy {
        Occupancy::Free => 254,
        Occupancy::Unknown => 205,
        Occupancy::Occupied => 0,
    }));
    bytes
}

/// The YAML file beside the image `image`.
fn yaml(raster: &Raster, image: &str) -> String {
    let (x, y) = raster.origin_m;
    let size = raster.pixel_size_m;
    format!(
        "image: {image}\nmode: trinary\nresolution: {size:.6}\norigin: [{x:.6}, {y:.6}, 0.0]\nnegate: 0\n\
         occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
}

/// Writes `{name}.pgm` and `{name}.yaml` into `folder`.
///
/// # Errors
/// If a file cannot be written; it is named.
pub fn write_map(folder: &Path, name: &str, raster: &Raster) -> anyhow::Result<()> {
    let image = format!("{name}.pgm");
    save_file(&folder.join(&image), &pgm(raster))?;
    save_file(&folder.join(format!("{name}.yaml")), yaml(raster, &image).as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maps::occupancy::{MapConfig, OccupancyMap};
    use lrfslam_core::geometry::Pose2;
    use lrfslam_core::scan::{Beam, Echo, RangeScan};
    use lrfslam_core::sweep::Sweep;
    use lrfslam_core::time::{Duration, Instant};

    fn raster() -> Raster {
        let mut map = OccupancyMap::new(MapConfig::default());
        let beam = |bearing_rad, range| Beam { bearing_rad, offset: Duration::ZERO, echo: Echo::Hit(range) };
        let beams = [beam(0.0, 0.1), beam(std::f32::consts::FRAC_PI_2, 0.06)];
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        map.insert(&Sweep::at_rest(scan, Pose2::IDENTITY), Pose2::new(-1.01, 2.01, 0.0));
        map.raster(100).unwrap()
    }

    #[test]
    fn pgm_has_the_bytes_that_map_server_expects() {
        let expected = [b"P5\n3 2\n255\n".as_slice(), &[0, 205, 205, 254, 254, 0]].concat();
        assert_eq!(pgm(&raster()), expected);
    }

    #[test]
    fn yaml_places_the_lower_left_corner() {
        let text = yaml(&raster(), "map.pgm");
        assert!(text.contains("resolution: 0.050000\norigin: [-1.050000, 2.000000, 0.0]\n"), "{text}");
        assert!(text.contains("occupied_thresh: 0.65\nfree_thresh: 0.196\n"), "{text}");
    }
}
