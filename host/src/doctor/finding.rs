//! What the doctor says: findings, where they are, and what to do.

use std::fmt;

use lrfslam_core::time::Instant;
use serde::Serialize;

use crate::scans::log::LogScan;

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// As it should be, or without consequence.
    Note,
    /// Unusual: the map may be right, or suffer.
    Unusual,
    /// Wrong: the map suffers, or there is none.
    Wrong,
}

/// A scan's place in a log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mark {
    /// Of the file, or number of a laser's scan, from 1.
    pub line: u64,
    pub stamp: Instant,
}

impl Mark {
    pub fn of(scan: &LogScan) -> Self {
        Self { line: scan.line, stamp: scan.stamp }
    }
}

/// A stretch of a log, both ends in it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Stretch {
    /// Line of the file, or number of a laser's scan, from 1.
    pub from_line: u64,
    /// The last one.
    pub to_line: u64,
    /// On the log's own clock, s.
    pub from_s: f64,
    /// The same of the last scan.
    pub to_s: f64,
}

impl Stretch {
    pub(super) fn new(from: Mark, to: Mark) -> Self {
        let seconds = |mark: Mark| mark.stamp.as_secs_f64();
        Self { from_line: from.line, to_line: to.line, from_s: seconds(from), to_s: seconds(to) }
    }
}

impl fmt::Display for Stretch {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { from_line, to_line, from_s, to_s } = self;
        if from_line == to_line {
            return write!(out, "line {from_line} ({from_s:.2} s)");
        }
        write!(out, "lines {from_line} to {to_line} ({from_s:.2} to {to_s:.2} s)")
    }
}

/// One thing found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Its name, the same in every run: `blocked-sector`.
    pub kind: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// What was found, with its figure.
    pub found: String,
    /// Where; the first [`STRETCHES_MAX`] at most, empty for what is everywhere.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub at: Vec<Stretch>,
    /// What it means for the map; empty for a note.
    #[serde(skip_serializing_if = "str::is_empty")]
    pub means: &'static str,
    /// What to set or to do; empty if there is nothing.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub advice: String,
}

/// Stretches of a finding that are named.
pub const STRETCHES_MAX: usize = 5;

impl Finding {
    pub(super) fn note(kind: &'static str, found: String) -> Self {
        Self { kind, severity: Severity::Note, found, at: Vec::new(), means: "", advice: String::new() }
    }

    pub(super) fn unusual(kind: &'static str, found: String, means: &'static str) -> Self {
        Self { severity: Severity::Unusual, means, ..Self::note(kind, found) }
    }

    pub(super) fn wrong(kind: &'static str, found: String, means: &'static str) -> Self {
        Self { severity: Severity::Wrong, means, ..Self::note(kind, found) }
    }

    /// * `advice` — what to set or to do
    pub(super) fn so(self, advice: impl Into<String>) -> Self {
        Self { advice: advice.into(), ..self }
    }

    pub(super) fn at(self, stretches: impl IntoIterator<Item = Stretch>) -> Self {
        Self { at: stretches.into_iter().take(STRETCHES_MAX).collect(), ..self }
    }
}

/// A whole number of percent, or a tenth where it is small.
pub(super) fn percent(part: f64, whole: f64) -> String {
    let percent = if whole > 0.0 { 100.0 * part / whole } else { 0.0 };
    if percent > 0.0 && percent < 9.95 { format!("{percent:.1} %") } else { format!("{percent:.0} %") }
}

/// The value at a share of the way through `values`, 0 to 1; they are sorted. `None` if there is none.
pub(super) fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(((values.len().saturating_sub(1)) as f64 * share).round() as usize).copied()
}
