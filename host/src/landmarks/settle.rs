//! What sightings were of, in hindsight: nobody says it, and a filter had to choose before it knew the way.
//!
//! smoothed path, fitted map → [duplicates](super::duplicates) become one → again; without duplicates → each sighting is taken for what lies where
//! the path puts it → again, until nothing changes any more. Landmarks that are left with few sightings were none.

use lrfslam_core::landmark::sight::{Sensor, innovation, mahalanobis};
use lrfslam_core::landmark::{Fate, LandmarkConfig, RobotState, Sighting, chi_squared};

use super::duplicates::{duplicates, number, together};
use super::hindsight::hindsight;
use super::smooth::smoothed;
use super::{Drive, MapLandmark, What};

/// Fits at most.
const ROUNDS_MAX: usize = 10;
/// Landmarks that one sighting may be of, the nearest.
const CANDIDATES_MAX: usize = 4;
/// Sightings of one moment that are judged together; more come in groups of so many.
const GROUP: usize = 8;
/// A fit that joins landmarks pulls far: the gate against gross errors is opened so wide for it.
const OPEN_GATES: f32 = 1000.0;

/// Path and map at the end, and what sightings are of.
#[derive(Debug, Clone)]
pub struct Settled {
    /// Landmarks, as fitted together with the path.
    pub landmarks: Vec<MapLandmark>,
    /// The robot after each event.
    pub path: Vec<RobotState>,
    /// Of each event, what its sightings are of.
    pub fates: Vec<Vec<Fate>>,
}

/// Fits path and landmarks, and chooses anew what sightings are of; `None` where [`hindsight`] gives none.
///
/// * `path` — the robot after each event; `map` — as the filter left it
/// * `fates` — as the filter chose them; without them, they are chosen by place from the start
pub fn settle(
    drive: &Drive,
    config: &LandmarkConfig,
    map: &[MapLandmark],
    path: &[RobotState],
    fates: Option<&[Vec<Fate>]>,
) -> Option<Settled> {
    let fates = fates.map_or_else(|| by_place(drive, config, map, path), <[_]>::to_vec);
    let path = smoothed(drive, config, map, path, Some(&fates));
    let mut settled = Settled { landmarks: map.to_vec(), path, fates };
    settled.converge(drive, config)?;
    Some(settled)
}

impl Settled {
    /// Fits, makes one of duplicates, and takes sightings anew, until nothing changes any more.
    fn converge(&mut self, drive: &Drive, config: &LandmarkConfig) -> Option<()> {
        let mut has_joined = false;
        for _ in 0..ROUNDS_MAX {
            let covariance = self.fit(drive, &if has_joined { open(config) } else { *config })?;
            let pairs = duplicates(config, &self.landmarks, &covariance, &together(&self.fates));
            has_joined = !pairs.is_empty();
            if has_joined {
                self.join(&pairs);
                continue;
            }
            let chosen = by_place(drive, config, &self.landmarks, &self.path);
            if chosen == self.fates {
                return Some(());
            }
            self.fates = chosen;
            self.drop_rare(config);
        }
        self.fit(drive, config).map(|_| ())
    }

    /// Fits the landmarks, and smooths the path in them; returns their joint covariance, m².
    fn fit(&mut self, drive: &Drive, config: &LandmarkConfig) -> Option<nalgebra::DMatrix<f64>> {
        let fit = hindsight(drive, config, &self.landmarks, &self.path, Some(&self.fates))?;
        self.landmarks = fit.landmarks;
        self.path = smoothed(drive, config, &self.landmarks, &self.path, Some(&self.fates));
        Some(fit.covariance)
    }

    /// Makes the second of each pair the first.
    fn join(&mut self, pairs: &[(usize, usize)]) {
        let numbers: Vec<(u16, u16)> =
            pairs.iter().map(|(kept, gone)| (self.landmarks[*kept].number, self.landmarks[*gone].number)).collect();
        for fate in self.fates.iter_mut().flatten() {
            if let Some((kept, _)) = numbers.iter().find(|(_, gone)| number(fate) == Some(*gone)) {
                *fate = Fate::Matched(*kept);
            }
        }
        self.landmarks.retain(|landmark| numbers.iter().all(|(_, gone)| landmark.number != *gone));
        self.count();
    }

    /// Takes out landmarks of which too little was seen.
    fn drop_rare(&mut self, config: &LandmarkConfig) {
        self.count();
        self.landmarks.retain(|landmark| landmark.sightings >= config.confirm_sightings);
    }

    fn count(&mut self) {
        for landmark in &mut self.landmarks {
            let sightings = self.fates.iter().flatten().filter(|fate| number(fate) == Some(landmark.number)).count();
            landmark.sightings = u16::try_from(sightings).unwrap_or(u16::MAX);
        }
    }
}

/// A gross error's squared distance, in deviations.
fn gate(config: &LandmarkConfig) -> f64 {
    chi_squared(2, f64::from(config.gate_deviations)) * f64::from(config.new_landmark_gates)
}

/// As configured, with the gate against gross errors open.
fn open(config: &LandmarkConfig) -> LandmarkConfig {
    LandmarkConfig { new_landmark_gates: OPEN_GATES, ..*config }
}

/// What each sighting is of, by where path and map put it.
fn by_place(drive: &Drive, config: &LandmarkConfig, map: &[MapLandmark], path: &[RobotState]) -> Vec<Vec<Fate>> {
    let sensor = Sensor::new(config);
    let gate = gate(config);
    let of_event = |(event, robot): (&super::Event, &RobotState)| match &event.what {
        What::Control(_) => Vec::new(),
        What::Sightings(sightings) => {
            let of_group = |group: &[Sighting]| {
                let near = group.iter().map(|sighting| candidates(&sensor, robot, map, sighting, gate)).collect();
                Search::of(near, gate).into_iter().map(|of| of.map_or(Fate::Refused, Fate::Matched))
            };
            sightings.chunks(GROUP).flat_map(of_group).collect()
        }
    };
    drive.events.iter().zip(path).map(of_event).collect()
}

/// Squared distance and number of the landmarks near a sighting, the nearest first.
fn candidates(
    sensor: &Sensor,
    robot: &RobotState,
    map: &[MapLandmark],
    sighting: &Sighting,
    gate: f64,
) -> Vec<(f64, u16)> {
    let distance = |landmark: &MapLandmark| {
        let view = sensor.view(robot, landmark.at)?;
        let noise = sensor.noise_of(sighting, view.seen.x, f64::INFINITY);
        let (squared, _) = mahalanobis(innovation(sighting, &view), &noise)?;
        (squared <= gate).then_some((squared, landmark.number))
    };
    let mut near: Vec<(f64, u16)> = map.iter().filter_map(distance).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    near.truncate(CANDIDATES_MAX);
    near
}

/// The choice for a group of sightings with the least sum of squared distances, where none costs as much as the gate; none is chosen twice.
struct Search {
    near: Vec<Vec<(f64, u16)>>,
    gate: f64,
    chosen: Vec<Option<u16>>,
    best: Vec<Option<u16>>,
    least: f64,
}

impl Search {
    fn of(near: Vec<Vec<(f64, u16)>>, gate: f64) -> Vec<Option<u16>> {
        let none = vec![None; near.len()];
        let mut search = Self { near, gate, chosen: none.clone(), best: none, least: f64::INFINITY };
        search.branch(0, 0.0);
        search.best
    }

    fn branch(&mut self, place: usize, sum: f64) {
        if sum >= self.least {
            return;
        }
        let Some(near) = self.near.get(place).cloned() else {
            (self.least, self.best) = (sum, self.chosen.clone());
            return;
        };
        for (squared, landmark) in near {
            if !self.chosen.contains(&Some(landmark)) {
                self.chosen[place] = Some(landmark);
                self.branch(place + 1, sum + squared);
                self.chosen[place] = None;
            }
        }
        self.branch(place + 1, sum + self.gate);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two sightings near one landmark: one of them is of the next, though that is farther for it.
    #[test]
    fn the_choice_of_least_cost_takes_no_landmark_twice() {
        let near = vec![vec![(1.0, 7), (9.0, 8)], vec![(2.0, 7), (30.0, 8)], vec![]];
        assert_eq!(Search::of(near.clone(), 100.0), [Some(8), Some(7), None]);
        assert_eq!(Search::of(near, 8.0), [Some(7), None, None]);
    }
}
