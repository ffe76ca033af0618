//! The families of lasers that there are drivers for, and what a user may say of one.

use serde::{Deserialize, Serialize};

/// Which protocol the sensor speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LrfFamily {
    /// SICK LMS200, 211, 220, 221, 291.
    #[serde(rename = "sick-lms2xx")]
    SickLms2xx,
    /// Hokuyo URG, UBG, UHG, UTM, UXM, UST.
    Hokuyo,
    /// Slamtec RPLIDAR A1, A2, A3, C1.
    Rplidar,
    /// LDROBOT LD06, LD19.
    Ld06,
}

/// What a family is called.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Names {
    /// As for `--lrf`.
    pub flag: &'static str,
    /// By people, with its article.
    pub article: &'static str,
    /// See `article`.
    pub name: &'static str,
    /// What it says.
    pub protocol: &'static str,
    /// Its models.
    pub models: &'static str,
}

impl LrfFamily {
    /// All of them, those first that are found out soonest.
    pub const ALL: [Self; 4] = [Self::Ld06, Self::Rplidar, Self::SickLms2xx, Self::Hokuyo];

    /// What it is called.
    pub const fn names(self) -> Names {
        match self {
            Self::SickLms2xx => Names {
                flag: "sick-lms2xx",
                article: "a",
                name: "SICK LMS2xx",
                protocol: "a SICK telegram",
                models: "SICK LMS200, 211, 220, 221, 291",
            },
            Self::Hokuyo => Names {
                flag: "hokuyo",
                article: "a",
                name: "Hokuyo",
                protocol: "SCIP",
                models: "Hokuyo URG, UBG, UHG, UTM, UXM, UST (SCIP), serial or Ethernet",
            },
            Self::Rplidar => Names {
                flag: "rplidar",
                article: "an",
                name: "RPLIDAR",
                protocol: "an RPLIDAR response",
                models: "Slamtec RPLIDAR A1, A2, A3, C1",
            },
            Self::Ld06 => Names {
                flag: "ld06",
                article: "an",
                name: "LD06",
                protocol: "an LD06 packet",
                models: "LDROBOT LD06, LD19",
            },
        }
    }

    /// False if it takes no commands: it turns while it has power.
    pub fn can_be_stopped(self) -> bool {
        self != Self::Ld06
    }

    /// The rates that a laser of this family can have, bit/s; others are refused before anything is sent.
    pub fn rates(self) -> &'static [u32] {
        match self {
            Self::SickLms2xx => &[9_600, 19_200, 38_400, 500_000],
            Self::Hokuyo => &[19_200, 38_400, 57_600, 115_200, 250_000, 500_000, 750_000],
            Self::Rplidar => &[115_200, 256_000, 460_800, 1_000_000],
            Self::Ld06 => &[230_400],
        }
    }

    /// True if it can be at a link whose rate, if it has one, nobody can change: a SICK is always changed to another.
    pub fn suits_fixed_rate(self) -> bool {
        self != Self::SickLms2xx
    }
}

impl std::fmt::Display for LrfFamily {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(self.names().name)
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
    /// False for TCP and UDP.
    pub has_baud: bool,
    /// SICK: field of view, degrees, and resolution, 1/100 degree.
    #[serde(default)]
    pub variant: Option<(u16, u16)>,
    /// SICK below 1°: whole scans instead of mirror turns.
    #[serde(default)]
    pub whole_scans: bool,
    /// SICK: the measuring mode that tells how bright echoes are.
    #[serde(default)]
    pub brightness: bool,
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
        let (variant, whole_scans, brightness) = (None, false, false);
        Self { family, baud: 0, has_baud: true, variant, whole_scans, brightness, cluster: 1, latency_us: 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_lrf::{hokuyo_scip, sick_lms};

    #[test]
    fn rates_are_those_that_the_drivers_look_at() {
        let sorted = |rates: &[u32]| {
            let mut rates = rates.to_vec();
            rates.sort_unstable();
            rates
        };
        assert_eq!(LrfFamily::SickLms2xx.rates(), sorted(&sick_lms::driver::RATES));
        assert_eq!(LrfFamily::Hokuyo.rates(), sorted(&hokuyo_scip::driver::RATES));
    }
}
