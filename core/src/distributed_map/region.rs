//! Rectangles of tiles of the plane.

use serde::{Deserialize, Serialize};

use super::TilePlace;

/// Tiles from the first column and row to before the last.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Region {
    /// First, and one past the last.
    pub columns: [i16; 2],
    /// As `columns`.
    pub rows: [i16; 2],
}

impl Region {
    /// The tiles at most `radius` columns and rows from that at `centre`.
    pub fn around(centre: TilePlace, radius: i16) -> Self {
        let along = |centre: i16| [centre.saturating_sub(radius), centre.saturating_add(radius).saturating_add(1)];
        Self { columns: along(centre.column), rows: along(centre.row) }
    }

    /// True if the tile is in it.
    pub fn contains(&self, TilePlace { column, row }: TilePlace) -> bool {
        (self.columns[0]..self.columns[1]).contains(&column) && (self.rows[0]..self.rows[1]).contains(&row)
    }

    /// True if no tile is in it.
    pub fn is_empty(&self) -> bool {
        self.columns[0] >= self.columns[1] || self.rows[0] >= self.rows[1]
    }

    /// The tiles in both.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        let along = |a: [i16; 2], b: [i16; 2]| [a[0].max(b[0]), a[1].min(b[1])];
        Self { columns: along(self.columns, other.columns), rows: along(self.rows, other.rows) }
    }

    /// Tiles in it.
    pub fn places(&self) -> usize {
        length(self.columns) * length(self.rows)
    }

    /// What `whole` has on one side of this part of it, as long as that side, and as wide as no more than `places` tiles allow, but one tile at
    /// least: columns first, then rows; `None` if the part is all of it.
    ///
    /// Part and strip together are a rectangle again: see [`with_strip`](Self::with_strip).
    pub fn next_strip_of(&self, whole: &Self, places: usize) -> Option<Self> {
        if self.is_empty() {
            let columns = beside([whole.columns[0]; 2], whole.columns, places / length(whole.rows).max(1));
            return columns.map(|columns| Self { columns, rows: whole.rows });
        }
        let columns = beside(self.columns, whole.columns, places / length(self.rows).max(1));
        let rows = || beside(self.rows, whole.rows, places / length(self.columns).max(1));
        let in_columns = columns.map(|columns| Self { columns, rows: self.rows });
        in_columns.or_else(|| rows().map(|rows| Self { columns: self.columns, rows }))
    }

    /// This part with a strip beside it that is as long as it is.
    #[must_use]
    pub fn with_strip(&self, strip: &Self) -> Self {
        let joined = |a: [i16; 2], b: [i16; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        if self.is_empty() {
            return *strip;
        }
        Self { columns: joined(self.columns, strip.columns), rows: joined(self.rows, strip.rows) }
    }
}

fn length([first, end]: [i16; 2]) -> usize {
    usize::try_from(i32::from(end) - i32::from(first)).unwrap_or(0)
}

/// What `whole` has before `part` or else behind it, next to it: no more than `width`, but one at least.
fn beside(part: [i16; 2], whole: [i16; 2], width: usize) -> Option<[i16; 2]> {
    let width = i16::try_from(width.max(1)).unwrap_or(i16::MAX);
    let before = (whole[0] < part[0]).then(|| [whole[0].max(part[0].saturating_sub(width)), part[0]]);
    before.or_else(|| (part[1] < whole[1]).then(|| [part[1], whole[1].min(part[1].saturating_add(width))]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn around(column: i16, row: i16, radius: i16) -> Region {
        Region::around(TilePlace { column, row }, radius)
    }

    #[test]
    fn around_a_tile() {
        let region = around(3, -2, 1);
        assert_eq!(region, Region { columns: [2, 5], rows: [-3, 0] });
        let contains = |column, row| region.contains(TilePlace { column, row });
        assert!(contains(2, -1) && !contains(5, -1) && !contains(2, 0));
        assert_eq!(around(i16::MAX, i16::MIN, 7).columns, [i16::MAX - 7, i16::MAX]);
    }

    proptest! {
        #[test]
        fn strips_complete_any_part(
            whole in (-40_i16..40, -40_i16..40, 1_i16..12),
            part in (-40_i16..40, -40_i16..40, 0_i16..12),
            places in 0_usize..200,
        ) {
            let whole = around(whole.0, whole.1, whole.2);
            let mut part = around(part.0, part.1, part.2).intersection(&whole);
            let mut seen = part.places();
            while let Some(strip) = part.next_strip_of(&whole, places) {
                prop_assert!(!strip.is_empty() && part.intersection(&strip).is_empty());
                let is_narrow = length(strip.columns) == 1 || length(strip.rows) == 1;
                prop_assert!(strip.places() <= places || is_narrow, "{strip:?}");
                part = part.with_strip(&strip);
                seen += strip.places();
                prop_assert_eq!(part.places(), seen);
            }
            prop_assert_eq!(part, whole);
        }
    }
}
