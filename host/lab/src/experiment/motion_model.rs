//! The scan-matching motion model (thesis §4.5.1, table 4.7): the distribution of the matcher's errors.
//!
//! Only matches that were found count: a search that ended in another optimum is no noise of the match. Their share is stated.

use serde::Serialize;

use super::sweep::PairError;
use crate::evaluation::Distribution;

/// The errors of one number of the displacement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AxisModel {
    /// Of all found matches.
    pub all: Distribution,
    /// Of the half with the shorter travel (for the heading: the smaller turn).
    pub less_motion: Distribution,
    /// And of the other half.
    pub more_motion: Distribution,
}

/// Standard deviations to be used in table 4.7, with what shows whether they are Gaussian and the same for every motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MotionModel {
    /// v of the forward displacement (the thesis's Δy), m.
    pub forward_m: AxisModel,
    /// v of the lateral displacement (the thesis's Δx), m.
    pub lateral_m: AxisModel,
    /// v of the rotation, degrees.
    pub heading_deg: AxisModel,
    /// Share of the matches that were found and count.
    pub found: f64,
    /// Median travel and turn between the scans of a pair, m and degrees: the halves above lie on either side.
    pub travel_m: f64,
    /// See above.
    pub turn_deg: f64,
}

/// Fits the model to `errors`.
pub fn fit_motion_model(errors: &[PairError]) -> MotionModel {
    let found: Vec<PairError> = errors.iter().filter(|error| error.found).copied().collect();
    let (travel_m, turn_deg) = (middle(&found, |e| e.travel_m), middle(&found, |e| e.turn_deg.abs()));
    let travels = move |e: &PairError| e.travel_m > travel_m;
    let turns = move |e: &PairError| e.turn_deg.abs() > turn_deg;
    MotionModel {
        forward_m: axis(&found, |e| e.forward_m, travels),
        lateral_m: axis(&found, |e| e.lateral_m, travels),
        heading_deg: axis(&found, |e| e.heading_deg, turns),
        found: found.len() as f64 / errors.len().max(1) as f64,
        travel_m,
        turn_deg,
    }
}

fn axis(errors: &[PairError], value: fn(&PairError) -> f64, moves_more: impl Fn(&PairError) -> bool) -> AxisModel {
    let of = |wanted: &dyn Fn(&PairError) -> bool| {
        Distribution::of(&errors.iter().filter(|e| wanted(e)).map(value).collect::<Vec<_>>())
    };
    AxisModel { all: of(&|_| true), less_motion: of(&|e| !moves_more(e)), more_motion: of(&moves_more) }
}

fn middle(errors: &[PairError], value: fn(&PairError) -> f64) -> f64 {
    let mut values: Vec<f64> = errors.iter().map(value).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
