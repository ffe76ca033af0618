//! Beginning anew in a map that somebody else knows better.

use crate::geometry::Pose2;
use crate::particles::Particle;
use crate::rays::RayCapacityError;
use crate::sweep::Sweep;

use super::LowSlam;
use super::stretch::OneScan;

impl<const SIDE: usize> LowSlam<'_, SIDE> {
    /// Forgets all maps and gathers all particles in one at `map_from_robot`; to be followed by [`refer_to`](Self::refer_to).
    ///
    /// For a high level that has corrected the map.
    pub fn restart_at(&mut self, map_from_robot: Pose2) {
        self.keep_one();
        self.map.clear();
        self.draws = self.config.draws_at_one_place(self.particles_max);
        if let Some(particle) = self.particles.first_mut() {
            let (node, draws) = (particle.node, self.draws);
            *particle = Particle { map_from_robot, node, draws, weight: 1.0, ..Particle::default() };
        }
    }

    /// Gathers all particles at `map_from_robot` in the map of `drawn`, which gets these maps for it.
    ///
    /// * `drawn` — of the same configuration; has been told what to refer to since it was [begun anew](Self::restart_at)
    pub fn go_on_in(&mut self, drawn: &mut Self, map_from_robot: Pose2) {
        core::mem::swap(&mut self.map, &mut drawn.map);
        core::mem::swap(&mut self.ancestry, &mut drawn.ancestry);
        core::mem::swap(&mut self.particles, &mut drawn.particles);
        core::mem::swap(&mut self.particle_count, &mut drawn.particle_count);
        core::mem::swap(&mut self.draws, &mut drawn.draws);
        self.particles.iter_mut().take(1).for_each(|particle| particle.map_from_robot = map_from_robot);
    }

    /// Prints a scan that was taken at `map_from_scan` into the map that all particles share; only after
    /// [`restart_at`](Self::restart_at), before the next step. Returns the squares left out because the pool of tiles is full.
    ///
    /// # Errors
    /// [`RayCapacityError`] if the scan has more beams than memory was lent for; nothing has changed then.
    pub fn refer_to(&mut self, sweep: &Sweep<'_>, map_from_scan: Pose2) -> Result<u32, RayCapacityError> {
        let stretch = &mut OneScan(*sweep);
        self.take(stretch, 0)?;
        self.keep_one();
        let map_from_robot = self.particles.first().map_or(map_from_scan, |particle| particle.map_from_robot);
        let report = self.print_at(map_from_scan, stretch)?;
        self.particles.iter_mut().take(1).for_each(|particle| particle.map_from_robot = map_from_robot);
        Ok(report.squares_left_out)
    }
}
