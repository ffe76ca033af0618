//! DP-SLAM's own text log: pairs of lines, odometry first.
//!
//! ```text
//! Odometry x y θ
//! Laser n r…
//! ```
//! Metres and radians, beams counter-clockwise over 180°, ranges from about 8 m on are "nothing seen" (8.183, 8.19).
//! There are no times: the reader gives the scans stamps at the fixed rate of its options. A `Laser` line without an
//! `Odometry` line before it has no odometry.
//!
//! Source: DP-SLAM's sample logs and its `ReadLog`.

use super::raw::{Content, LineReader, RawScan, beam_count, pose, ranges};
use crate::input::text::{FieldFault, Line, Words, fault};
use crate::pose_f64::PoseF64;

#[derive(Debug, Default)]
pub(super) struct DpSlamReader {
    odometry: Option<PoseF64>,
}

/// True if `first_word` begins a line of this format.
pub(super) fn is_dpslam(first_word: &str) -> bool {
    matches!(first_word, "Odometry" | "Laser")
}

impl LineReader for DpSlamReader {
    fn read(&mut self, line: &Line<'_>) -> Result<Content, FieldFault> {
        let mut words = Words::new(&line.text);
        match words.word() {
            Some("Odometry") => {
                // That of an earlier line must not stand in for one that cannot be read.
                self.odometry = None;
                self.odometry = pose(&mut words, "odometry")?;
                Ok(Content::Other)
            }
            Some("Laser") => self.scan(&mut words, line.number),
            _ => Ok(Content::Unknown),
        }
    }
}

impl DpSlamReader {
    fn scan(&mut self, words: &mut Words<'_>, line: u64) -> Result<Content, FieldFault> {
        let odometry = self.odometry.take();
        let count = beam_count(words)?;
        let mut scan = RawScan::new(line, ranges(words, count)?);
        if let Some(more) = words.word() {
            return Err(fault(format!("{}", count + 3), &format!("no more than {count} ranges"), Some(more)));
        }
        scan.odometry_from_robot = odometry;
        Ok(Content::Scan(Box::new(scan)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odometry_belongs_to_the_next_scan_only() {
        let mut reader = DpSlamReader::default();
        let mut read = |text: &str| reader.read(&Line { number: 1, text: text.into(), ended: true });
        assert!(matches!(read("Odometry 1 2 0.5 "), Ok(Content::Other)));
        let Ok(Content::Scan(scan)) = read("Laser 2 0.5 8.183") else { panic!() };
        assert_eq!((scan.odometry_from_robot, scan.stamp), (Some(PoseF64::new(1.0, 2.0, 0.5)), None));
        let Ok(Content::Scan(scan)) = read("Laser 2 0.5 8.183") else { panic!() };
        assert_eq!(scan.odometry_from_robot, None);
        assert_eq!(read("Laser 2 0.5").unwrap_err().field, "range 2 of 2");
        assert_eq!(read("Laser 2 0.5 1 7").unwrap_err().field, "5");
        assert!(matches!(read("Odometry 1 2 3"), Ok(Content::Other)));
        assert_eq!(read("Odometry 1 y 3").unwrap_err().field, "odometry y");
        let Ok(Content::Scan(scan)) = read("Laser 2 0.5 8.183") else { panic!() };
        assert_eq!(scan.odometry_from_robot, None, "not that of the line before the damaged one");
    }
}
