//! A simulated laser of either family: in a world, or saying again a recording that it could have taken.

use lrfslam_core::scan::Beam;

use super::VirtualLrf;
use super::hokuyo::{HokuyoModel, VirtualHokuyo};
use super::recording::RecordedScan;
use super::sick::{SickModel, VirtualSick};
use crate::scene::Scene;

/// What to simulate.
#[derive(Debug, Clone)]
pub enum SensorModel {
    /// LMS2xx.
    Sick(SickModel),
    /// SCIP.
    Hokuyo(HokuyoModel),
}

impl SensorModel {
    /// The one that measures in all directions of `beams`, and in the fewest others; `None` if neither does.
    ///
    /// * `range_max_m` — the longest range that it tells
    pub fn of(beams: &[Beam], range_max_m: f32) -> Option<Self> {
        let model = SickModel::seeing(beams, range_max_m).map(Self::Sick);
        model.or_else(|| HokuyoModel::seeing(beams).map(Self::Hokuyo))
    }

    /// The laser in `scene`.
    ///
    /// * `baud` — the line's rate, bit/s, if it is not that of a sensor just switched on
    pub fn seeing(self, scene: Box<dyn Scene>, seed: u64, baud: Option<u32>) -> Box<dyn VirtualLrf> {
        match self {
            Self::Sick(model) => {
                let mut device = VirtualSick::new(model, scene, seed);
                baud.into_iter().for_each(|baud| device.set_baud(baud));
                Box::new(device)
            }
            Self::Hokuyo(model) => {
                let mut device = VirtualHokuyo::new(model, scene, seed);
                baud.into_iter().for_each(|baud| device.set_baud(baud));
                Box::new(device)
            }
        }
    }

    /// The laser, to say `scans`.
    pub fn say(self, scans: Vec<RecordedScan>) -> Box<dyn VirtualLrf> {
        match self {
            Self::Sick(model) => Box::new(VirtualSick::of_recording(model, scans)),
            Self::Hokuyo(model) => Box::new(VirtualHokuyo::of_recording(model, scans)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::scan::Echo;
    use lrfslam_core::time::Duration;

    fn beams(first_deg: f32, step_deg: f32, count: u16) -> Vec<Beam> {
        let bearing = |index: u16| (first_deg + f32::from(index) * step_deg).to_radians();
        let beam = |index| Beam { bearing_rad: bearing(index), offset: Duration::ZERO, echo: Echo::Hit(1.0) };
        (0..count).map(beam).collect()
    }

    fn name(beams: &[Beam]) -> Option<&'static str> {
        SensorModel::of(beams, 8.0).map(|laser| match laser {
            SensorModel::Sick(_) => "sick",
            SensorModel::Hokuyo(_) => "hokuyo",
        })
    }

    #[test]
    fn lasers_are_known_by_their_beams() {
        for (first, step, count) in [(-90.0, 1.0, 180), (-90.0, 1.0, 181), (-90.0, 0.5, 361), (-50.0, 0.25, 401)] {
            assert_eq!(name(&beams(first, step, count)), Some("sick"), "{count} beams");
        }
        let step = 360.0 / 1024.0;
        assert_eq!(name(&beams(-340.0 * step, step, 682)), Some("hokuyo"));
        for (first, step, count) in [(-135.0, 0.25, 1081), (-90.0, 0.7, 200), (-90.0, 1.0, 0), (-90.0, 0.25, 721)] {
            assert_eq!(name(&beams(first, step, count)), None, "{count} beams");
        }
    }
}
