//! Maps as ROS' map_server keeps them, extruded to walls: `map.yaml` and its P5 PGM.

use std::path::{Path, PathBuf};

use super::World;
use super::building::Place;
use super::wall::Upright;

/// Why a map cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RosMapError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {why}", file.display())]
    Read {
        /// Which file.
        file: PathBuf,
        /// What the system says.
        why: std::io::Error,
    },
    /// A line of the YAML file is wrong, or a key is missing.
    #[error("{}:{line}: {key}: expected {expected}", file.display())]
    Yaml {
        /// Which file.
        file: PathBuf,
        /// Counted from 1; the number of lines where a key is missing.
        line: usize,
        /// The key.
        key: String,
        /// What would be right.
        expected: &'static str,
    },
    /// The picture is not as expected.
    #[error("{}: expected {expected}", file.display())]
    Picture {
        /// Which file.
        file: PathBuf,
        /// What would be right.
        expected: &'static str,
    },
}

/// Longest side of a picture, pixels: at 0.05 m a kilometre and a half.
const SIDE_MAX: usize = 32_768;
/// Farthest that an origin is, m, and largest cell.
const ORIGIN_MAX_M: f64 = 1e6;
const RESOLUTION_MAX_M: f64 = 100.0;

/// What the YAML file says.
#[derive(Debug, Clone, PartialEq)]
struct MapInfo {
    image: PathBuf,
    resolution_m: f64,
    /// Pose of the picture's lower left corner: x and y in m, heading in rad.
    origin: [f64; 3],
    negate: bool,
    occupied: f64,
}

/// Grey values, row by row from the top.
struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
    white: f64,
}

/// Adds the walls between occupied and other cells of the map at `yaml`, `height_m` high.
///
/// # Errors
/// See [`RosMapError`].
pub fn add_map(world: &mut World, yaml: &Path, height_m: f64) -> Result<(), RosMapError> {
    let text = std::fs::read_to_string(yaml).map_err(|why| RosMapError::Read { file: yaml.into(), why })?;
    let info = MapInfo::parse(yaml, &text)?;
    let file = yaml.parent().unwrap_or(Path::new("")).join(&info.image);
    let bytes = std::fs::read(&file).map_err(|why| RosMapError::Read { file: file.clone(), why })?;
    let picture = Picture::parse(&bytes).map_err(|expected| RosMapError::Picture { file, expected })?;
    for [from, to] in outlines(&picture, &info) {
        let wall = Upright::new(from, to);
        world.add(wall.and_then(|wall| wall.face([0.0, wall.length_m], 0.0, [0.0, height_m])));
    }
    Ok(())
}

impl MapInfo {
    fn parse(file: &Path, text: &str) -> Result<Self, RosMapError> {
        let fault =
            |line, key: &str, expected| RosMapError::Yaml { file: file.into(), line, key: key.to_owned(), expected };
        let find = |key: &'static str| {
            let lines = (1..).zip(text.lines());
            let mut found = lines.filter_map(|(line, text)| {
                Some((line, text.strip_prefix(key)?.trim_start().strip_prefix(':')?.trim()))
            });
            found.next()
        };
        let end = text.lines().count();
        let need = |key, expected| find(key).ok_or_else(|| fault(end, key, expected));
        let number = |key, usual: Option<f64>, expected| match (find(key), usual) {
            (None, Some(usual)) => Ok(usual),
            (None, None) => Err(fault(end, key, expected)),
            (Some((line, text)), _) => {
                text.parse::<f64>().ok().filter(|number| number.is_finite()).ok_or_else(|| fault(line, key, expected))
            }
        };
        const IMAGE: &str = "the name of a P5 PGM file";
        const RESOLUTION: &str = "the side of a cell in m, such as 0.05";
        const ORIGIN: &str = "three numbers, [x, y, yaw], of the lower left corner in m and rad";
        let (line, image) = need("image", IMAGE)?;
        let image = image.trim_matches(['"', '\'']);
        if image.is_empty() {
            return Err(fault(line, "image", IMAGE));
        }
        let resolution_m = number("resolution", None, RESOLUTION)?;
        if !(1e-4..=RESOLUTION_MAX_M).contains(&resolution_m) {
            return Err(fault(need("resolution", RESOLUTION)?.0, "resolution", RESOLUTION));
        }
        let (line, origin) = need("origin", ORIGIN)?;
        let origin = triple(origin).ok_or_else(|| fault(line, "origin", ORIGIN))?;
        let negate = number("negate", Some(0.0), "0 or 1")? != 0.0;
        let occupied = number("occupied_thresh", Some(0.65), "a number from 0 to 1")?;
        Ok(Self { image: image.into(), resolution_m, origin, negate, occupied })
    }
}

fn triple(text: &str) -> Option<[f64; 3]> {
    let inner = text.strip_prefix('[')?.strip_suffix(']')?;
    let numbers: Option<Vec<f64>> =
        inner.split(',').map(|word| word.trim().parse().ok().filter(|x: &f64| x.abs() <= ORIGIN_MAX_M)).collect();
    numbers?.try_into().ok()
}

impl Picture {
    /// Reads a P5 PGM of 8 bits a pixel; else says what was expected.
    ///
    /// Source: Netpbm, pgm(5).
    fn parse(bytes: &[u8]) -> Result<Self, &'static str> {
        const EXPECTED: &str = "a P5 PGM of at most 255 grey values";
        let mut rest = bytes.strip_prefix(b"P5").ok_or(EXPECTED)?;
        let mut numbers = [0_usize; 3];
        for number in &mut numbers {
            rest = skip_blank(rest);
            let digits = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
            let text = std::str::from_utf8(&rest[..digits]).map_err(|_| EXPECTED)?;
            *number = text.parse().map_err(|_| EXPECTED)?;
            rest = &rest[digits..];
        }
        let [width, height, white] = numbers;
        if !(1..=SIDE_MAX).contains(&width) || !(1..=SIDE_MAX).contains(&height) {
            return Err("1 to 32768 pixels along each side");
        }
        let size = width.checked_mul(height).filter(|_| (1..=255).contains(&white)).ok_or(EXPECTED)?;
        let pixels = rest.get(1..).and_then(|pixels| pixels.get(..size)).ok_or("as many pixels as its header says")?;
        Ok(Self { width, height, pixels: pixels.to_vec(), white: white as f64 })
    }

    /// False outside.
    fn is_occupied(&self, info: &MapInfo, column: isize, row: isize) -> bool {
        let inside = (0..self.width as isize).contains(&column) && (0..self.height as isize).contains(&row);
        if !inside {
            return false;
        }
        let brightness = f64::from(self.pixels[row as usize * self.width + column as usize]) / self.white;
        let occupancy = if info.negate { brightness } else { 1.0 - brightness };
        occupancy > info.occupied
    }
}

/// The bytes after blanks and comments.
fn skip_blank(mut bytes: &[u8]) -> &[u8] {
    loop {
        bytes = bytes.trim_ascii_start();
        if bytes.first() != Some(&b'#') {
            return bytes;
        }
        let line = bytes.iter().position(|byte| *byte == b'\n').unwrap_or(bytes.len());
        bytes = &bytes[line..];
    }
}

/// The edges between occupied and other cells, in pieces as long as they are straight, in the map's frame.
fn outlines(picture: &Picture, info: &MapInfo) -> Vec<[Place; 2]> {
    let (width, height) = (picture.width as isize, picture.height as isize);
    let occupied = |column, row| picture.is_occupied(info, column, row);
    let level = (0..=height).map(|row| {
        runs(width, |x| occupied(x, row) != occupied(x, row - 1)).into_iter().map(move |[a, b]| [[a, row], [b, row]])
    });
    let upright = (0..=width).map(|column| {
        runs(height, |y| occupied(column, y) != occupied(column - 1, y))
            .into_iter()
            .map(move |[a, b]| [[column, a], [column, b]])
    });
    let edges = level.flatten().collect::<Vec<_>>().into_iter().chain(upright.flatten());
    let (sin, cos) = info.origin[2].sin_cos();
    let place = |[column, row]: [isize; 2]| {
        let (x, y) = (column as f64 * info.resolution_m, (height - row) as f64 * info.resolution_m);
        [info.origin[0] + cos * x - sin * y, info.origin[1] + sin * x + cos * y]
    };
    edges.map(|edge| edge.map(place)).collect()
}

/// Where `is_edge` holds, as ranges from the first to behind the last.
fn runs(length: isize, is_edge: impl Fn(isize) -> bool) -> Vec<[isize; 2]> {
    let mut runs: Vec<[isize; 2]> = Vec::new();
    for at in (0..length).filter(|at| is_edge(*at)) {
        match runs.last_mut() {
            Some(run) if run[1] == at => run[1] = at + 1,
            _ => runs.push([at, at + 1]),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{Ray, Vector};

    const YAML: &str = "image: m.pgm\nresolution: 0.5\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n";

    fn folder(yaml: &str, pgm: &[u8]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("map.yaml"), yaml).unwrap();
        std::fs::write(folder.path().join("m.pgm"), pgm).unwrap();
        folder
    }

    fn load(yaml: &str, pgm: &[u8]) -> Result<World, String> {
        let folder = folder(yaml, pgm);
        let mut world = World::default();
        let done = add_map(&mut world, &folder.path().join("map.yaml"), 2.0);
        done.map(|()| world).map_err(|error| error.to_string().replace(&format!("{}/", folder.path().display()), ""))
    }

    /// Three by two cells: the upper row occupied, free, unknown; the lower one free.
    const PGM: &[u8] = b"P5\n# ours\n3 2\n255\n\x00\xfe\xcd\xfe\xfe\xfe";

    #[test]
    fn occupied_cells_become_walls_where_the_origin_says() {
        let world = load(YAML, PGM).unwrap();
        assert_eq!(world.rectangles().len(), 4, "one cell, four sides; unknown is no wall");
        let ray = Ray { from: Vector::new(2.0, 2.75, 1.0), direction: -Vector::x() };
        assert_eq!(world.range_m(&ray), Some(2.5), "the cell ends at x = -0.5");
        let below = Ray { from: Vector::new(-0.75, 0.0, 1.0), direction: Vector::y() };
        assert_eq!(world.range_m(&below), Some(2.5), "its lower side is at y = 2.5");
    }

    #[test]
    fn straight_walls_are_one_piece() {
        let world = load(YAML, b"P5 3 2 255\n\x00\x00\x00\xfe\xfe\xfe").unwrap();
        assert_eq!(world.rectangles().len(), 4);
    }

    #[test]
    fn faults_name_file_line_and_key() {
        let fault = |yaml: &str, pgm: &[u8]| load(yaml, pgm).unwrap_err();
        assert_eq!(
            fault(&YAML.replace("0.5", "fine"), PGM),
            "map.yaml:2: resolution: expected the side of a cell in m, such as 0.05"
        );
        assert!(
            fault(&YAML.replace("[-1.0, 2.0, 0.0]", "[1, 2]"), PGM)
                .starts_with("map.yaml:3: origin: expected three numbers")
        );
        assert!(fault("resolution: 1\n", PGM).starts_with("map.yaml:1: image: expected"));
        for size in ["0 1000000000000000000", "1000000000000000000 0", "40000 1"] {
            let absurd = format!("P5 {size} 255 ");
            assert_eq!(fault(YAML, absurd.as_bytes()), "m.pgm: expected 1 to 32768 pixels along each side");
        }
        assert!(fault(&YAML.replace("0.5", "1e308"), PGM).starts_with("map.yaml:2: resolution"));
        assert!(fault(&YAML.replace("2.0", "1e308"), PGM).starts_with("map.yaml:3: origin"));
        assert_eq!(fault(YAML, b"P6 3 2 255 "), "m.pgm: expected a P5 PGM of at most 255 grey values");
        assert_eq!(fault(YAML, b"P5 3 2 255\n\0\0"), "m.pgm: expected as many pixels as its header says");
        assert!(fault(&YAML.replace("m.pgm", "none.pgm"), PGM).starts_with("none.pgm: cannot be read"));
    }
}
