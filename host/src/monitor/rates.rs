//! Rates over the last second, and how they went over the last minutes.

use std::time::{Duration as WallDuration, Instant as WallInstant};

use lrfslam_core::time::Instant;

use super::batch::Now;

/// Over which a rate is taken.
const WINDOW: WallDuration = WallDuration::from_secs(1);
/// Samples kept, one a window: ten minutes.
pub(super) const SAMPLES_MAX: usize = 600;

/// What is drawn as a graph.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct Sample {
    /// Time of the scans since the first sample, s.
    pub time_s: f32,
    /// Scans a second of the wall's clock.
    pub scans_hz: f32,
    /// Time to map one, ms.
    pub step_ms: f32,
    /// From the scan to when it was mapped, ms; 0 of what is not live.
    pub late_ms: f32,
    /// Of the particle filter; 0 without one.
    pub effective_sample_size: f32,
    /// Memory of the process, megabytes.
    pub memory_mb: f32,
}

/// See the [module](self).
#[derive(Debug, Default)]
pub(super) struct Rates {
    last: Option<(WallInstant, u64, WallDuration)>,
    /// Stamp of the first sample.
    began: Option<Instant>,
}

impl Rates {
    /// Takes how things stand; a sample once a window is over.
    pub fn take(&mut self, now: &Now, is_paused: bool) -> Option<Sample> {
        let wall = WallInstant::now();
        let here = (wall, now.counts.scans, now.working);
        let (then, scans, working) = *self.last.get_or_insert(here);
        if wall - then < WINDOW || is_paused {
            self.last = if is_paused { None } else { self.last };
            return None;
        }
        self.last = Some(here);
        let taken = now.counts.scans.saturating_sub(scans) as f32;
        let worked_ms = now.working.saturating_sub(working).as_secs_f32() * 1e3;
        Some(Sample {
            // A stamp since 1970 is too large for it.
            time_s: now.stamp.since(*self.began.get_or_insert(now.stamp)).micros as f32 / 1e6,
            scans_hz: taken / (wall - then).as_secs_f32(),
            step_ms: worked_ms / taken.max(1.0),
            late_ms: now.late.map_or(0.0, |late| late.as_secs_f32() * 1e3),
            effective_sample_size: now.effective_sample_size.unwrap_or(0.0),
            memory_mb: memory_bytes().map_or(0.0, |bytes| bytes as f32 / 1e6),
        })
    }
}

/// Memory that this process holds now, bytes; `None` where there is no `/proc` that tells (`VmRSS`).
fn memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kibibytes| kibibytes * 1024)
}
