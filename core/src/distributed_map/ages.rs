//! Old ground: what was drawn before the robot went elsewhere. By the way that it made, not by time: it may stand.

use super::tiles::{DistributedMap, TileId};

/// When a tile was drawn, by the way that the robot has made. All zero when new.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TileAge {
    /// Last, dm.
    drawn_dm: u32,
    /// It holds what was drawn long before that.
    is_old: bool,
}

impl TileAge {
    /// Of a tile that nobody has drawn.
    pub const NEW: Self = Self { drawn_dm: 0, is_old: false };
}

/// What was not drawn for so much way is old ground, dm: then the robot has been elsewhere. Chosen: two and a half times as far as rays are believed there.
const OLD_AFTER_DM: u32 = 200;

impl<const SIDE: usize> DistributedMap<'_, SIDE> {
    /// The robot has made so much way, m.
    pub(crate) fn pass(&mut self, way_m: f32) {
        self.way_dm = (10.0 * way_m) as u32;
    }

    /// True if a tile holds what was drawn before the robot went elsewhere. Free space is drawn no more once it is certain, and so becomes old.
    #[inline]
    pub(super) fn is_old(&self, id: TileId) -> bool {
        let age = self.ages.get(id.index()).copied().filter(|_| id != TileId::NONE);
        age.is_some_and(|age| age.is_old || self.way_dm.saturating_sub(age.drawn_dm) >= OLD_AFTER_DM)
    }

    /// A tile is drawn into now.
    #[inline]
    pub(super) fn touch(&mut self, id: TileId) {
        if !self.ages.is_empty() {
            let age = TileAge { drawn_dm: self.way_dm, is_old: self.is_old(id) };
            self.set_age(id, age);
        }
    }

    fn set_age(&mut self, id: TileId, age: TileAge) {
        if let Some(place) = self.ages.get_mut(id.index()) {
            *place = age;
        }
    }

    /// A new tile at the place of `base` is as old as that one.
    pub(super) fn inherit_age(&mut self, id: TileId, base: TileId) {
        let age = self.ages.get(base.index()).copied().filter(|_| base != TileId::NONE);
        self.set_age(id, age.unwrap_or(TileAge { drawn_dm: self.way_dm, is_old: false }));
    }
}
