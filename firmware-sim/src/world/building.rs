//! Parts of buildings, as they stand in a world file, and what rectangles they are made of.
//!
//! All upright parts reach from the floor to the world's height unless they say otherwise by `z_m`.

use serde::Deserialize;

use super::wall::Upright;
use super::{Rectangle, Vector, World};

/// A place on the floor, m.
pub type Place = [f64; 2];

/// A value that makes no such part.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{key}: expected {expected}")]
pub struct PartFault {
    /// The key it stands under.
    pub key: &'static str,
    /// What would be right.
    pub expected: String,
}

/// The fault of `key`, unless `right`.
pub(crate) fn check(right: bool, key: &'static str, expected: &str) -> Result<(), PartFault> {
    if right { Ok(()) } else { Err(PartFault { key, expected: expected.to_owned() }) }
}

/// Something that can be built into a world.
pub trait Part {
    /// Adds its rectangles to `world`, whose walls are `height_m` high.
    ///
    /// # Errors
    /// If a value makes no such part.
    fn build(&self, world: &mut World, height_m: f64) -> Result<(), PartFault>;
}

/// The heights between which an upright part reaches, m.
pub(crate) fn heights(z_m: Option<[f64; 2]>, height_m: f64) -> Result<[f64; 2], PartFault> {
    let [low, high] = z_m.unwrap_or([0.0, height_m]);
    check(low < high, "z_m", "the lower height first, then the upper one, m")?;
    Ok([low, high])
}

/// One rectangle, by its corners.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Panel {
    /// In order round it, m.
    pub corners: [[f64; 3]; 4],
}

impl Part for Panel {
    fn build(&self, world: &mut World, _: f64) -> Result<(), PartFault> {
        let panel = Rectangle::from_corners(self.corners.map(Vector::from));
        check(panel.is_some(), "corners", "four corners of a rectangle, in order round it")?;
        world.add(panel);
        Ok(())
    }
}

/// An outline, extruded to thin walls.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Polygon {
    /// Corners, m.
    pub points: Vec<Place>,
    /// No wall from the last corner to the first.
    #[serde(default)]
    pub open: bool,
    /// Heights of its lower and upper edge, m.
    pub z_m: Option<[f64; 2]>,
}

impl Part for Polygon {
    fn build(&self, world: &mut World, height_m: f64) -> Result<(), PartFault> {
        check(self.points.len() >= 2, "points", "at least two corners")?;
        let z_m = heights(self.z_m, height_m)?;
        let next = self.points.iter().cycle().skip(1);
        let sides = self.points.len() - usize::from(self.open);
        for (from, to) in self.points.iter().zip(next).take(sides) {
            let side = Upright::new(*from, *to);
            check(side.is_some(), "points", "corners that differ from their neighbours")?;
            world.add(side.and_then(|side| side.face([0.0, side.length_m], 0.0, z_m)));
        }
        Ok(())
    }
}

/// A wall round a centre, in flat pieces.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvedWall {
    /// Centre, m.
    pub centre: Place,
    /// Radius, m.
    pub radius_m: f64,
    /// Direction of its first end from the centre, degrees.
    #[serde(default)]
    pub from_deg: f64,
    /// Direction of its last end, degrees; counter-clockwise.
    #[serde(default = "full_turn")]
    pub to_deg: f64,
    /// Number of flat pieces.
    #[serde(default = "usual_pieces")]
    pub pieces: u16,
    /// Heights of its lower and upper edge, m.
    pub z_m: Option<[f64; 2]>,
}

fn full_turn() -> f64 {
    360.0
}

fn usual_pieces() -> u16 {
    24
}

impl Part for CurvedWall {
    fn build(&self, world: &mut World, height_m: f64) -> Result<(), PartFault> {
        check(self.radius_m > 0.0, "radius_m", "a positive length")?;
        check(self.from_deg < self.to_deg, "to_deg", "more than from_deg")?;
        check(self.pieces > 0, "pieces", "at least 1")?;
        let point = |piece: u16| {
            let part = f64::from(piece) / f64::from(self.pieces);
            let (sin, cos) = (self.from_deg + part * (self.to_deg - self.from_deg)).to_radians().sin_cos();
            [self.centre[0] + self.radius_m * cos, self.centre[1] + self.radius_m * sin]
        };
        let points = (0..=self.pieces).map(point).collect();
        Polygon { points, open: true, z_m: self.z_m }.build(world, height_m)
    }
}

/// A round post, pillar or trunk; a reflector if it is wrapped in foil.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Post {
    /// Centre, m.
    pub centre: Place,
    /// Radius, m.
    pub radius_m: f64,
    /// It sends light back to where it came from.
    #[serde(default)]
    pub reflector: bool,
    /// Heights of its lower and upper edge, m.
    pub z_m: Option<[f64; 2]>,
}

impl Part for Post {
    fn build(&self, world: &mut World, height_m: f64) -> Result<(), PartFault> {
        let before = world.rectangles().len();
        let (centre, radius_m, pieces) = (self.centre, self.radius_m, usual_pieces());
        let round = CurvedWall { centre, radius_m, from_deg: 0.0, to_deg: full_turn(), pieces, z_m: self.z_m };
        round.build(world, height_m)?;
        if self.reflector {
            world.make_reflectors(before);
        }
        Ok(())
    }
}

/// A box that stands on the floor or hangs: furniture, a pillar.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Middle of its base, m.
    pub centre: Place,
    /// Length and width, m.
    pub size_m: [f64; 2],
    /// Where its length points, degrees.
    #[serde(default)]
    pub heading_deg: f64,
    /// Heights of its bottom and top, m.
    pub z_m: Option<[f64; 2]>,
}

impl Block {
    /// Corners of its base, counter-clockwise, m.
    pub fn base(&self) -> [Place; 4] {
        let (sin, cos) = self.heading_deg.to_radians().sin_cos();
        let ([x, y], [length, width]) = (self.centre, self.size_m.map(|side| side / 2.0));
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[along, across]| {
            let (dx, dy) = (along * length, across * width);
            [x + cos * dx - sin * dy, y + sin * dx + cos * dy]
        })
    }
}

impl Part for Block {
    fn build(&self, world: &mut World, height_m: f64) -> Result<(), PartFault> {
        check(self.size_m.iter().all(|side| *side > 0.0), "size_m", "a positive length and width")?;
        let z_m = heights(self.z_m, height_m)?;
        let [a, b, c, d] = self.base();
        for z in z_m {
            world.add(Rectangle::from_corners([a, b, c, d].map(|[x, y]| Vector::new(x, y, z))));
        }
        Polygon { points: vec![a, b, c, d], open: false, z_m: Some(z_m) }.build(world, height_m)
    }
}

/// A floor or a ceiling.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slab {
    /// One corner, m.
    pub from: Place,
    /// The corner across, m.
    pub to: Place,
    /// Height, m.
    pub z_m: f64,
}

impl Part for Slab {
    fn build(&self, world: &mut World, _: f64) -> Result<(), PartFault> {
        let ([x0, y0], [x1, y1]) = (self.from, self.to);
        let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(|[x, y]| Vector::new(x, y, self.z_m));
        let slab = Rectangle::from_corners(corners);
        check(slab.is_some(), "to", "a corner across from `from`")?;
        world.add(slab);
        Ok(())
    }
}

/// Floor and ceiling between two corners.
pub(crate) fn add_slabs(world: &mut World, from: Place, to: Place, height_m: f64) -> Result<(), PartFault> {
    Slab { from, to, z_m: 0.0 }.build(world, height_m)?;
    Slab { from, to, z_m: height_m }.build(world, height_m)
}
