//! `lrfslam demo`: its arguments.

#[cfg(feature = "demo")]
mod live_cloud;
#[cfg(feature = "demo")]
mod results;
#[cfg(feature = "demo")]
mod robot;
#[cfg(feature = "demo")]
mod session;
#[cfg(feature = "demo")]
mod show;
#[cfg(feature = "demo")]
mod verdict;

use clap::{Args, ValueEnum};

#[cfg(feature = "demo")]
pub(super) use self::show::run;
use super::monitor::MonitorArgs;
use super::out::OutArgs;
use super::shared::{ConfigArgs, LRF, SECONDS, SeedArgs, TellArgs, seconds};

/// Show everything at once: a simulated robot drives, and its laser is mapped live.
///
/// A robot drives through a simulated building, with a laser on a pseudo-terminal; the real driver and the whole of SLAM follow it live.
/// At stops the laser is tilted, for a 3D map. At the end map, path, cloud and a table of errors against the truth are in the
/// folder. Takes less than two minutes.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Where results go.
    #[command(flatten)]
    pub out: OutArgs,
    #[arg(long, value_enum, default_value_t = DemoLrf::Lms200, help = LRF)]
    /// The laser.
    pub lrf: DemoLrf,
    /// Where: demo, office, floor, corridor, loop, ring, maze, small-maze, reflectors, room, a world file, or the YAML of a ROS map.
    #[arg(long, value_name = "NAME|FILE", default_value = "demo")]
    pub world: String,
    #[arg(long, value_name = "S", help = SECONDS, value_parser = seconds)]
    /// When the drive ends.
    pub seconds: Option<f64>,
    /// The configuration of the mapping.
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Of the laser's errors and of the mapping.
    #[command(flatten)]
    pub seed: SeedArgs,
    /// What is said.
    #[command(flatten)]
    pub tell: TellArgs,
    /// Who watches.
    #[command(flatten)]
    pub monitor: MonitorArgs,
}

/// Lasers that are simulated down to their bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DemoLrf {
    /// SICK LMS200, 8 m, at 500 kbit/s
    #[value(name = "lms200")]
    Lms200,
    /// SICK LMS200-30106 set to 80 m in cm, at 500 kbit/s
    #[value(name = "lms200-3016")]
    Lms200Far,
    /// SICK LMS291, 80 m, at 500 kbit/s
    #[value(name = "lms291")]
    Lms291,
    /// SICK LMS200 with the errors of a URG-04LX-UG01
    #[value(name = "lms200-noisy")]
    Lms200Noisy,
    /// Hokuyo URG-04LX-UG01, 5.6 m, USB
    #[value(name = "urg-04lx-ug01")]
    Urg04lxUg01,
    /// Hokuyo UTM-30LX, 30 m, USB
    #[value(name = "utm-30lx")]
    Utm30lx,
}

/// Says how to get the demonstration.
#[cfg(not(feature = "demo"))]
pub(super) fn run(_: &DemoArgs) -> Result<String, super::Failure> {
    Err(super::not_built_in("simulator", "demo"))
}
