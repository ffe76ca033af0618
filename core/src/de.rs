//! Differential evolution on a box (Storn & Price 1997; thesis §2.4.5, table 4.5). It knows numbers, not scans.
//!
//! DE/rand/1/bin: a mutant v = a + F (b − c) of three distinct others, crossed with its parent gene by gene (at least
//! one gene is the mutant's), replaces the parent if it is no worse. A member that improves is replaced in place, so
//! that one population's memory is enough.

use rand_core::Rng;

use crate::math::{clamp, uniform};

crate::config! {
    /// Differential evolution (thesis table 4.5).
    pub struct DeConfig {
        /// NP, members of the population; cost is in proportion. Thesis table 4.5: 100.
        population: u16 = 100, in 4..=1000;
        /// G, generations at most; cost is in proportion. Thesis table 4.5: 50.
        generations: u16 = 50, in 1..=1000;
        /// Fitness below which the search stops early. Thesis 4.4.1: 1.0.
        stop_fitness: f32 = 1.0, in 0.0..=1000.0;
    }
}

/// F, scale of the difference vector. Source: thesis table 4.5.
const SCALE_FACTOR: f32 = 1.0;
/// CR, chance of a gene to come from the mutant. Source: thesis table 4.5.
const CROSSOVER_RATE: f32 = 0.95;

/// One candidate and its fitness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Member<const D: usize> {
    /// The candidate's coordinates.
    pub genes: [f32; D],
    /// Smaller is better.
    pub fitness: f32,
}

impl<const D: usize> Member<D> {
    /// A member of an all-zero pool.
    pub const EMPTY: Self = Self { genes: [0.0; D], fitness: 0.0 };
}

/// A box: each gene between its low and high end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds<const D: usize> {
    /// Low ends.
    pub low: [f32; D],
    /// High ends.
    pub high: [f32; D],
}

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome<const D: usize> {
    /// The best member found.
    pub best: Member<D>,
    /// Generations used.
    pub generations: u16,
    /// True if the fitness fell below `stop_fitness`.
    pub converged: bool,
    /// Members of the final population.
    pub population: usize,
}

/// Minimises `objective` over the box; the final population stays in the front of `memory`.
///
/// * `start` — a first guess that becomes one member; the others are drawn uniformly from the box
/// * `objective(genes, limit)` — fitness at `genes`; it may return any value above `limit` as soon as it knows that the
///   fitness is above it, which changes nothing in the result and saves most of the work
/// * the population is `config.population`, or what `memory` holds if that is less; below 4 members only `start` is tried
///
/// Source: Storn & Price 1997; thesis table 4.5. Departure: members that leave the box are reflected at its wall.
pub fn minimise<const D: usize>(
    config: &DeConfig,
    bounds: &Bounds<D>,
    start: [f32; D],
    memory: &mut [Member<D>],
    rng: &mut impl Rng,
    mut objective: impl FnMut(&[f32; D], f32) -> f32,
) -> Outcome<D> {
    let size = memory.len().min(usize::from(config.population));
    let population = memory.get_mut(..size).unwrap_or_default();
    let mut best = initialise(bounds, start, population, rng, &mut objective);
    let mut generations = 0;
    while generations < config.generations && best.fitness >= config.stop_fitness && size >= 4 {
        generations += 1;
        for parent in 0..size {
            let Some(trial) = trial_genes(bounds, population, parent, rng) else { continue };
            let Some(member) = population.get_mut(parent) else { continue };
            let fitness = objective(&trial, member.fitness);
            if fitness <= member.fitness {
                *member = Member { genes: trial, fitness };
                if fitness < best.fitness {
                    best = *member;
                }
            }
        }
    }
    Outcome { best, generations, converged: best.fitness < config.stop_fitness, population: size }
}

/// Draws the first population and returns its best member.
fn initialise<const D: usize>(
    bounds: &Bounds<D>,
    start: [f32; D],
    population: &mut [Member<D>],
    rng: &mut impl Rng,
    objective: &mut impl FnMut(&[f32; D], f32) -> f32,
) -> Member<D> {
    let mut best = Member { genes: start, fitness: objective(&start, f32::INFINITY) };
    for (index, member) in population.iter_mut().enumerate() {
        if index == 0 {
            *member = best;
            continue;
        }
        let mut ends = bounds.low.iter().zip(&bounds.high);
        let genes = core::array::from_fn(|_| match ends.next() {
            Some((low, high)) => low + uniform(rng) * (high - low),
            None => 0.0,
        });
        *member = Member { genes, fitness: objective(&genes, f32::INFINITY) };
        if member.fitness < best.fitness {
            best = *member;
        }
    }
    best
}

/// The mutant of three others, crossed with the parent. `None` only if the indices were out of range, which they are not.
fn trial_genes<const D: usize>(
    bounds: &Bounds<D>,
    population: &[Member<D>],
    parent: usize,
    rng: &mut impl Rng,
) -> Option<[f32; D]> {
    let [a, b, c] = three_others(population.len(), parent, rng).map(|index| population.get(index));
    let (a, b, c) = (a?.genes, b?.genes, c?.genes);
    let kept = population.get(parent)?.genes;
    let sure = below(D, rng);
    let mut genes = kept;
    for (d, gene) in genes.iter_mut().enumerate() {
        if uniform(rng) < CROSSOVER_RATE || d == sure {
            let mutant = a.get(d)? + SCALE_FACTOR * (b.get(d)? - c.get(d)?);
            *gene = reflect(mutant, *bounds.low.get(d)?, *bounds.high.get(d)?);
        }
    }
    Some(genes)
}

/// Three distinct indices below `size` (≥ 4), none of them `parent`, by the shortest unbiased draw.
fn three_others(size: usize, parent: usize, rng: &mut impl Rng) -> [usize; 3] {
    let mut taken = [parent, 0, 0, 0];
    for count in 1..4_usize {
        let mut index = below(size - count, rng);
        let mut sorted = taken;
        let used = sorted.get_mut(..count).unwrap_or_default();
        used.sort_unstable();
        for used_index in used.iter() {
            if index >= *used_index {
                index += 1;
            }
        }
        if let Some(slot) = taken.get_mut(count) {
            *slot = index;
        }
    }
    let [_, a, b, c] = taken;
    [a, b, c]
}

/// Uniform integer below `size` by multiplication (Lemire's, without the rejection: the bias is below size/2³²).
fn below(size: usize, rng: &mut impl Rng) -> usize {
    ((u64::from(rng.next_u32()) * size as u64) >> 32) as usize
}

/// Back into [low, high]: reflected at the wall that was crossed, clamped if that is not enough.
fn reflect(x: f32, low: f32, high: f32) -> f32 {
    let inside = if x < low {
        low + (low - x)
    } else if x > high {
        high - (x - high)
    } else {
        x
    };
    clamp(inside, low, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::SeedableRng;
    use rand_pcg::Pcg32;

    const BOX: Bounds<3> = Bounds { low: [-5.0; 3], high: [5.0; 3] };

    /// Rastrigin's function: 10^3 local minima in the box, the global one at (1, 1, 1).
    fn rastrigin(genes: &[f32; 3]) -> f32 {
        genes.iter().map(|g| (g - 1.0) * (g - 1.0) + 10.0 * (1.0 - libm::cosf(6.283_185_5 * (g - 1.0)))).sum()
    }

    #[test]
    fn finds_the_global_minimum_among_a_thousand_local_ones() {
        let config = DeConfig { population: 200, generations: 1000, stop_fitness: 1e-3 };
        for seed in 0..10 {
            let mut memory = [Member::EMPTY; 200];
            let mut rng = Pcg32::seed_from_u64(seed);
            let outcome = minimise(&config, &BOX, [-4.0; 3], &mut memory, &mut rng, |g, _| rastrigin(g));
            assert!(outcome.converged, "seed {seed}: {outcome:?}");
            assert!(outcome.best.genes.iter().all(|g| (g - 1.0).abs() < 0.01));
        }
    }

    #[test]
    fn giving_up_early_changes_nothing_in_the_result() {
        let run = |early: bool| {
            let mut memory = [Member::EMPTY; 30];
            let mut rng = Pcg32::seed_from_u64(3);
            minimise(&DeConfig::default(), &BOX, [0.0; 3], &mut memory, &mut rng, |genes, limit| {
                let fitness = rastrigin(genes);
                if early && fitness > limit { f32::INFINITY } else { fitness }
            })
        };
        assert_eq!(run(true), run(false));
    }

    #[test]
    fn stays_in_the_box() {
        let mut memory = [Member::EMPTY; 20];
        let mut rng = Pcg32::seed_from_u64(1);
        minimise(&DeConfig::default(), &BOX, [0.0; 3], &mut memory, &mut rng, |genes, _| {
            assert!(genes.iter().all(|g| (-5.0..=5.0).contains(g)));
            -genes[0]
        });
    }

    #[test]
    fn too_little_memory_still_tries_the_start() {
        let mut rng = Pcg32::seed_from_u64(1);
        let outcome = minimise(&DeConfig::default(), &BOX, [2.0; 3], &mut [], &mut rng, |g, _| g[0]);
        assert_eq!((outcome.best.genes, outcome.generations, outcome.population), ([2.0; 3], 0, 0));
    }

    #[test]
    fn the_three_others_are_distinct_and_all_are_drawn() {
        let mut rng = Pcg32::seed_from_u64(9);
        let mut seen = [0_u32; 5];
        for _ in 0..2000 {
            let [a, b, c] = three_others(5, 2, &mut rng);
            assert!(a != b && b != c && a != c && ![a, b, c].contains(&2));
            [a, b, c].iter().for_each(|i| seen[*i] += 1);
        }
        assert_eq!(seen[2], 0);
        assert!(seen.iter().enumerate().all(|(i, n)| i == 2 || (1350..1650).contains(n)), "{seen:?}");
    }
}
