//! Runs core drivers over a link: the only place where a laser meets the clock.
//!
//! [`LrfOptions`] says which driver, and [`Search`] which are tried and for how long; [`run_driver`] opens the port, and opens
//! it again after it was unplugged, moves bytes and deadlines between both, records them, and hands out events until it
//! is told to stop, or nothing answers.

mod run;
mod search;

use super::family::{LrfFamily, LrfOptions};
use lrfslam_core::scan::Beam;
use lrfslam_core::time::Duration;
use lrfslam_lrf::driver::{BaudPolicy, LrfDriver};
use lrfslam_lrf::hokuyo_scip::driver as hokuyo;
use lrfslam_lrf::hokuyo_scip::{HokuyoConfig, HokuyoDriver};
use lrfslam_lrf::ldrobot::LdrobotDriver;
use lrfslam_lrf::rplidar::driver as rplidar;
use lrfslam_lrf::rplidar::{RplidarConfig, RplidarDriver};
use lrfslam_lrf::sick_lms::driver as sick;
use lrfslam_lrf::sick_lms::{SickConfig, SickDriver, Variant};

pub use run::{DriverEvent, EventSink, HostClock, Opener, RunEnd, run_driver};
pub use search::{GaveUp, Heard, Search};

impl LrfOptions {
    /// The driver, in memory that the caller keeps.
    pub fn driver<'a>(&self, memory: &'a mut LaserMemory) -> Box<dyn LrfDriver + Send + 'a> {
        let latency = Duration::from_micros(self.latency_us);
        let (bytes, beams) = (&mut memory.bytes, &mut memory.beams);
        match self.family {
            LrfFamily::SickLms2xx => {
                let variant = self.variant.map(|(angle_deg, resolution_cdeg)| Variant { angle_deg, resolution_cdeg });
                let baud = self.baud_policy(38_400);
                let (each_turn, brightness) = (!self.whole_scans, self.brightness);
                let config = SickConfig { baud, variant, brightness, each_turn, latency, ..SickConfig::default() };
                let driver = SickDriver::new(config, bytes.get_mut(..sick::TELEGRAM_MEMORY).unwrap_or_default(), beams);
                Box::new(driver.with_brightness(&mut memory.brightness))
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
    brightness: Vec<u8>,
}

impl Default for LaserMemory {
    fn default() -> Self {
        let bytes = hokuyo::FRAME_MEMORY.max(sick::TELEGRAM_MEMORY);
        let beams = vec![Beam::BLANK; hokuyo::BEAM_MEMORY.max(rplidar::BEAM_MEMORY)];
        Self { bytes: vec![0; bytes], beams, brightness: vec![0; sick::BEAM_MEMORY] }
    }
}
