//! A map as a ROS robot gets it: `map.yaml` and its picture, read by the rules of map_server's documentation and not by our writer's.
//!
//! Source: ROS wiki, map_server, sections 1.1 (map format) and 1.3 (value interpretation), mode "trinary":
//! p = (255 − x) / 255, or x / 255 if `negate` is set; p > `occupied_thresh`: occupied; p < `free_thresh`: free; else unknown.
//! `origin` is the pose of the lower left pixel; the picture's first row is the top.

#![allow(dead_code, reason = "not every test file uses all of it")]

use std::fs;
use std::path::Path;

/// What map_server publishes for a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cell {
    Unknown,
    Free,
    Occupied,
}

/// A map, its cells row by row from the bottom, as in an OccupancyGrid.
pub struct ServedMap {
    pub width: usize,
    pub height: usize,
    pub resolution_m: f64,
    pub origin_m: [f64; 2],
    pub cells: Vec<Cell>,
}

impl ServedMap {
    /// Reads the YAML file `yaml` and the picture that it names.
    pub fn load(yaml: &Path) -> Self {
        let text = fs::read_to_string(yaml).unwrap();
        let value = |key: &str| -> String {
            let line =
                text.lines().find(|line| line.starts_with(&format!("{key}:"))).unwrap_or_else(|| panic!("{text}"));
            line[key.len() + 1..].trim().to_owned()
        };
        let number = |key: &str| -> f64 { value(key).parse().unwrap() };
        assert!(text.lines().all(|line| !line.starts_with("mode:") || line == "mode: trinary"), "{text}");
        let origin: Vec<f64> =
            value("origin").trim_matches(['[', ']']).split(',').map(|v| v.trim().parse().unwrap()).collect();
        assert_eq!((origin.len(), origin[2]), (3, 0.0), "x, y, and no turn");
        let bytes = fs::read(yaml.with_file_name(value("image"))).unwrap();
        let (width, height, pixels) = picture(&bytes);
        let [occupied, free] = ["occupied_thresh", "free_thresh"].map(number);
        let negate = value("negate") != "0";
        let cell = |x: &u8| {
            let p = f64::from(if negate { *x } else { 255 - *x }) / 255.0;
            if p > occupied {
                Cell::Occupied
            } else if p < free {
                Cell::Free
            } else {
                Cell::Unknown
            }
        };
        let cells = pixels.chunks(width).rev().flatten().map(cell).collect();
        Self { width, height, resolution_m: number("resolution"), origin_m: [origin[0], origin[1]], cells }
    }

    /// The cell at a place, m; unknown outside.
    pub fn at(&self, x: f64, y: f64) -> Cell {
        let [column, row] = [(x, 0), (y, 1)].map(|(v, axis)| ((v - self.origin_m[axis]) / self.resolution_m).floor());
        let inside = column >= 0.0 && row >= 0.0 && column < self.width as f64 && row < self.height as f64;
        if inside { self.cells[row as usize * self.width + column as usize] } else { Cell::Unknown }
    }

    /// Free, unknown and occupied cells.
    pub fn counts(&self) -> [usize; 3] {
        [Cell::Free, Cell::Unknown, Cell::Occupied]
            .map(|wanted| self.cells.iter().filter(|cell| **cell == wanted).count())
    }
}

/// Width, height and bytes of a binary PGM of 8 bits, as its manual page says.
fn picture(bytes: &[u8]) -> (usize, usize, &[u8]) {
    let mut at = 0;
    let mut word = || {
        let start = at + bytes[at..].iter().position(|byte| !byte.is_ascii_whitespace()).unwrap();
        at = start + bytes[start..].iter().position(u8::is_ascii_whitespace).unwrap();
        std::str::from_utf8(&bytes[start..at]).unwrap().to_owned()
    };
    let [magic, width, height, largest] = [word(), word(), word(), word()];
    assert_eq!((magic.as_str(), largest.as_str()), ("P5", "255"));
    let (width, height) = (width.parse::<usize>().unwrap(), height.parse::<usize>().unwrap());
    let pixels = &bytes[at + 1..];
    assert_eq!(pixels.len(), width * height);
    (width, height, pixels)
}
