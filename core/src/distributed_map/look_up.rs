//! One square of one particle's map, without a window: for a question now and then.

use crate::ancestry::{Ancestry, NodeId};
use crate::geometry::Point2;
use crate::grid::CellIndex;

use super::Square;
use super::tiles::{DistributedMap, TilePlace};

impl<const SIDE: usize> DistributedMap<'_, SIDE> {
    /// What the particle at `leaf` knows of the square that holds `point`, map frame, m; unseen if that is not finite or off the plane.
    ///
    /// Cost: the tiles owned by the particle and its ancestors but the root. Who asks for many opens a [`Window`](super::Window).
    pub fn square_at(&self, ancestry: &Ancestry<'_>, leaf: NodeId, point: Point2) -> Square {
        let CellIndex { column, row } = CellIndex::containing(point, self.config.square_size_m);
        let side = SIDE as i32;
        let is_finite = point.x.is_finite() && point.y.is_finite();
        let tile = (i16::try_from(column.div_euclid(side)), i16::try_from(row.div_euclid(side)));
        let place = match tile {
            (Ok(column), Ok(row)) if is_finite => TilePlace { column, row },
            _ => return Square::UNSEEN,
        };
        let mut nodes = ancestry.upwards(leaf).filter(|node| *node != NodeId::ROOT);
        let own = nodes.find_map(|node| self.tiles_of(node).find(|id| self.header(*id).place == place));
        let id = own.unwrap_or_else(|| self.agreed(place));
        self.square(id, column.rem_euclid(side) as usize, row.rem_euclid(side) as usize)
    }
}
