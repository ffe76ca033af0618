//! The whole configuration of a run: sections, each with its own numbers, read from TOML.
//!
//! Layers, later ones win: defaults < file < `--set section.key=value` < flags. Every section is declared with core's
//! [`config!`](lrfslam_core::config!), which keeps default, bounds, unit and source of a number in one place; from there
//! [`RunConfig::to_commented_toml`] prints a file ready to edit. Bounds are checked once, by [`RunConfig::validate`].

use std::fmt::Write as _;
use std::path::Path;

use lrfslam_core::config::{ConfigError, Section};
use lrfslam_core::geometry::Pose2;
use lrfslam_core::slam::SlamConfig;
use lrfslam_core::time::Duration;
use lrfslam_robot::{LaserConfig, ReportConfig, RobotConfig};
use serde::{Deserialize, Serialize};

use lrfslam_host::localize::{LocalizeConfig, LocalizerConfig};
use lrfslam_host::mapping::high::HighConfig;
use lrfslam_host::mapping::saved_map::{self, SavedMap, SavedMapError};
use lrfslam_host::mapping::{HierarchyConfig, MappingConfig, MemoryConfig};
use lrfslam_host::maps::occupancy::MapConfig;
use lrfslam_host::places::ClosureConfig;
use lrfslam_host::runs::robot::RobotSetup;
use lrfslam_host::scans::bags::TfWanted;
use lrfslam_host::scans::log::LogOptions;

lrfslam_core::config! {
    /// How the log is read.
    pub struct LogConfig {
        /// Ranges of a log or laser from here on mean "nothing seen", m; 0: as the log or laser says or shows.
        range_max_m: f32 = 0.0, in 0.0..=1000.0;
        /// Angle over which the beams lie evenly, degrees; 0: as the log says, else by the number of beams.
        field_of_view_deg: f32 = 0.0, in 0.0..=360.0;
        /// From scan to scan in a log that has no times (DP-SLAM's), s.
        untimed_scan_interval_s: f32 = 0.2, in 0.001..=60.0;
    }
}

lrfslam_core::config! {
    /// Where the laser sits on the robot: the path is the robot's, not the laser's.
    pub struct MountingConfig {
        /// Take it from the log's laser and robot poses, where there are any; the numbers below are for logs without.
        from_log: bool = true;
        /// Laser ahead of the robot's centre, m.
        forward_m: f32 = 0.0, in -10.0..=10.0;
        /// Laser to the left of the robot's centre, m.
        left_m: f32 = 0.0, in -10.0..=10.0;
        /// Direction of the laser, counter-clockwise from forward, degrees.
        heading_deg: f32 = 0.0, in -180.0..=180.0;
    }
}

lrfslam_core::config! {
    /// When a user is told that the robot moves too fast for its laser (thesis 4.4.2, eq. 4.44 and 4.45).
    pub struct SpeedConfig {
        /// Motion of the laser within one sweep, m. The thesis' example: 0.005, without correction of the beams.
        error_m: f32 = 0.05, in 0.0001..=10.0;
        /// Rotation within one sweep, degrees. The thesis' example: 0.25.
        error_deg: f32 = 5.0, in 0.001..=180.0;
    }
}

/// Declares the sections of the configuration, in the order in which they are printed: its own, and those of SLAM.
macro_rules! run_config {
    (
        first { $( $(#[doc = $first_doc:literal])* $first:ident : $first_type:ty, )* }
        between { $( $(#[doc = $between_doc:literal])* $between:ident : $between_type:ty, )* }
        last { $( $(#[doc = $last_doc:literal])* $last:ident : $last_type:ty, )* }
        matching { $( $(#[doc = $matching_doc:literal])* $matching:ident : $matching_type:ty, )* }
        particles { $( $(#[doc = $particles_doc:literal])* $particles:ident : $particles_type:ty, )* }
    ) => {
        /// The configuration of a run: that of SLAM, and what a computer does besides.
        #[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct RunConfig {
            $( $(#[doc = $first_doc])* pub $first: $first_type, )*
            $( $(#[doc = $matching_doc])* pub $matching: $matching_type, )*
            $( $(#[doc = $between_doc])* pub $between: $between_type, )*
            $( $(#[doc = $particles_doc])* pub $particles: $particles_type, )*
            $( $(#[doc = $last_doc])* pub $last: $last_type, )*
        }

        impl RunConfig {
            /// Every section under its name.
            pub fn sections(&self) -> Vec<(&'static str, &dyn Section)> {
                vec![
                    $( (stringify!($first), &self.$first as &dyn Section), )*
                    $( (stringify!($matching), &self.$matching), )*
                    $( (stringify!($between), &self.$between), )*
                    $( (stringify!($particles), &self.$particles), )*
                    $( (stringify!($last), &self.$last), )*
                ]
            }

            /// The part of SLAM.
            pub fn slam(&self) -> SlamConfig {
                SlamConfig { $( $matching: self.$matching, )* $( $particles: self.$particles, )* }
            }

            /// The same with `slam` as that part.
            pub fn with_slam(self, slam: &SlamConfig) -> Self {
                Self { $( $matching: slam.$matching, )* $( $particles: slam.$particles, )* ..self }
            }
        }
    };
}

// A further section is one line here: its name in the file, and its type.
lrfslam_core::slam_sections!(run_config! {
    first {
        /// How the log is read.
        log: LogConfig,
        /// Where the laser sits on the robot.
        mounting: MountingConfig,
    }
    between {
        /// Levels of SLAM.
        hierarchy: HierarchyConfig,
    }
    last {
        /// What a robot that does the SLAM itself tells.
        report: ReportConfig,
        /// High level.
        high: HighConfig,
        /// Closing of loops.
        closure: ClosureConfig,
        /// Localisation.
        localize: LocalizeConfig,
        /// Memory.
        memory: MemoryConfig,
        /// When the robot is too fast.
        speed: SpeedConfig,
        /// How the map is drawn.
        map: MapConfig,
    }
});

/// The library's results, with this configuration in them.
pub type RunReport = lrfslam_host::results::report::RunReport<RunConfig>;
/// See [`RunReport`].
pub type LocalizeReport = lrfslam_host::runs::localize::LocalizeReport<RunConfig>;
/// See [`RunReport`].
pub type About = lrfslam_host::runs::map::About<RunConfig>;
/// See [`RunReport`].
pub type RobotRun = lrfslam_host::runs::robot::RobotRun<RunConfig>;

/// What is wrong with a configuration.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunConfigError {
    /// The file cannot be read.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// Name of the file, as given.
        file: String,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not TOML, or has a key or a kind of value that is not known here.
    #[error("{file}: {message}")]
    File {
        /// Name of the file, as given.
        file: String,
        /// Line, key, and what was expected.
        message: String,
    },
    /// An override is wrong.
    #[error("--set {argument}: {message}")]
    Override {
        /// The argument.
        argument: String,
        /// What was expected.
        message: String,
    },
    /// A value is out of its bounds.
    #[error("configuration: {section}.{source}")]
    Value {
        /// Name of the section.
        section: &'static str,
        /// The field, its value and its bounds.
        source: ConfigError,
    },
}

/// `message`, and where it names a key that is not known, that there were more of them once.
fn with_notice_of_cut_keys(message: &str) -> String {
    let message = message.trim_end();
    let is_unknown = message.contains("unknown field") || message.contains("there is no section");
    let notice = if is_unknown { "; `lrfslam config` prints all that there are; older versions had more" } else { "" };
    format!("{message}{notice}")
}

impl RunConfig {
    /// `defaults`, then the file (if any), then the overrides `section.key=value`, checked.
    ///
    /// # Errors
    /// The first thing that is wrong, said with file and line, override, or section and field.
    pub fn load_over(defaults: Self, file: Option<&Path>, overrides: &[String]) -> Result<Self, RunConfigError> {
        let mut config = file.map_or(Ok(defaults), |file| defaults.with_file(file))?;
        for argument in overrides {
            let wrong = |message: String| RunConfigError::Override {
                argument: argument.clone(),
                message: with_notice_of_cut_keys(&message),
            };
            config = config.with(argument).map_err(wrong)?;
        }
        config.validate()?;
        Ok(config)
    }

    /// This configuration with the values of a file.
    fn with_file(self, path: &Path) -> Result<Self, RunConfigError> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path);
        let text = text.map_err(|source| RunConfigError::Read { file: file.clone(), source })?;
        let wrong =
            |message: String| RunConfigError::File { file: file.clone(), message: with_notice_of_cut_keys(&message) };
        // Read by itself first: only then do messages tell the line.
        let _: Self = toml::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        let given: toml::Table = toml::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        let mut tree = toml::Table::try_from(self).map_err(|error| wrong(error.to_string()))?;
        for (name, values) in given {
            let section = tree.get_mut(&name).and_then(toml::Value::as_table_mut);
            section.into_iter().zip(values.as_table()).for_each(|(section, values)| section.extend(values.clone()));
        }
        tree.try_into().map_err(|error: toml::de::Error| wrong(error.to_string()))
    }

    /// This configuration with one value replaced.
    fn with(self, argument: &str) -> Result<Self, String> {
        const FORM: &str = "expected section.key=value";
        let (key, value) = argument.split_once('=').ok_or(FORM)?;
        let (section, field) = key.trim().split_once('.').ok_or(FORM)?;
        let mut tree = toml::Table::try_from(self).map_err(|error| error.to_string())?;
        let names = tree.keys().cloned().collect::<Vec<_>>().join(", ");
        let table = tree.get_mut(section).and_then(toml::Value::as_table_mut);
        let table = table.ok_or_else(|| format!("there is no section `{section}`, expected one of {names}"))?;
        table.insert(field.to_owned(), parse_value(value.trim()));
        tree.try_into().map_err(|error: toml::de::Error| error.message().to_owned())
    }

    /// # Errors
    /// The first field out of its bounds.
    pub fn validate(&self) -> Result<(), RunConfigError> {
        let check = |(section, fields): (&'static str, &dyn Section)| {
            fields.validate().map_err(|source| RunConfigError::Value { section, source })
        };
        self.sections().into_iter().try_for_each(check)
    }

    /// The configuration as a TOML file that explains itself: documentation and bounds above every value.
    pub fn to_commented_toml(&self) -> String {
        let mut text =
            String::from("# Configuration of lrfslam. Every value may be left out; this is what holds then.\n");
        for (name, section) in self.sections() {
            write_section(&mut text, name, section);
        }
        text
    }

    /// What the log's reader needs to know.
    pub fn log_options(&self) -> LogOptions {
        let given = |value: f32| (value > 0.0).then_some(value);
        LogOptions {
            range_max_m: given(self.log.range_max_m),
            field_of_view_rad: given(self.log.field_of_view_deg).map(f32::to_radians),
            robot_from_lrf: (!self.mounting.from_log).then(|| self.robot_from_lrf()),
            scan_interval: Duration::from_micros((self.log.untimed_scan_interval_s * 1e6) as i64),
            topic: None,
            tf: TfWanted::default(),
        }
    }

    /// Defaults for a robot that does the SLAM itself: what fits its memory.
    pub fn for_robot() -> Self {
        Self::default().with_slam(&SlamConfig::small())
    }

    /// The part that a robot works with.
    pub fn robot(&self, seed: u64, laser: LaserConfig) -> RobotConfig {
        let robot_from_lrf = self.robot_from_lrf();
        RobotConfig { seed, robot_from_lrf, laser, slam: self.slam(), report: self.report }
    }

    /// The part that makes maps.
    pub fn mapping(&self) -> MappingConfig {
        let Self { hierarchy, high, closure, memory, map, .. } = *self;
        MappingConfig { slam: self.slam(), hierarchy, high, closure, memory, map }
    }

    /// The configuration that a map was made with.
    ///
    /// # Errors
    /// If this program does not know all of it.
    pub fn of_saved(saved: &SavedMap, folder: &Path) -> Result<Self, SavedMapError> {
        let file = || folder.join(saved_map::FILE_NAME);
        let unknown = |why: String| SavedMapError::Configuration(file(), saved.program.clone(), why);
        let config: Self = toml::from_str(&saved.config).map_err(|error| unknown(error.message().to_owned()))?;
        config.validate().map_err(|error| unknown(error.to_string()))?;
        Ok(config)
    }

    /// How the map of a robot that does the SLAM itself is made.
    pub fn robot_setup(&self) -> RobotSetup<Self> {
        RobotSetup { mapping: self.mapping(), robot_from_lrf: self.robot_from_lrf(), config: *self }
    }

    /// What pairs of scans are matched with.
    #[cfg(feature = "experiments")]
    pub fn rig(&self) -> lrfslam_lab::experiment::Rig {
        lrfslam_lab::experiment::Rig { slam: self.slam(), robot_from_lrf: self.robot_from_lrf() }
    }

    /// The part that finds and follows a robot in a map.
    pub fn localizer(&self) -> LocalizerConfig {
        let Self { localize, closure, memory, .. } = *self;
        LocalizerConfig { localize, slam: self.slam(), closure, memory }
    }

    /// The configured mounting of the laser, for logs that do not tell it.
    pub fn robot_from_lrf(&self) -> Pose2 {
        let mounting = &self.mounting;
        Pose2::new(mounting.forward_m, mounting.left_m, mounting.heading_deg.to_radians())
    }
}

/// A TOML value, or else plain text without its quotes.
fn parse_value(text: &str) -> toml::Value {
    let parsed = toml::from_str::<toml::Table>(&format!("value = {text}")).ok();
    parsed.and_then(|mut table| table.remove("value")).unwrap_or_else(|| toml::Value::String(text.to_owned()))
}

fn write_section(text: &mut String, name: &str, section: &dyn Section) {
    text.push('\n');
    push_comment(text, section.doc());
    text.push_str(&format!("[{name}]\n"));
    section.visit(&mut |field| {
        push_comment(text, field.doc);
        if !field.expected.is_empty() {
            push_comment(text, &[&field.expected]);
        }
        text.push_str(field.name);
        text.push_str(" = ");
        // Writing to a string cannot fail.
        let _ = field.value.write_toml(text);
        let _ = text.write_char('\n');
    });
}

fn push_comment(text: &mut String, lines: &[&str]) {
    for line in lines {
        text.push_str(&format!("# {}\n", line.trim()));
    }
}

#[cfg(test)]
mod tests;
