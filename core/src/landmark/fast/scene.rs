//! What one particle does with what is seen: which landmark it is, how likely that is, and the landmark's own EKF.

use core::f64::consts::PI;

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2};

use super::super::assignment::is_usable;
use super::super::ekf::{Landmark, is_given_up};
use super::super::sight::{Sensor, View, huber, innovation, inverse, mahalanobis};
use super::super::{Association, Fate, LandmarkConfig, ROBOT, Sighting, SightingCounts, chi_squared};
use super::{FastLandmark, FastParticle, draw_pose};
use crate::random::RandomStream;

/// What all particles have in common at one moment.
pub(super) struct Scene<'a> {
    pub config: &'a LandmarkConfig,
    pub sensor: &'a Sensor,
    pub seconds: f64,
    /// Squared width of the kernel that a particle stands for, in deviations of what it was drawn from.
    pub bandwidth: f64,
}

/// What a sighting is of, in one particle's map.
enum Of {
    Landmark(usize),
    New,
    Neither,
}

impl Scene<'_> {
    /// Corrects, draws and weighs one particle by what is seen, and brings its map up to date.
    pub fn take(
        &self,
        particle: &mut FastParticle,
        map: &mut [FastLandmark],
        sightings: &[Sighting],
        rng: &mut RandomStream,
    ) -> SightingCounts {
        let mut counts = SightingCounts::default();
        let mut kernel = Matrix3::zeros();
        if self.config.fast_proposal {
            // The pose is corrected by all that is seen before it is drawn, and by the map as it was before.
            for sighting in sightings {
                self.propose(particle, map, sighting);
            }
            kernel = particle.covariance.fixed_view::<3, 3>(0, 0) * self.bandwidth;
            draw_pose(particle, rng);
        }
        for sighting in sightings.iter().filter(|sighting| is_usable(sighting)) {
            counts.count(match self.find(particle, map, sighting) {
                Of::Landmark(landmark) => self.update(particle, map, landmark, (sighting, &kernel)),
                Of::New => self.begin(particle, map, (sighting, &kernel)),
                Of::Neither => Fate::Refused,
            });
        }
        counts.removed = self.keep_up(particle, map);
        counts
    }

    /// Log-likelihood of a sighting that says nothing: it may be anywhere before the sensor.
    fn log_outlier(&self) -> f64 {
        libm::log(f64::from(self.config.outlier_share).max(1e-9) / (10.0 * PI))
    }

    fn gate(&self) -> f64 {
        chi_squared(2, f64::from(self.config.gate_deviations))
    }

    /// Expected sighting, its innovation covariance with the pose's uncertainty, and the noise in it.
    fn expect(
        &self,
        particle: &FastParticle,
        landmark: &FastLandmark,
        sighting: &Sighting,
    ) -> Option<(View, Matrix2<f64>, Matrix2<f64>)> {
        let view = self.sensor.view(&particle.robot, landmark.at)?;
        let noise = self.sensor.noise_of(sighting, view.seen.x, self.seconds - landmark.record.seen_s);
        let pose = particle.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let s = view.by_robot * pose * view.by_robot.transpose()
            + view.by_landmark * landmark.covariance * view.by_landmark.transpose()
            + noise;
        Some((view, s, noise))
    }

    /// Which landmark it is: by identity, or the nearest in Mahalanobis' distance.
    fn find(&self, particle: &FastParticle, map: &[FastLandmark], sighting: &Sighting) -> Of {
        let known = map.get(..usize::from(particle.landmarks)).unwrap_or(&[]);
        if self.config.association == Association::Known {
            return match sighting.identity {
                None => Of::Neither,
                id => known.iter().position(|l| l.record.identity == id).map_or(Of::New, Of::Landmark),
            };
        }
        let distance = |landmark: &FastLandmark| {
            let (view, s, _) = self.expect(particle, landmark, sighting)?;
            mahalanobis(innovation(sighting, &view), &s).map(|(squared, _)| squared)
        };
        let distances = known.iter().enumerate().filter_map(|(index, landmark)| Some((index, distance(landmark)?)));
        match distances.min_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((index, squared)) if squared <= self.gate() => Of::Landmark(index),
            Some((_, squared)) if squared <= self.gate() * f64::from(self.config.new_landmark_gates) => Of::Neither,
            _ => Of::New,
        }
    }

    /// FastSLAM 2.0: weighs the particle by the sighting and corrects the Gaussian of its motion.
    fn propose(&self, particle: &mut FastParticle, map: &[FastLandmark], sighting: &Sighting) {
        if !is_usable(sighting) {
            return;
        }
        let Of::Landmark(index) = self.find(particle, map, sighting) else {
            particle.log_weight += self.log_outlier();
            return;
        };
        let Some(landmark) = map.get(index) else { return };
        let Some((view, s, noise)) = self.expect(particle, landmark, sighting) else { return };
        let off = innovation(sighting, &view);
        let Some(weight) = self.weigh(particle, off, &s) else { return };
        let s = s + noise * (weight - 1.0);
        let Some(inverse) = inverse(&s) else { return };
        let by_robot = of_state(&view.by_robot);
        let cross = particle.covariance * by_robot.transpose();
        particle.robot += cross * (inverse * off);
        particle.covariance -= cross * inverse * cross.transpose();
    }

    /// Multiplies the weight by the sighting's likelihood (table 4.2); returns Huber's factor on its noise, `None` if it says nothing.
    fn weigh(&self, particle: &mut FastParticle, off: Vector2<f64>, s: &Matrix2<f64>) -> Option<f64> {
        let (squared, log_determinant) = mahalanobis(off, s)?;
        let knee = f64::from(self.config.huber_deviations);
        let root = libm::sqrt(squared);
        let loss = if root > knee { knee * (root - 0.5 * knee) } else { 0.5 * squared };
        let fits = squared <= self.gate() * f64::from(self.config.new_landmark_gates);
        let log_likelihood = -loss - 0.5 * log_determinant - libm::log(2.0 * PI);
        particle.log_weight += if fits { log_likelihood.max(self.log_outlier()) } else { self.log_outlier() };
        fits.then(|| huber(squared, knee))
    }

    /// EKF of one landmark (eq. 4.24–4.29); with 1.0 the sighting also weighs the particle.
    fn update(
        &self,
        particle: &mut FastParticle,
        map: &mut [FastLandmark],
        index: usize,
        (sighting, kernel): (&Sighting, &Matrix3<f64>),
    ) -> Fate {
        let Some(landmark) = map.get_mut(index) else { return Fate::Refused };
        let Some((view, s, noise)) = self.expect(particle, landmark, sighting) else { return Fate::Refused };
        let of_kernel = view.by_robot * kernel * view.by_robot.transpose();
        let (s, noise) = (s + of_kernel, noise + of_kernel);
        let off = innovation(sighting, &view);
        let weight = match self.config.fast_proposal {
            true => mahalanobis(off, &s)
                .filter(|(squared, _)| *squared <= self.gate() * f64::from(self.config.new_landmark_gates))
                .map(|(squared, _)| huber(squared, f64::from(self.config.huber_deviations))),
            false => self.weigh(particle, off, &s),
        };
        let s = s + noise * (weight.unwrap_or(1.0) - 1.0);
        let (Some(weight), Some(inverse)) = (weight, inverse(&s)) else {
            landmark.record.misfits = landmark.record.misfits.saturating_add(1);
            return Fate::Refused;
        };
        let gain = landmark.covariance * view.by_landmark.transpose() * inverse;
        landmark.at += gain * off;
        let rest = Matrix2::identity() - gain * view.by_landmark;
        let covariance = rest * landmark.covariance * rest.transpose() + gain * (noise * weight) * gain.transpose();
        landmark.covariance = (covariance + covariance.transpose()) * 0.5;
        landmark.record.sightings = landmark.record.sightings.saturating_add(1);
        (landmark.record.misfits, landmark.record.seen_s) = (0, self.seconds);
        Fate::Matched(index as u16)
    }

    /// A new landmark (eq. 4.34–4.37).
    fn begin(
        &self,
        particle: &mut FastParticle,
        map: &mut [FastLandmark],
        (sighting, kernel): (&Sighting, &Matrix3<f64>),
    ) -> Fate {
        if !self.config.fast_proposal {
            particle.log_weight += self.log_outlier();
        }
        let index = particle.landmarks;
        let Some(landmark) = map.get_mut(usize::from(index)) else { return Fate::Full };
        let place = self.sensor.place(&particle.robot, sighting);
        let noise = self.sensor.noise_of(sighting, sighting.range_m, f64::INFINITY);
        let covariance = place.by_sighting * noise * place.by_sighting.transpose()
            + place.by_robot * kernel * place.by_robot.transpose();
        let record =
            Landmark { identity: sighting.identity, sightings: 1, seen_s: self.seconds, ..Landmark::default() };
        *landmark = FastLandmark { at: place.at, covariance, record };
        particle.landmarks += 1;
        Fate::Began(index)
    }

    fn keep_up(&self, particle: &mut FastParticle, map: &mut [FastLandmark]) -> u32 {
        let mut removed = 0;
        for index in (0..usize::from(particle.landmarks)).rev() {
            let Some(landmark) = map.get_mut(index) else { continue };
            landmark.record.batches = landmark.record.batches.saturating_add(1);
            if is_given_up(&landmark.record, self.config) {
                particle.landmarks -= 1;
                map.swap(index, usize::from(particle.landmarks));
                removed += 1;
            }
        }
        removed
    }
}

/// The Jacobian by all numbers of the robot: the scales are not seen.
fn of_state(by_robot: &Matrix2x3<f64>) -> nalgebra::SMatrix<f64, 2, ROBOT> {
    let mut jacobian = nalgebra::SMatrix::<f64, 2, ROBOT>::zeros();
    jacobian.fixed_view_mut::<2, 3>(0, 0).copy_from(by_robot);
    jacobian
}
