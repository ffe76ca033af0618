//! How likely a scan is at a pose of a map: rays through squares of some opacity (thesis §3.2.3.1, eq. 3.36–3.39).
//!
//! A ray stops in square i with P(stop = i) = (1 − e^(−τᵢ)) · e^(−Σ τⱼ, j before i), where τ = ρ⁻¹ x: length in the square over
//! the mean distance that rays run in it before they stop. What was measured is then likely by how near that square is
//! to the measured end. So along the free part of a ray τ is only summed up; exponentials are needed near the end alone.
//!
//! Data flow: rays of a scan (lrf frame) and a pose → walk over the map's squares → log-likelihood of the scan.
//!
//! What is not here: dynamic objects, beams that hit two surfaces, dependence between neighbouring beams (but see
//! [`PerceptionConfig::gain`] and [`PerceptionConfig::beam_step`]).

use crate::chords::{Chord, Chords, UNITS_PER_SQUARE};
use crate::distributed_map::{DISTANCE_UNITS, MapView, Square};
use crate::geometry::{Point2, Pose2};
use crate::math::{exp_neg, sin_cos};
use crate::rays::Ray;

/// Entries of the table of the Gaussian: at 3 σ reach it is wrong by at most 0.004.
const GAUSSIAN_STEPS: usize = 256;

crate::config! {
    /// Perception model of the particles (thesis 3.2.3.1).
    pub struct PerceptionConfig {
        /// σ of eq. (3.38): distance of a ray's end from the square it stopped in, m. Laser's noise, the square's size and
        /// what the map is off. The thesis: the laser's at the low level, 0.07 at the high one; the original: 0.13 and 0.41.
        sigma_m: f32 = 0.1, in 0.005..=2.0;
        /// Every so many rays are looked at, others at the next step; cost is in inverse proportion. The thesis: 1.
        beam_step: u16 = 4, in 1..=100;
        /// The log-likelihood is multiplied by this: below 1 where beams are not independent, since they all share
        /// the map's errors. The thesis: 1.
        gain: f32 = 1.0, in 0.001..=10.0;
    }
}

/// How far about the measured end squares count, in σ. Chosen; the original: 4.4, which is slower.
const REACH_SIGMAS: f32 = 3.0;
/// Least likelihood of one ray, of at most 1: so that somebody walking by cannot kill a particle. The original: 0.316.
const FLOOR: f32 = 0.3;
/// Mean distance that a ray runs through squares never seen before it stops, m. Source: the original.
const UNSEEN_FREE_M: f32 = 8.0;
/// Weight of that prior beside what was seen: as if rays had run so far in every square, m. The original: 0.11.
const PRIOR_DISTANCE_M: f32 = 0.1;

/// How far past the measured end of a ray squares are looked at, m.
pub fn reach_m(config: &PerceptionConfig) -> f32 {
    REACH_SIGMAS * config.sigma_m
}

/// The model, its tables made ready for a size of squares; see the [module](self).
#[derive(Debug, Clone)]
pub struct PerceptionModel {
    config: PerceptionConfig,
    squares_per_metre: f32,
    reach_squares: f32,
    /// Least likelihood of a ray.
    floor: f32,
    /// τ beyond which a ray certainly ends at the floor.
    opaque: f32,
    /// Eq. (3.38) by distance from the measured end, [`GAUSSIAN_STEPS`] to the reach.
    gaussian: [f32; GAUSSIAN_STEPS],
    /// Table steps per unit of length.
    steps_per_unit: f32,
    /// Hits that a square never seen is believed to have had.
    prior_hits: f32,
    /// 1 / (distance travelled + prior), per [`Square::distance`]; in 1/[`UNITS_PER_SQUARE`], so that chords need not be converted.
    inverse_distance: [f32; 256],
}

impl PerceptionModel {
    /// The model for squares of `square_size_m`.
    pub fn new(config: &PerceptionConfig, square_size_m: f32) -> Self {
        Self::with_floor(config, square_size_m, FLOOR)
    }

    fn with_floor(config: &PerceptionConfig, square_size_m: f32, floor: f32) -> Self {
        let squares_per_metre = 1.0 / square_size_m;
        let prior = PRIOR_DISTANCE_M * squares_per_metre;
        let sigma = config.sigma_m * squares_per_metre;
        let mut distance = -1.0_f32;
        let inverse_distance = core::array::from_fn(|_| {
            distance += 1.0;
            1.0 / ((distance / DISTANCE_UNITS + prior) * UNITS_PER_SQUARE)
        });
        let mut off = -0.5_f32;
        let gaussian = core::array::from_fn(|_| {
            off += 1.0;
            let sigmas = off * REACH_SIGMAS / GAUSSIAN_STEPS as f32;
            exp_neg(-0.5 * sigmas * sigmas)
        });
        Self {
            config: *config,
            squares_per_metre,
            reach_squares: REACH_SIGMAS * sigma,
            opaque: 0.01 - libm::logf(floor),
            floor,
            gaussian,
            steps_per_unit: GAUSSIAN_STEPS as f32 / (REACH_SIGMAS * sigma * UNITS_PER_SQUARE),
            prior_hits: prior / (UNSEEN_FREE_M * squares_per_metre),
            inverse_distance,
        }
    }

    /// How far past the measured end of a ray squares are looked at, m.
    pub fn reach_m(&self) -> f32 {
        self.reach_squares / self.squares_per_metre
    }

    /// Logarithm of the likelihood of a scan in the map that `view` shows: 0 at best, `gain` · ln `FLOOR` for each ray at worst.
    ///
    /// * `rays` — every `beam_step`-th is used; `map_from_lrf` — pose of the laser
    /// * a ray that hit something counts by eq. (3.39), one that did not by its chance to pass; the Gaussian of eq. (3.38)
    ///   is 1 at its peak, which changes all particles' weights alike
    /// * a ray that is cut by the window's frame counts as one that passed up to there
    /// * finite for every finite pose; −∞ if the pose is not finite
    ///
    /// Cost: one look-up, one multiplication and one addition per square, two exponentials per square near the end.
    ///
    /// Source: eq. (3.37)–(3.39). Departures: logarithms are added (the text says sum, low.c adds logarithms); the end of a
    /// stop is the middle of its chord; a square's density is the mean of its posterior (hits + a) / (distance + b), which is the
    /// prior's in a square never seen, where the original switches between three cases.
    pub fn log_likelihood<const SIDE: usize>(
        &self,
        view: MapView<'_, '_, SIDE>,
        rays: &[Ray],
        map_from_lrf: Pose2,
    ) -> f32 {
        if !map_from_lrf.is_finite() {
            return f32::NEG_INFINITY;
        }
        let start = view.to_squares(map_from_lrf.position());
        let (sin, cos) = sin_cos(map_from_lrf.heading);
        let mut sum = 0.0;
        for ray in rays.iter().step_by(usize::from(self.config.beam_step.max(1))) {
            let direction = Point2::new(
                cos * ray.direction.x - sin * ray.direction.y,
                sin * ray.direction.x + cos * ray.direction.y,
            );
            let likelihood = self.ray_likelihood(view, start, direction, ray);
            sum += libm::logf(if likelihood > self.floor { likelihood } else { self.floor });
        }
        sum * self.config.gain
    }

    /// Likelihood of one ray, 0 to 1; any value below the floor if it is below that.
    #[inline]
    fn ray_likelihood<const SIDE: usize>(
        &self,
        view: MapView<'_, '_, SIDE>,
        start: Point2,
        direction: Point2,
        ray: &Ray,
    ) -> f32 {
        let end = ray.length_m * self.squares_per_metre;
        let beyond = if ray.hit { end + self.reach_squares } else { end };
        let (mut chords, cut) = view.ray(start, direction, beyond);
        let hit = ray.hit && !cut;
        let near = if hit { ((end - self.reach_squares) * UNITS_PER_SQUARE) as i32 } else { i32::MAX };
        let mut depth = 0.0;
        // A copy, so that the walk stays in registers; the first chord near the end is walked again.
        let mut ahead = chords.clone();
        while let Some(chord) = ahead.next() {
            if chord.leave > near {
                return self.stop_likelihood(view, end, depth, chords);
            }
            depth += self.depth(view.square(chord.x, chord.y), &chord);
            if depth > self.opaque {
                return 0.0;
            }
            chords = ahead.clone();
        }
        if hit { 0.0 } else { exp_neg(-depth) }
    }

    /// Eq. (3.39) over the squares near the measured end, `depth` being the sum of τ before them.
    #[inline]
    fn stop_likelihood<const SIDE: usize>(
        &self,
        view: MapView<'_, '_, SIDE>,
        end: f32,
        mut depth: f32,
        chords: Chords,
    ) -> f32 {
        let end = (end * UNITS_PER_SQUARE) as i32;
        let mut transmission = exp_neg(-depth);
        let mut likelihood = 0.0;
        for chord in chords {
            depth += self.depth(view.square(chord.x, chord.y), &chord);
            let left = exp_neg(-depth);
            likelihood += (transmission - left) * self.gaussian(chord.enter + chord.length() / 2 - end);
            transmission = left;
        }
        likelihood
    }

    /// Eq. (3.38) at `off` units from the measured end, 1 at its peak; 0 out of reach.
    #[inline(always)]
    fn gaussian(&self, off: i32) -> f32 {
        let step = (off.unsigned_abs() as f32 * self.steps_per_unit) as usize;
        self.gaussian.get(step).copied().unwrap_or_default()
    }

    /// τ of one chord: its length over the mean distance that rays run in this square before they stop, eq. (3.36).
    #[inline(always)]
    fn depth(&self, square: Square, chord: &Chord) -> f32 {
        let inverse = self.inverse_distance.get(usize::from(square.distance())).copied().unwrap_or_default();
        (f32::from(square.hits()) + self.prior_hits) * inverse * chord.length() as f32
    }
}

#[cfg(test)]
mod tests;
