use super::*;
use crate::math::wrap_angle;
use crate::random::RandomStream;

const START: Pose2 = Pose2 { x: 2.0, y: -1.0, heading: 0.7 };

/// 1 cm, 1 cm and 0.3 degrees, nothing else.
fn plain() -> ScanMatchingMotionConfig {
    let (undetermined_m, covariance_gain) = (0.0, 0.0);
    let base = ScanMatchingMotionConfig { undetermined_m, covariance_gain, ..Default::default() };
    ScanMatchingMotionConfig { forward_m: 0.01, lateral_m: 0.01, heading_deg: 0.3, ..base }
}

/// Mean and covariance of (x, y, heading) of many samples, as seen from `expected`.
fn moments(motion: &impl Motion, expected: Pose2) -> (Vector3<f32>, Matrix3<f32>) {
    let count = 40_000;
    let draw = |index| {
        let pose = motion.sample(START, &mut RandomStream::new(1, 2, index));
        let off = expected.between(pose);
        Vector3::new(off.x, off.y, wrap_angle(off.heading))
    };
    let mean = (0..count).map(draw).sum::<Vector3<f32>>() / count as f32;
    let spread = |index| {
        let off: Vector3<f32> = draw(index) - mean;
        off * off.transpose()
    };
    (mean, (0..count).map(spread).sum::<Matrix3<f32>>() / count as f32)
}

fn assert_deviations(covariance: &Matrix3<f32>, expected: [f32; 3], tolerance: f32) {
    for (axis, sigma) in expected.into_iter().enumerate() {
        let measured = libm::sqrtf(covariance[(axis, axis)]);
        assert!((measured - sigma).abs() <= tolerance * sigma.max(0.01), "axis {axis}: {measured}, expected {sigma}");
    }
}

#[test]
fn matched_displacement_has_the_configured_spread() {
    let config = ScanMatchingMotionConfig { forward_m: 0.02, lateral_m: 0.01, heading_deg: 1.0, ..plain() };
    let step = Pose2::new(0.3, 0.05, 0.2);
    let motion = ScanMatchingMotion::new(&config, &MatchedMotion { previous_from_robot: step, ..Default::default() });
    let (mean, covariance) = moments(&motion, START * step);
    assert!(mean.norm() < 5e-4, "{mean}");
    // Seen from the new heading, turned by 0.2 rad from the frame in which the noise is stated.
    let (sin, cos) = sin_cos(0.2);
    let forward = libm::sqrtf((0.02 * cos) * (0.02 * cos) + (0.01 * sin) * (0.01 * sin));
    let lateral = libm::sqrtf((0.02 * sin) * (0.02 * sin) + (0.01 * cos) * (0.01 * cos));
    assert_deviations(&covariance, [forward, lateral, 1.0_f32.to_radians()], 0.02);
}

#[test]
fn undetermined_axis_spreads_along_itself_only() {
    let config = ScanMatchingMotionConfig { undetermined_m: 0.2, ..plain() };
    // The corridor runs along the map's y axis; the robot looks along it at 90 degrees.
    let before = Pose2::new(0.0, 0.0, core::f32::consts::FRAC_PI_2);
    let matched = MatchedMotion::from_map(
        before,
        before * Pose2::new(0.1, 0.0, 0.0),
        &Matrix3::zeros(),
        Some(Point2::new(0.0, 1.0)),
    );
    let motion = ScanMatchingMotion::new(&config, &matched);
    let (_, covariance) = moments(&motion, START * Pose2::new(0.1, 0.0, 0.0));
    assert_deviations(&covariance, [0.2003, 0.01, 0.3_f32.to_radians()], 0.02);
}

#[test]
fn covariance_of_the_match_widens_up_to_its_limit() {
    let narrow = Matrix3::from_diagonal(&Vector3::new(4e-4, 1e-6, 1e-6));
    let config = ScanMatchingMotionConfig { covariance_gain: 2.0, covariance_max: 1.0, ..plain() };
    let at = |covariance| {
        let matched = MatchedMotion { covariance, ..Default::default() };
        moments(&ScanMatchingMotion::new(&config, &matched), START).1
    };
    assert_deviations(&at(narrow), [0.0412, 0.0102, 0.0056], 0.03);
    let endless = Matrix3::from_diagonal(&Vector3::new(1e4, 1e-6, 1e-6));
    assert_deviations(&at(endless), [1.0, 0.0102, 0.0056], 0.03);
    assert_deviations(&at(Matrix3::from_element(f32::NAN)), [0.01, 0.01, 0.00524], 0.03);
}

#[test]
fn odometry_noise_grows_with_distance_and_rotation() {
    let config = OdometryMotionConfig::default();
    let (distance, turn) = (1.0, 0.5);
    let step = Pose2::new(distance * libm::cosf(0.25), distance * libm::sinf(0.25), turn);
    let motion = OdometryMotion::new(&config, step);
    let (_, covariance) = moments(&motion, START * step);
    let heading = hypot(0.028 * distance, 0.1405 * turn);
    assert!((libm::sqrtf(covariance.m33) - heading).abs() < 0.002);
    let exact = OdometryMotionConfig {
        move_sigma_per_m: 0.0,
        move_sigma_per_rad: 0.0,
        drift_sigma_per_m: 0.0,
        drift_sigma_per_rad: 0.0,
        turn_sigma_per_m: 0.0,
        turn_sigma_per_rad: 0.0,
        ..config
    };
    for step in [step, Pose2::new(-0.4, 0.0, 0.1), Pose2::new(0.0, 0.3, 0.0)] {
        let (mean, _) = moments(&OdometryMotion::new(&exact, step), START * step);
        assert!(mean.norm() < 1e-4, "reversing and sliding are kept: {mean}");
    }
}

#[test]
fn odometry_on_a_straight_line_has_eliazars_moments() {
    let step = Pose2::new(2.0, 0.0, 0.0);
    let (_, covariance) = moments(&OdometryMotion::new(&OdometryMotionConfig::default(), step), START * step);
    assert!((libm::sqrtf(covariance.m33) - 0.056).abs() < 0.001);
    assert!((libm::sqrtf(covariance.m11) - 0.312).abs() < 0.006);
}

#[test]
fn velocity_arc_ends_where_the_circle_does() {
    let still =
        VelocityMotionConfig { alpha_1: 0.0, alpha_2: 0.0, alpha_3: 0.0, alpha_4: 0.0, alpha_5: 0.0, alpha_6: 0.0 };
    for turn_rate in [0.5_f32, -0.7, 1e-3, 0.0] {
        let (v, dt) = (0.8, 1.5);
        let end = VelocityMotion::new(&still, v, turn_rate, dt).sample(START, &mut RandomStream::new(1, 1, 1));
        let (h, turned) = (START.heading, START.heading + turn_rate * dt);
        let expected = if turn_rate == 0.0 {
            (START.x + v * dt * libm::cosf(h), START.y + v * dt * libm::sinf(h))
        } else {
            let radius = f64::from(v) / f64::from(turn_rate);
            let (h, turned) = (f64::from(h), f64::from(turned));
            (
                START.x + (radius * (libm::sin(turned) - libm::sin(h))) as f32,
                START.y + (radius * (libm::cos(h) - libm::cos(turned))) as f32,
            )
        };
        assert!((end.x - expected.0).abs() < 1e-4 && (end.y - expected.1).abs() < 1e-4, "{end:?} {expected:?}");
        assert!((wrap_angle(end.heading - turned)).abs() < 1e-5);
    }
}

#[test]
fn velocity_noise_has_the_stated_deviations() {
    let config = VelocityMotionConfig { alpha_3: 0.0, alpha_4: 0.0, ..VelocityMotionConfig::default() };
    let motion = VelocityMotion::new(&config, 1.0, 0.0, 2.0);
    let (_, covariance) = moments(&motion, START * Pose2::new(2.0, 0.0, 0.0));
    // Forward before the final rotation: α₁ v Δt = 0.2; final rotation: α₅ v Δt = 0.04.
    assert_deviations(&covariance, [0.2, 0.0, 0.04], 0.05);
}
