//! Which particle came from which: the path of every particle alive, in memory that hardly grows.
//!
//! Every step of the filter is a generation of poses with their parents. Generations before the last common ancestor of all
//! particles alive hold one pose each that counts: the rest goes.

use std::collections::VecDeque;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::particles::Particle;

#[derive(Debug, Clone, Copy)]
struct Ancestor {
    pose: Pose2,
    parent: u16,
}

/// See the [module](self).
#[derive(Debug, Default)]
pub struct Genealogy {
    /// What all particles agree on: one pose a step.
    agreed: Vec<Pose2>,
    /// The steps since then.
    generations: VecDeque<Vec<Ancestor>>,
}

impl Genealogy {
    /// Number of steps.
    pub fn steps(&self) -> usize {
        self.agreed.len() + self.generations.len()
    }

    /// Takes the particles after a step.
    pub fn add(&mut self, particles: &[Particle]) {
        let ancestor = |particle: &Particle| Ancestor { pose: particle.map_from_robot, parent: particle.parent };
        self.generations.push_back(particles.iter().map(ancestor).collect());
        // Looking back costs all generations: do it when there are twice as many as could be needed.
        if self.generations.len() >= 64 && self.generations.len().is_power_of_two() {
            self.forget();
        }
    }

    /// Poses at all steps, of the particle that has `index` among the latest.
    pub fn path(&self, index: usize) -> Vec<Pose2> {
        let mut path = self.agreed.clone();
        let agreed = path.len();
        path.resize(self.steps(), Pose2::IDENTITY);
        let mut index = index;
        for (pose, generation) in path[agreed..].iter_mut().zip(&self.generations).rev() {
            let Some(ancestor) = generation.get(index) else { break };
            *pose = ancestor.pose;
            index = usize::from(ancestor.parent);
        }
        path
    }

    /// Particles of each generation that have descendants now, and the steps on which all agree.
    fn forget(&mut self) {
        let mut alive: Vec<bool> = vec![true; self.generations.back().map_or(0, Vec::len)];
        let mut agreed = 0;
        let mut only = Vec::new();
        for (step, generation) in self.generations.iter().enumerate().rev() {
            let mut survivors = alive.iter().enumerate().filter(|(_, alive)| **alive).map(|(index, _)| index);
            if let (Some(index), None) = (survivors.next(), survivors.next()) {
                agreed = agreed.max(step + 1);
                only.push(generation[index].pose);
            }
            let before = step.checked_sub(1).and_then(|before| self.generations.get(before));
            let mut parents = vec![false; before.map_or(0, Vec::len)];
            for (ancestor, _) in generation.iter().zip(&alive).filter(|(_, alive)| **alive) {
                if let Some(parent) = parents.get_mut(usize::from(ancestor.parent)) {
                    *parent = true;
                }
            }
            alive = parents;
        }
        // The children of the last agreed generation point to its only survivor, which is all that is left of it.
        self.agreed.extend(only.iter().rev().take(agreed));
        self.generations.drain(..agreed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::random::RandomStream;
    use rand_core::Rng as _;

    /// Histories kept whole, for comparison.
    #[test]
    fn every_particle_has_the_path_of_its_ancestors_and_old_generations_go() {
        let mut genealogy = Genealogy::default();
        let mut whole: Vec<Vec<Pose2>> = vec![Vec::new()];
        let mut rng = RandomStream::new(5, 0, 0);
        for step in 0..700_u32 {
            let mut parents: Vec<u16> = (0..8).map(|_| (rng.next_u32() as usize % whole.len()) as u16).collect();
            parents.sort_unstable();
            let place = |index: usize| Pose2::new(step as f32, index as f32, 0.0);
            let particles: Vec<Particle> = parents
                .iter()
                .enumerate()
                .map(|(index, &parent)| {
                    let mut particle = Particle::UNUSED;
                    (particle.map_from_robot, particle.parent) = (place(index), parent);
                    particle
                })
                .collect();
            genealogy.add(&particles);
            whole = parents
                .iter()
                .enumerate()
                .map(|(index, &parent)| [&whole[usize::from(parent)][..], &[place(index)]].concat())
                .collect();
        }
        for (index, path) in whole.iter().enumerate() {
            assert_eq!(&genealogy.path(index), path);
        }
        assert!(genealogy.generations.len() < 128, "{} generations kept", genealogy.generations.len());
        assert_eq!(genealogy.steps(), 700);
    }
}
