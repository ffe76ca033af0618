//! The driver of whichever laser is configured.

use super::config::{LaserConfig, LaserFamily};
use crate::lrf::driver::{BaudPolicy, LrfDriver};
use crate::lrf::hokuyo_scip::{HokuyoConfig, HokuyoDriver};
use crate::lrf::sick_lms::{SickConfig, SickDriver};
use crate::scan::Beam;

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
