//! Writing a scan into the map of one particle.

use crate::chords::Chord;
use crate::geometry::{Point2, Pose2};
use crate::math::sin_cos;
use crate::rays::Ray;

use super::tiles::{DistributedMap, PoolFullError, TileId};
use super::window::Window;

/// What a scan did to the map of one particle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PrintReport {
    /// Rays that left the window: they clear their way up to its border and mark no end.
    pub rays_cut: u32,
    /// Squares left out because no tile was free.
    pub squares_left_out: u32,
}

/// A scan on its way into a map. It can be stopped by a full pool and goes on where it was when there is room again.
#[derive(Debug)]
pub struct Print<'a> {
    rays: &'a [Ray],
    map_from_lrf: Pose2,
    /// The next ray, how many on the one after it is, and squares done of the next one.
    next_ray: usize,
    ray_step: usize,
    squares_done: usize,
    report: PrintReport,
}

impl<'a> Print<'a> {
    /// To print `rays`, seen by a laser at `map_from_lrf`.
    pub fn new(rays: &'a [Ray], map_from_lrf: Pose2) -> Self {
        Self { rays, map_from_lrf, next_ray: 0, ray_step: 1, squares_done: 0, report: PrintReport::default() }
    }

    /// Only every `step`-th ray, from `first` on.
    #[must_use]
    pub fn every(self, step: usize, first: usize) -> Self {
        Self { next_ray: first, ray_step: step.max(1), ..self }
    }

    /// Prints into the map that `window` shows: distance into every square passed, a hit into the last one of a ray that hit
    /// something (thesis §3.2.3.1). The window's leaf gets a tile of its own wherever something changes and it had none.
    ///
    /// # Errors
    /// [`PoolFullError`] if there is no tile for the next square. Call again when some have been given back, or
    /// [`skip_square`](Self::skip_square) first.
    pub fn run<const SIDE: usize>(
        &mut self,
        map: &mut DistributedMap<'_, SIDE>,
        window: &mut Window<'_>,
    ) -> Result<PrintReport, PoolFullError> {
        let start = window.to_squares::<SIDE>(self.map_from_lrf.position(), map.config.square_size_m);
        let (sin, cos) = sin_cos(self.map_from_lrf.heading);
        while let Some(ray) = self.rays.get(self.next_ray) {
            let direction = Point2::new(
                cos * ray.direction.x - sin * ray.direction.y,
                sin * ray.direction.x + cos * ray.direction.y,
            );
            let (chords, cut) = window.ray::<SIDE>(start, direction, ray.length_m / map.config.square_size_m);
            self.print_ray(map, window, chords, ray.hit && !cut)?;
            self.report.rays_cut += u32::from(cut);
            self.next_ray += self.ray_step;
            self.squares_done = 0;
        }
        Ok(self.report)
    }

    /// Gives up the square for which no tile was free.
    pub fn skip_square(&mut self) {
        self.squares_done += 1;
        self.report.squares_left_out += 1;
    }

    fn print_ray<const SIDE: usize>(
        &mut self,
        map: &mut DistributedMap<'_, SIDE>,
        window: &mut Window<'_>,
        chords: impl Iterator<Item = Chord>,
        hit: bool,
    ) -> Result<(), PoolFullError> {
        let mut chords = chords.skip(self.squares_done);
        let mut open = Open { slot: usize::MAX, id: TileId::NONE, is_own: false };
        let mut next = chords.next();
        while let Some(chord) = next {
            next = chords.next();
            write(map, window, &mut open, &chord, hit && next.is_none())?;
            self.squares_done += 1;
        }
        Ok(())
    }
}

/// The tile that the ray is in.
struct Open {
    slot: usize,
    id: TileId,
    /// It belongs to the window's leaf.
    is_own: bool,
}

/// Writes one chord into the window's leaf's map. A tile of its own is made where something changes and there is none yet.
#[inline]
fn write<const SIDE: usize>(
    map: &mut DistributedMap<'_, SIDE>,
    window: &mut Window<'_>,
    open: &mut Open,
    chord: &Chord,
    is_end: bool,
) -> Result<(), PoolFullError> {
    let slot = window.slot_of::<SIDE>(chord.x, chord.y);
    if slot != open.slot {
        let id = window.tile_in(slot);
        *open = Open { slot, id, is_own: map.header(id).owner == window.leaf() };
    }
    let (x, y) = (chord.x as usize & (SIDE - 1), chord.y as usize & (SIDE - 1));
    let seen = map.square(open.id, x, y);
    let now = if is_end { seen.stopped(chord.length()) } else { seen.passed(chord.length()) };
    if now == seen {
        return Ok(());
    }
    if !open.is_own {
        open.id = map.copy(open.id, window.place_of(slot), window.leaf())?;
        open.is_own = true;
        window.set_tile(slot, open.id);
    }
    map.touch(open.id);
    map.set_square(open.id, x, y, now);
    Ok(())
}
