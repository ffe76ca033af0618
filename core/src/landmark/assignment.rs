//! Which landmark a sighting is of: known, nearest, or the most that fit together.
//!
//! Joint compatibility branch and bound: Neira & Tardós, IEEE Trans. Robotics and Automation 17(6), 2001. The factor of the joint covariance
//! grows by two rows with each pair, so that testing one more pair costs O(pairs²). Sources of the gate: thesis eq. (3.23), chi-squared.

use nalgebra::{Matrix2, Vector2};

use super::belief::{Belief, SightJacobian, joined};
use super::ekf::Landmark;
use super::sight::{Sensor, innovation, inverse, mahalanobis};
use super::{Association, LandmarkConfig, Sighting, chi_squared};

/// Sightings that are judged together; more of one moment come in groups of so many.
pub const JOINT_MAX: usize = 16;
/// Landmarks that a sighting may be of.
const CANDIDATES_MAX: usize = 4;
/// Pairs that a search tries at most: a crowd of landmarks nearer to one another than the noise would take for ever.
const TRIES_MAX: u32 = 4000;

/// What a sighting is taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Choice {
    /// The landmark of this index.
    Landmark(u16),
    /// One that was not known.
    New,
    /// Nothing that is certain.
    #[default]
    Neither,
}

/// Chooses for each of up to [`JOINT_MAX`] sightings; no landmark is chosen twice by nearest or joint association.
pub fn associate(
    config: &LandmarkConfig,
    sensor: &Sensor,
    belief: &Belief<'_>,
    landmarks: &[Landmark],
    sightings: &[Sighting],
) -> [Choice; JOINT_MAX] {
    let mut choices = [Choice::Neither; JOINT_MAX];
    if config.association == Association::Known {
        for (choice, sighting) in choices.iter_mut().zip(sightings).filter(|(_, sighting)| is_usable(sighting)) {
            *choice = match sighting.identity {
                Some(_) => known(landmarks.iter().position(|landmark| landmark.identity == sighting.identity)),
                None => Choice::Neither,
            };
        }
        return choices;
    }
    let gate = chi_squared(2, f64::from(config.gate_deviations));
    let search = Search { belief, sensor, sightings, gate_deviations: f64::from(config.gate_deviations) };
    let mut candidates = [Candidates::default(); JOINT_MAX];
    for ((choice, list), sighting) in choices.iter_mut().zip(&mut candidates).zip(sightings) {
        if is_usable(sighting) {
            *list = search.candidates(sighting, landmarks.len(), gate * f64::from(config.new_landmark_gates));
            *choice = if list.count == 0 { Choice::New } else { Choice::Neither };
        }
    }
    let pairs = match config.association {
        Association::Joint => search.joint(&candidates),
        _ => nearest(&candidates, gate),
    };
    for ((choice, list), pair) in choices.iter_mut().zip(&candidates).zip(pairs) {
        // One landmark is seen once at a time: what lies near those of other sightings only is something else.
        let is_other = |near: &(f64, u16)| pairs.contains(&Some(near.1));
        match pair {
            Some(_) => *choice = known(pair.map(usize::from)),
            None if list.count < CANDIDATES_MAX && list.near.iter().take(list.count).all(is_other) => {
                *choice = if list.is_usable { Choice::New } else { Choice::Neither };
            }
            None => {}
        }
    }
    choices
}

/// A sighting with numbers that can be used.
pub(super) fn is_usable(sighting: &Sighting) -> bool {
    sighting.range_m.is_finite() && sighting.range_m > 0.0 && sighting.bearing_rad.is_finite()
}

fn known(landmark: Option<usize>) -> Choice {
    landmark.and_then(|index| u16::try_from(index).ok()).map_or(Choice::New, Choice::Landmark)
}

type Pairs = [Option<u16>; JOINT_MAX];

/// Landmarks near a sighting, the nearest first.
#[derive(Debug, Clone, Copy)]
struct Candidates {
    near: [(f64, u16); CANDIDATES_MAX],
    count: usize,
    /// The sighting has numbers.
    is_usable: bool,
}

impl Default for Candidates {
    fn default() -> Self {
        Self { near: [(f64::INFINITY, 0); CANDIDATES_MAX], count: 0, is_usable: false }
    }
}

/// Each its nearest; of several with the same the nearest of them.
fn nearest(candidates: &[Candidates; JOINT_MAX], gate: f64) -> Pairs {
    let best = |list: &Candidates| list.near.first().filter(|near| near.0 <= gate).copied();
    let mut pairs = [None; JOINT_MAX];
    for (place, list) in candidates.iter().enumerate() {
        let Some((squared, landmark)) = best(list) else { continue };
        let beaten = candidates.iter().enumerate().any(|(other, rival)| {
            best(rival).is_some_and(|(rivals, same)| {
                same == landmark && (rivals < squared || (rivals == squared && other < place))
            })
        });
        if let Some(pair) = pairs.get_mut(place).filter(|_| !beaten) {
            *pair = Some(landmark);
        }
    }
    pairs
}

struct Search<'a> {
    belief: &'a Belief<'a>,
    sensor: &'a Sensor,
    sightings: &'a [Sighting],
    gate_deviations: f64,
}

/// A pair taken for right, with its rows of the joint factor L (2 × 2 blocks) and of L⁻¹ν.
#[derive(Debug, Clone, Copy)]
struct Pair {
    landmark: u16,
    jacobian: SightJacobian,
    row: [Matrix2<f64>; JOINT_MAX],
    whitened: Vector2<f64>,
    /// νᵀS⁻¹ν of the pairs up to here.
    squared: f64,
}

/// State of the search: pairs so far, and the best choice seen.
struct State {
    pairs: heapless::Vec<Pair, JOINT_MAX>,
    chosen: Pairs,
    best: Pairs,
    best_count: usize,
    best_squared: f64,
    tries: u32,
}

impl Search<'_> {
    fn view(&self, sighting: &Sighting, landmark: usize) -> Option<(SightJacobian, Vector2<f64>, Matrix2<f64>)> {
        let view = self.sensor.view(&self.belief.robot(), self.belief.landmark(landmark))?;
        Some((joined(&view), innovation(sighting, &view), self.sensor.noise_of(sighting, view.seen.x, f64::INFINITY)))
    }

    /// Landmarks up to the squared distance `reach`.
    fn candidates(&self, sighting: &Sighting, landmarks: usize, reach: f64) -> Candidates {
        let mut list = Candidates { is_usable: true, ..Candidates::default() };
        for landmark in 0..landmarks.min(usize::from(u16::MAX)) {
            let Some((jacobian, off, noise)) = self.view(sighting, landmark) else { continue };
            let s = self.belief.between(landmark, &jacobian, landmark, &jacobian) + noise;
            let Some((squared, _)) = mahalanobis(off, &s) else { continue };
            if squared > reach {
                continue;
            }
            let place = list.near.iter().take_while(|near| near.0 <= squared).count();
            let mut moved = (squared, landmark as u16);
            for near in list.near.iter_mut().skip(place) {
                core::mem::swap(near, &mut moved);
            }
            list.count = (list.count + 1).min(CANDIDATES_MAX);
        }
        list
    }

    fn joint(&self, candidates: &[Candidates; JOINT_MAX]) -> Pairs {
        let mut state = State {
            pairs: heapless::Vec::new(),
            chosen: [None; JOINT_MAX],
            best: [None; JOINT_MAX],
            best_count: 0,
            best_squared: f64::INFINITY,
            tries: 0,
        };
        self.branch(&mut state, candidates, 0);
        state.best
    }

    /// Tries each candidate of sighting `place` and none of them; as deep as there are sightings.
    fn branch(&self, state: &mut State, candidates: &[Candidates; JOINT_MAX], place: usize) {
        let (Some(list), Some(sighting)) = (candidates.get(place), self.sightings.get(place)) else {
            state.judge();
            return;
        };
        let left = candidates.iter().skip(place + 1).filter(|list| list.count > 0).count();
        let gate = chi_squared(2, self.gate_deviations);
        for &(alone, landmark) in list.near.iter().take(list.count) {
            if alone > gate || state.tries >= TRIES_MAX || state.chosen.contains(&Some(landmark)) {
                continue;
            }
            state.tries += 1;
            let Some(pair) = self.pair(state, sighting, landmark) else { continue };
            let gate = chi_squared(2 * (state.pairs.len() + 1), self.gate_deviations);
            let can_win = state.pairs.len() + 1 + left >= state.best_count;
            if pair.squared > gate || !can_win || state.pairs.push(pair).is_err() {
                continue;
            }
            state.choose(place, Some(landmark));
            self.branch(state, candidates, place + 1);
            state.choose(place, None);
            state.pairs.pop();
        }
        if state.pairs.len() + left >= state.best_count {
            self.branch(state, candidates, place + 1);
        }
    }

    /// The pair with its part of the joint factor: S = L Lᵀ by blocks.
    fn pair(&self, state: &State, sighting: &Sighting, landmark: u16) -> Option<Pair> {
        let index = usize::from(landmark);
        let (jacobian, off, noise) = self.view(sighting, index)?;
        let mut row = [Matrix2::zeros(); JOINT_MAX];
        let mut left = self.belief.between(index, &jacobian, index, &jacobian) + noise;
        let mut whitened = off;
        for (column, earlier) in state.pairs.iter().enumerate() {
            let mut block = self.belief.between(index, &jacobian, usize::from(earlier.landmark), &earlier.jacobian);
            for (mine, theirs) in row.iter().zip(&earlier.row).take(column) {
                block -= mine * theirs.transpose();
            }
            let diagonal = earlier.row.get(column)?.try_inverse()?;
            block *= diagonal.transpose();
            *row.get_mut(column)? = block;
            left -= block * block.transpose();
            whitened -= block * earlier.whitened;
        }
        inverse(&left)?;
        let l11 = libm::sqrt(left.m11);
        let l21 = left.m21 / l11;
        let l22 = libm::sqrt(left.m22 - l21 * l21);
        let diagonal = Matrix2::new(l11, 0.0, l21, l22);
        *row.get_mut(state.pairs.len())? = diagonal;
        let whitened = diagonal.try_inverse()? * whitened;
        let before = state.pairs.last().map_or(0.0, |pair| pair.squared);
        Some(Pair { landmark, jacobian, row, whitened, squared: before + whitened.norm_squared() })
    }
}

impl State {
    fn choose(&mut self, place: usize, landmark: Option<u16>) {
        if let Some(choice) = self.chosen.get_mut(place) {
            *choice = landmark;
        }
    }

    /// More pairs are better; of as many, those that fit better.
    fn judge(&mut self) {
        let squared = self.pairs.last().map_or(0.0, |pair| pair.squared);
        let is_better =
            self.pairs.len() > self.best_count || (self.pairs.len() == self.best_count && squared < self.best_squared);
        if is_better {
            (self.best, self.best_count, self.best_squared) = (self.chosen, self.pairs.len(), squared);
        }
    }
}
