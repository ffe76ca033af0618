//! The low level of DP-SLAM: a particle filter over whole maps, one scan at a time (thesis figure 4.20).
//!
//! scan → rays → **predict** every sample's pose ([`Motion`]) → **weigh** it against its map ([`PerceptionModel`]) → **resample**
//! → **advance** the ancestry (prune, collapse, add; the map is told) → **print** the scan into the survivors' maps.
//!
//! The high level (figure 4.19) is the same filter: its steps take whole stretches of the path ([`LowSlam::step_along`]).
//!
//! # Memory
//! All of it is lent by the caller ([`LowSlamMemory`]) and nothing grows. When tiles run out, the least likely particles go
//! until the tree has given enough back; their places are drawn anew at the next resampling. With one particle
//! left, what finds no tile is left out. The [`FilterReport`] says all of that. With P particles, 2P nodes are always enough; the
//! filter takes no more particles than its memory has room for ([`LowSlam::particles_max`]).
//!
//! # Path
//! The core keeps no path: it would grow with the run. [`Particle::parent`] and [`Particle::map_from_robot`] of every step, read
//! after it from [`LowSlam::particles`], are the genealogy: who stores them walks from the best particle's index
//! back, parent by parent, and has the history that its map was built from.
//!
//! # Threads
//! Weighing takes most of the time when more samples are tried than kept. [`LowSlam::step_with`] hands it to the caller, who may share out ranges of
//! particles, each thread with a [`Window`] of its own; every sample has its own random stream. So any number of threads
//! gives the same bytes.

mod memory;
#[cfg(feature = "old-ground")]
mod old_ground;
mod pools;
mod resampling;
mod restart;
mod stretch;
mod upkeep;
mod weighing;

pub use memory::{LowSlamMemory, LowSlamMemoryError};
pub use pools::LowSlamPools;
pub use stretch::Stretch;
pub use weighing::Weighing;

use self::stretch::OneScan;
use crate::ancestry::{Ancestry, NodeId};
use crate::distributed_map::{DistributedMap, ParticleMapConfig, Square, Window, WindowFrame};
use crate::geometry::{Point2, Pose2};
use crate::math::normal;
use crate::motion::Motion;
use crate::particles::{self, Particle, Sample, Weights};
use crate::perception::{PerceptionConfig, PerceptionModel};
use crate::random::RandomStream;
use crate::rays::{Ray, RayCapacityError, RayConfig};
use crate::sweep::Sweep;

/// From so many rays on some are always about where what was seen so far ends; the few of a sparse laser miss it. Chosen.
const CROWDED_RAYS: usize = 64;

crate::config! {
    /// Particle filter of the low level (thesis figure 4.20).
    pub struct LowSlamConfig {
        /// P, particles kept at most; time and memory are in proportion. The original: 50.
        particles: u16 = 50, in 1..=10000;
        /// Particles kept at least. From here to `particles` there are as many as their spread asks for (KLD-sampling: Fox, IJRR 2003), and all of them
        /// where the scene leaves an axis undetermined or a loop is to be closed. As many as `particles`: always all, as the thesis has it.
        particles_min: u16 = 8, in 1..=10000;
        /// Poses tried for each particle kept, with one map: time is in proportion, memory is not. The thesis: 1; the original: 10.
        samples_per_particle: u16 = 1, in 1..=100;
    }
}

/// The configuration of the low level with all its parts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LowSlamConfigs {
    /// Particles.
    pub filter: LowSlamConfig,
    /// Maps.
    pub map: ParticleMapConfig,
    /// Beams.
    pub rays: RayConfig,
    /// Weights.
    pub perception: PerceptionConfig,
    /// Each particle is placed and weighed by [old ground](crate::distributed_map::MapMemory::ages) of its own map, and by nothing else. Where matching knows the last
    /// scans alone, and particles spread as it drifts.
    pub closes_loops: bool,
}

/// What one step did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FilterReport {
    /// Where the most likely particle is.
    pub map_from_robot: Pose2,
    /// Its index among [`LowSlam::particles`].
    pub best: usize,
    /// Weighted mean of the particles' poses.
    pub mean_map_from_robot: Pose2,
    /// Particles alive.
    pub particles: usize,
    /// Poses tried.
    pub samples: usize,
    /// 1 to `samples`, before resampling.
    pub effective_sample_size: f32,
    /// Log weight of the best sample, with what it carried on from the steps before.
    pub best_log_weight: f32,
    /// True if survivors were drawn; false if all went on with their weights.
    pub resampled: bool,
    /// Usable rays of the scan.
    pub rays: usize,
    /// Rays that left the window while printing, all particles together: the window is too small.
    pub rays_cut: u32,
    /// Nodes of the ancestry tree.
    pub nodes: usize,
    /// Edges from its root to the deepest leaf.
    pub depth: usize,
    /// Tiles in use, all maps together.
    pub tiles: usize,
    /// Particles that had to go because the pool of tiles was full.
    pub dropped: usize,
    /// Squares left out because no tile was free with one particle left.
    pub squares_left_out: u32,
}

/// The filter; see the [module](self).
#[derive(Debug)]
pub struct LowSlam<'m, const SIDE: usize> {
    config: LowSlamConfigs,
    /// The laser at the current scan, as seen from a particle's pose.
    particle_from_lrf: Pose2,
    /// Place of the current scan in its stretch.
    scan_index: usize,
    seed: u64,
    steps: u32,
    model: PerceptionModel,
    ancestry: Ancestry<'m>,
    map: DistributedMap<'m, SIDE>,
    window: Window<'m>,
    particles: &'m mut [Particle],
    samples: &'m mut [Sample],
    rays: &'m mut [Ray],
    /// Of these slices, what is in use.
    particle_count: usize,
    sample_count: usize,
    ray_count: usize,
    particles_max: u16,
    /// Survivors drawn the last time: fewer may be left where the pool of tiles was full.
    draws: u16,
    /// Of the particles' mean, m.
    way_m: f32,
    mean_map_from_robot: Pose2,
}

impl<'m, const SIDE: usize> LowSlam<'m, SIDE> {
    /// A filter whose particles all are at the map's origin and have seen nothing yet.
    ///
    /// * `seed` — of all random numbers
    ///
    /// # Errors
    /// [`LowSlamMemoryError`] if the memory does not fit together.
    pub fn new(
        config: &LowSlamConfigs,
        seed: u64,
        memory: LowSlamMemory<'m, SIDE>,
    ) -> Result<Self, LowSlamMemoryError> {
        let room = memory.particles_max(config.filter.samples_per_particle);
        let LowSlamMemory { map, nodes, particles, samples, rays, window } = memory;
        let lists = map.node_tiles.len();
        let has_lists = lists >= nodes.len();
        let ancestry = Ancestry::new(nodes)?;
        let particles_max = config.filter.particles.min(u16::try_from(room).unwrap_or(u16::MAX));
        let Some(first) = particles.first_mut().filter(|_| particles_max > 0 && has_lists) else {
            return Err(LowSlamMemoryError::Particles);
        };
        let draws = config.draws_at_one_place(particles_max);
        *first = Particle { node: NodeId::ROOT, draws, weight: 1.0, ..Particle::default() };
        Ok(Self {
            config: *config,
            particle_from_lrf: Pose2::IDENTITY,
            scan_index: 0,
            seed,
            steps: 0,
            model: PerceptionModel::new(&config.perception, config.map.square_size_m),
            ancestry,
            map: DistributedMap::new(&config.map, map)?,
            window: Window::new(window)?,
            particles,
            samples,
            rays,
            particle_count: 1,
            sample_count: 0,
            ray_count: 0,
            particles_max,
            draws,
            way_m: 0.0,
            mean_map_from_robot: Pose2::IDENTITY,
        })
    }

    /// P: particles that the configuration asks for, or that the memory has room for.
    pub fn particles_max(&self) -> usize {
        usize::from(self.particles_max)
    }

    /// The particles after the last step, in the order of the tree's leaves.
    pub fn particles(&self) -> &[Particle] {
        self.particles.get(..self.particle_count).unwrap_or_default()
    }

    /// The samples of the last step, in the order of the particles they came from.
    pub fn samples(&self) -> &[Sample] {
        self.samples.get(..self.sample_count).unwrap_or_default()
    }

    /// What a particle, by its index, knows of the square that holds `point`, map frame, m; unseen if there is no such particle.
    pub fn square_at(&self, particle: usize, point: Point2) -> Square {
        let particle = self.particles().get(particle);
        particle.map_or(Square::UNSEEN, |particle| self.map.square_at(&self.ancestry, particle.node, point))
    }

    /// All particles' maps.
    pub fn map(&self) -> &DistributedMap<'m, SIDE> {
        &self.map
    }

    /// The same, to let go and take back tiles that no particle has changed.
    pub fn map_mut(&mut self) -> &mut DistributedMap<'m, SIDE> {
        &mut self.map
    }

    /// The tree.
    pub fn ancestry(&self) -> &Ancestry<'m> {
        &self.ancestry
    }

    /// One step of figure 4.20, on one thread; see [`step_with`](Self::step_with).
    ///
    /// # Errors
    /// [`RayCapacityError`] if the scan has more beams than memory was lent for.
    pub fn step(&mut self, sweep: &Sweep<'_>, motion: &impl Motion) -> Result<FilterReport, RayCapacityError> {
        self.step_with(sweep, motion, |weighing, samples, window| weighing.weigh_all(samples, window))
    }

    /// One step of figure 4.20.
    ///
    /// * `sweep` — taken by the laser now; `motion` — what the robot did since the last scan (not looked at by the first step)
    /// * `weigh` — must have every particle weighed once by [`Weighing::weigh`], on any thread; is lent the samples and a
    ///   window for one thread
    ///
    /// # Errors
    /// [`RayCapacityError`] if the scan has more beams than memory was lent for; nothing has changed then.
    pub fn step_with(
        &mut self,
        sweep: &Sweep<'_>,
        motion: &impl Motion,
        weigh: impl FnMut(&Weighing<'_, 'm, SIDE>, &mut [Sample], &mut Window<'m>),
    ) -> Result<FilterReport, RayCapacityError> {
        self.step_along(&mut OneScan(*sweep), Pose2::IDENTITY, motion, weigh)
    }

    /// One step with a whole stretch of the path, which is taken to be rigid: the high level's (figure 4.19).
    ///
    /// * `motion` — moves the particles to where the stretch starts; `start_from_end` — then the stretch moves them to its end
    /// * `weigh` — as in [`step_with`](Self::step_with), called for every scan
    ///
    /// # Errors
    /// [`RayCapacityError`] if a scan has more beams than memory was lent for; nothing has changed then.
    pub fn step_along(
        &mut self,
        stretch: &mut impl Stretch,
        start_from_end: Pose2,
        motion: &impl Motion,
        mut weigh: impl FnMut(&Weighing<'_, 'm, SIDE>, &mut [Sample], &mut Window<'m>),
    ) -> Result<FilterReport, RayCapacityError> {
        (0..stretch.len()).try_for_each(|index| self.take(stretch, index))?;
        if self.steps == 0 {
            // "first read? all particles at x = 0, y = 0, θ = 0", or wherever they were told to start
            let start = self.particles.first().map_or(Pose2::IDENTITY, |particle| particle.map_from_robot);
            let report = self.print_at(start, stretch);
            return report.map(|report| self.moved_by(start_from_end, report));
        }
        let mut report = FilterReport::default();
        self.predict(motion); // "predict, using motion model + particles t−1"
        // Departure: where an axis is open nothing is weighed. Particles that lag see more of what they know, and would win.
        let is_open = motion.is_open() && self.ray_count >= CROWDED_RAYS;
        let weighed = if is_open && !self.config.closes_loops { 0 } else { stretch.len() };
        for index in 0..weighed {
            self.take_again(stretch, index)?;
            let frame = self.frame();
            self.weigh(frame, &mut weigh); // "weigh out, using perception model + low map t−1": eq. (3.39)
        }
        let weights = particles::normalise(self.samples_mut()).unwrap_or_default();
        report.resampled = self.resample(&weights, motion.is_open()); // "resampling particles"
        self.advance(); // §3.2.3.2: prune, collapse, add
        self.print_all(stretch, &mut report)?; // "print low map"
        self.steps = self.steps.saturating_add(1); // "t = t + 1"
        self.finish(&weights, &mut report);
        self.pass(report.mean_map_from_robot);
        Ok(self.moved_by(start_from_end, report))
    }

    /// Puts the only particle, which stands for all draws, at `map_from_robot`, and prints the scans there.
    fn print_at(
        &mut self,
        map_from_robot: Pose2,
        stretch: &mut impl Stretch,
    ) -> Result<FilterReport, RayCapacityError> {
        let draws = self.draws;
        self.sample_count = 1;
        if let (Some(sample), Some(particle)) = (self.samples.first_mut(), self.particles.first_mut()) {
            *sample = Sample { map_from_robot, draws, weight: 1.0, ..Sample::default() };
            particle.samples = [0, 1];
        }
        let mut report = FilterReport::default();
        self.advance();
        self.print_all(stretch, &mut report)?;
        self.steps = self.steps.saturating_add(1);
        self.finish(&Weights { effective_sample_size: 1.0, ..Weights::default() }, &mut report);
        Ok(report)
    }

    /// Every draw of a particle tries its samples' poses, each with its own random stream.
    fn predict(&mut self, motion: &impl Motion) {
        let shares = u32::from(self.config.filter.samples_per_particle.max(1));
        let mut next = 0;
        let particles = self.particles.iter_mut().take(self.particle_count);
        for (parent, particle) in particles.enumerate() {
            let end = next + u32::from(particle.draws) * shares;
            particle.samples = [next, end];
            for (index, sample) in (next..end).zip(self.samples.iter_mut().skip(next as usize)) {
                let mut rng = RandomStream::new(self.seed, self.steps, index);
                let speed = match particle.speed {
                    _ if !motion.carries_speed() => 0.0,
                    0.0 => normal(&mut rng),
                    kept => kept,
                };
                let map_from_robot = motion.sample_at_speed(particle.map_from_robot, speed, &mut rng);
                let (parent, log_weight) = (parent as u16, particle.log_weight);
                *sample = Sample { map_from_robot, log_weight, parent, speed, ..Sample::default() };
            }
            next = end;
        }
        self.sample_count = (next as usize).min(self.samples.len());
    }

    fn weigh(
        &mut self,
        frame: WindowFrame,
        weigh: &mut impl FnMut(&Weighing<'_, 'm, SIDE>, &mut [Sample], &mut Window<'m>),
    ) {
        let first_ray = self.phase() % usize::from(self.config.perception.beam_step.max(1));
        let weighing = Weighing {
            map: &self.map,
            ancestry: &self.ancestry,
            particles: self.particles.get(..self.particle_count).unwrap_or_default(),
            rays: self.rays.get(first_ray.min(self.ray_count)..self.ray_count).unwrap_or_default(),
            #[cfg(feature = "old-ground")]
            all_rays: self.rays.get(..self.ray_count).unwrap_or_default(),
            closes_loops: self.config.closes_loops,
            model: &self.model,
            particle_from_lrf: self.particle_from_lrf,
            frame,
        };
        weigh(&weighing, self.samples.get_mut(..self.sample_count).unwrap_or_default(), &mut self.window);
    }

    /// The window of this step: all samples' positions, as far as the scan's longest ray goes about them.
    fn frame(&self) -> WindowFrame {
        let longest = self.rays.iter().take(self.ray_count).map(|ray| ray.length_m).fold(0.0, f32::max);
        let squares = 2.0 * self.config.map.square_size_m;
        let beyond = self.model.reach_m().max(self.old_ground_reach_m());
        let reach = longest + beyond + self.particle_from_lrf.position().norm() + squares;
        let (mut low, mut high) = (Point2::new(f32::MAX, f32::MAX), Point2::new(f32::MIN, f32::MIN));
        for pose in self.samples().iter().map(|sample| sample.map_from_robot).filter(|pose| pose.is_finite()) {
            low = Point2::new(low.x.min(pose.x), low.y.min(pose.y));
            high = Point2::new(high.x.max(pose.x), high.y.max(pose.y));
        }
        let reach = Point2::new(reach, reach);
        let tile_m = SIDE as f32 * self.config.map.square_size_m;
        WindowFrame::around(low - reach, high + reach, self.window.side(), tile_m)
    }

    /// Of the rays and beams that are left out in turns.
    fn phase(&self) -> usize {
        self.steps as usize + self.scan_index
    }

    fn samples_mut(&mut self) -> &mut [Sample] {
        self.samples.get_mut(..self.sample_count).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests;
