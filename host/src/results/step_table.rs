//! What the particle filter did, step by step: `steps.csv`, and its summary for `run.json`.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::Path;
use std::time::Duration as WallDuration;

use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use lrfslam_core::low_slam::FilterReport;
use lrfslam_core::time::Instant;
use serde::Serialize;

use crate::mapping::mapper::StageTimes;
use crate::output::{Aside, Kept, save_by};

const HEADER: &str = "scan,stamp_s,effective_sample_size,particles,resampled,nodes,depth,tiles,dropped,squares_left_out,\
                      rays_cut,matching_us,weighing_us,printing_us\n";

/// Bytes of lines that are packed and put aside together: a robot that drives for a day has 30 MB of them.
const PACKED: usize = 1 << 16;

/// Over a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct ParticleSummary {
    /// Steps that the filter took.
    pub steps: u64,
    /// Particles alive, on average.
    pub particles_mean: f64,
    /// Effective sample size, on average.
    pub effective_sample_size_mean: f64,
    /// Nodes of the ancestry tree, at most.
    pub nodes_max: usize,
    /// Depth of the tree, at most.
    pub depth_max: usize,
    /// Tiles of all maps, at most.
    pub tiles_max: usize,
    /// Particles that went because the tiles were used up.
    pub dropped: u64,
    /// Squares that found no tile.
    pub squares_left_out: u64,
    /// Rays that left the window.
    pub rays_cut: u64,
    /// Time for matching the scans of steps, s.
    pub matching_s: f64,
    /// Time for weighing, s.
    pub weighing_s: f64,
    /// Time for resampling and printing, s.
    pub printing_s: f64,
}

/// See the [module](self).
#[derive(Debug, Default)]
pub struct StepTable {
    /// The newest lines; …
    text: String,
    /// … and the older ones, packed.
    packs: Vec<Kept>,
    aside: Aside,
    sums: ParticleSummary,
}

impl StepTable {
    /// Older lines go there.
    pub fn put_aside(&mut self, aside: &Aside) {
        self.aside = aside.clone();
        self.packs.iter_mut().for_each(|pack| pack.put_aside(aside));
    }

    /// Takes a step; `scan` counts from 0.
    pub fn add(&mut self, stamp: Instant, scan: usize, step: &FilterReport, times: &StageTimes) {
        let micros = |time: WallDuration| time.as_micros();
        // Writing to a string cannot fail.
        let _ = writeln!(
            self.text,
            "{scan},{:.6},{:.2},{},{},{},{},{},{},{},{},{},{},{}",
            stamp.as_secs_f64(),
            step.effective_sample_size,
            step.particles,
            u8::from(step.resampled),
            step.nodes,
            step.depth,
            step.tiles,
            step.dropped,
            step.squares_left_out,
            step.rays_cut,
            micros(times.matching),
            micros(times.weighing),
            micros(times.printing),
        );
        if self.text.len() >= PACKED {
            self.pack();
        }
        let sums = &mut self.sums;
        sums.steps += 1;
        sums.particles_mean += step.particles as f64;
        sums.effective_sample_size_mean += f64::from(step.effective_sample_size);
        sums.nodes_max = sums.nodes_max.max(step.nodes);
        sums.depth_max = sums.depth_max.max(step.depth);
        sums.tiles_max = sums.tiles_max.max(step.tiles);
        sums.dropped += step.dropped as u64;
        sums.squares_left_out += u64::from(step.squares_left_out);
        sums.rays_cut += u64::from(step.rays_cut);
        sums.matching_s += times.matching.as_secs_f64();
        sums.weighing_s += times.weighing.as_secs_f64();
        sums.printing_s += times.printing.as_secs_f64();
    }

    fn pack(&mut self) {
        let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
        // Writing to memory cannot fail.
        let packed = encoder.write_all(self.text.as_bytes()).and_then(|()| encoder.finish()).unwrap_or_default();
        self.packs.push(self.aside.put(packed.into_boxed_slice()));
        self.text.clear();
    }

    /// `None` if there was no step.
    pub fn summary(&self) -> Option<ParticleSummary> {
        let steps = self.sums.steps as f64;
        (self.sums.steps > 0).then(|| ParticleSummary {
            particles_mean: self.sums.particles_mean / steps,
            effective_sample_size_mean: self.sums.effective_sample_size_mean / steps,
            ..self.sums
        })
    }

    /// Writes the table to `file`; nothing if there was no step.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, file: &Path) -> anyhow::Result<()> {
        if self.sums.steps == 0 {
            return Ok(());
        }
        save_by(file, |out| {
            out.write_all(HEADER.as_bytes())?;
            for pack in &self.packs {
                io::copy(&mut DeflateDecoder::new(&*pack.read()), out)?;
            }
            out.write_all(self.text.as_bytes())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_lines_are_written_those_that_were_packed_with_them() {
        let folder = tempfile::tempdir().unwrap();
        let mut table = StepTable::default();
        table.put_aside(&Aside::in_folder(folder.path()));
        let (step, times) = (FilterReport::default(), StageTimes::default());
        for scan in 0..5000 {
            table.add(Instant::from_micros(200_000 * scan), scan as usize, &step, &times);
        }
        assert!(table.packs.len() >= 2 && table.packs.iter().all(|pack| pack.read().len() < 20_000));
        let file = folder.path().join("steps.csv");
        table.write(&file).unwrap();
        let text = std::fs::read_to_string(&file).unwrap();
        let mut lines = text.lines();
        assert_eq!(lines.next().map(|line| format!("{line}\n")).as_deref(), Some(HEADER));
        for scan in 0..5000 {
            let begin = format!("{scan},{:.6},", 0.2 * f64::from(scan));
            assert!(lines.next().is_some_and(|line| line.starts_with(&begin)), "{begin}");
        }
        assert_eq!(lines.next(), None);
    }
}
