//! A map under way: scans in, and at the end a folder with trajectory, map, picture and report.
//!
//! What `lrfslam map`, `run` and `replay` share; they differ in where the scans come from.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use anyhow::Context as _;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::laser_odometry::StepReport;
use lrfslam_core::scan::{Echo, RangeScan};

use crate::config::RunConfig;
use crate::map_io::{PGM_SIDE_MAX, write_map};
use crate::mapper::{Mapper, MapperMemory};
use crate::occupancy_map::OccupancyMap;
use crate::output::{PendingFile, write_file};
use crate::picture::write_picture;
use crate::run_report::{BeamCounts, Cost, Program, RunReport, Source, peak_memory_bytes};
use crate::trajectory::TimedPose;

/// See the [module](self).
#[derive(Debug)]
pub struct MapRun<'m> {
    config: RunConfig,
    seed: u64,
    out: PathBuf,
    mapper: Mapper<'m>,
    map: OccupancyMap,
    trajectory_file: PendingFile,
    trajectory: Vec<TimedPose>,
    beams: BeamCounts,
    working: WallDuration,
}

impl<'m> MapRun<'m> {
    /// An empty map whose results will be in `out`; that it can be written to is found out here.
    ///
    /// # Errors
    /// If the folder cannot be used, or the memory does not fit the configuration.
    pub fn open(out: &Path, config: &RunConfig, seed: u64, memory: &'m mut MapperMemory) -> anyhow::Result<Self> {
        let unusable = || format!("{}: cannot be used as output folder", out.display());
        fs::create_dir_all(out).with_context(unusable)?;
        let trajectory_file = PendingFile::create(&out.join("trajectory.tum")).with_context(unusable)?;
        Ok(Self {
            config: *config,
            seed,
            out: out.to_owned(),
            mapper: Mapper::new(config, seed, memory)?,
            map: OccupancyMap::new(config.map),
            trajectory_file,
            trajectory: Vec::new(),
            beams: BeamCounts::default(),
            working: WallDuration::ZERO,
        })
    }

    /// Maps one scan. A scan that cannot be believed is not drawn.
    ///
    /// * `robot_from_lrf` — where the laser sits on the robot
    /// * `odometry` — the robot's pose by its odometry, if that is to be the prediction
    ///
    /// # Errors
    /// If the scan has too many points for the memory, or the trajectory cannot be written.
    pub fn add_scan(
        &mut self,
        scan: &RangeScan<'_>,
        robot_from_lrf: Pose2,
        odometry: Option<Pose2>,
    ) -> anyhow::Result<StepReport> {
        let started = WallInstant::now();
        let step = self.mapper.add_scan(scan, robot_from_lrf, odometry)?;
        let map_from_robot = step.matched.map_from_robot;
        if !step.is_lost {
            self.map.insert(scan, map_from_robot * robot_from_lrf);
        }
        self.beams.add(scan);
        let pose = TimedPose { stamp: scan.stamp, map_from_robot };
        self.trajectory.push(pose);
        pose.write_tum(&mut self.trajectory_file).with_context(|| cannot_write(&self.out.join("trajectory.tum")))?;
        self.working += started.elapsed();
        Ok(step)
    }

    /// Scans mapped so far.
    pub fn scans(&self) -> usize {
        self.trajectory.len()
    }

    /// Where the results go.
    pub fn out(&self) -> &Path {
        &self.out
    }

    /// Writes the results.
    ///
    /// * `source` — where the scans came from; `odometry` — whether it was used
    /// * `fault` — what ended the run early, if anything did: the results are then said to be partial
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn finish(self, source: Source, odometry: bool, fault: Option<&anyhow::Error>) -> anyhow::Result<RunReport> {
        let report = self.report(source, odometry, fault);
        let Self { out, map, config, trajectory, trajectory_file, .. } = self;
        trajectory_file.finish().with_context(|| cannot_write(&out.join("trajectory.tum")))?;
        // Without a known cell there is nothing to draw; the report says how many beams hit.
        if let Some(raster) = map.raster(PGM_SIDE_MAX) {
            write_map(&out, &raster).with_context(|| cannot_write(&out.join("map.pgm")))?;
        }
        if let Some(raster) = map.raster(config.map.picture_px) {
            let file = out.join("map.png");
            write_picture(&file, &raster, &trajectory).with_context(|| cannot_write(&file))?;
        }
        let file = out.join("run.json");
        let text = serde_json::to_string_pretty(&report)? + "\n";
        write_file(&file, text.as_bytes()).with_context(|| cannot_write(&file))?;
        Ok(report)
    }

    fn report(&self, source: Source, odometry: bool, fault: Option<&anyhow::Error>) -> RunReport {
        RunReport {
            program: Program::THIS,
            source,
            config: self.config,
            seed: self.seed,
            odometry,
            beams: self.beams,
            matching: self.mapper.counts(),
            cost: self.cost(),
            partial: fault.is_some(),
            fault: fault.map(|error| format!("{error:#}")),
        }
    }

    fn cost(&self) -> Cost {
        let ends = self.trajectory.first().zip(self.trajectory.last());
        let wall_s = self.working.as_secs_f64();
        Cost {
            scans: self.trajectory.len() as u64,
            wall_s,
            scans_per_s: self.trajectory.len() as f64 / wall_s.max(1e-6),
            driven_s: ends.map_or(0.0, |(first, last)| last.stamp.since(first.stamp).micros as f64 / 1e6),
            peak_memory_bytes: peak_memory_bytes(),
        }
    }
}

impl BeamCounts {
    fn add(&mut self, scan: &RangeScan<'_>) {
        for beam in scan.beams {
            match beam.echo {
                Echo::Hit(_) => self.hits += 1,
                Echo::Miss => self.misses += 1,
                Echo::Invalid => self.invalid += 1,
            }
        }
    }
}

fn cannot_write(file: &Path) -> String {
    format!("{}: cannot be written", file.display())
}
