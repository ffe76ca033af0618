//! A laser that is tilted about its own lateral axis, and the encoder that says how far.
//!
//! A tilt is the angle by which the laser looks **up** from level. Source: thesis, §4.3.2 and figure 4.12: 0° to 90°.

use lrfslam_core::time::{Duration, Instant};
use serde::Deserialize;

use crate::world::building::{PartFault, check};

/// One sweep up and back to level.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// Lowest tilt, degrees.
    #[serde(default)]
    pub from_deg: f64,
    /// Highest tilt, degrees.
    #[serde(default = "straight_up")]
    pub to_deg: f64,
    /// Turn rate of the tilt unit, degrees per second: of the sweep, or between two stands.
    #[serde(default = "usual_rate")]
    pub rate_degps: f64,
    /// Stop and go: so far from stand to stand, degrees. Without it the sweep is continuous.
    pub step_deg: Option<f64>,
    /// Stop and go: how long each stand is, s.
    #[serde(default = "usual_stand")]
    pub stand_s: f64,
}

fn straight_up() -> f64 {
    90.0
}

fn usual_rate() -> f64 {
    30.0
}

fn usual_stand() -> f64 {
    0.1
}

impl Sweep {
    pub(crate) fn check(&self) -> Result<(), PartFault> {
        let angles = (-90.0..=90.0).contains(&self.from_deg) && (-90.0..=90.0).contains(&self.to_deg);
        check(angles && self.from_deg < self.to_deg, "sweep.to_deg", "more than from_deg, both from -90 to 90")?;
        check(self.rate_degps > 0.0 && self.rate_degps.is_finite(), "sweep.rate_degps", "a positive rate")?;
        let fine = self.step_deg.is_none_or(|step| (0.05..=90.0).contains(&step));
        check(fine, "sweep.step_deg", "0.05 to 90 degrees")?;
        check((0.0..=60.0).contains(&self.stand_s), "sweep.stand_s", "0 to 60 s")
    }
}

/// Tilt over time: straight lines between (time, tilt) pairs, level before and after.
#[derive(Debug, Clone, Default)]
pub struct TiltPlan {
    /// s and rad, times rising.
    knots: Vec<(f64, f64)>,
}

impl TiltPlan {
    /// Adds a sweep that begins at `begins_s`; returns how long it takes, s.
    pub(crate) fn add(&mut self, begins_s: f64, sweep: &Sweep) -> f64 {
        let mut at = begins_s;
        let mut tilt_deg = 0.0;
        let mut go = |to_deg: f64, stand_s: f64| {
            self.knots.push((at, f64::to_radians(tilt_deg)));
            at += (to_deg - tilt_deg).abs() / sweep.rate_degps;
            tilt_deg = to_deg;
            self.knots.push((at, to_deg.to_radians()));
            at += stand_s;
        };
        match sweep.step_deg {
            None => {
                go(sweep.from_deg, 0.0);
                go(sweep.to_deg, 0.0);
            }
            Some(step_deg) => {
                let steps = ((sweep.to_deg - sweep.from_deg) / step_deg + 1e-9) as u32;
                (0..=steps).for_each(|step| go(sweep.from_deg + f64::from(step) * step_deg, sweep.stand_s));
            }
        }
        go(0.0, 0.0);
        at - begins_s
    }

    /// The tilt, rad.
    pub fn tilt_rad(&self, at: Instant) -> f64 {
        let at = at.as_secs_f64();
        let next = self.knots.partition_point(|(time, _)| *time <= at);
        match (next.checked_sub(1).and_then(|last| self.knots.get(last)), self.knots.get(next)) {
            (Some((t0, a)), Some((t1, b))) => a + (b - a) * (at - t0) / (t1 - t0),
            _ => 0.0,
        }
    }
}

/// The tilt unit's encoder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoder {
    /// Steps of a whole turn.
    pub steps_per_turn: u32,
    /// From reading to reading.
    pub period: Duration,
}

impl Default for Encoder {
    /// 4096 steps a turn, 0.088°, read 100 times a second.
    fn default() -> Self {
        Self { steps_per_turn: 4096, period: Duration::from_millis(10) }
    }
}

impl Encoder {
    /// The readings from the simulator's time zero until `end`: when, and the tilt in whole steps, rad.
    pub fn readings<'p>(&self, plan: &'p TiltPlan, end: Instant) -> impl Iterator<Item = (Instant, f64)> + use<'p> {
        let step_rad = 2.0 * std::f64::consts::PI / f64::from(self.steps_per_turn.max(1));
        let period = self.period.micros.max(1);
        let times = (0..=end.micros / period).map(move |index| Instant::from_micros(index * period));
        times.map(move |at| (at, (plan.tilt_rad(at) / step_rad).round() * step_rad))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep() -> Sweep {
        Sweep { from_deg: 0.0, to_deg: 90.0, rate_degps: 30.0, step_deg: None, stand_s: 0.5 }
    }

    fn tilt_deg(plan: &TiltPlan, at_s: f64) -> f64 {
        plan.tilt_rad(Instant::from_secs_f64(at_s)).to_degrees()
    }

    #[test]
    fn continuous_sweep_goes_up_and_back() {
        let mut plan = TiltPlan::default();
        assert_eq!(plan.add(10.0, &sweep()), 6.0);
        let expected = [(0.0, 0.0), (10.0, 0.0), (11.0, 30.0), (13.0, 90.0), (14.5, 45.0), (16.5, 0.0)];
        for (at, tilt) in expected {
            assert!((tilt_deg(&plan, at) - tilt).abs() < 1e-9, "{at}: {}", tilt_deg(&plan, at));
        }
    }

    #[test]
    fn stop_and_go_stands_at_every_step() {
        let mut plan = TiltPlan::default();
        let stop_and_go = Sweep { to_deg: 60.0, step_deg: Some(30.0), ..sweep() };
        assert_eq!(plan.add(0.0, &stop_and_go), 1.5 + 2.0 + 2.0);
        let expected =
            [(0.2, 0.0), (0.5, 0.0), (1.0, 15.0), (1.5, 30.0), (1.9, 30.0), (3.2, 60.0), (4.5, 30.0), (6.0, 0.0)];
        for (at, tilt) in expected {
            assert!((tilt_deg(&plan, at) - tilt).abs() < 1e-9, "{at}: {}", tilt_deg(&plan, at));
        }
    }

    #[test]
    fn encoder_reads_whole_steps() {
        let mut plan = TiltPlan::default();
        plan.add(0.0, &sweep());
        let encoder = Encoder { steps_per_turn: 360, period: Duration::from_millis(100) };
        let readings: Vec<(Instant, f64)> = encoder.readings(&plan, Instant::from_micros(1_000_000)).collect();
        assert_eq!(readings.len(), 11);
        assert_eq!(readings[10].0, Instant::from_micros(1_000_000));
        for (at, tilt) in readings {
            assert!((tilt.to_degrees() - tilt.to_degrees().round()).abs() < 1e-9);
            assert!((tilt - plan.tilt_rad(at)).abs() <= 0.5_f64.to_radians() + 1e-9);
        }
    }

    #[test]
    fn impossible_sweeps_are_refused() {
        assert_eq!(Sweep { to_deg: 95.0, ..sweep() }.check().unwrap_err().key, "sweep.to_deg");
        assert_eq!(Sweep { rate_degps: 0.0, ..sweep() }.check().unwrap_err().key, "sweep.rate_degps");
        assert_eq!(Sweep { step_deg: Some(0.0), ..sweep() }.check().unwrap_err().key, "sweep.step_deg");
        assert!(sweep().check().is_ok());
    }
}
