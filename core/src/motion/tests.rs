use super::*;
use crate::math::wrap_angle;
use crate::random::RandomStream;

const START: Pose2 = Pose2 { x: 2.0, y: -1.0, heading: 0.7 };

/// 1 cm, 1 cm and 0.3 degrees, nothing else.
fn plain() -> ScanMatchingMotionConfig {
    ScanMatchingMotionConfig { forward_m: 0.01, lateral_m: 0.01, heading_deg: 0.3, undetermined_m: 0.0 }
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
    let matched = MatchedMotion::from_map(before, before * Pose2::new(0.1, 0.0, 0.0), Some(Point2::new(0.0, 1.0)));
    let motion = ScanMatchingMotion::new(&config, &matched);
    let (_, covariance) = moments(&motion, START * Pose2::new(0.1, 0.0, 0.0));
    assert_deviations(&covariance, [0.2003, 0.01, 0.3_f32.to_radians()], 0.02);
}
