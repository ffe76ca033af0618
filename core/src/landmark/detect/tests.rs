//! Landmarks of which everything is known, seen by a laser with noise.

use std::vec::Vec;

use super::*;
use crate::math::normal;
use crate::random::RandomStream;
use crate::time::{Duration, Instant};

/// Deviation of ranges, m.
const NOISE_M: f64 = 0.01;

/// Circles (range and bearing of the centre, radius) before a wall, seen by beams every `step_deg`.
fn scan(circles: &[(f64, f64, f64)], step_deg: f64, wall_m: f64, rng: &mut RandomStream) -> Vec<Beam> {
    let count = (180.0 / step_deg) as i32;
    let beams = (0..=count).map(|index| {
        let bearing = (f64::from(index) * step_deg - 90.0).to_radians();
        let near = circles.iter().filter_map(|(range, at, radius)| {
            let (sin, cos) = libm::sincos(bearing - at);
            let under = radius * radius - (range * sin) * (range * sin);
            (under > 0.0 && cos > 0.0).then(|| range * cos - libm::sqrt(under))
        });
        let range = near.fold(wall_m, f64::min) + NOISE_M * f64::from(normal(rng));
        Beam { bearing_rad: bearing as f32, offset: Duration::ZERO, echo: Echo::Hit(range as f32) }
    });
    beams.collect()
}

fn found(config: &DetectConfig, beams: &[Beam], brightness: &[u8]) -> Vec<Detection> {
    let mut found = [Detection::default(); 8];
    let scan = RangeScan { stamp: Instant::default(), range_max_m: 80.0, beams };
    let result = detect(config, &scan, brightness, &mut found);
    assert_eq!(result.left_out, 0);
    found[..result.count].to_vec()
}

fn config() -> DetectConfig {
    DetectConfig { range_noise_m: NOISE_M as f32, ..DetectConfig::default() }
}

/// Over many places: the centre is found without a bias towards the laser, and is as uncertain as it is said to be.
#[test]
fn centres_of_posts_are_found_and_their_covariance_is_honest() {
    let rng = &mut RandomStream::new(1, 0, 0);
    let (mut seen, mut bias, mut radius_off, mut squares) = (0, 0.0, 0.0, 0.0);
    for place in 0..400 {
        let (range, bearing) = (2.0 + 0.01 * f64::from(place), -1.0 + 0.005 * f64::from(place));
        let beams = scan(&[(range, bearing, 0.15)], 0.5, 12.0, rng);
        for detection in found(&config(), &beams, &[]) {
            let off = nalgebra::Vector2::new(detection.range_m - range, detection.bearing_rad - bearing);
            seen += 1;
            bias += off.x;
            radius_off += detection.radius_m - 0.15;
            squares += off.dot(&(detection.covariance.try_inverse().unwrap() * off));
        }
    }
    let n = f64::from(seen);
    println!("{seen} of 400; bias {:.4} m, radius {:.4} m off, NEES {:.2}", bias / n, radius_off / n, squares / n);
    assert!(seen > 380, "{seen}");
    assert!((bias / n).abs() < 0.005 && (radius_off / n).abs() < 0.01, "{bias} {radius_off}");
    // Two degrees of freedom; edges are uniform, not Gaussian.
    assert!((1.0..2.6).contains(&(squares / n)), "{}", squares / n);
}

/// The same post from all sides is in one place: not on its near side.
#[test]
fn a_reflector_of_two_beams_has_its_centre_and_a_wall_none() {
    let rng = &mut RandomStream::new(2, 0, 0);
    let (range, bearing) = (5.0, 0.3);
    let beams = scan(&[(range, bearing, 0.05)], 0.5, 9.0, rng);
    let is_it = |beam: &Beam| matches!(beam.echo, Echo::Hit(range) if range < 6.0);
    let brightness: Vec<u8> = beams.iter().map(|beam| if is_it(beam) { 255 } else { 40 }).collect();
    assert_eq!(beams.iter().filter(|beam| is_it(beam)).count(), 2);
    let all = found(&config(), &beams, &brightness);
    assert_eq!(all.len(), 1, "{all:?}");
    assert!(all[0].is_reflector && (all[0].range_m - range).abs() < 0.03, "{all:?}");
    assert!((all[0].bearing_rad - bearing).abs() < 0.5_f64.to_radians(), "{all:?}");
    assert_eq!(found(&config(), &beams, &[]), [], "two beams are no post");
    let mut mixed = beams.clone();
    let edge = beams.iter().position(is_it).unwrap();
    mixed[edge].echo = Echo::Hit(7.0);
    assert_eq!(found(&config(), &mixed, &brightness), [], "an edge between reflector and wall");
    assert_eq!(found(&DetectConfig { reflectors: false, ..config() }, &beams, &brightness), []);
}

/// What is flat, hidden in part, too large or at the end of what is seen is no post.
#[test]
fn other_things_are_no_posts() {
    let rng = &mut RandomStream::new(3, 0, 0);
    let plain = scan(&[], 0.5, 6.0, rng);
    let cut = |low: f64, high: f64, range: fn(f64) -> f64| -> Vec<Beam> {
        let echo = |beam: &Beam| match (low..high).contains(&f64::from(beam.bearing_rad)) {
            true => Echo::Hit(range(f64::from(beam.bearing_rad)) as f32),
            false => beam.echo,
        };
        plain.iter().map(|beam| Beam { echo: echo(beam), ..*beam }).collect()
    };
    let plate = cut(-0.08, 0.08, |bearing| 2.0 / libm::cos(bearing));
    assert_eq!(found(&config(), &plate, &[]), [], "a plate of 0.32 m");
    let corner = cut(-0.08, 0.08, |bearing| 2.0 - bearing.abs());
    assert_eq!(found(&config(), &corner, &[]), [], "an edge that points away");
    assert_eq!(found(&config(), &scan(&[(3.0, 0.0, 0.8)], 0.5, 9.0, rng), &[]), [], "too large");
    let hidden = scan(&[(3.0, 0.0, 0.15), (2.0, 0.09, 0.12)], 0.5, 9.0, rng);
    let places: Vec<f64> = found(&config(), &hidden, &[]).iter().map(|found| found.range_m).collect();
    assert!(places.len() == 1 && (places[0] - 2.0).abs() < 0.05, "the one in front: {places:?}");
    assert_eq!(found(&config(), &scan(&[(3.0, 1.57, 0.15)], 0.5, 9.0, rng), &[]), [], "at the end");
}

#[test]
fn nonsense_finds_nothing_and_what_has_no_room_is_counted() {
    let beam = |bearing_rad, echo| Beam { bearing_rad, offset: Duration::ZERO, echo };
    for odd in [f32::NAN, f32::INFINITY, 0.0] {
        let beams: Vec<Beam> = (0..20).map(|_| beam(odd, Echo::Hit(odd))).collect();
        assert_eq!(found(&config(), &beams, &[255; 20]), []);
        assert_eq!(found(&config(), &beams, &[255; 3]), []);
    }
    assert_eq!(found(&config(), &[], &[]), []);
    let rng = &mut RandomStream::new(4, 0, 0);
    let beams = scan(&[(2.0, -0.5, 0.1), (2.0, 0.5, 0.1)], 0.5, 9.0, rng);
    let scan = RangeScan { stamp: Instant::default(), range_max_m: 80.0, beams: &beams };
    assert_eq!(detect(&config(), &scan, &[], &mut [Detection::default()]), Found { count: 1, left_out: 1 });
}
