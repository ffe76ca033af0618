//! World files: a building, a robot in it and people, in TOML; and those that come with the program.
//!
//! A file is made of parts, each a table of its own (`[[wall]]`, `[[room]]`, …); docs/simulation.md describes them all. A fault is told with
//! file, line and key.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Deserialize;
use toml::Spanned;

use crate::drive::{Drive, RobotPlan};
use crate::people::{Person, PersonPlan};
use crate::raycast::RayCaster;
use crate::scene::RobotScene;
use crate::world::World;
use crate::world::building::{Block, CurvedWall, Panel, Part, PartFault, Place, Polygon, Post, Slab, check};
use crate::world::office::Office;
use crate::world::ros_map::{RosMapError, add_map};
use crate::world::wall::{Corridor, Room, Wall};

/// The worlds that come with the program: name, what it is, and its file.
pub const LIBRARY: [(&str, &str, &str); 10] = [
    ("room", "a room of 6 m by 4 m, the robot turning slowly within", include_str!("../worlds/room.toml")),
    ("floor", "a small floor of rooms and a corridor: the example log", include_str!("../worlds/floor.toml")),
    ("office", "an office floor of 36 m by 24 m whose corridors close loops", include_str!("../worlds/office.toml")),
    ("demo", "the office floor with a shorter drive and a laser that tilts", include_str!("../worlds/demo.toml")),
    ("corridor", "a corridor of 60 m", include_str!("../worlds/corridor.toml")),
    ("loop", "a loop of 60 m by 40 m, as in figure 3.11 of the thesis", include_str!("../worlds/loop.toml")),
    ("ring", "a ring of bare corridor, 300 m round", include_str!("../worlds/ring.toml")),
    ("maze", "a maze of thin walls seen from both sides", include_str!("../worlds/maze.toml")),
    ("small-maze", "a maze of ways 1 m wide", include_str!("../worlds/small-maze.toml")),
    ("reflectors", "a hall of 24 m by 16 m with reflectors on posts", include_str!("../worlds/reflectors.toml")),
];

/// Why a world cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {why}; worlds that come with the program: {}", file.display(), names())]
    Read {
        /// Which file.
        file: PathBuf,
        /// What the system says.
        why: std::io::Error,
    },
    /// Not TOML, or a key or value that no world has.
    #[error("{file}:{line}: {message}, in `{text}`")]
    Toml {
        /// Which file.
        file: String,
        /// Counted from 1.
        line: usize,
        /// What is wrong.
        message: String,
        /// The line.
        text: String,
    },
    /// A part whose values make no such part.
    #[error("{file}:{line}: {part}: {fault}")]
    Part {
        /// Which file.
        file: String,
        /// Where the part begins, counted from 1.
        line: usize,
        /// Its name.
        part: &'static str,
        /// What is wrong.
        fault: PartFault,
    },
    /// A map that cannot be read.
    #[error(transparent)]
    Map(#[from] RosMapError),
}

fn names() -> String {
    LIBRARY.map(|(name, _, _)| name).join(", ")
}

/// A building, a robot and people, ready to be looked at.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// The building.
    pub world: World,
    /// The robot's plan.
    pub robot: RobotPlan,
    /// Who walks about.
    pub people: Vec<Person>,
    drive: Drive,
}

/// A world file as it stands.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct WorldFile {
    height_m: Option<Spanned<f64>>,
    rectangle: Vec<Spanned<Panel>>,
    polygon: Vec<Spanned<Polygon>>,
    wall: Vec<Spanned<Wall>>,
    curved_wall: Vec<Spanned<CurvedWall>>,
    post: Vec<Spanned<Post>>,
    block: Vec<Spanned<Block>>,
    slab: Vec<Spanned<Slab>>,
    room: Vec<Spanned<Room>>,
    corridor: Vec<Spanned<Corridor>>,
    office: Vec<Spanned<Office>>,
    map: Vec<MapPart>,
    robot: Option<Spanned<RobotPlan>>,
    person: Vec<Spanned<PersonPlan>>,
}

/// A ROS map in a world file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MapPart {
    /// Its YAML file, beside the world file.
    yaml: PathBuf,
}

/// How high walls are if nothing is said, m.
const DEFAULT_HEIGHT_M: f64 = 2.7;

impl Scenario {
    /// The world called `name`: one that comes with the program, else a file: TOML, or the YAML of a ROS map.
    ///
    /// # Errors
    /// See [`ScenarioError`].
    pub fn load(name: &str) -> Result<Self, ScenarioError> {
        if let Some((name, _, text)) = LIBRARY.iter().find(|(known, _, _)| *known == name) {
            return Self::parse(text, name, Path::new(""));
        }
        let path = Path::new(name);
        if path.extension().is_some_and(|extension| extension == "yaml" || extension == "yml") {
            return Self::from_map(path);
        }
        let text = std::fs::read_to_string(path).map_err(|why| ScenarioError::Read { file: path.into(), why })?;
        Self::parse(&text, name, path.parent().unwrap_or(Path::new("")))
    }

    /// The same, the robot driving on to `places` after its route, m.
    ///
    /// # Errors
    /// If that cannot be driven.
    pub fn driving_on(mut self, places: &[Place]) -> Result<Self, PartFault> {
        if !places.is_empty() {
            self.robot.route.extend(places);
            self.drive = Drive::new(&self.robot)?;
        }
        Ok(self)
    }

    /// A world from the text of a file.
    ///
    /// * `file` — what it is called in messages; `folder` — where the maps are that it names
    ///
    /// # Errors
    /// See [`ScenarioError`].
    pub fn parse(text: &str, file: &str, folder: &Path) -> Result<Self, ScenarioError> {
        let content: WorldFile = toml::from_str(text).map_err(|error| in_toml(text, file, &error))?;
        numbers_are_sane(text, file)?;
        let source = Source { text, file };
        let mut world = World::default();
        let (height_m, at) =
            content.height_m.map_or((DEFAULT_HEIGHT_M, 0), |height_m| (*height_m.as_ref(), height_m.span().start));
        let high = check(height_m > 0.0 && height_m.is_finite(), "height_m", "a positive height");
        high.map_err(|fault| source.fault("world", at, fault))?;
        source.build("rectangle", &content.rectangle, &mut world, height_m)?;
        source.build("polygon", &content.polygon, &mut world, height_m)?;
        source.build("wall", &content.wall, &mut world, height_m)?;
        source.build("curved_wall", &content.curved_wall, &mut world, height_m)?;
        source.build("post", &content.post, &mut world, height_m)?;
        source.build("block", &content.block, &mut world, height_m)?;
        source.build("slab", &content.slab, &mut world, height_m)?;
        source.build("room", &content.room, &mut world, height_m)?;
        source.build("corridor", &content.corridor, &mut world, height_m)?;
        source.build("office", &content.office, &mut world, height_m)?;
        content.map.iter().try_for_each(|map| add_map(&mut world, &folder.join(&map.yaml), height_m))?;
        let person = |plan: &Spanned<PersonPlan>| {
            Person::new(plan.as_ref()).map_err(|fault| source.fault("person", plan.span().start, fault))
        };
        let people = content.person.iter().map(person).collect::<Result<_, _>>()?;
        let at = content.robot.as_ref().map_or(0, |robot| robot.span().start);
        let robot = content.robot.map_or_else(RobotPlan::default, Spanned::into_inner);
        let drive = Drive::new(&robot).map_err(|fault| source.fault("robot", at, fault))?;
        Ok(Self { world, robot, people, drive })
    }

    /// A ROS map with a robot at its origin.
    fn from_map(yaml: &Path) -> Result<Self, ScenarioError> {
        let mut world = World::default();
        add_map(&mut world, yaml, DEFAULT_HEIGHT_M)?;
        Ok(Self { world, robot: RobotPlan::default(), people: Vec::new(), drive: Drive::default() })
    }

    /// What the robot's laser sees.
    pub fn scene(&self) -> RobotScene {
        let caster = Arc::new(RayCaster::new(&self.world));
        RobotScene::new(caster, self.people.clone(), self.drive.clone(), self.robot.laser_m)
    }

    /// The robot's way.
    pub fn drive(&self) -> &Drive {
        &self.drive
    }
}

/// The text that parts come from, for messages.
struct Source<'t> {
    text: &'t str,
    file: &'t str,
}

impl Source<'_> {
    fn build<P: Part>(
        &self,
        name: &'static str,
        parts: &[Spanned<P>],
        world: &mut World,
        height_m: f64,
    ) -> Result<(), ScenarioError> {
        let mut build = |part: &Spanned<P>| {
            part.as_ref().build(world, height_m).map_err(|fault| self.fault(name, part.span().start, fault))
        };
        parts.iter().try_for_each(&mut build)
    }

    fn fault(&self, part: &'static str, at: usize, fault: PartFault) -> ScenarioError {
        ScenarioError::Part { file: self.file.to_owned(), line: line_of(self.text, at), part, fault }
    }
}

/// Places and sizes are no larger, m, and nothing else of a world is either.
const NUMBER_MAX: f64 = 1e6;

/// Every number is one that a world can have: where it stands is looked for only if one is not.
fn numbers_are_sane(text: &str, file: &str) -> Result<(), ScenarioError> {
    fn is_sane(value: &toml::Value) -> bool {
        match value {
            toml::Value::Float(number) => number.abs() <= NUMBER_MAX,
            toml::Value::Integer(number) => number.unsigned_abs() <= NUMBER_MAX as u64,
            toml::Value::Array(values) => values.iter().all(is_sane),
            toml::Value::Table(values) => values.values().all(is_sane),
            _ => true,
        }
    }
    let table: toml::Table = toml::from_str(text).map_err(|error| in_toml(text, file, &error))?;
    if table.values().all(is_sane) {
        return Ok(());
    }
    let is_absurd = |word: &str| {
        word.replace('_', "").parse::<f64>().is_ok_and(|number| number.is_nan() || number.abs() > NUMBER_MAX)
    };
    let words = |line: &str| line.split([' ', '\t', '=', ',', '[', ']', '{', '}']).any(is_absurd);
    let (line, content) = (1..).zip(text.lines()).find(|(_, line)| words(line)).unwrap_or((1, ""));
    let message = format!("expected numbers from -{NUMBER_MAX} to {NUMBER_MAX}");
    Err(ScenarioError::Toml { file: file.to_owned(), line, message, text: content.trim().chars().take(60).collect() })
}

fn line_of(text: &str, at: usize) -> usize {
    text.bytes().take(at).filter(|byte| *byte == b'\n').count() + 1
}

fn in_toml(text: &str, file: &str, error: &toml::de::Error) -> ScenarioError {
    let line = error.span().map_or(1, |span| line_of(text, span.start));
    let content = text.lines().nth(line - 1).unwrap_or("").trim();
    let content: String = content.chars().take(60).collect();
    let message = error.message().lines().collect::<Vec<_>>().join(", ");
    ScenarioError::Toml { file: file.to_owned(), line, message, text: content }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use lrfslam_core::time::Instant;

    use crate::drive::FloorPose;
    use crate::world::Vector;

    fn fault(text: &str) -> String {
        Scenario::parse(text, "w.toml", Path::new("")).unwrap_err().to_string()
    }

    #[test]
    fn worlds_that_come_with_the_program_can_all_be_looked_at() {
        for (name, _, _) in LIBRARY {
            let scene = Scenario::load(name).unwrap_or_else(|error| panic!("{error}")).scene();
            for degrees in -90..90 {
                let range = scene.range_m(Instant::default(), f64::from(degrees).to_radians());
                assert!(range.is_some_and(|range| range > 0.1), "{name} {degrees}: {range:?}");
            }
        }
    }

    #[test]
    fn robots_drive_through_nothing() {
        for (name, _, _) in LIBRARY {
            let scenario = Scenario::load(name).unwrap();
            let Some(end) = scenario.drive().end() else { continue };
            for at in (0..end.micros).step_by(100_000).map(Instant::from_micros) {
                let FloorPose { x, y, .. } = scenario.drive().pose(at);
                let distance = scenario.world.distance_m(&Vector::new(x, y, scenario.robot.laser_m[2]));
                assert!(distance > 0.1, "{name}: {distance} m from a surface at ({x}, {y})");
            }
        }
    }

    #[test]
    fn faults_name_file_line_and_key() {
        let wall = "[[wall]]\nfrom = [0, 0]\nto = [4, 0]\n";
        assert!(fault("heigth_m = 2").starts_with("w.toml:1: unknown field `heigth_m`, expected one of `height_m`"));
        let wrong = fault(&format!("{wall}thickness_m = \"thin\"\n"));
        assert!(wrong.starts_with("w.toml:4: invalid type: string \"thin\", expected f64, in `thickness_m"), "{wrong}");
        assert_eq!(
            fault(&format!("\n{wall}thickness_m = -1.0")),
            "w.toml:2: wall: thickness_m: expected a length, or 0"
        );
        assert!(fault(&format!("{wall}\n[[wall]]\nfrom = [0, 0]\n")).contains("w.toml:5: missing field `to`"));
        assert_eq!(fault("height_m = 0.0"), "w.toml:1: world: height_m: expected a positive height");
        assert!(
            fault("[robot]\nroute = [[0, 0], [1, 0]]\n").starts_with("w.toml:1: robot: speed_mps: expected a positive")
        );
        assert!(fault("[[person]]\nway = [[0, 0]]\n").starts_with("w.toml:1: person: way: expected"));
        assert!(fault("[[wall]\n").starts_with("w.toml:1: "));
        for number in ["nan", "-inf", "1e308", "1_000_000_000"] {
            let fault = fault(&format!("{wall}[robot]\nspeed_mps = {number}\n"));
            assert!(fault.starts_with("w.toml:5: expected numbers from -1000000 to 1000000, in `speed_mps"), "{fault}");
        }
    }

    #[test]
    fn missing_files_say_what_there_is() {
        let error = Scenario::load("castle.toml").unwrap_err().to_string();
        assert!(
            error.starts_with("castle.toml: cannot be read") && error.contains("office, demo, corridor, loop"),
            "{error}"
        );
    }
}
