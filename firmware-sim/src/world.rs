//! What there is: rectangles in space, and the builders that make walls, rooms and floors of them.
//!
//! Data flow: parts ([`building`], [`wall`], [`office`]) and maps ([`ros_map`]) → [`World`] → [`crate::raycast`]. Nothing here moves; what does is in
//! [`crate::scene`].

pub mod building;
pub mod office;
mod rectangle;
pub mod ros_map;
pub mod wall;

use std::io::{self, Write};

pub use rectangle::{Ray, Rectangle, Vector};

/// Rectangles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct World {
    rectangles: Vec<Rectangle>,
    /// Of each: it sends light back to where it came from.
    reflects: Vec<bool>,
}

impl World {
    /// All of them.
    pub fn rectangles(&self) -> &[Rectangle] {
        &self.rectangles
    }

    /// Puts a rectangle in; what is none ([`Rectangle::new`]) is left out.
    pub fn add(&mut self, rectangle: Option<Rectangle>) {
        self.rectangles.extend(rectangle);
        self.reflects.resize(self.rectangles.len(), false);
    }

    /// Of each rectangle, whether it is a reflector.
    pub fn reflectors(&self) -> &[bool] {
        &self.reflects
    }

    /// All rectangles from this one on are reflectors.
    pub(crate) fn make_reflectors(&mut self, from: usize) {
        self.reflects.iter_mut().skip(from).for_each(|reflects| *reflects = true);
    }

    /// Distance along `ray` to the nearest rectangle, m; looks at every one. The oracle of [`crate::raycast`].
    pub fn range_m(&self, ray: &Ray) -> Option<f64> {
        self.rectangles.iter().filter_map(|rectangle| rectangle.range_m(ray)).min_by(f64::total_cmp)
    }

    /// Distance from `point` to the nearest surface, m; infinite in an empty world.
    pub fn distance_m(&self, point: &Vector) -> f64 {
        self.rectangles.iter().map(|rectangle| rectangle.distance_m(point)).fold(f64::INFINITY, f64::min)
    }

    /// Writes every rectangle as a line: four corners in order round it, 12 numbers, m.
    ///
    /// # Errors
    /// If `out` fails.
    pub fn write_surfaces(&self, out: &mut impl Write) -> io::Result<()> {
        for rectangle in &self.rectangles {
            let corners = rectangle.corners().map(|corner| format!("{:.6} {:.6} {:.6}", corner.x, corner.y, corner.z));
            writeln!(out, "{}", corners.join(" "))?;
        }
        Ok(())
    }
}
