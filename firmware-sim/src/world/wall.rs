//! Walls with doors and windows, and what is made of walls: rooms and corridors.

use serde::Deserialize;

use super::building::{Part, PartFault, Place, Polygon, add_slabs, check, heights};
use super::{Rectangle, Vector, World};

/// An upright plane over a line on the floor: where along it, how far to its left, how high.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Upright {
    from: Place,
    along: Place,
    /// Length of the line, m.
    pub(crate) length_m: f64,
}

impl Upright {
    /// Over the line between two places; `None` if they are the same.
    pub(crate) fn new(from: Place, to: Place) -> Option<Self> {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let length_m = dx.hypot(dy);
        (length_m > 1e-3).then(|| Self { from, along: [dx / length_m, dy / length_m], length_m })
    }

    /// The place `along_m` along and `left_m` to the left of the line.
    pub(crate) fn place(&self, along_m: f64, left_m: f64) -> Place {
        let [cos, sin] = self.along;
        [self.from[0] + cos * along_m - sin * left_m, self.from[1] + sin * along_m + cos * left_m]
    }

    /// A face between two places along, parallel to the line.
    pub(crate) fn face(&self, along_m: [f64; 2], left_m: f64, z_m: [f64; 2]) -> Option<Rectangle> {
        self.piece(along_m.map(|along| [along, left_m]), z_m)
    }

    /// A face across the line, from its right to its left.
    fn cross(&self, along_m: f64, left_m: [f64; 2], z_m: [f64; 2]) -> Option<Rectangle> {
        self.piece(left_m.map(|left| [along_m, left]), z_m)
    }

    /// A level face.
    fn level(&self, along_m: [f64; 2], left_m: [f64; 2], z_m: f64) -> Option<Rectangle> {
        let [[a, b], [right, left]] = [along_m, left_m];
        let corner = |[along, left]: [f64; 2]| self.vector(along, left, z_m);
        Rectangle::from_corners([[a, right], [b, right], [b, left], [a, left]].map(corner))
    }

    fn piece(&self, ends: [[f64; 2]; 2], [low, high]: [f64; 2]) -> Option<Rectangle> {
        let at = |[along, left]: [f64; 2], z| self.vector(along, left, z);
        Rectangle::from_corners([at(ends[0], low), at(ends[1], low), at(ends[1], high), at(ends[0], high)])
    }

    fn vector(&self, along_m: f64, left_m: f64, z_m: f64) -> Vector {
        let [x, y] = self.place(along_m, left_m);
        Vector::new(x, y, z_m)
    }
}

/// A hole in a wall: a door, or a window, through which a laser sees.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Opening {
    /// From the wall's start to the opening, m.
    pub at_m: f64,
    /// Its width, m.
    #[serde(default = "door_width")]
    pub width_m: f64,
    /// Heights of sill and lintel, m; a door's if not said.
    #[serde(default = "door_heights")]
    pub z_m: [f64; 2],
    /// A door leaf hangs in it, open by this angle to the wall's left, degrees; 0 is shut.
    pub leaf_deg: Option<f64>,
}

fn door_width() -> f64 {
    0.9
}

fn door_heights() -> [f64; 2] {
    [0.0, 2.1]
}

/// A straight wall.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// Start, m.
    pub from: Place,
    /// End, m.
    pub to: Place,
    /// Thickness, half of it on each side of the line, m; 0 for a thin one.
    #[serde(default)]
    pub thickness_m: f64,
    /// Heights of its lower and upper edge, m.
    pub z_m: Option<[f64; 2]>,
    /// Doors and windows, in order from its start.
    #[serde(default)]
    pub opening: Vec<Opening>,
}

impl Part for Wall {
    fn build(&self, world: &mut World, height_m: f64) -> Result<(), PartFault> {
        let same_place = || PartFault { key: "to", expected: "another place than `from`".to_owned() };
        let line = Upright::new(self.from, self.to).ok_or_else(same_place)?;
        let z_m = heights(self.z_m, height_m)?;
        check(self.thickness_m >= 0.0, "thickness_m", "a length, or 0")?;
        self.check_openings(&line, z_m)?;
        let left_m = [-self.thickness_m / 2.0, self.thickness_m / 2.0];
        let mut start_m = 0.0;
        for opening in &self.opening {
            let within = [opening.at_m, opening.at_m + opening.width_m];
            add_block(world, &line, [start_m, within[0]], left_m, z_m);
            add_opening(world, &line, opening, left_m, z_m);
            start_m = within[1];
        }
        add_block(world, &line, [start_m, line.length_m], left_m, z_m);
        Ok(())
    }
}

impl Wall {
    fn check_openings(&self, line: &Upright, [low, high]: [f64; 2]) -> Result<(), PartFault> {
        let mut start_m = 0.0;
        for opening in &self.opening {
            let end_m = opening.at_m + opening.width_m;
            let fits = opening.width_m > 0.0 && opening.at_m >= start_m && end_m <= line.length_m + 1e-9;
            check(fits, "opening", "openings in order along the wall, beside each other, within it")?;
            let [sill, lintel] = opening.z_m;
            check(
                low <= sill && sill < lintel && lintel <= high,
                "opening.z_m",
                "heights within the wall's, the sill first",
            )?;
            start_m = end_m;
        }
        Ok(())
    }
}

/// A solid piece of wall: two faces and two ends; one face if it is thin.
fn add_block(world: &mut World, line: &Upright, along_m: [f64; 2], left_m: [f64; 2], z_m: [f64; 2]) {
    if left_m[0] == left_m[1] {
        return world.add(line.face(along_m, left_m[0], z_m));
    }
    left_m.iter().for_each(|left| world.add(line.face(along_m, *left, z_m)));
    if along_m[1] - along_m[0] > 1e-3 {
        along_m.iter().for_each(|along| world.add(line.cross(*along, left_m, z_m)));
    }
}

/// What is above and below an opening, and its door.
fn add_opening(world: &mut World, line: &Upright, opening: &Opening, left_m: [f64; 2], [low, high]: [f64; 2]) {
    let along_m = [opening.at_m, opening.at_m + opening.width_m];
    let [sill, lintel] = opening.z_m;
    for (z_m, edge) in [([low, sill], sill), ([lintel, high], lintel)] {
        if z_m[1] - z_m[0] > 1e-3 {
            left_m.iter().for_each(|left| world.add(line.face(along_m, *left, z_m)));
            world.add(line.level(along_m, left_m, edge));
        }
    }
    if let Some(leaf_deg) = opening.leaf_deg {
        let hinge = line.place(along_m[0], left_m[1]);
        let (sin, cos) = leaf_deg.to_radians().sin_cos();
        let end = line.place(along_m[0] + opening.width_m * cos, left_m[1] + opening.width_m * sin);
        let leaf = Upright::new(hinge, end);
        world.add(leaf.and_then(|leaf| leaf.face([0.0, leaf.length_m], 0.0, opening.z_m)));
    }
}

/// A side of a room, as on a map with y to the north.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Where y is lowest.
    South,
    /// Where x is highest.
    East,
    /// Where y is highest.
    North,
    /// Where x is lowest.
    West,
}

/// An opening in one of a room's sides.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoomOpening {
    /// Which side.
    pub side: Side,
    /// From the side's western or southern end to the opening, m.
    pub at_m: f64,
    /// Its width, m.
    #[serde(default = "door_width")]
    pub width_m: f64,
    /// Heights of sill and lintel, m; a door's if not said.
    #[serde(default = "door_heights")]
    pub z_m: [f64; 2],
}

/// Four walls, a floor and a ceiling.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Room {
    /// South-western corner, inside, m.
    pub from: Place,
    /// North-eastern corner, inside, m.
    pub to: Place,
    /// Thickness of the walls, m.
    #[serde(default)]
    pub thickness_m: f64,
    /// Doors and windows; along each side in order.
    #[serde(default)]
    pub opening: Vec<RoomOpening>,
}

impl Part for Room {
    fn build(&self, world: &mut World, height_m: f64) -> Result<(), PartFault> {
        let ([x0, y0], [x1, y1]) = (self.from, self.to);
        check(x0 < x1 && y0 < y1, "to", "a corner north-east of `from`")?;
        add_slabs(world, self.from, self.to, height_m)?;
        // The walls' lines run half a thickness outside the room.
        let out = self.thickness_m / 2.0;
        let sides = [
            (Side::South, [x0, y0 - out], [x1, y0 - out]),
            (Side::North, [x0, y1 + out], [x1, y1 + out]),
            (Side::West, [x0 - out, y0], [x0 - out, y1]),
            (Side::East, [x1 + out, y0], [x1 + out, y1]),
        ];
        for (side, from, to) in sides {
            let opening =
                self.opening.iter().filter(|opening| opening.side == side).map(RoomOpening::in_wall).collect();
            Wall { from, to, thickness_m: self.thickness_m, z_m: None, opening }.build(world, height_m)?;
        }
        Ok(())
    }
}

impl RoomOpening {
    fn in_wall(&self) -> Opening {
        Opening { at_m: self.at_m, width_m: self.width_m, z_m: self.z_m, leaf_deg: None }
    }
}

/// A way with thin walls on both sides, a floor and a ceiling.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Corridor {
    /// Corners of its middle line, m.
    pub way: Vec<Place>,
    /// Width, m.
    pub width_m: f64,
    /// It leads back to its start.
    #[serde(default)]
    pub closed: bool,
}

impl Part for Corridor {
    fn build(&self, world: &mut World, height_m: f64) -> Result<(), PartFault> {
        check(self.width_m > 0.0, "width_m", "a positive length")?;
        check(self.way.len() >= if self.closed { 3 } else { 2 }, "way", "at least 2 corners, 3 if it is closed")?;
        let half = self.width_m / 2.0;
        let lines = self.lines()?;
        lines.iter().for_each(|line| self.add_slabs(world, line, height_m));
        let (left, right) = (offset(&lines, half, self.closed), offset(&lines, -half, self.closed));
        let outlines = if self.closed {
            vec![left, right]
        } else {
            vec![left.into_iter().chain(right.into_iter().rev()).collect()]
        };
        let wall = |points| Polygon { points, open: false, z_m: None }.build(world, height_m);
        outlines.into_iter().try_for_each(wall)
    }
}

impl Corridor {
    fn lines(&self) -> Result<Vec<Upright>, PartFault> {
        let count = self.way.len() - usize::from(!self.closed);
        let next = self.way.iter().cycle().skip(1);
        let line = |(from, to): (&Place, &Place)| Upright::new(*from, *to);
        let lines: Option<Vec<Upright>> = self.way.iter().zip(next).take(count).map(line).collect();
        lines.ok_or_else(|| PartFault { key: "way", expected: "corners that differ from their neighbours".to_owned() })
    }

    fn add_slabs(&self, world: &mut World, line: &Upright, height_m: f64) {
        let half = self.width_m / 2.0;
        let ends = [-half, line.length_m + half];
        [0.0, height_m].iter().for_each(|z| world.add(line.level(ends, [-half, half], *z)));
    }
}

/// The line `left_m` to the left of a way: its corners, where neighbouring lines' offsets cross.
fn offset(lines: &[Upright], left_m: f64, closed: bool) -> Vec<Place> {
    let mitre = |a: &Upright, b: &Upright| {
        // tan of half the turn moves the corner along.
        let (cos, sin) =
            (a.along[0] * b.along[0] + a.along[1] * b.along[1], a.along[0] * b.along[1] - a.along[1] * b.along[0]);
        a.place(a.length_m - left_m * sin / (1.0 + cos).max(0.1), left_m)
    };
    let corners = lines.windows(2).map(|pair| mitre(&pair[0], &pair[1]));
    match (lines.first(), lines.last()) {
        (Some(first), Some(last)) if closed => corners.chain([mitre(last, first)]).collect(),
        (Some(first), Some(last)) => {
            let ends = [first.place(0.0, left_m), last.place(last.length_m, left_m)];
            [ends[0]].into_iter().chain(corners).chain([ends[1]]).collect()
        }
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Ray;

    fn range(world: &World, from: [f64; 3], heading_deg: f64) -> Option<f64> {
        let (sin, cos) = heading_deg.to_radians().sin_cos();
        world.range_m(&Ray { from: Vector::from(from), direction: Vector::new(cos, sin, 0.0) })
    }

    fn built(part: &impl Part) -> World {
        let mut world = World::default();
        part.build(&mut world, 2.5).unwrap();
        world
    }

    #[test]
    fn rays_pass_doors_and_windows_at_their_heights() {
        let door = Opening { at_m: 1.0, width_m: 1.0, z_m: door_heights(), leaf_deg: None };
        let window = Opening { at_m: 3.0, z_m: [0.9, 2.0], ..door };
        let wall = Wall { from: [0.0, 0.0], to: [5.0, 0.0], thickness_m: 0.2, z_m: None, opening: vec![door, window] };
        let world = built(&wall);
        let at = |x: f64, z: f64| range(&world, [x, -1.0, z], 90.0).map(|range| (range * 1e6).round() / 1e6);
        assert_eq!([at(0.5, 1.0), at(1.5, 1.0), at(1.5, 2.3)], [Some(0.9), None, Some(0.9)]);
        assert_eq!([at(3.5, 0.5), at(3.5, 1.0), at(3.5, 2.2)], [Some(0.9), None, Some(0.9)]);
        assert_eq!(range(&world, [1.5, 0.0, 1.0], 0.0).map(|range| (range * 1e6).round()), Some(0.5e6), "the reveal");
    }

    #[test]
    fn leaf_hangs_open_by_its_angle() {
        let door = Opening { at_m: 1.0, width_m: 1.0, z_m: door_heights(), leaf_deg: Some(90.0) };
        let world = built(&Wall { from: [0.0, 0.0], to: [3.0, 0.0], thickness_m: 0.0, z_m: None, opening: vec![door] });
        assert_eq!(range(&world, [2.0, 0.5, 1.0], 180.0).map(|range| (range * 1e6).round()), Some(1e6));
        assert_eq!(range(&world, [1.5, -0.5, 1.0], 90.0), None);
    }

    #[test]
    fn room_is_closed_but_for_its_openings() {
        let door = RoomOpening { side: Side::East, at_m: 1.0, width_m: 0.9, z_m: door_heights() };
        let world = built(&Room { from: [0.0, 0.0], to: [4.0, 3.0], thickness_m: 0.1, opening: vec![door] });
        for heading_deg in 0..360 {
            let is_door = (-8..=16).contains(&heading_deg) || heading_deg > 350;
            let range = range(&world, [2.0, 1.3, 1.0], f64::from(heading_deg));
            assert!(is_door || range.is_some_and(|range| range < 2.7), "{heading_deg}: {range:?}");
        }
        assert_eq!(range(&world, [2.0, 1.3, 1.0], 0.0), None);
    }

    #[test]
    fn closed_corridor_has_its_width_everywhere() {
        let way = vec![[0.0, 0.0], [10.0, 0.0], [10.0, 6.0], [0.0, 6.0]];
        let world = built(&Corridor { way, width_m: 2.0, closed: true });
        for (from, heading_deg) in
            [([5.0, 0.0, 1.0], 90.0), ([5.0, 0.0, 1.0], 270.0), ([10.0, 3.0, 1.0], 0.0), ([0.0, 3.0, 1.0], 0.0)]
        {
            assert_eq!(range(&world, from, heading_deg).map(|range| (range * 1e6).round()), Some(1e6), "{from:?}");
        }
        assert_eq!(range(&world, [5.0, 0.0, 1.0], 0.0), Some(6.0));
    }

    #[test]
    fn bent_open_corridor_ends_in_walls() {
        let world = built(&Corridor { way: vec![[0.0, 0.0], [4.0, 0.0], [8.0, 4.0]], width_m: 2.0, closed: false });
        assert_eq!(range(&world, [1.0, 0.0, 1.0], 180.0), Some(1.0));
        let across = range(&world, [6.0, 2.0, 1.0], 135.0).unwrap();
        assert!((across - 1.0).abs() < 1e-9, "{across}");
        assert!((range(&world, [6.0, 2.0, 1.0], 45.0).unwrap() - 8.0_f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn openings_that_do_not_fit_are_refused() {
        let door = |at_m| Opening { at_m, width_m: 1.0, z_m: door_heights(), leaf_deg: None };
        let wall = |opening| Wall { from: [0.0, 0.0], to: [3.0, 0.0], thickness_m: 0.1, z_m: None, opening };
        let fault = |opening| wall(opening).build(&mut World::default(), 2.5).unwrap_err().key;
        assert_eq!(fault(vec![door(2.5)]), "opening");
        assert_eq!(fault(vec![door(1.0), door(1.5)]), "opening");
        assert_eq!(fault(vec![Opening { z_m: [0.0, 2.6], ..door(1.0) }]), "opening.z_m");
    }
}
