//! Maps as they are drawn and written: grids of occupancy, pictures, clouds of points.

pub mod cloud;
pub mod colours;
pub mod contradictions;
pub mod io;
pub mod occupancy;
pub mod picture;
