//! PCD, the Point Cloud Library's format: version 0.7, binary, points with colours.
//!
//! The colour is 0x00RRGGBB in the bits of a float, as PCL has it. Source: PCL's documentation, "The PCD file format".

use std::io::{self, Write};

use crate::maps::colours::ColouredPoint;

/// Writes `points` as a PCD file; 16 bytes a point.
///
/// # Errors
/// If `out` fails.
pub fn write_pcd(points: &[ColouredPoint], out: &mut impl Write) -> io::Result<()> {
    let count = points.len();
    write!(
        out,
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\n\
         COUNT 1 1 1 1\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    )?;
    for point in points {
        for coordinate in &point.position.coords {
            out.write_all(&coordinate.to_le_bytes())?;
        }
        let [red, green, blue] = point.colour;
        out.write_all(&[blue, green, red, 0])?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    /// Reads as PCL does: the header's words, then `POINTS` records of `SIZE` bytes a field.
    fn read(bytes: &[u8]) -> Vec<ColouredPoint> {
        let start = b"DATA binary\n";
        let split = bytes.windows(start.len()).position(|window| window == start).unwrap();
        let header = std::str::from_utf8(&bytes[..split]).unwrap();
        let words = |key: &str| -> Vec<&str> {
            let line = header.lines().find(|line| line.split(' ').next() == Some(key)).unwrap();
            line.split(' ').skip(1).collect()
        };
        assert_eq!((words("VERSION"), words("FIELDS")), (vec!["0.7"], vec!["x", "y", "z", "rgb"]));
        assert_eq!((words("SIZE"), words("TYPE"), words("COUNT")), (vec!["4"; 4], vec!["F"; 4], vec!["1"; 4]));
        assert_eq!((words("WIDTH"), words("HEIGHT")), (words("POINTS"), vec!["1"]));
        let records = bytes[split + start.len()..].chunks(16);
        assert_eq!(words("POINTS"), [records.len().to_string()]);
        let record = |record: &[u8]| {
            let word = |at: usize| <[u8; 4]>::try_from(&record[4 * at..4 * at + 4]).unwrap();
            let [x, y, z] = [0, 1, 2].map(|at| f32::from_le_bytes(word(at)));
            let rgb = u32::from_le_bytes(word(3));
            ColouredPoint { position: Point3::new(x, y, z), colour: [16, 8, 0].map(|shift| (rgb >> shift) as u8) }
        };
        records.map(record).collect()
    }

    #[test]
    fn points_and_colours_come_back() {
        let point = |i: u8| ColouredPoint {
            position: Point3::new(f32::from(i) * 0.37, -1e6, 1e-6),
            colour: [i, 255 - i, i / 2],
        };
        for count in [0, 1, 200] {
            let points: Vec<_> = (0..count).map(point).collect();
            let mut bytes = Vec::new();
            write_pcd(&points, &mut bytes).unwrap();
            assert_eq!(read(&bytes), points);
        }
    }
}
