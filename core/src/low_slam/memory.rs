//! What the filter borrows.

use crate::ancestry::{AncestryMemoryError, Node};
use crate::distributed_map::{MapMemory, MapMemoryError, TileId, WindowMemoryError};
use crate::particles::{Particle, Sample};
use crate::rays::Ray;

/// Memory that a [`LowSlam`](super::LowSlam) works in, lent by the caller; all zero at first.
#[derive(Debug)]
pub struct LowSlamMemory<'m, const SIDE: usize> {
    /// See [`DistributedMap::new`](crate::distributed_map::DistributedMap::new); one of its `node_tiles` for each of `nodes`.
    pub map: MapMemory<'m, SIDE>,
    /// Two for each particle.
    pub nodes: &'m mut [Node],
    /// P.
    pub particles: &'m mut [Particle],
    /// P times the samples per particle.
    pub samples: &'m mut [Sample],
    /// One for each beam of a scan.
    pub rays: &'m mut [Ray],
    /// See [`Window::new`](crate::distributed_map::Window::new); 4ⁿ, so many that its side covers twice the range and what particles are apart.
    pub window: &'m mut [TileId],
}

impl<const SIDE: usize> LowSlamMemory<'_, SIDE> {
    /// Particles for which there is room, with so many samples each.
    pub fn particles_max(&self, samples_per_particle: u16) -> usize {
        let samples = self.samples.len() / usize::from(samples_per_particle.max(1));
        (self.nodes.len() / 2).min(self.particles.len()).min(samples)
    }
}

/// The memory lent to a [`LowSlam`](super::LowSlam) does not fit together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LowSlamMemoryError {
    /// Of the tree.
    #[error(transparent)]
    Ancestry(#[from] AncestryMemoryError),
    /// Of the map.
    #[error(transparent)]
    Map(#[from] MapMemoryError),
    /// Of the window.
    #[error(transparent)]
    Window(#[from] WindowMemoryError),
    /// There must be room for one particle with its samples, and a tile list for each node.
    #[error("no room for a particle with its samples, or fewer tile lists than nodes")]
    Particles,
}
