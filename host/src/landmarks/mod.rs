//! SLAM on point landmarks from recorded drives: readers, a run of either filter, errors against the truth, and results.
//!
//! [`Drive`] (controls and sightings in order of time) ← [`mrclam`], [`victoria`], [`laser`], [`simulated`] → [`mod@run`] → [`LandmarkRun`] → [`mod@errors`],
//! [`mod@output`].

pub mod duplicates;
pub mod errors;
mod filter;
pub mod hindsight;
pub mod laser;
pub mod mrclam;
pub mod output;
pub mod run;
pub mod settle;
pub mod simulated;
pub mod smooth;
pub mod victoria;
pub mod watch;

use lrfslam_core::landmark::detect::DetectConfig;
use lrfslam_core::landmark::{Control, LandmarkConfig, Sighting};
use lrfslam_core::time::Instant;

use crate::trajectory::TimedPose;

pub use self::run::{Estimate, Filter, Glance, LandmarkRun, MapLandmark};

/// A drive among landmarks, as recorded or simulated.
#[derive(Debug, Clone)]
pub struct Drive {
    /// Where it comes from.
    pub name: String,
    /// In order of time.
    pub events: Vec<Event>,
    /// The true path, in a frame of its own; empty if it is not known. Headings may be missing, see [`has_headings`](Self::has_headings).
    pub truth: Vec<TimedPose>,
    /// The true path has headings.
    pub has_headings: bool,
    /// True landmarks in the same frame; empty if they are not known.
    pub landmarks: Vec<TrueLandmark>,
    /// What the configuration should be for this robot and sensor.
    pub config: LandmarkConfig,
    /// How landmarks were looked for in a laser's scans; none where a file tells them.
    pub detect: Option<DetectConfig>,
    /// Sightings have identities.
    pub has_identities: bool,
}

/// Something at a moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// When: of a control, its end.
    pub stamp: Instant,
    /// What.
    pub what: What,
}

/// A control, or what is seen at one moment.
#[derive(Debug, Clone, PartialEq)]
pub enum What {
    /// The robot moved so, up to this moment.
    Control(Control),
    /// All that is seen now.
    Sightings(Vec<Sighting>),
}

/// Where a landmark truly is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueLandmark {
    /// What the sensor calls it.
    pub identity: u16,
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
}

/// Velocities as a robot reports them: each holds until the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Velocity {
    /// From when on, s.
    pub t: f64,
    /// Forward, m/s.
    pub forward_m_s: f64,
    /// Counter-clockwise, rad/s.
    pub turn_rad_s: f64,
}

/// Sightings of one moment, s.
pub type Batch = (f64, Vec<Sighting>);

/// Controls and sightings in order of time: a velocity that holds over a sighting is cut there.
///
/// * both in order of time; before the first velocity the robot stands
pub fn merge(velocities: &[Velocity], batches: Vec<Batch>) -> Vec<Event> {
    let mut events = Vec::new();
    let mut rest = velocities.iter().peekable();
    let mut held = Velocity { t: f64::NAN, forward_m_s: 0.0, turn_rad_s: 0.0 };
    let mut now = f64::NAN;
    let drive = |events: &mut Vec<Event>, held: &Velocity, now: &mut f64, until: f64| {
        let seconds = until - *now;
        if seconds > 0.0 {
            let control = Control::Velocity { forward_m_s: held.forward_m_s, turn_rad_s: held.turn_rad_s, seconds };
            events.push(Event { stamp: Instant::from_secs_f64(until), what: What::Control(control) });
        }
        // At the start nothing is known of the time before.
        *now = if now.is_nan() { until } else { now.max(until) };
    };
    for (t, sightings) in batches {
        while let Some(next) = rest.next_if(|next| next.t <= t) {
            drive(&mut events, &held, &mut now, next.t);
            held = *next;
        }
        drive(&mut events, &held, &mut now, t);
        events.push(Event { stamp: Instant::from_secs_f64(t), what: What::Sightings(sightings) });
    }
    for next in rest {
        drive(&mut events, &held, &mut now, next.t);
        held = *next;
    }
    events
}

/// Sightings with their times, gathered by moment.
pub fn batches(sightings: impl IntoIterator<Item = (f64, Sighting)>) -> Vec<Batch> {
    let mut batches: Vec<Batch> = Vec::new();
    for (t, sighting) in sightings {
        match batches.last_mut() {
            Some((last, batch)) if *last == t => batch.push(sighting),
            _ => batches.push((t, vec![sighting])),
        }
    }
    batches
}

#[cfg(test)]
mod tests;
