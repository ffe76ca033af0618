//! What a run leaves: trajectory, map, picture, steps, saved map and report, written as often as is wanted.

use std::borrow::Cow;
use std::path::Path;
use std::time::Instant as WallInstant;

use anyhow::Context as _;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::sweep::Sweep;
use serde::Serialize;

use super::Run;
use crate::mapping::LowLevel;
use crate::mapping::high::HighSlam;
use crate::mapping::saved_map::{self, map_of};
use crate::maps::contradictions::RevisitedWalls;
use crate::maps::io::{PGM_SIDE_MAX, write_map};
use crate::maps::occupancy::{OccupancyMap, Raster};
use crate::maps::picture::{PictureNotes, write_picture};
use crate::output::{cannot_write, save_json};
use crate::program::Program;
use crate::results::quality::Quality;
use crate::results::report::{Cost, Ending, RunReport, Source, peak_memory_bytes};
use crate::trajectory::{TimedPose, write_trajectory};

/// What a run does not know of itself.
#[derive(Debug, Clone)]
pub struct About<C> {
    /// The program's configuration, for the report and the saved map.
    pub config: C,
    /// Where the scans came from.
    pub source: Source,
    /// The log's odometry was used.
    pub odometry: bool,
    /// How it ended, or that it goes on.
    pub ending: Ending,
    /// What ended it early, if anything did.
    pub fault: Option<String>,
}

impl<L: LowLevel> Run<'_, L> {
    /// Writes the results as they are now into `folder`; the run can go on. One that has come to its end is [finished](Self::finish) first.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write_into<C: Serialize + Clone>(
        &mut self,
        folder: &Path,
        about: &About<C>,
    ) -> anyhow::Result<RunReport<C>> {
        let started = WallInstant::now();
        // Who interrupts it does not wait.
        if matches!(about.ending, Ending::Complete | Ending::Failed) {
            self.finish();
        }
        let trajectory = self.trajectory();
        let map = self.drawn(&trajectory);
        // Without a known cell there is nothing to draw; the report says how many beams hit.
        let raster = map.raster(PGM_SIDE_MAX);
        if let Some(raster) = &raster {
            write_map(folder, "map", raster)?;
            self.bag.iter().for_each(|bag| bag.map(raster));
        }
        let walls = self.revisited_walls(&trajectory);
        let quality = self.quality_of(&trajectory, raster.as_ref(), &walls);
        if let Some(raster) = map.raster(self.config.map.picture_px) {
            let (has_times, trust) = (about.source.has_times(), &*self.trust());
            let contradicted = if quality.is_drawn_twice() { &*walls.contradicted } else { &[] };
            let notes = PictureNotes { truth: &[], has_times, found_after_s: 0.0, trust, contradicted };
            write_picture(&folder.join("map.png"), &raster, &trajectory, &notes)?;
        }
        self.steps.write(&folder.join("steps.csv"))?;
        self.save_map(folder, &trajectory, toml::to_string(&about.config)?)
            .with_context(|| cannot_write(&folder.join(saved_map::FILE_NAME)))?;
        drop(trajectory);
        write_trajectory(&folder.join("trajectory.tum"), self.trusted_trajectory())?;
        self.working += started.elapsed();
        let report = self.report(about, quality);
        save_json(&folder.join("run.json"), &report)?;
        Ok(report)
    }

    /// The map as it is now, as `map.pgm` has it; `None` without a known cell. Costs as much as drawing it.
    pub fn raster(&self) -> Option<Raster> {
        self.drawn(&self.trajectory()).raster(PGM_SIDE_MAX)
    }

    /// What it noticed of itself so far. Costs as much as drawing the map.
    pub fn quality(&self) -> Quality {
        let trajectory = self.trajectory();
        let raster = self.drawn(&trajectory).raster(PGM_SIDE_MAX);
        self.quality_of(&trajectory, raster.as_ref(), &self.revisited_walls(&trajectory))
    }

    fn revisited_walls(&self, trajectory: &[TimedPose]) -> RevisitedWalls {
        RevisitedWalls::find(|take| self.each_scan(trajectory, take))
    }

    fn quality_of(&self, trajectory: &[TimedPose], raster: Option<&Raster>, walls: &RevisitedWalls) -> Quality {
        let size_m = raster.map(|raster| [raster.width, raster.height].map(|side| side as f64 * raster.pixel_size_m));
        Quality::of(&self.fits, trajectory, size_m, (self.high_counts().as_ref(), walls))
    }

    /// Writes all that is needed to draw the map again.
    fn save_map(&self, folder: &Path, trajectory: &[TimedPose], config: String) -> anyhow::Result<()> {
        if let Some(high) = &self.high {
            return map_of(config, high).write(folder);
        }
        let mut scans = vec![None; trajectory.len()];
        for (scan, place) in self.drawn.iter().enumerate() {
            scans[*place] = u32::try_from(scan).ok();
        }
        let path = trajectory.iter().copied().zip(scans);
        let high = HighSlam::of_path(&self.config.high_slam(), path, self.scans.clone())?;
        map_of(config, &high).write(folder)
    }

    /// The kept scans, drawn from the path of the highest level.
    fn drawn(&self, trajectory: &[TimedPose]) -> Cow<'_, OccupancyMap> {
        if self.high.is_none() && !self.low.has_particles() {
            return Cow::Borrowed(&self.map);
        }
        let mut map = OccupancyMap::new(self.config.map);
        self.each_scan(trajectory, &mut |sweep, map_from_robot| map.insert(sweep, map_from_robot));
        Cow::Owned(map)
    }

    /// Hands out the kept scans, and where the robot was by the highest level, in the order of the way.
    fn each_scan(&self, trajectory: &[TimedPose], take: &mut dyn FnMut(&Sweep<'_>, Pose2)) {
        if let Some(high) = &self.high {
            return high.each_scan(take);
        }
        let mut beams = Vec::new();
        for (scan, place) in self.drawn.iter().enumerate() {
            if let (Some(sweep), Some(pose)) = (self.scans.sweep(scan, &mut beams), trajectory.get(*place)) {
                take(&sweep, pose.map_from_robot);
            }
        }
    }

    fn report<C: Clone>(&self, about: &About<C>, quality: Quality) -> RunReport<C> {
        RunReport {
            program: Program::THIS,
            source: about.source.clone(),
            continues: self.continues.clone(),
            config: about.config.clone(),
            seed: self.seed,
            odometry: about.odometry,
            beams: self.beams,
            matching: self.low.counts(),
            particles: self.steps.summary(),
            high: self.high_counts(),
            quality,
            cost: self.cost(),
            partial: about.ending != Ending::Complete,
            ending: about.ending,
            fault: about.fault.clone().or_else(|| self.aside.fault()),
        }
    }

    fn cost(&self) -> Cost {
        let wall_s = self.working.as_secs_f64();
        Cost {
            scans: self.scans() as u64,
            wall_s,
            scans_per_s: self.scans() as f64 / wall_s.max(1e-6),
            driven_s: self.ends.map_or(0.0, |[first, last]| last.since(first).micros as f64 / 1e6),
            peak_memory_bytes: peak_memory_bytes(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::MappingConfig;
    use crate::mapping::high::test_world::{stretched, to_and_fro};
    use crate::results::quality::Fit;
    use crate::results::report::Input;
    use crate::runs::map::ScanPlace;
    use crate::scans::log::LogCounts;

    /// Who interrupts a run, or looks at it on the way, does not wait for its path to be refined; at its end it is, once.
    #[test]
    fn path_is_refined_at_the_end_of_a_run_and_only_there() {
        let config = MappingConfig::default();
        let mut run = Run::told(&config, 1).unwrap();
        to_and_fro(stretched, false, 0.0, |sweep, low| {
            let (stamp, step) = (sweep.scan.stamp, run.scans());
            let place = ScanPlace { stamp, step, step_from_robot: Pose2::IDENTITY, fit: Fit::from(low) };
            run.place(sweep, low, place, true).unwrap();
        });
        let folder = tempfile::tempdir().unwrap();
        let mut path_after = |ending: Ending| {
            let input = Input { name: "test".to_owned(), sha256: None, bytes: 0, format: None };
            let source = Source::Log { input, log: LogCounts::default(), range_max_m: 30.0 };
            run.write_into(folder.path(), &About { config: config.slam, source, odometry: false, ending, fault: None })
                .unwrap();
            std::fs::read(folder.path().join("trajectory.tum")).unwrap()
        };
        let [running, interrupted] = [Ending::Running, Ending::Interrupted].map(&mut path_after);
        let [complete, again, later] = [Ending::Complete, Ending::Complete, Ending::Interrupted].map(&mut path_after);
        assert!(running == interrupted && complete != running, "only a run that is over is refined");
        assert!(complete == again && complete == later, "and only once");
    }
}
