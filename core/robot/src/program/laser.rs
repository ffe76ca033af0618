//! The driver of whichever laser is configured.

use crate::config::{LaserConfig, LaserFamily};
use lrfslam_core::scan::Beam;
use lrfslam_lrf::driver::{BaudPolicy, LrfDriver};
use lrfslam_lrf::hokuyo_scip::{HokuyoConfig, HokuyoDriver};
use lrfslam_lrf::sick_lms::{SickConfig, SickDriver};

#[derive(Debug)]
// It exists once and is never moved after its making.
#[allow(clippy::large_enum_variant)]
pub(super) enum Laser<'m> {
    Hokuyo(HokuyoDriver<'m>),
    Sick(SickDriver<'m>),
}

impl<'m> Laser<'m> {
    pub(super) fn new(config: &LaserConfig, telegram: &'m mut [u8], beams: &'m mut [Beam]) -> Self {
        let baud = if config.baud == 0 { BaudPolicy::Keep } else { BaudPolicy::AtLeast(config.baud) };
        match config.family {
            LaserFamily::Hokuyo => {
                let config = HokuyoConfig { baud, cluster: config.cluster.max(1), ..HokuyoConfig::default() };
                Laser::Hokuyo(HokuyoDriver::new(config, telegram, beams))
            }
            LaserFamily::Sick => {
                Laser::Sick(SickDriver::new(SickConfig { baud, ..SickConfig::default() }, telegram, beams))
            }
        }
    }

    pub(super) fn driver(&mut self) -> &mut (dyn LrfDriver + 'm) {
        match self {
            Laser::Hokuyo(driver) => driver,
            Laser::Sick(driver) => driver,
        }
    }
}
