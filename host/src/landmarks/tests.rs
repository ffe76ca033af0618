//! Runs over simulated and recorded drives, against their truth.

use std::path::PathBuf;

use lrfslam_core::landmark::{Control, Fate};

use super::errors::errors;
use super::run::run;
use super::*;

/// The data sets; none says so, and its test is skipped.
fn data() -> Option<PathBuf> {
    let place = std::env::var_os("LRFSLAM_DATA").map(|data| PathBuf::from(data).join("landmarks"));
    let found = place.filter(|place| place.is_dir());
    if found.is_none() {
        println!("skipped: LRFSLAM_DATA names no folder with landmarks");
    }
    found
}

#[test]
fn velocities_are_cut_where_something_is_seen() {
    let velocity = |t, forward_m_s| Velocity { t, forward_m_s, turn_rad_s: 0.0 };
    let events = merge(&[velocity(1.0, 0.5), velocity(2.0, 1.0)], vec![(0.5, vec![]), (1.25, vec![]), (2.5, vec![])]);
    let seconds: Vec<f64> = events
        .iter()
        .filter_map(|event| match event.what {
            What::Control(Control::Velocity { forward_m_s, seconds, .. }) => Some(forward_m_s * seconds),
            _ => None,
        })
        .collect();
    // The robot stands until its first report; from 1.25 s to 2 s it goes on as reported at 1 s.
    assert_eq!(seconds, [0.0, 0.125, 0.375, 0.5]);
    assert!(events.is_sorted_by_key(|event| event.stamp));
}

#[test]
fn both_filters_map_a_simulated_drive() {
    let drive = simulated::drive(30, 2);
    for filter in [Filter::Ekf, Filter::Fastslam { particles: 60 }] {
        let run = run(&drive, &drive.config, filter, 40, 1, |_| true).unwrap();
        let errors = errors(&drive, run.estimate.best_path(), &run.estimate.landmarks);
        println!("{filter:?}: {errors:?}");
        assert!(errors.path_rmse_m.unwrap() < 0.4 && errors.landmarks_rmse_m.unwrap() < 0.4, "{filter:?}: {errors:?}");
        assert_eq!(errors.landmarks_false, 0);
    }
}

/// Particles leave different maps; fitted with the path over the whole drive they become one, as near to the truth as its covariances say.
#[test]
fn the_map_in_hindsight_does_not_depend_on_the_particles() {
    let drive = simulated::drive(30, 2);
    let filter = Filter::Fastslam { particles: 60 };
    let of = |seed| run(&drive, &drive.config, filter, 40, seed, |_| true).unwrap().estimate;
    let (one, other) = (of(1), of(2));
    let place = |map: &[MapLandmark], identity| map.iter().find(|l| l.identity == identity).map(|l| l.at).unwrap();
    let apart = |a: &[MapLandmark], b: &[MapLandmark]| {
        a.iter().map(|l| (l.at - place(b, l.identity)).norm()).fold(0.0, f64::max)
    };
    let online = apart(&one.online_landmarks, &other.online_landmarks);
    let at_the_end = apart(&one.landmarks, &other.landmarks);
    let squared = |landmark: &MapLandmark| {
        let truth = drive.landmarks.iter().find(|truth| Some(truth.identity) == landmark.identity).unwrap();
        let off = landmark.at - nalgebra::Vector2::new(truth.x, truth.y);
        off.dot(&(landmark.covariance.try_inverse().unwrap() * off))
    };
    let mean = one.landmarks.iter().map(squared).sum::<f64>() / one.landmarks.len() as f64;
    println!(
        "apart: {online:.3} m by the filter, {at_the_end:.5} m at the end; squared errors over covariance {mean:.2}"
    );
    assert!(online > 0.01 && at_the_end < 0.005, "{online} {at_the_end}");
    assert!((0.2..8.0).contains(&mean), "{mean}");
}

/// Bounds of the path as it is believed at the end, and of the landmarks.
#[test]
fn an_ekf_maps_mrclam() {
    let Some(place) = data() else { return };
    for (robot, path_m, landmarks_m) in [(1, 0.18, 0.09), (3, 0.16, 0.12)] {
        let drive = mrclam::read(&place.join("mrclam7"), robot, mrclam::Ranges::default(), 1.0).unwrap();
        let run = run(&drive, &drive.config, Filter::Ekf, 20, 1, |_| true).unwrap();
        let errors = errors(&drive, run.estimate.best_path(), &run.estimate.landmarks);
        println!("robot {robot}: {errors:?}");
        assert!(errors.path_rmse_m.unwrap() <= path_m, "robot {robot}: {errors:?}");
        assert!(errors.landmarks_rmse_m.unwrap() <= landmarks_m, "robot {robot}: {errors:?}");
    }
}

#[test]
fn a_missing_file_is_named() {
    let empty = tempfile::tempdir().unwrap();
    let error = mrclam::read(empty.path(), 1, mrclam::Ranges::default(), 1.0).unwrap_err().to_string();
    assert!(error.contains("no file called …barcodes.dat"), "{error}");
    std::fs::write(empty.path().join("a_Barcodes.dat"), "# subject barcode\n6 x\n").unwrap();
    let error = mrclam::read(empty.path(), 1, mrclam::Ranges::default(), 1.0).unwrap_err().to_string();
    assert!(error.contains("line 2: field barcode"), "{error}");
    std::fs::write(empty.path().join("b_Barcodes.dat.gz"), "").unwrap();
    let error = mrclam::read(empty.path(), 1, mrclam::Ranges::default(), 1.0).unwrap_err().to_string();
    assert!(error.contains("both end with barcodes.dat"), "{error}");
}

/// A drive of two rounds whose second mapped everything anew, a little aside: in hindsight the two maps are one, as if identities were known.
#[test]
fn a_map_made_twice_becomes_one() {
    let drive = simulated::drive(16, 2);
    let known = run(&drive, &drive.config, Filter::Ekf, 40, 1, |_| true).unwrap().estimate;
    let of_second = |index: usize| if 2 * index > drive.events.len() { 100 } else { 0 };
    let fates = |(index, event): (usize, &Event)| match &event.what {
        What::Control(_) => Vec::new(),
        What::Sightings(seen) => seen.iter().map(|s| Fate::Matched(s.identity.unwrap() + of_second(index))).collect(),
    };
    let fates: Vec<Vec<Fate>> = drive.events.iter().enumerate().map(fates).collect();
    let copy = |landmark: &MapLandmark, second: u16, aside: f64| {
        let at = landmark.at + nalgebra::Vector2::new(aside, -aside);
        MapLandmark { number: landmark.identity.unwrap() + second, identity: None, at, ..*landmark }
    };
    let maps =
        [(0, 0.0), (100, 0.1)].map(|(second, aside)| known.landmarks.iter().map(move |l| copy(l, second, aside)));
    let map: Vec<MapLandmark> = maps.into_iter().flatten().collect();
    let state = |event: &Event| {
        let pose = super::errors::pose_at(known.best_path(), event.stamp).unwrap_or_default();
        lrfslam_core::landmark::RobotState::new(pose.x, pose.y, pose.heading, 0.96, 1.04)
    };
    let path: Vec<_> = drive.events.iter().map(state).collect();
    let settled = settle::settle(&drive, &drive.config, &map, &path, Some(&fates)).unwrap();
    assert_eq!(settled.landmarks.len(), known.landmarks.len());
    let found = errors(&drive, known.best_path(), &settled.landmarks);
    println!("{found:?}");
    assert_eq!((found.landmarks_found, found.landmarks_false), (known.landmarks.len(), 0));
    assert!(found.landmarks_rmse_m.unwrap() < 0.05, "{found:?}");
}
