//! The tilt's encoder as a file: lines `t tilt` (s, rad; looking up is positive), plain or gzip, `#` comments.

use std::path::Path;

use lrfslam_core::time::Instant;

use crate::input::table::{TableError, read_table};
use crate::input::text::fault;

/// Reads all readings of the file.
///
/// # Errors
/// If it cannot be read, has no reading, or a line that is wrong (named).
pub fn read_tilt(path: &Path) -> Result<Vec<(Instant, f64)>, TableError> {
    read_table(path, "t tilt", |words| match words.left() {
        2 => {
            let stamp = Instant::from_secs_f64(words.finite("t")?);
            let tilt_rad = words.finite("tilt")?;
            let turn = std::f64::consts::PI;
            let wrong = || fault("tilt".to_owned(), "-π to π (rad)", Some(&tilt_rad.to_string()));
            if tilt_rad.abs() <= turn { Ok((stamp, tilt_rad)) } else { Err(wrong()) }
        }
        found => Err(fault("count".to_owned(), "2 columns (t tilt)", Some(&format!("{found} columns")))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<(Instant, f64)>, TableError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read_tilt(file.path())
    }

    #[test]
    fn readings_have_times_and_radians() {
        let readings = read("# t tilt\n1.5 -0.25\n2 0.5\n").unwrap();
        assert_eq!(readings, [(Instant::from_micros(1_500_000), -0.25), (Instant::from_micros(2_000_000), 0.5)]);
    }

    #[test]
    fn wrong_lines_are_named() {
        let text = |text: &str| read(text).unwrap_err().to_string();
        assert!(text("1 45\n").ends_with("line 1: field tilt: expected -π to π (rad), found \"45\""));
        assert!(text("1 0\n2\n").contains("line 2: field count: expected 2 columns (t tilt)"));
        assert!(text("\n").contains("expected lines of `t tilt`"));
    }
}
