//! EKF-SLAM (thesis §4.1): one Gaussian over the robot and a fixed maximum of landmarks.
//!
//! control → [predict](EkfSlam::predict), O(n); sightings → association → update, O(n²) for each → new landmarks, O(n) → upkeep.

use nalgebra::{Matrix2, Vector2};

use super::assignment::{Choice, JOINT_MAX, associate};
use super::belief::{Belief, joined};
use super::covariance::packed_len;
use super::sight::{Sensor, huber, innovation, mahalanobis};
use super::travel::{Travel, start_covariance};
use super::{
    Association, Control, Fate, LandmarkConfig, ROBOT, RobotCovariance, RobotState, Sighting, SightingCounts,
    chi_squared,
};

/// What is known of a landmark beside its place. All zero when unused.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Landmark {
    /// Which one it is of all that an EKF ever began, from 0; others get no number of one that was taken out.
    pub number: u16,
    /// What the sensor calls it.
    pub identity: Option<u16>,
    /// Sightings that were used, the first one too.
    pub sightings: u16,
    /// Sightings with its identity that did not fit, since the last that did.
    pub misfits: u16,
    /// Batches of sightings since it began.
    pub batches: u16,
    /// When it was last seen, s since the start.
    pub seen_s: f64,
}

impl Landmark {
    /// A record of an unused pool.
    pub const UNUSED: Self = Self { number: 0, identity: None, sightings: 0, misfits: 0, batches: 0, seen_s: 0.0 };
}

/// Memory of an [`EkfSlam`], see [`EkfMemory::lengths`].
#[derive(Debug)]
pub struct EkfMemory<'m> {
    /// Mean of the state.
    pub mean: &'m mut [f64],
    /// Its covariance, the lower triangle.
    pub covariance: &'m mut [f64],
    /// A row for each number of the state.
    pub work: &'m mut [[f64; 4]],
    /// One for each landmark.
    pub landmarks: &'m mut [Landmark],
}

impl EkfMemory<'_> {
    /// Lengths of mean and work, covariance, and landmarks, for so many landmarks.
    pub const fn lengths(landmarks: usize) -> [usize; 3] {
        let order = ROBOT + 2 * landmarks;
        [order, packed_len(order), landmarks]
    }

    /// Bytes for so many landmarks.
    pub const fn bytes(landmarks: usize) -> usize {
        let [order, triangle, records] = Self::lengths(landmarks);
        order * 40 + triangle * 8 + records * size_of::<Landmark>()
    }
}

/// The filter; see the [module](self).
#[derive(Debug)]
pub struct EkfSlam<'m> {
    config: LandmarkConfig,
    sensor: Sensor,
    belief: Belief<'m>,
    landmarks: &'m mut [Landmark],
    /// Landmarks that ever began.
    begun: u16,
    seconds: f64,
}

impl<'m> EkfSlam<'m> {
    /// A robot at the map's origin that knows no landmark; `None` if the memory does not hold a robot.
    pub fn new(config: &LandmarkConfig, memory: EkfMemory<'m>) -> Option<Self> {
        let EkfMemory { mean, covariance, work, landmarks } = memory;
        let belief = Belief::new(mean, covariance, work, &start_covariance(config))?;
        Some(Self { config: *config, sensor: Sensor::new(config), belief, landmarks, begun: 0, seconds: 0.0 })
    }

    /// The robot: x, y (m), heading (rad) in the map, scale of distances, scale of turns.
    pub fn robot(&self) -> RobotState {
        self.belief.robot()
    }

    /// Its covariance.
    pub fn robot_covariance(&self) -> RobotCovariance {
        self.belief.robot_covariance()
    }

    /// State and covariance of all.
    pub fn belief(&self) -> &Belief<'m> {
        &self.belief
    }

    /// Landmarks in the map: records, positions (m), covariances (m²).
    pub fn landmarks(&self) -> impl Iterator<Item = (Landmark, Vector2<f64>, Matrix2<f64>)> + '_ {
        let count = self.belief.landmarks();
        self.landmarks
            .iter()
            .take(count)
            .enumerate()
            .map(|(index, record)| (*record, self.belief.landmark(index), self.belief.landmark_covariance(index)))
    }

    /// Landmarks for which there is room.
    pub fn landmarks_max(&self) -> usize {
        self.belief.landmarks_max().min(self.landmarks.len())
    }

    /// Moves the robot; a control that is not finite changes nothing and gives false.
    pub fn predict(&mut self, control: &Control) -> bool {
        let Some(travel) = Travel::new(control, &self.config) else { return false };
        self.seconds += travel.seconds;
        self.belief.predict(&travel);
        true
    }

    /// Takes what was seen at one moment.
    ///
    /// * `fates` — of each sighting, as far as there is room for them
    pub fn observe(&mut self, sightings: &[Sighting], fates: &mut [Fate]) -> SightingCounts {
        let mut counts = SightingCounts::default();
        let mut told = fates.iter_mut();
        for group in sightings.chunks(JOINT_MAX) {
            let known = self.landmarks.get(..self.belief.landmarks()).unwrap_or(&[]);
            let choices = associate(&self.config, &self.sensor, &self.belief, known, group);
            for (sighting, choice) in group.iter().zip(choices) {
                let fate = match choice {
                    Choice::Landmark(landmark) => self.update(usize::from(landmark), sighting),
                    Choice::New => self.begin(sighting),
                    Choice::Neither => Fate::Refused,
                };
                counts.count(fate);
                if let Some(place) = told.next() {
                    *place = fate;
                }
            }
        }
        counts.removed = self.keep_up();
        counts
    }

    fn update(&mut self, landmark: usize, sighting: &Sighting) -> Fate {
        let refused = Fate::Refused;
        let Some(record) = self.landmarks.get(landmark).copied() else { return refused };
        let Some(view) = self.sensor.view(&self.belief.robot(), self.belief.landmark(landmark)) else { return refused };
        let (jacobian, off) = (joined(&view), innovation(sighting, &view));
        let noise = self.sensor.noise_of(sighting, view.seen.x, self.seconds - record.seen_s);
        let s = self.belief.between(landmark, &jacobian, landmark, &jacobian) + noise;
        let Some((squared, _)) = mahalanobis(off, &s) else { return refused };
        let gate = chi_squared(2, f64::from(self.config.gate_deviations)) * f64::from(self.config.new_landmark_gates);
        let weight = huber(squared, f64::from(self.config.huber_deviations));
        let is_used =
            squared <= gate && self.belief.correct(landmark, &jacobian, off, &(noise * weight), self.config.invariant);
        if let Some(record) = self.landmarks.get_mut(landmark) {
            if is_used {
                record.sightings = record.sightings.saturating_add(1);
                (record.misfits, record.seen_s) = (0, self.seconds);
            } else {
                record.misfits = record.misfits.saturating_add(1);
            }
        }
        if is_used { Fate::Matched(record.number) } else { refused }
    }

    fn begin(&mut self, sighting: &Sighting) -> Fate {
        let count = self.belief.landmarks();
        let Some(record) = self.landmarks.get_mut(count) else { return Fate::Full };
        let place = self.sensor.place(&self.belief.robot(), sighting);
        let noise = self.sensor.noise_of(sighting, sighting.range_m, f64::INFINITY);
        if !self.belief.add(&place, &noise) {
            return Fate::Full;
        }
        let (number, identity) = (self.begun, sighting.identity);
        *record = Landmark { number, identity, sightings: 1, seen_s: self.seconds, ..Landmark::default() };
        self.begun = self.begun.saturating_add(1);
        Fate::Began(number)
    }

    /// Takes out landmarks that were not seen again, or whose sightings do not fit; returns how many.
    fn keep_up(&mut self) -> u32 {
        let mut removed = 0;
        for landmark in (0..self.belief.landmarks()).rev() {
            let Some(record) = self.landmarks.get_mut(landmark) else { continue };
            record.batches = record.batches.saturating_add(1);
            if !is_given_up(record, &self.config) {
                continue;
            }
            let last = self.belief.landmarks().saturating_sub(1);
            self.belief.remove(landmark);
            self.landmarks.swap(landmark, last);
            removed += 1;
        }
        removed
    }
}

/// A landmark that nobody saw again in time, or that its own sightings contradict.
pub(super) fn is_given_up(record: &Landmark, config: &LandmarkConfig) -> bool {
    let is_unconfirmed = config.association != Association::Known
        && record.sightings < config.confirm_sightings
        && record.batches >= config.confirm_batches;
    is_unconfirmed || (record.misfits >= config.misfits_max && record.misfits > record.sightings)
}
