//! What is known of a run: the changes that a [`Monitor`](lrfslam_host::monitor::Monitor) gives, put together.

use std::collections::BTreeMap;

use lrfslam_host::monitor::{Status, wire};

/// Cells in a row of a tile that are alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    /// Column of the first, and row, in cells of the map.
    pub column: i32,
    pub row: i32,
    /// How many.
    pub cells: i32,
    pub is_wall: bool,
}

/// Layer, column and row of a tile.
type TileKey = (u32, i32, i32);
/// Lower left and upper right corner, m.
pub(super) type Bounds = ([f32; 2], [f32; 2]);

/// See the [module](self). Lengths in m, in the map's frame.
#[derive(Debug, Default)]
pub(super) struct Picture {
    pub instance: u64,
    pub revision: u64,
    /// Edge of a cell.
    pub cell_m: f32,
    pub tiles: BTreeMap<TileKey, Vec<Run>>,
    pub path: Vec<[f32; 2]>,
    /// Ends of the beams of the last scan, and whether they contradict the map.
    pub hits: Vec<([f32; 2], bool)>,
    pub particles: Vec<[f32; 2]>,
    pub status: Status,
}

/// Numbers off the front of a section.
struct Reader<'b>(&'b [u8]);

impl<'b> Reader<'b> {
    fn word(&mut self) -> Option<[u8; 4]> {
        let (word, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*word)
    }

    fn u32(&mut self) -> Option<u32> {
        self.word().map(u32::from_le_bytes)
    }

    fn i32(&mut self) -> Option<i32> {
        self.word().map(i32::from_le_bytes)
    }

    fn f32(&mut self) -> Option<f32> {
        self.word().map(f32::from_le_bytes)
    }

    fn bytes(&mut self, count: usize) -> Option<&'b [u8]> {
        let (bytes, _) = self.0.split_at_checked(count)?;
        self.0 = self.0.get(count.next_multiple_of(4)..).unwrap_or_default();
        Some(bytes)
    }

    /// Groups of `N` numbers to the end.
    fn groups<const N: usize>(mut self) -> Vec<[f32; N]> {
        let mut groups = Vec::with_capacity(self.0.len() / (4 * N));
        loop {
            let mut group = [0.0; N];
            for value in &mut group {
                let Some(number) = self.f32() else { return groups };
                *value = number;
            }
            groups.push(group);
        }
    }
}

impl Picture {
    /// What is to be asked for: instance and revision.
    pub(super) fn known(&self) -> (u64, u64) {
        (self.instance, self.revision)
    }

    /// Takes changes; what is no such message is left out.
    pub(super) fn take(&mut self, message: &[u8]) {
        let Some((instance, revision, is_all, sections)) = wire::decode(message) else { return };
        if is_all {
            let status = std::mem::take(&mut self.status);
            *self = Self { status, ..Self::default() };
        }
        (self.instance, self.revision) = (instance, revision);
        for (kind, section) in sections {
            let reader = Reader(section);
            match kind {
                2 => drop(self.take_tiles(reader)),
                3 => self.take_path(reader),
                5 => self.hits = reader.groups().into_iter().map(|[x, y, fit]| ([x, y], fit > 2.5)).collect(),
                6 => self.particles = reader.groups().into_iter().map(|[x, y, _, _]| [x, y]).collect(),
                _ => {}
            }
        }
    }

    fn take_tiles(&mut self, mut reader: Reader<'_>) -> Option<()> {
        self.cell_m = reader.f32()?;
        let side = i32::try_from(reader.u32()?).ok()?;
        for _ in 0..reader.u32()? {
            let (layer, column, row) = (reader.u32()?, reader.i32()?, reader.i32()?);
            let length = reader.u32()? as usize;
            let runs = runs(reader.bytes(length)?, (column.wrapping_mul(side), row.wrapping_mul(side)), side);
            self.tiles.insert((layer, column, row), runs);
        }
        Some(())
    }

    fn take_path(&mut self, mut reader: Reader<'_>) {
        let known = reader.u32().unwrap_or(0) as usize;
        self.path.truncate(known);
        self.path.extend(reader.groups().into_iter().map(|[x, y, _, _]| [x, y]));
    }

    /// What is known lies within; `None` of nothing.
    pub(super) fn bounds(&self) -> Option<Bounds> {
        let ends = |run: &Run| {
            let at = |column: i32, row: i32| [column as f32 * self.cell_m, row as f32 * self.cell_m];
            [at(run.column, run.row), at(run.column + run.cells, run.row + 1)]
        };
        let map = self.tiles.values().flatten().flat_map(ends);
        let robot = self.status.pose.map(|[x, y, _]| [x, y]);
        map.chain(robot).fold(None, |bounds: Option<Bounds>, [x, y]| {
            let (low, high) = bounds.unwrap_or(([x, y], [x, y]));
            Some(([low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]))
        })
    }
}

/// Cells of a tile whose first cell is `origin`: runs of a byte, row by row from below.
fn runs(bytes: &[u8], (column, row): (i32, i32), side: i32) -> Vec<Run> {
    let (mut runs, mut at) = (Vec::new(), 0);
    for byte in bytes {
        let (what, mut cells) = (byte >> 6, i32::from(byte & 63) + 1);
        while cells > 0 && side > 0 {
            let in_row = cells.min(side - at % side);
            if what == 1 || what == 2 {
                let (column, row) = (column + at % side, row + at / side);
                runs.push(Run { column, row, cells: in_row, is_wall: what == 2 });
            }
            (at, cells) = (at + in_row, cells - in_row);
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_where_the_runs_have_them() {
        // Three free, then 61 unknown; one unknown, two walls.
        let bytes = [0b0100_0010, 0b0011_1100, 0b0000_0000, 0b1000_0001];
        let wanted = [
            Run { column: 64, row: -64, cells: 3, is_wall: false },
            Run { column: 65, row: -63, cells: 2, is_wall: true },
        ];
        assert_eq!(runs(&bytes, (64, -64), 64), wanted);
    }

    #[test]
    fn a_message_that_is_cut_or_foreign_is_survived() {
        let mut message = wire::MAGIC.to_vec();
        message.extend([&1_u32.to_le_bytes()[..], &[7; 16], &1_u32.to_le_bytes()].concat());
        for kind in 0..9_u32 {
            message.extend([&kind.to_le_bytes()[..], &12_u32.to_le_bytes(), &[255; 12]].concat());
        }
        for end in 0..=message.len() {
            Picture::default().take(&message[..end]);
        }
        let mut picture = Picture::default();
        picture.take(&message);
        assert_eq!(picture.known(), (0x0707_0707_0707_0707, 0x0707_0707_0707_0707));
    }
}
