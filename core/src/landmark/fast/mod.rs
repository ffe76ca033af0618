//! FastSLAM (thesis §4.2): particles that each have a path, two scales, and a small EKF for every landmark.
//!
//! 1.0 moves particles by the motion model alone and weighs them by what is seen (tables 4.1, 4.2). 2.0 (Montemerlo & Thrun 2003) keeps the
//! motion since the last sighting as a Gaussian, corrects it by the sightings, and draws the pose from that.
//!
//! Few particles cannot say how uncertain a pose was that they were drawn from, and a landmark placed by one would never move again. So each
//! stands for a kernel (regularised particle filter: Musso, Oudjane & Le Gland 2001): its landmarks take the kernel's width as noise.
//!
//! Scales of the odometry are not sampled: given a particle's path they are Gaussian, and drawing a pose corrects them exactly
//! (Rao-Blackwell), as knowing the path makes landmarks independent.
//!
//! control → [predict](FastSlam::predict), O(particles); sightings → [observe](FastSlam::observe), O(particles) for each with known
//! identities, and O(particles · landmarks) where a map is searched or copied by resampling.

mod scene;

use nalgebra::{Matrix2, Vector2};

use self::scene::Scene;
use super::ekf::Landmark;
use super::sight::Sensor;
use super::travel::{Travel, start_covariance};
use super::{Control, LandmarkConfig, ROBOT, RobotCovariance, RobotState, Sighting, SightingCounts};
use crate::math::{normal, uniform};
use crate::random::RandomStream;

/// One landmark of one particle. All zero when unused.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FastLandmark {
    /// Where it is, m.
    pub at: Vector2<f64>,
    /// Covariance of that, given the path, m².
    pub covariance: Matrix2<f64>,
    /// What is known beside.
    pub record: Landmark,
}

/// One particle; its landmarks are in a slice of their own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FastParticle {
    /// The robot's numbers.
    pub robot: RobotState,
    /// Their covariance: of the scales, and with 2.0 of the motion since the last sighting.
    pub covariance: RobotCovariance,
    /// Logarithm of its weight, not normalised.
    pub log_weight: f64,
    /// Its weight; all add up to 1.
    pub weight: f64,
    /// Index, before the last resampling, of the particle that it comes from.
    pub parent: u16,
    /// Landmarks in its map.
    pub landmarks: u16,
}

impl FastParticle {
    /// A particle of an unused pool.
    pub const UNUSED: Self = Self {
        robot: RobotState::new(0.0, 0.0, 0.0, 1.0, 1.0),
        covariance: RobotCovariance::from_array_storage(nalgebra::ArrayStorage([[0.0; ROBOT]; ROBOT])),
        log_weight: 0.0,
        weight: 0.0,
        parent: 0,
        landmarks: 0,
    };
}

/// Memory of a [`FastSlam`].
#[derive(Debug)]
pub struct FastMemory<'m> {
    /// One for each particle, 1 to 65,535.
    pub particles: &'m mut [FastParticle],
    /// As many for each particle.
    pub landmarks: &'m mut [FastLandmark],
}

/// The filter; see the [module](self).
#[derive(Debug)]
pub struct FastSlam<'m> {
    config: LandmarkConfig,
    sensor: Sensor,
    particles: &'m mut [FastParticle],
    landmarks: &'m mut [FastLandmark],
    /// Landmarks for each particle.
    room: usize,
    seed: u64,
    steps: u32,
    seconds: f64,
    has_resampled: bool,
    bandwidth: f64,
}

/// Deviations of a pose, m and rad, below which it counts as known.
const DEVIATION_MIN: f64 = 1e-12;

impl<'m> FastSlam<'m> {
    /// Particles at the map's origin that know no landmark; `None` without particles, or with more than 65,535.
    pub fn new(config: &LandmarkConfig, seed: u64, memory: FastMemory<'m>) -> Option<Self> {
        let FastMemory { particles, landmarks } = memory;
        let count = u16::try_from(particles.len()).ok().filter(|count| *count > 0)?;
        for (index, particle) in (0..count).zip(particles.iter_mut()) {
            let weight = 1.0 / f64::from(count);
            *particle =
                FastParticle { covariance: start_covariance(config), weight, parent: index, ..FastParticle::UNUSED };
        }
        let room = (landmarks.len() / particles.len()).min(usize::from(u16::MAX));
        let sensor = Sensor::new(config);
        Some(Self {
            config: *config,
            sensor,
            particles,
            landmarks,
            room,
            seed,
            steps: 0,
            seconds: 0.0,
            has_resampled: false,
            bandwidth: bandwidth(f64::from(count)) * f64::from(config.fast_kernel),
        })
    }

    /// All particles.
    pub fn particles(&self) -> &[FastParticle] {
        self.particles
    }

    /// Index of the heaviest.
    pub fn best(&self) -> usize {
        let heaviest = self.particles.iter().enumerate().max_by(|a, b| a.1.weight.total_cmp(&b.1.weight));
        heaviest.map_or(0, |(index, _)| index)
    }

    /// Landmarks of the particle of this index.
    pub fn landmarks(&self, particle: usize) -> &[FastLandmark] {
        let count = self.particles.get(particle).map_or(0, |particle| usize::from(particle.landmarks));
        self.landmarks.get(particle * self.room..particle * self.room + count).unwrap_or(&[])
    }

    /// Weighted mean of the robots; headings by their directions.
    pub fn mean(&self) -> RobotState {
        let mut mean: RobotState = self.particles.iter().map(|p| p.robot * p.weight).sum();
        let part = |of: fn(f64) -> f64| self.particles.iter().map(|p| of(p.robot.z) * p.weight).sum::<f64>();
        mean.z = libm::atan2(part(libm::sin), part(libm::cos));
        mean
    }

    /// Covariance of the robots about [their mean](Self::mean), the particles' own included.
    pub fn covariance(&self) -> RobotCovariance {
        let mean = self.mean();
        let of = |p: &FastParticle| {
            let mut off = p.robot - mean;
            off.z = super::wrap_angle(off.z);
            (off * off.transpose() + p.covariance) * p.weight
        };
        self.particles.iter().map(of).sum()
    }

    /// True if the last sightings ended in resampling: then particles have [parents](FastParticle::parent) other than themselves.
    pub fn has_resampled(&self) -> bool {
        self.has_resampled
    }

    /// Moves every particle (eq. 4.21); a control that is not finite changes nothing and gives false.
    pub fn predict(&mut self, control: &Control) -> bool {
        let Some(travel) = Travel::new(control, &self.config) else { return false };
        self.seconds += travel.seconds;
        self.steps = self.steps.wrapping_add(1);
        for (index, particle) in (0_u32..).zip(self.particles.iter_mut()) {
            let (jacobian, noise) = travel.jacobian_and_noise(&particle.robot);
            particle.covariance = jacobian * particle.covariance * jacobian.transpose() + noise;
            particle.robot = travel.moved(&particle.robot);
            if !self.config.fast_proposal {
                draw_pose(particle, &mut RandomStream::new(self.seed, self.steps, index));
            }
        }
        true
    }

    /// Takes what was seen at one moment: corrects, draws, weighs, and resamples when half of the particles do not count any more.
    ///
    /// * returns what the sightings did to the heaviest particle
    pub fn observe(&mut self, sightings: &[Sighting]) -> SightingCounts {
        self.has_resampled = false;
        if sightings.is_empty() {
            return SightingCounts::default();
        }
        self.steps = self.steps.wrapping_add(1);
        let best = self.best();
        let mut counts = SightingCounts::default();
        let scene =
            Scene { config: &self.config, sensor: &self.sensor, seconds: self.seconds, bandwidth: self.bandwidth };
        let maps = self.landmarks.chunks_mut(self.room.max(1));
        for ((index, particle), map) in (0_u32..).zip(self.particles.iter_mut()).zip(maps) {
            let rng = &mut RandomStream::new(self.seed, self.steps, index);
            let of_particle = scene.take(particle, map, sightings, rng);
            if index as usize == best {
                counts = of_particle;
            }
        }
        let effective = normalise(self.particles);
        if effective < 0.5 * self.particles.len() as f64 {
            self.resample();
        }
        counts
    }

    /// Low-variance resampling (Thrun, Burgard & Fox table 4.4), in place: the dead take copies of those drawn again.
    ///
    /// Departure: the thesis draws each on its own, which adds noise for nothing.
    fn resample(&mut self) {
        let count = self.particles.len();
        let first = f64::from(uniform(&mut RandomStream::new(self.seed, self.steps, u32::MAX)));
        // Draws of each are kept in `parent` until they are made.
        let (mut drawn, mut cumulative) = (0_usize, 0.0);
        for index in 0..count {
            let Some(particle) = self.particles.get_mut(index) else { continue };
            cumulative += particle.weight * count as f64;
            let mut draws = 0_u16;
            while drawn < count && (drawn as f64 + first < cumulative || index + 1 == count) {
                draws += 1;
                drawn += 1;
            }
            particle.parent = draws;
        }
        let mut dead = 0;
        for from in 0..count {
            let draws = self.particles.get(from).map_or(0, |particle| particle.parent);
            for _ in 1..draws {
                while self.particles.get(dead).is_some_and(|particle| particle.parent != 0 || dead == from) {
                    dead += 1;
                }
                self.copy(from, dead);
                dead += 1;
            }
        }
        self.has_resampled = true;
        self.name_parents();
    }

    /// Copies a particle with its map; its weight says whose copy it is until [`name_parents`](Self::name_parents).
    fn copy(&mut self, from: usize, to: usize) {
        let used = self.particles.get(from).map_or(0, |particle| usize::from(particle.landmarks));
        let (source, target) = (from * self.room, to * self.room);
        if target + self.room <= self.landmarks.len() && source + used <= self.landmarks.len() {
            self.landmarks.copy_within(source..source + used, target);
        }
        let Some(particle) = self.particles.get(from).copied() else { return };
        if let Some(place) = self.particles.get_mut(to) {
            // A mark that no count of draws is: negative weights name the source.
            *place = FastParticle { weight: -1.0 - from as f64, parent: 1, ..particle };
        }
    }

    fn name_parents(&mut self) {
        let weight = 1.0 / self.particles.len() as f64;
        for (index, particle) in (0_u16..).zip(self.particles.iter_mut()) {
            particle.parent = if particle.weight < 0.0 { (-1.0 - particle.weight) as u16 } else { index };
            (particle.weight, particle.log_weight) = (weight, 0.0);
        }
    }
}

/// Squared width of the best Gaussian kernel for so many draws of a Gaussian in three dimensions: (4 / (5 n))^(2/7) (Silverman 1986).
fn bandwidth(draws: f64) -> f64 {
    libm::pow(4.0 / (5.0 * draws), 2.0 / 7.0)
}

/// Turns log weights into weights that add up to 1, all equal if none is finite; returns 1 / Σ w².
fn normalise(particles: &mut [FastParticle]) -> f64 {
    let best = particles.iter().map(|p| p.log_weight).fold(f64::NEG_INFINITY, f64::max);
    for (index, particle) in (0_u16..).zip(particles.iter_mut()) {
        particle.parent = index;
        particle.log_weight = if best.is_finite() { particle.log_weight - best } else { 0.0 };
        particle.weight = libm::exp(particle.log_weight);
    }
    let sum: f64 = particles.iter().map(|p| p.weight).sum();
    let squares = particles.iter_mut().map(|p| {
        p.weight /= sum;
        p.weight * p.weight
    });
    1.0 / squares.sum::<f64>()
}

/// Draws x, y and heading one after the other, each given the ones before; what depends on them follows exactly.
fn draw_pose(particle: &mut FastParticle, rng: &mut RandomStream) {
    for row in 0..3 {
        let draw = f64::from(normal(rng));
        let column = particle.covariance.column(row).into_owned();
        let variance = column.get(row).copied().unwrap_or(0.0);
        if variance.is_nan() || variance <= DEVIATION_MIN * DEVIATION_MIN {
            continue;
        }
        particle.robot += column * (draw / libm::sqrt(variance));
        particle.covariance -= column * column.transpose() / variance;
    }
    for row in 0..3 {
        particle.covariance.row_mut(row).fill(0.0);
        particle.covariance.column_mut(row).fill(0.0);
    }
    particle.robot.z = super::wrap_angle(particle.robot.z);
}
