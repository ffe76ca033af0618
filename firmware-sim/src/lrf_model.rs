//! What laser range finders are, as numbers: geometry, pace, and how they err.
//!
//! Source: thesis, table 4.3 and §4.3.3; the makers' data sheets.

use lrfslam_core::math;
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::time::{Duration, Instant};
use rand_pcg::Pcg32;

use crate::scene::Scene;

/// The parameters of a laser range finder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LrfModel {
    /// As on the command line.
    pub name: &'static str,
    /// From the first beam to the last, degrees; half of it on each side.
    pub field_of_view_deg: f64,
    /// From beam to beam, degrees.
    pub resolution_deg: f64,
    /// Shortest and longest range, m.
    pub range_m: [f64; 2],
    /// Mirror turns per second; the field of view takes its part of a turn.
    pub rate_hz: f64,
    /// How it errs.
    pub errors: LrfErrors,
}

/// How ranges differ from the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LrfErrors {
    /// The same for all, m.
    pub systematic_m: f64,
    /// Different each time.
    pub statistical: Statistical,
    /// Angle that a beam is wide, degrees.
    pub beam_deg: f64,
    /// Chance that a beam which lights two things at different ranges reports a range between them.
    pub mixed: f64,
    /// Chance that a beam fails: no range but an error.
    pub lost: f64,
    /// Chance that a beam sees nothing where something is: glass, a black surface.
    pub overlooked: f64,
}

/// The three forms in which makers state the statistical error. Source: thesis, §4.3.3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Statistical {
    /// Normal, by its standard deviation, m.
    StandardDeviation(f64),
    /// ± a bound, m; within it each value is as likely as any other.
    Bound(f64),
    /// ± a bound up to a range, beyond it ± a fraction of the range; within, each value is as likely as any other.
    BoundThenFraction {
        /// m.
        bound_m: f64,
        /// m.
        up_to_m: f64,
        /// Of the range.
        fraction: f64,
    },
}

impl Statistical {
    fn draw(&self, range_m: f64, rng: &mut Pcg32) -> f64 {
        let mut within = |bound: f64| bound * (2.0 * f64::from(math::uniform(rng)) - 1.0);
        match *self {
            Self::StandardDeviation(sigma_m) => sigma_m * f64::from(math::normal(rng)),
            Self::Bound(bound_m) => within(bound_m),
            Self::BoundThenFraction { bound_m, up_to_m, fraction } => {
                within(if range_m <= up_to_m { bound_m } else { fraction * range_m })
            }
        }
    }
}

impl LrfErrors {
    /// A laser that tells the truth.
    pub const NONE: Self = Self {
        systematic_m: 0.0,
        statistical: Statistical::StandardDeviation(0.0),
        beam_deg: 0.0,
        mixed: 0.0,
        lost: 0.0,
        overlooked: 0.0,
    };

    /// Nothing but normal errors of this standard deviation, m.
    pub const fn gaussian(sigma_m: f64) -> Self {
        Self { statistical: Statistical::StandardDeviation(sigma_m), ..Self::NONE }
    }

    /// What indoor lasers share: half of the beams on an edge are mixed, few are lost.
    const fn usual(statistical: Statistical, beam_deg: f64) -> Self {
        Self { statistical, beam_deg, mixed: 0.5, lost: 0.002, overlooked: 0.001, ..Self::NONE }
    }
}

impl LrfModel {
    /// SICK LMS200: 180° by 0.5°, 8 m in millimetres, 75 turns a second, 5 mm.
    pub const LMS200: Self = Self {
        name: "lms200",
        field_of_view_deg: 180.0,
        resolution_deg: 0.5,
        range_m: [0.0, 8.0],
        rate_hz: 75.0,
        errors: LrfErrors::usual(Statistical::StandardDeviation(0.005), 0.25),
    };
    /// SICK LMS200-30106: 80 m, with its systematic error of 15 mm. Source: thesis, §4.3.3.
    pub const LMS200_3016: Self = Self {
        name: "lms200-3016",
        range_m: [0.0, 80.0],
        errors: LrfErrors { systematic_m: 0.015, ..Self::LMS200.errors },
        ..Self::LMS200
    };
    /// SICK LMS291: 80 m, 10 mm.
    pub const LMS291: Self = Self {
        name: "lms291",
        range_m: [0.0, 80.0],
        errors: LrfErrors::usual(Statistical::StandardDeviation(0.010), 0.25),
        ..Self::LMS200
    };
    /// Hokuyo URG-04LX: 240° by 360°/1024, 10 turns a second; ±10 mm to 1 m, then 1 %.
    pub const URG_04LX: Self = Self {
        name: "urg-04lx",
        field_of_view_deg: 681.0 * 360.0 / 1024.0,
        resolution_deg: 360.0 / 1024.0,
        range_m: [0.02, 5.6],
        rate_hz: 10.0,
        errors: LrfErrors {
            lost: 0.02,
            ..LrfErrors::usual(Statistical::BoundThenFraction { bound_m: 0.01, up_to_m: 1.0, fraction: 0.01 }, 0.5)
        },
    };
    /// Hokuyo URG-04LX-UG01: the same, ±30 mm to 1 m, then 3 %.
    pub const URG_04LX_UG01: Self = Self {
        name: "urg-04lx-ug01",
        errors: LrfErrors {
            statistical: Statistical::BoundThenFraction { bound_m: 0.03, up_to_m: 1.0, fraction: 0.03 },
            ..Self::URG_04LX.errors
        },
        ..Self::URG_04LX
    };
    /// Hokuyo UTM-30LX: 270° by 0.25°, 30 m, 40 turns a second; repeats to 10 mm.
    pub const UTM_30LX: Self = Self {
        name: "utm-30lx",
        field_of_view_deg: 270.0,
        resolution_deg: 0.25,
        range_m: [0.023, 30.0],
        rate_hz: 40.0,
        errors: LrfErrors { lost: 0.005, ..LrfErrors::usual(Statistical::StandardDeviation(0.010), 0.5) },
    };
    /// All that are known.
    pub const ALL: [Self; 6] =
        [Self::LMS200, Self::LMS200_3016, Self::LMS291, Self::URG_04LX, Self::URG_04LX_UG01, Self::UTM_30LX];

    /// Beams of a scan.
    pub fn beams(&self) -> usize {
        (self.field_of_view_deg / self.resolution_deg).round() as usize + 1
    }

    /// Direction of a beam, rad; the first looks farthest right.
    pub fn bearing_rad(&self, beam: usize) -> f64 {
        (beam as f64 * self.resolution_deg - self.field_of_view_deg / 2.0).to_radians()
    }

    /// When a beam leaves, from the first one on.
    pub fn beam_offset(&self, beam: usize) -> Duration {
        Duration::from_micros((beam as f64 * self.resolution_deg / 360.0 / self.rate_hz * 1e6).round() as i64)
    }

    /// From the first beam to the last.
    pub fn sweep(&self) -> Duration {
        self.beam_offset(self.beams().saturating_sub(1))
    }
}

/// What a laser makes of one beam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// A range, m; whether it is within the laser's reach is not asked here.
    Range(f64),
    /// Nothing is there, or nothing was seen.
    Nothing,
    /// No measurement; the number below 16 picks an error code.
    Failed(u32),
}

/// Measures in a scene, with errors.
#[derive(Debug, Clone)]
pub struct RangeMeter {
    errors: LrfErrors,
    rng: Pcg32,
}

impl RangeMeter {
    /// `seed` decides all errors.
    pub fn new(errors: LrfErrors, seed: u64) -> Self {
        Self { errors, rng: Pcg32::new(seed, 0xDA7A) }
    }

    /// Measures along one beam.
    pub fn measure(&mut self, scene: &(impl Scene + ?Sized), at: Instant, bearing_rad: f64) -> Reading {
        if self.happens(self.errors.lost) {
            return Reading::Failed((math::uniform(&mut self.rng) * 16.0) as u32);
        }
        if self.happens(self.errors.overlooked) {
            return Reading::Nothing;
        }
        let Some(range_m) = self.seen_m(scene, at, bearing_rad) else { return Reading::Nothing };
        let error_m = self.errors.systematic_m + self.errors.statistical.draw(range_m, &mut self.rng);
        Reading::Range((range_m + error_m).max(0.0))
    }

    /// A draw even if it cannot happen would change what follows; so none is made.
    fn happens(&mut self, chance: f64) -> bool {
        chance > 0.0 && f64::from(math::uniform(&mut self.rng)) < chance
    }

    /// What a beam as wide as it is sees: the nearer of what its two borders meet, or at an edge something between.
    fn seen_m(&mut self, scene: &(impl Scene + ?Sized), at: Instant, bearing_rad: f64) -> Option<f64> {
        /// Echoes nearer together than this are one pulse for the laser anyway, m.
        const EDGE_M: f64 = 0.1;
        let middle = scene.range_m(at, bearing_rad);
        if self.errors.mixed <= 0.0 {
            return middle;
        }
        let half = self.errors.beam_deg.to_radians() / 2.0;
        let border = [-half, half].map(|aside| scene.range_m(at, bearing_rad + aside));
        let [Some(a), Some(b)] = border else { return border[0].or(border[1]).or(middle) };
        // A wall seen at a slant is no edge, however far apart its two borders are.
        let flat_m = 2.0 * half.cos() * a * b / (a + b);
        if (a - b).abs() < EDGE_M || middle.is_some_and(|middle| (middle - flat_m).abs() < EDGE_M / 2.0) {
            return middle;
        }
        if !self.happens(self.errors.mixed) {
            return Some(a.min(b));
        }
        Some(a + (b - a) * f64::from(math::uniform(&mut self.rng)))
    }
}

/// A laser that takes whole scans: for logs and experiments. Those on serial lines are in [`crate::virtual_lrf`].
#[derive(Debug, Clone)]
pub struct SimulatedLrf {
    model: LrfModel,
    meter: RangeMeter,
}

impl SimulatedLrf {
    /// `seed` decides all errors.
    pub fn new(model: LrfModel, seed: u64) -> Self {
        Self { model, meter: RangeMeter::new(model.errors, seed) }
    }

    /// What it is.
    pub fn model(&self) -> &LrfModel {
        &self.model
    }

    /// One sweep, its first beam at `start`; each beam leaves from where the robot is by then.
    pub fn sweep(&mut self, scene: &(impl Scene + ?Sized), start: Instant) -> Vec<Beam> {
        (0..self.model.beams()).map(|beam| self.beam(scene, start, beam, self.model.beam_offset(beam))).collect()
    }

    /// One scan whose beams all leave at once, as the robot stands at `at`.
    pub fn snapshot(&mut self, scene: &(impl Scene + ?Sized), at: Instant) -> Vec<Beam> {
        (0..self.model.beams()).map(|beam| self.beam(scene, at, beam, Duration::ZERO)).collect()
    }

    fn beam(&mut self, scene: &(impl Scene + ?Sized), start: Instant, beam: usize, offset: Duration) -> Beam {
        let bearing_rad = self.model.bearing_rad(beam);
        let [shortest, longest] = self.model.range_m;
        let echo = match self.meter.measure(scene, start + offset, bearing_rad) {
            Reading::Range(range_m) if range_m >= longest => Echo::Miss,
            Reading::Range(range_m) if range_m > shortest => Echo::Hit(range_m as f32),
            Reading::Nothing => Echo::Miss,
            Reading::Range(_) | Reading::Failed(_) => Echo::Invalid,
        };
        Beam { bearing_rad: bearing_rad as f32, offset, echo }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall straight ahead at 2 m up to a bearing, and another behind it.
    struct Edge {
        behind_m: f64,
    }

    impl Scene for Edge {
        fn range_m(&self, _: Instant, bearing_rad: f64) -> Option<f64> {
            Some(if bearing_rad < 0.0 { 2.0 } else { self.behind_m })
        }
    }

    fn errors_at(errors: LrfErrors, range_m: f64) -> Vec<f64> {
        let mut meter = RangeMeter::new(errors, 3);
        let scene = Edge { behind_m: range_m };
        let readings = (0..20_000).map(|_| meter.measure(&scene, Instant::default(), 1.0));
        let error = |reading| match reading {
            Reading::Range(measured) => Some(measured - range_m),
            _ => None,
        };
        readings.filter_map(error).collect()
    }

    fn mean_and_deviation(errors: &[f64]) -> (f64, f64) {
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let variance = errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / errors.len() as f64;
        (mean, variance.sqrt())
    }

    #[test]
    fn errors_have_the_stated_size_in_all_three_forms() {
        let (mean, deviation) = mean_and_deviation(&errors_at(LrfModel::LMS200_3016.errors, 5.0));
        assert!((mean - 0.015).abs() < 2e-4 && (deviation - 0.005).abs() < 2e-4, "{mean} {deviation}");
        let bound = LrfErrors { statistical: Statistical::Bound(0.01), ..LrfErrors::NONE };
        let errors = errors_at(bound, 5.0);
        assert!(errors.iter().all(|error| error.abs() <= 0.01 + 1e-12));
        assert!((mean_and_deviation(&errors).1 - 0.01 / 3_f64.sqrt()).abs() < 1e-4);
        for (range_m, bound_m) in [(0.5, 0.03), (1.0, 0.03), (4.0, 0.12)] {
            let errors = errors_at(LrfModel::URG_04LX_UG01.errors, range_m);
            let worst = errors.iter().fold(0.0_f64, |worst, error| worst.max(error.abs()));
            assert!(worst <= bound_m + 1e-9 && worst > 0.98 * bound_m, "{range_m}: {worst}");
        }
    }

    #[test]
    fn lost_and_overlooked_beams_are_as_many_as_stated() {
        let errors = LrfErrors { lost: 0.02, overlooked: 0.05, ..LrfErrors::NONE };
        let mut meter = RangeMeter::new(errors, 5);
        let readings: Vec<Reading> =
            (0..50_000).map(|_| meter.measure(&Edge { behind_m: 3.0 }, Instant::default(), 1.0)).collect();
        let share = |wanted: fn(&Reading) -> bool| readings.iter().filter(|r| wanted(r)).count() as f64 / 50_000.0;
        assert!((share(|reading| matches!(reading, Reading::Failed(_))) - 0.02).abs() < 0.003);
        assert!((share(|reading| matches!(reading, Reading::Nothing)) - 0.049).abs() < 0.004);
    }

    #[test]
    fn beams_on_an_edge_are_mixed_or_near() {
        let errors = LrfErrors { beam_deg: 0.5, mixed: 0.5, ..LrfErrors::NONE };
        let mut meter = RangeMeter::new(errors, 9);
        let mut mixed = 0;
        for _ in 0..4000 {
            match meter.measure(&Edge { behind_m: 4.0 }, Instant::default(), 0.001) {
                Reading::Range(2.0) => {}
                Reading::Range(range_m) if (2.0..4.0).contains(&range_m) => mixed += 1,
                other => panic!("{other:?}"),
            }
        }
        assert!((1800..2200).contains(&mixed), "{mixed}");
        let beside = meter.measure(&Edge { behind_m: 4.0 }, Instant::default(), 0.01);
        assert_eq!(beside, Reading::Range(4.0));
    }

    /// A wall beside the robot, 1 m to its left, without end.
    struct Slant;

    impl Scene for Slant {
        fn range_m(&self, _: Instant, bearing_rad: f64) -> Option<f64> {
            (bearing_rad > 0.0).then(|| 1.0 / bearing_rad.sin())
        }
    }

    #[test]
    fn a_wall_seen_at_a_slant_is_no_edge() {
        let errors = LrfErrors { beam_deg: 0.5, mixed: 0.5, ..LrfErrors::NONE };
        let mut meter = RangeMeter::new(errors, 9);
        for range_m in [1.5, 5.0, 10.0, 20.0, 40.0_f64] {
            let bearing_rad = (1.0 / range_m).asin();
            for _ in 0..100 {
                let Reading::Range(seen_m) = meter.measure(&Slant, Instant::default(), bearing_rad) else { panic!() };
                assert!((seen_m - range_m).abs() < 1e-9, "{seen_m}, not {range_m}");
            }
        }
    }

    #[test]
    fn models_have_the_beams_of_their_data_sheets() {
        let beams = LrfModel::ALL.map(|model| model.beams());
        assert_eq!(beams, [361, 361, 361, 682, 682, 1081]);
        assert_eq!(LrfModel::LMS200.bearing_rad(180), 0.0);
        assert_eq!(LrfModel::LMS200.sweep(), Duration::from_micros(6667));
        assert!((LrfModel::UTM_30LX.bearing_rad(0).to_degrees() + 135.0).abs() < 1e-9);
    }

    #[test]
    fn ranges_out_of_reach_are_misses_or_invalid() {
        let model = LrfModel { errors: LrfErrors::NONE, ..LrfModel::URG_04LX };
        let echoes = |behind_m| {
            let beams = SimulatedLrf::new(model, 1).snapshot(&Edge { behind_m }, Instant::default());
            (beams[0].echo, beams[681].echo)
        };
        assert_eq!(echoes(9.0), (Echo::Hit(2.0), Echo::Miss));
        assert_eq!(echoes(0.01), (Echo::Hit(2.0), Echo::Invalid));
    }
}
