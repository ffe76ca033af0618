//! What was met while reading a log.

use std::fmt::Write as _;

use serde::Serialize;

use super::range_limit::RangeNotes;
use crate::input::text::FieldFault;
use crate::plural::count;

/// Damaged lines that are named; the others are counted.
const NAMED_MAX: usize = 10;

/// A larger share of damaged scan lines than one in so many is said loudly.
const FEW: u64 = 100;

/// A line that could not be read and was left out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, thiserror::Error)]
#[error("line {line}: {fault}")]
pub struct DamagedLine {
    /// Of the file, from 1.
    pub line: u64,
    /// Which field, what was expected, what stands there.
    #[serde(flatten)]
    pub fault: FieldFault,
}

/// What was met on the way.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct LogCounts {
    /// Scans handed out.
    pub scans: u64,
    /// Lines of unknown kinds, passed over.
    pub skipped_lines: u64,
    /// Lines of known kinds that cannot be read, left out; in most formats a scan each.
    pub damaged_lines: u64,
    /// The first ten of them.
    pub damaged: Vec<DamagedLine>,
    /// Scans whose time lies before that of the scan before.
    pub backward_times: u64,
    /// Scans with the very time of an earlier one: a trajectory has one pose for both.
    pub repeated_times: u64,
    /// Scans whose laser and robot poses contradict the mounting.
    pub mounting_contradictions: u64,
    /// The last line was cut short and is ignored.
    pub cut_last_line: bool,
    /// The log has no times: stamps are made up at a fixed rate.
    pub synthetic_times: bool,
    /// Scans whose beams' directions are guessed: neither the line nor a known device's number of beams tells them.
    #[serde(skip)]
    pub guessed_angles: u64,
    /// What ranges are like, and what "nothing seen" is known from.
    #[serde(skip)]
    pub ranges: RangeNotes,
}

impl LogCounts {
    pub(super) fn add_damaged(&mut self, line: u64, fault: FieldFault) {
        self.damaged_lines += 1;
        if self.damaged.len() < NAMED_MAX {
            self.damaged.push(DamagedLine { line, fault });
        }
    }

    /// More than 1 % of the scans are lost to damaged lines.
    pub fn is_badly_damaged(&self) -> bool {
        self.damaged_lines.saturating_mul(FEW) > self.scans + self.damaged_lines
    }

    /// How many lines are damaged, and where the first of them are; `None` if none is.
    pub fn damage_note(&self) -> Option<String> {
        let (damaged, lines) = (self.damaged_lines, self.scans + self.damaged_lines);
        let mut text = match damaged {
            0 => return None,
            _ if self.is_badly_damaged() => format!(
                "WARNING: {damaged} of {lines} lines with scans ({:.1} %) are damaged and were left out: what they saw is missing",
                100.0 * damaged as f64 / lines as f64
            ),
            _ => format!("{} left out", count(damaged, "damaged line")),
        };
        for place in &self.damaged {
            // Writing to a string cannot fail.
            let _ = write!(text, "\n      {place}");
        }
        if damaged > self.damaged.len() as u64 {
            text.push_str("\n      …");
        }
        Some(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::text::fault;

    #[test]
    fn ten_places_are_named_and_one_in_a_hundred_is_said_loudly() {
        let mut counts = LogCounts { scans: 1980, ..LogCounts::default() };
        assert_eq!(counts.damage_note(), None);
        counts.add_damaged(7, fault("time".to_owned(), "a finite number", Some("x")));
        let note = "1 damaged line left out\n      line 7: field time: expected a finite number, found \"x\"";
        assert_eq!(counts.damage_note().unwrap(), note);
        (8..27).for_each(|line| counts.add_damaged(line, fault("time".to_owned(), "a finite number", None)));
        let note = counts.damage_note().unwrap();
        assert!(note.starts_with("20 damaged lines") && note.contains("line 16:") && note.ends_with("…"), "{note}");
        assert!(!note.contains("line 17:"), "{note}");
        counts.add_damaged(27, fault("time".to_owned(), "a finite number", None));
        let note = counts.damage_note().unwrap();
        assert!(note.starts_with("WARNING: 21 of 2001 lines with scans (1.0 %)"), "{note}");
    }
}
