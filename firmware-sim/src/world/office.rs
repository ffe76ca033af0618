//! A whole office floor: rows of rooms, corridors that close loops, doors and furniture.

use lrfslam_core::math;
use rand_core::SeedableRng;
use rand_pcg::Pcg32;
use serde::Deserialize;

use super::World;
use super::building::{Block, Part, PartFault, Place, add_slabs, check};
use super::wall::{Opening, Wall};

/// Rooms along both long sides of a building, a double row between, and corridors round and through it.
///
/// ```text
/// +--+--+--+--+--+--+     rooms, doors to the south
/// |  .  .  .  .  .  |     corridor
/// |  +--+--+ +--+--+|     two rows of rooms back to back,
/// |  +--+--+ +--+--+|     cut by a passage in the middle
/// |  .  .  .  .  .  |     corridor
/// +--+--+--+--+--+--+     rooms, doors to the north
/// ```
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Office {
    /// South-western corner, m.
    pub from: Place,
    /// North-eastern corner, m.
    pub to: Place,
    /// Width of a room along the corridor, m; changed a little so that rooms fill the rows.
    #[serde(default = "room_width")]
    pub room_m: f64,
    /// Width of the corridors, m.
    #[serde(default = "corridor_width")]
    pub corridor_m: f64,
    /// Thickness of the walls, m.
    #[serde(default = "wall_thickness")]
    pub thickness_m: f64,
    /// Which doors stand open how far, and what stands in the rooms.
    #[serde(default)]
    pub seed: u64,
}

fn room_width() -> f64 {
    4.0
}

fn corridor_width() -> f64 {
    2.0
}

fn wall_thickness() -> f64 {
    0.12
}

/// A row of rooms between two heights on the map.
struct Row {
    x: [f64; 2],
    y: [f64; 2],
    /// The doors are on its upper (northern) side.
    doors_north: bool,
}

impl Office {
    /// The y of the four rows' edges: outer rooms, corridor, two inner rows, corridor, outer rooms.
    fn levels(&self) -> [f64; 7] {
        let (y0, y1) = (self.from[1], self.to[1]);
        let depth = (y1 - y0 - 2.0 * self.corridor_m) / 4.0;
        let middle = (y0 + y1) / 2.0;
        [y0, y0 + depth, y0 + depth + self.corridor_m, middle, y1 - depth - self.corridor_m, y1 - depth, y1]
    }

    fn rows(&self) -> Vec<Row> {
        let [south, a, b, middle, c, d, north] = self.levels();
        let (x0, x1) = (self.from[0], self.to[0]);
        let (inner, passage) = ((x0 + x1) / 2.0, self.corridor_m / 2.0);
        let halves = [[x0 + self.corridor_m, inner - passage], [inner + passage, x1 - self.corridor_m]];
        let mut rows = vec![
            Row { x: [x0, x1], y: [south, a], doors_north: true },
            Row { x: [x0, x1], y: [d, north], doors_north: false },
        ];
        for x in halves {
            rows.push(Row { x, y: [b, middle], doors_north: false });
            rows.push(Row { x, y: [middle, c], doors_north: true });
        }
        rows
    }

    fn add_row(&self, world: &mut World, row: &Row, height_m: f64, rng: &mut Pcg32) -> Result<(), PartFault> {
        let [x0, x1] = row.x;
        let rooms = ((x1 - x0) / self.room_m).round().max(1.0);
        let width = (x1 - x0) / rooms;
        let wall = |from, to, opening| Wall { from, to, thickness_m: self.thickness_m, z_m: None, opening };
        let (front, back) = if row.doors_north { (row.y[1], row.y[0]) } else { (row.y[0], row.y[1]) };
        let mut doors = Vec::new();
        for room in 0..rooms as u32 {
            let start = f64::from(room) * width;
            doors.push(self.door(start, width, rng));
            if room > 0 {
                wall([x0 + start, row.y[0]], [x0 + start, row.y[1]], Vec::new()).build(world, height_m)?;
            }
            furnish(world, [x0 + start, x0 + start + width], [front, back], rng)?;
        }
        // Its left is the rooms' side, into which the doors open.
        let ends = if row.doors_north { [x1, x0] } else { [x0, x1] };
        wall([ends[0], front], [ends[1], front], doors).build(world, height_m)?;
        wall([x0, back], [x1, back], Vec::new()).build(world, height_m)?;
        for x in row.x {
            wall([x, row.y[0]], [x, row.y[1]], Vec::new()).build(world, height_m)?;
        }
        Ok(())
    }

    /// Cupboards, notice boards and columns along a wall without doors, a few metres apart.
    fn line_with_cupboards(
        &self,
        world: &mut World,
        x: f64,
        inward: f64,
        y: [f64; 2],
        rng: &mut Pcg32,
    ) -> Result<(), PartFault> {
        let mut draw = |low: f64, high: f64| low + (high - low) * f64::from(math::uniform(rng));
        let mut at = y[0] + self.corridor_m + draw(0.3, 1.5);
        while at < y[1] - self.corridor_m {
            let (depth, length) = (draw(0.12, 0.35), draw(0.3, 1.2));
            let centre = [x + inward * (depth + self.thickness_m) / 2.0, at];
            Block { centre, size_m: [depth, length], heading_deg: 0.0, z_m: Some([0.0, draw(1.0, 2.0)]) }
                .build(world, 0.0)?;
            at += length + draw(1.0, 3.0);
        }
        Ok(())
    }

    /// A door somewhere in the room's front: three in four stand open, some of them with a leaf to be seen.
    fn door(&self, start_m: f64, width_m: f64, rng: &mut Pcg32) -> Opening {
        let spare = (width_m - 0.9 - 2.0 * self.thickness_m - 0.4).max(0.0);
        let at_m = start_m + self.thickness_m + 0.2 + spare * f64::from(math::uniform(rng));
        let (state, angle) = (math::uniform(rng), f64::from(math::uniform(rng)));
        let leaf_deg = match state {
            shut if shut < 0.25 => Some(0.0),
            ajar if ajar < 0.5 => Some(30.0 + 60.0 * angle),
            _ => None,
        };
        Opening { at_m, width_m: 0.9, z_m: [0.0, 2.1], leaf_deg }
    }
}

/// A desk at the back, a cupboard at a side, and a chair.
fn furnish(world: &mut World, x: [f64; 2], [front, back]: [f64; 2], rng: &mut Pcg32) -> Result<(), PartFault> {
    let mut draw = |low: f64, high: f64| low + (high - low) * f64::from(math::uniform(rng));
    let inward = (back - front).signum();
    let (width, depth) = (x[1] - x[0], (back - front).abs());
    if width < 2.5 || depth < 2.5 {
        return Ok(());
    }
    let desk = [draw(x[0] + 1.0, x[1] - 1.0), back - inward * 0.55];
    let chair = [desk[0] + draw(-0.2, 0.2), desk[1] - inward * draw(0.6, 0.8)];
    let cupboard = [x[0] + 0.32, front + inward * draw(1.2, depth - 1.0)];
    let parts = [
        // A desk's top is 72 cm high; below it are drawers at one end and a panel at the back.
        Block { centre: desk, size_m: [1.6, 0.8], heading_deg: 0.0, z_m: Some([0.70, 0.74]) },
        Block { centre: [desk[0] + 0.55, desk[1]], size_m: [0.43, 0.75], heading_deg: 0.0, z_m: Some([0.0, 0.70]) },
        Block { centre: chair, size_m: [0.45, 0.45], heading_deg: draw(0.0, 90.0), z_m: Some([0.0, 0.48]) },
        Block { centre: cupboard, size_m: [0.45, draw(0.8, 1.2)], heading_deg: 0.0, z_m: Some([0.0, draw(1.2, 2.0)]) },
    ];
    parts.iter().try_for_each(|part| part.build(world, 0.0))
}

impl Part for Office {
    fn build(&self, world: &mut World, height_m: f64) -> Result<(), PartFault> {
        let [x0, y0] = self.from;
        let [x1, y1] = self.to;
        let corridors =
            self.corridor_m > 0.0 && 3.0 * self.corridor_m + 4.0 < x1 - x0 && 2.0 * self.corridor_m + 8.0 < y1 - y0;
        check(corridors, "corridor_m", "corridors that leave 2 m and more for each room, between `from` and `to`")?;
        check(self.room_m >= 2.0, "room_m", "2 m or more")?;
        check((0.0..0.5).contains(&self.thickness_m), "thickness_m", "less than 0.5 m")?;
        check(height_m >= 2.1, "height_m", "2.1 m or more: doors are that high")?;
        let mut rng = Pcg32::seed_from_u64(self.seed);
        self.rows().iter().try_for_each(|row| self.add_row(world, row, height_m, &mut rng))?;
        // The corridors' ends, between the outer rows.
        let [_, south, .., north, _] = self.levels();
        for x in [x0, x1] {
            Wall { from: [x, south], to: [x, north], thickness_m: self.thickness_m, z_m: None, opening: Vec::new() }
                .build(world, height_m)?;
        }
        let passage = [-1.0, 1.0].map(|side| (x0 + x1) / 2.0 + side * self.corridor_m / 2.0);
        for (x, inward) in [(x0, 1.0), (x1, -1.0), (passage[0], 1.0), (passage[1], -1.0)] {
            self.line_with_cupboards(world, x, inward, [south, north], &mut rng)?;
        }
        add_slabs(world, self.from, self.to, height_m)
    }
}
