//! Changes as they are sent: little-endian, sections one after the other, `f32` in m and rad in the map's frame.
//!
//! Head, 28 bytes: `LRFM`, version (`u32`, 1), instance, revision (`u64` each), and (`u32`) 1 if this is all there is and what was known before
//! is void, else 0. Each section: kind (`u32`), length of what follows (`u32`), and so many bytes, padded to a multiple of 4.
//!
//! | kind | content |
//! | --- | --- |
//! | 1 status | [`Status`](super::Status) as JSON |
//! | 2 tiles | edge of a cell; edge of a tile in cells, tiles (`u32`); each: layer, column, row, bytes (`i32`), and these: runs of cells |
//! | 3 path | index of the first point: from there all are replaced; each: x, y, s since the first pose, 1 if trusted else 0 |
//! | 4 closures | each: x, y, x, y of its ends |
//! | 5 scan | each hit: x, y, fit: 0 on a wall, 1 near one, 2 where nothing was known, 3 where the map is free |
//! | 6 particles | each: x, y, heading, weight |
//! | 7 cloud | index of the first point; each: x, y, z |
//! | 8 rates | each `Sample`: s since the first, scans a second, ms a scan, ms late, effective sample size, megabytes |
//! | 9 landmarks | each: x, y, and covariance: xx, xy, yy |
//!
//! A tile's cells go row by row from below, in runs of a byte: two bits of what (0 unknown, 1 free, 2 occupied), six of how many less one.
//! Layer 0 is the map, layer 1 the piece of a robot that was lost. A tile without bytes is unknown.

use super::scene::Scene;
use crate::maps::occupancy::OccupancyMap;

/// First bytes of every message.
pub const MAGIC: [u8; 4] = *b"LRFM";
/// Version of the form.
pub const VERSION: u32 = 1;
/// Bytes of the head.
pub const HEAD: usize = 28;

struct Writer(Vec<u8>);

impl Writer {
    fn u32(&mut self, value: u32) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    fn f32s(&mut self, values: impl IntoIterator<Item = f32>) {
        values.into_iter().for_each(|value| self.0.extend_from_slice(&value.to_le_bytes()));
    }

    fn pad(&mut self) {
        self.0.resize(self.0.len().next_multiple_of(4), 0);
    }

    fn section(&mut self, kind: u32, content: impl FnOnce(&mut Self)) {
        self.u32(kind);
        let at = self.0.len();
        self.u32(0);
        content(self);
        let length = (self.0.len() - at - 4) as u32;
        self.0[at..at + 4].copy_from_slice(&length.to_le_bytes());
        self.pad();
    }
}

/// What has changed in `scene` since the revision `since`.
pub(super) fn encode(scene: &Scene, since: u64) -> Vec<u8> {
    // What is newer than the scene is of nobody.
    let since = if since < scene.began || since > scene.revision() { 0 } else { since };
    let mut out = Writer(Vec::with_capacity(4096));
    out.0.extend_from_slice(&MAGIC);
    out.u32(VERSION);
    out.0.extend_from_slice(&scene.instance().to_le_bytes());
    out.0.extend_from_slice(&scene.revision().to_le_bytes());
    out.u32(u32::from(since == 0));
    let status = serde_json::to_vec(&scene.status).unwrap_or_default();
    out.section(1, |out| out.0.extend_from_slice(&status));
    tiles(&mut out, scene, since);
    path(&mut out, scene, since);
    if scene.closures.changed > since {
        out.section(4, |out| out.f32s(scene.closures.is.iter().copied().flatten()));
    }
    if scene.scan.changed > since {
        out.section(5, |out| out.f32s(scene.scan.is.iter().flat_map(|(x, y, fit)| [*x, *y, f32::from(*fit)])));
    }
    if scene.particles.changed > since {
        out.section(6, |out| out.f32s(scene.particles.is.iter().copied().flatten()));
    }
    if scene.landmarks.changed > since {
        out.section(9, |out| out.f32s(scene.landmarks.is.iter().copied().flatten()));
    }
    let known = scene.cloud.partition_point(|(_, changed)| *changed <= since);
    if known < scene.cloud.len() {
        out.section(7, |out| {
            out.u32(known as u32);
            out.f32s(scene.cloud[known..].iter().flat_map(|(point, _)| *point));
        });
    }
    let new = scene.samples.iter().filter(|(_, changed)| *changed > since).map(|(sample, _)| sample);
    let values = new.flat_map(|s| [s.time_s, s.scans_hz, s.step_ms, s.late_ms, s.effective_sample_size, s.memory_mb]);
    out.section(8, |out| out.f32s(values));
    out.0
}

fn tiles(out: &mut Writer, scene: &Scene, since: u64) {
    let changed = || scene.tiles.iter().filter(move |(_, tile)| tile.changed > since);
    let count = changed().count();
    if count == 0 {
        return;
    }
    out.section(2, |out| {
        out.f32s([scene.cell_size_m]);
        out.u32(OccupancyMap::TILE_CELLS as u32);
        out.u32(count as u32);
        for ((layer, column, row), tile) in changed() {
            out.u32(u32::from(*layer));
            [*column, *row].into_iter().for_each(|index| out.u32(index as u32));
            out.u32(tile.is.len() as u32);
            out.0.extend_from_slice(&tile.is);
            out.pad();
        }
    });
}

fn path(out: &mut Writer, scene: &Scene, since: u64) {
    let is_replaced = scene.path_began > since;
    let known = if is_replaced { 0 } else { scene.path.partition_point(|point| point.changed <= since) };
    if known == scene.path.len() && !is_replaced {
        return;
    }
    out.section(3, |out| {
        out.u32(known as u32);
        let new = scene.path[known..].iter();
        out.f32s(new.flat_map(|p| [p.x_m, p.y_m, p.time_s, f32::from(u8::from(p.is_trusted))]));
    });
}

/// A message taken apart; see [`decode`].
pub type Decoded<'a> = (u64, u64, bool, Vec<(u32, &'a [u8])>);

/// A message taken apart: instance, revision, whether it is all there is, and its sections by kind; `None` if it is none.
pub fn decode(message: &[u8]) -> Option<Decoded<'_>> {
    let u32_at = |at: usize| Some(u32::from_le_bytes(message.get(at..at + 4)?.try_into().ok()?));
    let u64_at = |at: usize| Some(u64::from_le_bytes(message.get(at..at + 8)?.try_into().ok()?));
    if message.get(..4)? != MAGIC || u32_at(4)? != VERSION {
        return None;
    }
    let mut sections = Vec::new();
    let mut at = HEAD;
    while at < message.len() {
        let (kind, length) = (u32_at(at)?, u32_at(at + 4)? as usize);
        let end = at.checked_add(8)?.checked_add(length)?;
        sections.push((kind, message.get(at + 8..end)?));
        at = end.next_multiple_of(4);
    }
    Some((u64_at(8)?, u64_at(16)?, u32_at(24)? == 1, sections))
}
