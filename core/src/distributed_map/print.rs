//! Writing a scan into the map of one particle.

use crate::chords::Chord;
use crate::geometry::{Point2, Pose2};
use crate::math::sin_cos;
use crate::rays::Ray;

use super::tiles::{DistributedMap, PoolFullError};
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
    /// Rays done, and squares done of the next one.
    rays_done: usize,
    squares_done: usize,
    report: PrintReport,
}

impl<'a> Print<'a> {
    /// To print `rays`, seen by a laser at `map_from_lrf`.
    pub fn new(rays: &'a [Ray], map_from_lrf: Pose2) -> Self {
        Self { rays, map_from_lrf, rays_done: 0, squares_done: 0, report: PrintReport::default() }
    }

    /// Prints into the map that `window` shows: distance into every square passed, a hit into the last one of a ray that hit
    /// something (thesis §3.2.3.1). The window's leaf gets a tile of its own wherever it had none.
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
        while let Some(ray) = self.rays.get(self.rays_done) {
            let direction = Point2::new(
                cos * ray.direction.x - sin * ray.direction.y,
                sin * ray.direction.x + cos * ray.direction.y,
            );
            let (chords, cut) = window.ray::<SIDE>(start, direction, ray.length_m / map.config.square_size_m);
            self.print_ray(map, window, chords, ray.hit && !cut)?;
            self.report.rays_cut += u32::from(cut);
            self.rays_done += 1;
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
        let mut chords = chords.skip(self.squares_done).peekable();
        while let Some(chord) = chords.next() {
            let is_end = hit && chords.peek().is_none();
            write(map, window, &chord, is_end)?;
            self.squares_done += 1;
        }
        Ok(())
    }
}

/// Writes one chord into the window's leaf's own tile, which is made if there is none yet.
#[inline]
fn write<const SIDE: usize>(
    map: &mut DistributedMap<'_, SIDE>,
    window: &mut Window<'_>,
    chord: &Chord,
    is_end: bool,
) -> Result<(), PoolFullError> {
    let slot = window.slot_of::<SIDE>(chord.x, chord.y);
    let mut id = window.tile_in(slot);
    if map.header(id).owner != window.leaf() {
        id = map.copy(id, window.place_of(slot), window.leaf())?;
        window.set_tile(slot, id);
    }
    let mask = SIDE - 1;
    let row = map.tiles.get_mut(id.index()).and_then(|tile| tile.squares.get_mut(chord.y as usize & mask));
    if let Some(square) = row.and_then(|row| row.get_mut(chord.x as usize & mask)) {
        if is_end { square.hit(chord.length()) } else { square.pass(chord.length()) }
    }
    Ok(())
}
