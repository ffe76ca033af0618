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

    /// What `whole` has on one side of this part of it, as long as that side: columns first, then rows; `None` if it is all of it.
    ///
    /// Part and side together are a rectangle again: see [`with_side`](Self::with_side).
    pub fn next_side_of(&self, whole: &Self) -> Option<Self> {
        if self.is_empty() {
            return Some(*whole);
        }
        let side = |part: [i16; 2], whole: [i16; 2]| {
            let before = (whole[0] < part[0]).then_some([whole[0], part[0]]);
            before.or((part[1] < whole[1]).then_some([part[1], whole[1]]))
        };
        let columns = side(self.columns, whole.columns).map(|columns| Self { columns, rows: self.rows });
        columns.or_else(|| side(self.rows, whole.rows).map(|rows| Self { columns: self.columns, rows }))
    }

    /// Both together if that is a rectangle, which a side that does not touch it, or is shorter, does not give; else only this one.
    #[must_use]
    pub fn with_side(&self, side: &Self) -> Self {
        let covers = |long: [i16; 2], short: [i16; 2]| long[0] <= short[0] && short[1] <= long[1];
        let touches = |a: [i16; 2], b: [i16; 2]| a[0] <= b[1] && b[0] <= a[1];
        let joined = |a: [i16; 2], b: [i16; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        if self.is_empty() {
            *side
        } else if covers(side.rows, self.rows) && touches(side.columns, self.columns) {
            Self { columns: joined(self.columns, side.columns), rows: self.rows }
        } else if covers(side.columns, self.columns) && touches(side.rows, self.rows) {
            Self { columns: self.columns, rows: joined(self.rows, side.rows) }
        } else {
            *self
        }
    }
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

    #[test]
    fn side_that_does_not_fit_adds_nothing() {
        let part = around(0, 0, 2);
        for other in [around(9, 0, 3), Region { columns: [3, 5], rows: [0, 2] }] {
            assert_eq!(part.with_side(&other), part);
        }
    }

    proptest! {
        #[test]
        fn sides_complete_any_part(whole in (-40_i16..40, -40_i16..40, 1_i16..12), part in (-40_i16..40, -40_i16..40, 0_i16..12)) {
            let whole = around(whole.0, whole.1, whole.2);
            let mut part = around(part.0, part.1, part.2).intersection(&whole);
            let mut sides = 0;
            while let Some(side) = part.next_side_of(&whole) {
                prop_assert!(!side.is_empty() && part.intersection(&side).is_empty());
                part = part.with_side(&side);
                sides += 1;
                prop_assert!(sides <= 4);
            }
            prop_assert_eq!(part, whole);
        }
    }
}
