//! Every Jacobian against differences of the function that it is of.

use nalgebra::{SMatrix, SVector, Vector2};
use proptest::prelude::*;

use super::super::sight::Sensor;
use super::super::travel::Travel;
use super::super::*;

const STEP: f64 = 1e-6;

/// Central differences; rows in `angles` are angles.
fn differences<const R: usize, const C: usize>(
    at: SVector<f64, C>,
    angles: &[usize],
    function: impl Fn(SVector<f64, C>) -> SVector<f64, R>,
) -> SMatrix<f64, R, C> {
    SMatrix::from_fn(|row, column| {
        let mut step = SVector::<f64, C>::zeros();
        step[column] = STEP;
        let change = function(at + step)[row] - function(at - step)[row];
        (if angles.contains(&row) { wrap_angle(change) } else { change }) / (2.0 * STEP)
    })
}

fn mounted() -> Sensor {
    Sensor::new(&LandmarkConfig { lrf_x_m: 0.4, lrf_y_m: -0.2, lrf_heading_deg: 25.0, ..LandmarkConfig::default() })
}

fn robot() -> impl Strategy<Value = RobotState> {
    (-5.0..5.0_f64, -5.0..5.0_f64, -3.1..3.1_f64, 0.7..1.3_f64, 0.7..1.3_f64)
        .prop_map(|(x, y, heading, d, b)| RobotState::new(x, y, heading, d, b))
}

fn travel(distance_m: f64, turn_rad: f64) -> Travel {
    let control = Control::Odometry { distance_m, turn_rad, seconds: 1.0 };
    Travel::new(&control, &LandmarkConfig::default()).unwrap()
}

proptest! {
    #[test]
    fn of_motion_by_the_state(robot in robot(), distance in -2.0..2.0_f64, turn in -2.0..2.0_f64, is_small in any::<bool>()) {
        let travel = travel(distance, if is_small { turn * 1e-4 } else { turn });
        let (jacobian, _) = travel.jacobian_and_noise(&robot);
        let expected = differences(robot, &[2], |robot| travel.moved(&robot));
        prop_assert!((jacobian - expected).abs().max() < 1e-7, "{}", jacobian - expected);
    }

    /// Noise of the step is J diag(σ²) Jᵀ with J by the arc's length and angle.
    #[test]
    fn of_motion_by_the_control(robot in robot(), distance in -2.0..2.0_f64, turn in -2.0..2.0_f64) {
        let robot = RobotState::new(robot[0], robot[1], robot[2], 1.0, 1.0);
        let step = travel(distance, turn);
        let by_control = differences(Vector2::new(distance, turn), &[2], |control| {
            let moved = travel(control[0], control[1]).moved(&robot);
            nalgebra::Vector3::new(moved[0], moved[1], moved[2])
        });
        let variances = nalgebra::Matrix2::from_diagonal(&Vector2::new(step.distance_variance, step.turn_variance));
        let mut expected = by_control * variances * by_control.transpose();
        expected[(2, 2)] += step.heading_variance;
        let (_, noise) = step.jacobian_and_noise(&robot);
        prop_assert!((noise.fixed_view::<3, 3>(0, 0) - expected).abs().max() < 1e-7);
        prop_assert_eq!(noise.fixed_view::<2, 5>(3, 0).abs().max(), 0.0);
    }

    #[test]
    fn of_a_sighting(robot in robot(), x in -9.0..9.0_f64, y in -9.0..9.0_f64) {
        let (sensor, landmark) = (mounted(), Vector2::new(x, y));
        let view = sensor.view(&robot, landmark).unwrap();
        prop_assume!(view.seen.x > 0.3);
        let by_robot = differences(robot, &[1], |robot| sensor.view(&robot, landmark).unwrap().seen);
        let by_landmark = differences(landmark, &[1], |landmark| sensor.view(&robot, landmark).unwrap().seen);
        prop_assert!((view.by_robot - by_robot.fixed_view::<2, 3>(0, 0)).abs().max() < 1e-6);
        prop_assert!((view.by_landmark - by_landmark).abs().max() < 1e-6);
    }

    #[test]
    fn of_a_new_landmark(robot in robot(), range_m in 0.1..20.0_f64, bearing_rad in -3.0..3.0_f64) {
        let sensor = mounted();
        let sighting = |seen: Vector2<f64>| Sighting { range_m: seen.x, bearing_rad: seen.y, identity: None, noise: None };
        let seen = Vector2::new(range_m, bearing_rad);
        let place = sensor.place(&robot, &sighting(seen));
        let by_robot = differences(robot, &[], |robot| sensor.place(&robot, &sighting(seen)).at);
        let by_sighting = differences(seen, &[], |seen| sensor.place(&robot, &sighting(seen)).at);
        prop_assert!((place.by_robot - by_robot.fixed_view::<2, 3>(0, 0)).abs().max() < 1e-6);
        prop_assert!((place.by_sighting - by_sighting).abs().max() < 1e-6);
        // Seen from there it looks as it did.
        let back = sensor.view(&robot, place.at).unwrap().seen - seen;
        prop_assert!(back.x.abs() < 1e-9 && wrap_angle(back.y).abs() < 1e-9);
    }
}

#[test]
fn an_arc_ends_where_the_circle_does() {
    // A quarter of a circle of radius 2: table 4.1 with v/ω = 2.
    let step = travel(2.0 * PI / 2.0, PI / 2.0);
    let moved = step.moved(&RobotState::new(1.0, 1.0, 0.0, 1.0, 1.0));
    assert!((moved - RobotState::new(3.0, 3.0, PI / 2.0, 1.0, 1.0)).abs().max() < 1e-12, "{moved}");
}

#[test]
fn what_is_not_finite_is_no_travel() {
    let config = LandmarkConfig::default();
    for (distance_m, turn_rad, seconds) in [(f64::NAN, 0.0, 1.0), (0.0, f64::INFINITY, 1.0), (0.0, 0.0, -1.0)] {
        assert_eq!(Travel::new(&Control::Odometry { distance_m, turn_rad, seconds }, &config), None);
    }
}
