//! Runs core drivers over a link: the only place where a laser meets the clock.
//!
//! [`LrfOptions`] says which driver, and [`Search`] which are tried and for how long; [`run_driver`] opens the port, and opens
//! it again after it was unplugged, moves bytes and deadlines between both, records them, and hands out events until it
//! is told to stop, or nothing answers.

mod run;
mod search;

use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::Duration;
use lrfslam_lrf::driver::{BaudPolicy, LrfDriver};
use lrfslam_lrf::hokuyo_scip::driver as hokuyo;
use lrfslam_lrf::hokuyo_scip::{HokuyoConfig, HokuyoDriver};
use lrfslam_lrf::ldrobot::LdrobotDriver;
use lrfslam_lrf::rplidar::driver as rplidar;
use lrfslam_lrf::rplidar::{RplidarConfig, RplidarDriver};
use lrfslam_lrf::sick_lms::driver as sick;
use lrfslam_lrf::sick_lms::{SickConfig, SickDriver, Variant};
use serde::{Deserialize, Serialize};

pub use run::{DriverEvent, EventSink, HostClock, Opener, RunEnd, run_driver};
pub use search::{GaveUp, Heard, Search};

/// Which protocol the sensor speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum LrfFamily {
    /// SICK LMS200, 211, 220, 221, 291
    #[serde(rename = "sick-lms2xx")]
    #[value(name = "sick-lms2xx")]
    SickLms2xx,
    /// Hokuyo URG, UBG, UHG, UTM, UXM, UST (SCIP), serial or Ethernet
    Hokuyo,
    /// Slamtec RPLIDAR A1, A2, A3, C1
    Rplidar,
    /// LDROBOT LD06, LD19
    Ld06,
}

impl LrfFamily {
    /// All of them, those first that are found out soonest.
    pub const ALL: [Self; 4] = [Self::Ld06, Self::Rplidar, Self::SickLms2xx, Self::Hokuyo];

    /// As for `--lrf`.
    pub fn flag(self) -> &'static str {
        match self {
            Self::SickLms2xx => "sick-lms2xx",
            Self::Hokuyo => "hokuyo",
            Self::Rplidar => "rplidar",
            Self::Ld06 => "ld06",
        }
    }

    /// What stands before its name.
    pub fn article(self) -> &'static str {
        match self {
            Self::SickLms2xx | Self::Hokuyo => "a",
            Self::Rplidar | Self::Ld06 => "an",
        }
    }

    /// What it says, as people call it.
    pub fn protocol(self) -> &'static str {
        match self {
            Self::SickLms2xx => "a SICK telegram",
            Self::Hokuyo => "SCIP",
            Self::Rplidar => "an RPLIDAR response",
            Self::Ld06 => "an LD06 packet",
        }
    }

    /// True if it can be at a link whose rate, if it has one, nobody can change: a SICK is always changed to another.
    pub fn suits_fixed_rate(self) -> bool {
        self != Self::SickLms2xx
    }
}

impl std::fmt::Display for LrfFamily {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(match self {
            Self::SickLms2xx => "SICK LMS2xx",
            Self::Hokuyo => "Hokuyo",
            Self::Rplidar => "RPLIDAR",
            Self::Ld06 => "LD06",
        })
    }
}

/// Everything that decides what a driver does; with the same inputs it then does the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LrfOptions {
    /// Which driver.
    pub family: LrfFamily,
    /// Rate to change to, bit/s; 0 for "auto": found, and raised to what every serial port can.
    #[serde(default)]
    pub baud: u32,
    /// False for TCP.
    pub has_baud: bool,
    /// SICK: field of view, degrees, and resolution, 1/100 degree.
    #[serde(default)]
    pub variant: Option<(u16, u16)>,
    /// SICK below 1°: whole scans instead of mirror turns.
    #[serde(default)]
    pub whole_scans: bool,
    /// Hokuyo: neighbouring steps merged.
    #[serde(default)]
    pub cluster: u8,
    /// Subtracted from every stamp, µs.
    #[serde(default)]
    pub latency_us: i64,
}

impl LrfOptions {
    /// Everything as the sensor has it, on a serial port.
    pub fn new(family: LrfFamily) -> Self {
        Self { family, baud: 0, has_baud: true, variant: None, whole_scans: false, cluster: 1, latency_us: 0 }
    }

    /// The driver, in memory that the caller keeps.
    pub fn driver<'a>(&self, memory: &'a mut LaserMemory) -> Box<dyn LrfDriver + Send + 'a> {
        let latency = Duration::from_micros(self.latency_us);
        let (bytes, beams) = (&mut memory.bytes[..], &mut memory.beams[..]);
        match self.family {
            LrfFamily::SickLms2xx => {
                let variant = self.variant.map(|(angle_deg, resolution_cdeg)| Variant { angle_deg, resolution_cdeg });
                let baud = self.baud_policy(38_400);
                let config =
                    SickConfig { baud, variant, each_turn: !self.whole_scans, latency, ..SickConfig::default() };
                Box::new(SickDriver::new(config, &mut bytes[..sick::TELEGRAM_MEMORY], beams))
            }
            LrfFamily::Hokuyo => {
                let (baud, cluster) = (self.baud_policy(115_200), self.cluster.max(1));
                let config = HokuyoConfig { baud, cluster, latency, ..HokuyoConfig::default() };
                Box::new(HokuyoDriver::new(config, bytes, beams))
            }
            LrfFamily::Rplidar => Box::new(RplidarDriver::new(RplidarConfig { baud: self.baud, latency }, beams)),
            LrfFamily::Ld06 => Box::new(LdrobotDriver::new(latency, beams)),
        }
    }

    /// * `usual` — the fastest rate that any serial port and cable of this family manages
    fn baud_policy(&self, usual: u32) -> BaudPolicy {
        match self.baud {
            _ if !self.has_baud => BaudPolicy::NoRate,
            0 => BaudPolicy::AtLeast(usual),
            rate => BaudPolicy::Raise(rate),
        }
    }
}

/// Memory that a driver borrows: enough for the largest scan of any family.
#[derive(Debug)]
pub struct LaserMemory {
    bytes: Vec<u8>,
    beams: Vec<Beam>,
}

impl Default for LaserMemory {
    fn default() -> Self {
        let blank = Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Invalid };
        let bytes = hokuyo::FRAME_MEMORY.max(sick::TELEGRAM_MEMORY);
        Self { bytes: vec![0; bytes], beams: vec![blank; hokuyo::BEAM_MEMORY.max(rplidar::BEAM_MEMORY)] }
    }
}
