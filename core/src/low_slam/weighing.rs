//! Weighing samples against the maps of the particles they come from; work that threads can share.

use core::ops::Range;

use crate::ancestry::Ancestry;
use crate::distributed_map::{DistributedMap, MapView, Window, WindowFrame};
use crate::geometry::Pose2;
use crate::particles::{Particle, Sample};
use crate::perception::PerceptionModel;
use crate::rays::Ray;

#[cfg(feature = "old-ground")]
use super::old_ground::OldGround;

/// A step's work of weighing: shared by all threads, changes nothing but the samples given to it.
#[derive(Debug, Clone, Copy)]
pub struct Weighing<'a, 'm, const SIDE: usize> {
    pub(super) map: &'a DistributedMap<'m, SIDE>,
    pub(super) ancestry: &'a Ancestry<'m>,
    pub(super) particles: &'a [Particle],
    pub(super) rays: &'a [Ray],
    #[cfg(feature = "old-ground")]
    pub(super) all_rays: &'a [Ray],
    pub(super) closes_loops: bool,
    pub(super) model: &'a PerceptionModel,
    pub(super) particle_from_lrf: Pose2,
    pub(super) frame: WindowFrame,
}

impl<const SIDE: usize> Weighing<'_, '_, SIDE> {
    /// Number of particles to be weighed.
    pub fn particles(&self) -> usize {
        self.particles.len()
    }

    /// Number of samples of the particles in `range`: they stand together, those of earlier particles before them.
    pub fn samples_of(&self, range: Range<usize>) -> usize {
        let particles = self.particles.get(range).unwrap_or_default();
        particles.iter().map(|particle| (particle.samples[1] - particle.samples[0]) as usize).sum()
    }

    /// Particles for worker `part` of `parts`: about the same number of samples each; together all, in order.
    pub fn share(&self, part: usize, parts: usize) -> Range<usize> {
        let total = self.samples_of(0..self.particles.len());
        let border = |part: usize| {
            let sample = total * part / parts.max(1);
            self.particles.partition_point(|particle| (particle.samples[0] as usize) < sample)
        };
        border(part)..if part + 1 >= parts { self.particles.len() } else { border(part + 1) }
    }

    /// Weighs all samples on this thread.
    pub fn weigh_all(&self, samples: &mut [Sample], window: &mut Window<'_>) {
        self.weigh(0..self.particles(), samples, window);
    }

    /// Adds the log-likelihood of the scan to the log weight of each sample of the particles in `range`; on old ground, moves it too.
    ///
    /// * `samples` — exactly the samples of these particles; `window` — any, of the same size for every thread
    /// * the result depends on neither how the work was shared out nor on what `window` held before
    pub fn weigh(&self, range: Range<usize>, samples: &mut [Sample], window: &mut Window<'_>) {
        let particles = self.particles.get(range).unwrap_or_default();
        let mut rest = samples;
        for (index, particle) in particles.iter().enumerate() {
            let count = ((particle.samples[1] - particle.samples[0]) as usize).min(rest.len());
            let (own, others) = rest.split_at_mut(count);
            rest = others;
            if index == 0 {
                window.open(self.map, self.ancestry, self.frame, particle.node);
            } else {
                window.next_leaf(self.map, self.ancestry);
            }
            let view = MapView::new(self.map, window);
            for sample in own {
                if self.closes_loops {
                    self.place_on_old_ground(view, sample);
                } else {
                    sample.log_weight += self.log_likelihood(view, sample.map_from_robot);
                }
            }
        }
    }

    /// Without the feature `old-ground`, all ground is new.
    #[cfg_attr(not(feature = "old-ground"), allow(unused_variables, clippy::unused_self))]
    fn place_on_old_ground(&self, view: MapView<'_, '_, SIDE>, sample: &mut Sample) {
        #[cfg(feature = "old-ground")]
        {
            let Self { all_rays: rays, particle_from_lrf, .. } = *self;
            let ground = OldGround { view, rays, particle_from_lrf, square_size_m: self.map.square_size_m() };
            if let Some(placed) = ground.place(sample.map_from_robot) {
                sample.map_from_robot = placed.map_from_robot;
                sample.log_weight += placed.log_likelihood;
            }
        }
    }

    fn log_likelihood(&self, view: MapView<'_, '_, SIDE>, map_from_robot: Pose2) -> f32 {
        self.model.log_likelihood(view, self.rays, map_from_robot * self.particle_from_lrf)
    }
}
