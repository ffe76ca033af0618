//! PLY, the Stanford polygon format: binary, little-endian, points with colours.
//!
//! Source: G. Turk, *The PLY Polygon File Format*, 1994. MeshLab, CloudCompare, Blender and Open3D read it.

use std::io::{self, Write};

use crate::maps::colours::ColouredPoint;

/// Writes `points` as a PLY file; 15 bytes a point.
///
/// # Errors
/// If `out` fails.
pub fn write_ply(points: &[ColouredPoint], out: &mut impl Write) -> io::Result<()> {
    let count = points.len();
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment lrfslam: m, x forward, y left, z up\nelement vertex {count}\n\
         property float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )?;
    for point in points {
        for coordinate in &point.position.coords {
            out.write_all(&coordinate.to_le_bytes())?;
        }
        out.write_all(&point.colour)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use ply_rs_bw::parser::Parser;
    use ply_rs_bw::ply::{DefaultElement, Property};
    use proptest::prelude::*;

    fn written(points: &[ColouredPoint]) -> Vec<u8> {
        let mut bytes = Vec::new();
        write_ply(points, &mut bytes).unwrap();
        bytes
    }

    /// Reads with a library that is not ours.
    fn read(bytes: &[u8]) -> Vec<ColouredPoint> {
        let ply = Parser::<DefaultElement>::new().read_ply(&mut io::Cursor::new(bytes)).unwrap();
        let float = |element: &DefaultElement, name: &str| match element[name] {
            Property::Float(value) => value,
            ref other => panic!("{name} is {other:?}"),
        };
        let byte = |element: &DefaultElement, name: &str| match element[name] {
            Property::UChar(value) => value,
            ref other => panic!("{name} is {other:?}"),
        };
        let point = |element: &DefaultElement| ColouredPoint {
            position: Point3::new(float(element, "x"), float(element, "y"), float(element, "z")),
            colour: ["red", "green", "blue"].map(|name| byte(element, name)),
        };
        ply.payload["vertex"].iter().map(point).collect()
    }

    #[test]
    fn one_point_has_the_bytes_of_the_format() {
        let bytes = written(&[ColouredPoint { position: Point3::new(1.0, -2.0, 0.5), colour: [1, 2, 3] }]);
        let end = b"end_header\n";
        let data = bytes.windows(end.len()).position(|window| window == end).unwrap() + end.len();
        assert!(bytes.starts_with(b"ply\nformat binary_little_endian 1.0\n"));
        assert_eq!(bytes[data..], [0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0, 0, 0, 0, 0x3f, 1, 2, 3]);
    }

    proptest! {
        #[test]
        fn another_library_reads_the_same_points(
            raw in proptest::collection::vec((any::<[i16; 3]>(), any::<[u8; 3]>()), 0..50)
        ) {
            let point = |(at, colour): &([i16; 3], [u8; 3])| {
                let [x, y, z] = at.map(|v| f32::from(v) / 300.0);
                ColouredPoint { position: Point3::new(x, y, z), colour: *colour }
            };
            let points: Vec<_> = raw.iter().map(point).collect();
            prop_assert_eq!(read(&written(&points)), points);
        }
    }
}
