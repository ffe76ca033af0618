//! What happens to particles between weighing and the next scan: survivors get leaves, print their scan, and go if there is no room.

use crate::ancestry::{Ancestry, NodeId};
use crate::distributed_map::{DistributedMap, Print, Window, WindowFrame};
use crate::geometry::Pose2;
use crate::particles::{Particle, Weights};

use super::{FilterReport, LowSlam};

/// How a full pool was dealt with.
enum Room {
    /// Another particle went.
    OtherWent,
    /// The printing particle is the least likely one.
    SelfMustGo,
    /// It is the only one.
    None,
}

/// The particles of one step with the tree and the maps they live in.
struct Population<'a, 'm, const SIDE: usize> {
    particles: &'a mut [Particle],
    ancestry: &'a mut Ancestry<'m>,
    map: &'a mut DistributedMap<'m, SIDE>,
}

impl<const SIDE: usize> Population<'_, '_, SIDE> {
    /// Takes a particle's leaf out of the tree; a particle whose leaf was renamed by that is told.
    fn prune(&mut self, index: usize) {
        let Some(leaf) = self.particles.get(index).map(|particle| particle.node) else { return };
        let Some(merged) = self.ancestry.prune(leaf, self.map) else { return };
        if let Some(particle) = self.ancestry.particle(merged).and_then(|owner| self.particles.get_mut(owner)) {
            particle.node = merged;
        }
    }

    /// The particle dies now: it is marked by having no draws.
    fn drop(&mut self, index: usize) {
        self.prune(index);
        if let Some(particle) = self.particles.get_mut(index) {
            particle.draws = 0;
        }
    }

    /// Lets the least likely particle go, if it is not the one at `printing`.
    fn make_room(&mut self, printing: usize) -> Room {
        let alive = self.particles.iter().enumerate().filter(|(_, particle)| particle.draws > 0);
        if alive.clone().count() <= 1 {
            return Room::None;
        }
        match alive.min_by(|(i, a), (j, b)| a.weight.total_cmp(&b.weight).then(j.cmp(i))) {
            Some((index, _)) if index != printing => {
                self.drop(index);
                Room::OtherWent
            }
            _ => Room::SelfMustGo,
        }
    }

    fn node(&self, index: usize) -> NodeId {
        self.particles.get(index).map_or(NodeId::NONE, |particle| particle.node)
    }

    /// Prints into the map of the particle that `window` shows, making room where there is none; false if it must go itself.
    fn print(
        &mut self,
        index: usize,
        mut print: Print<'_>,
        window: &mut Window<'_>,
        report: &mut FilterReport,
    ) -> bool {
        loop {
            let Ok(printed) = print.run(self.map, window) else {
                match self.make_room(index) {
                    Room::OtherWent => window.rename_leaf(self.node(index)),
                    Room::SelfMustGo => return false,
                    Room::None => print.skip_square(),
                }
                continue;
            };
            report.rays_cut += printed.rays_cut;
            report.squares_left_out += printed.squares_left_out;
            return true;
        }
    }
}

/// Weighted mean of the particles' poses, seen from one of them, so that headings do not wrap.
fn mean_from(centre: Pose2, particles: &[Particle]) -> Pose2 {
    let (mut sum, mut weights) = (Pose2::IDENTITY, 0.0);
    for particle in particles.iter().filter(|particle| particle.map_from_robot.is_finite()) {
        let Pose2 { x, y, heading } = centre.between(particle.map_from_robot);
        let weight = particle.weight;
        sum = Pose2 { x: sum.x + weight * x, y: sum.y + weight * y, heading: sum.heading + weight * heading };
        weights += weight;
    }
    let scale = if weights > 0.0 { 1.0 / weights } else { 0.0 };
    Pose2::new(scale * sum.x, scale * sum.y, scale * sum.heading)
}

impl<'m, const SIDE: usize> LowSlam<'m, SIDE> {
    /// Brings the tree up to the survivors (§3.2.3.2): particles without one are pruned, an only survivor goes on in its parent's leaf,
    /// several get leaves below it. Then survivors are the particles.
    pub(super) fn advance(&mut self) {
        for index in 0..self.particle_count {
            if self.survivors_of(index) == 0 {
                self.population().prune(index);
            }
        }
        for index in 0..self.particle_count {
            self.attach_survivors(index);
        }
        self.take_over_survivors();
    }

    /// All particles but the first go.
    pub(super) fn keep_one(&mut self) {
        for index in 1..self.particle_count {
            self.population().prune(index);
        }
        self.particle_count = self.particle_count.min(1);
    }

    /// Number of survivors among the samples of a particle.
    fn survivors_of(&self, index: usize) -> usize {
        let Some([first, end]) = self.particles.get(index).map(|particle| particle.samples) else { return 0 };
        let samples = self.samples.get(first as usize..end as usize).unwrap_or_default();
        samples.iter().filter(|sample| sample.draws > 0).count()
    }

    /// Gives each survivor of a particle its leaf. A pool without nodes, which 2P exclude, would cost the survivor its place.
    fn attach_survivors(&mut self, index: usize) {
        let siblings = self.survivors_of(index);
        let Some(Particle { node, samples: [first, end], .. }) = self.particles.get(index).copied() else { return };
        let samples = self.samples.get_mut(first as usize..end as usize).unwrap_or_default();
        for sample in samples.iter_mut().filter(|sample| sample.draws > 0) {
            let leaf = if siblings == 1 { Some(node) } else { self.ancestry.add(node) };
            sample.node = leaf.unwrap_or_default();
            sample.draws = if leaf.is_some() { sample.draws } else { 0 };
        }
    }

    fn take_over_survivors(&mut self) {
        let survivors = self.samples.iter().take(self.sample_count).filter(|sample| sample.draws > 0);
        let mut count = 0;
        for (particle, sample) in self.particles.iter_mut().zip(survivors) {
            *particle = Particle {
                map_from_robot: sample.map_from_robot,
                node: sample.node,
                draws: sample.draws,
                parent: sample.parent,
                weight: sample.weight,
                log_weight: sample.log_weight,
                speed: sample.speed,
                samples: [0, 0],
            };
            self.ancestry.set_particle(sample.node, count);
            count += 1;
        }
        self.particle_count = usize::from(count);
    }

    /// Prints the scan into every particle's map. Particles for whose map there is no room go.
    pub(super) fn print(&mut self, frame: WindowFrame, report: &mut FilterReport) {
        let phase = self.phase();
        let rays = self.rays.get(..self.ray_count).unwrap_or_default();
        let mut population = Population {
            particles: self.particles.get_mut(..self.particle_count).unwrap_or_default(),
            ancestry: &mut self.ancestry,
            map: &mut self.map,
        };
        // There is no next time for what the first scan leaves out: the second is weighed against it.
        let ray_step = if self.steps == 0 { 1 } else { usize::from(self.config.map.print_step.max(1)) };
        let window = &mut self.window;
        let mut leaf = Some(population.ancestry.first_leaf(NodeId::ROOT));
        window.open(population.map, population.ancestry, frame, leaf.unwrap_or_default());
        while let Some(index) = leaf.and_then(|leaf| population.ancestry.particle(leaf)) {
            let Some(particle) = population.particles.get(index) else { break };
            let print =
                Print::new(rays, particle.map_from_robot * self.particle_from_lrf).every(ray_step, phase % ray_step);
            let stays = population.print(index, print, window, report);
            leaf = window.next_leaf(population.map, population.ancestry);
            if !stays {
                let next = leaf.and_then(|leaf| population.ancestry.particle(leaf));
                population.drop(index);
                leaf = next.map(|next| population.node(next));
                window.rename_leaf(leaf.unwrap_or_default());
            }
        }
        report.dropped += self.close_ranks();
    }

    /// Particles without draws are taken out of their ranks; returns how many.
    fn close_ranks(&mut self) -> usize {
        let mut kept = 0;
        for index in 0..self.particle_count {
            let Some(particle) = self.particles.get(index).copied().filter(|particle| particle.draws > 0) else {
                continue;
            };
            if let Some(place) = self.particles.get_mut(kept) {
                *place = particle;
                self.ancestry.set_particle(particle.node, kept as u16);
                kept += 1;
            }
        }
        let dropped = self.particle_count - kept;
        self.particle_count = kept;
        dropped
    }

    pub(super) fn finish(&self, weights: &Weights, report: &mut FilterReport) {
        let particles = self.particles();
        let best = particles.iter().enumerate().rev().max_by(|(_, a), (_, b)| a.weight.total_cmp(&b.weight));
        if let Some((index, particle)) = best {
            report.best = index;
            report.map_from_robot = particle.map_from_robot;
            report.mean_map_from_robot = particle.map_from_robot * mean_from(particle.map_from_robot, particles);
        }
        report.particles = particles.len();
        report.samples = self.sample_count;
        report.effective_sample_size = weights.effective_sample_size;
        report.best_log_weight = weights.best_log_weight;
        report.rays = self.ray_count;
        report.nodes = self.ancestry.nodes_used();
        report.depth = particles.iter().map(|particle| self.ancestry.depth(particle.node)).max().unwrap_or(0);
        report.tiles = self.map.tiles_used();
    }

    /// The particles' mean has come to `mean_map_from_robot`.
    pub(super) fn pass(&mut self, mean_map_from_robot: Pose2) {
        self.way_m += self.mean_map_from_robot.between(mean_map_from_robot).position().norm();
        self.mean_map_from_robot = mean_map_from_robot;
        self.map.pass(self.way_m);
    }

    /// How far beyond a ray's end old ground is looked at, m.
    pub(super) fn old_ground_reach_m(&self) -> f32 {
        #[cfg(feature = "old-ground")]
        if self.config.closes_loops {
            return super::old_ground::REACH_M;
        }
        0.0
    }

    fn population(&mut self) -> Population<'_, 'm, SIDE> {
        Population {
            particles: self.particles.get_mut(..self.particle_count).unwrap_or_default(),
            ancestry: &mut self.ancestry,
            map: &mut self.map,
        }
    }
}
