//! Ranges that cannot be walls, and walls that might be taken for such.

use super::*;

#[test]
fn a_value_for_nothing_that_is_taken_as_a_wall() {
    let mut chance = Chance(2);
    let short = with(|_, scan| {
        set_echoes(scan, |beam| match beam.echo {
            Echo::Hit(range) if range > 5.0 => Echo::Hit(5.0 + 0.02 * chance.next()),
            echo => echo,
        });
    });
    assert_among("no-return-as-wall", short);
}

#[test]
fn a_wall_before_a_robot_that_stands_is_one() {
    let beam = |degrees: f32| {
        let bearing_rad = degrees.to_radians();
        let ahead_m = if degrees.abs() < 6.0 { 12.0 / bearing_rad.cos() } else { f32::MAX };
        let echo = Echo::Hit(ahead_m.min(1.2 / bearing_rad.sin().abs().max(1e-3)).min(12.2));
        Beam { bearing_rad, offset: Duration::ZERO, echo }
    };
    let stands = with(|_, scan| scan.beams = (-90..=90).map(|degrees| beam(degrees as f32)).collect());
    assert!(!kinds(stands).contains(&"no-return-as-wall"), "the end of a corridor");
}

/// As in a corridor whose ends are out of sight.
#[test]
fn a_value_for_nothing_in_one_direction_is_told_by_a_robot_that_drives() {
    let ahead = with(|_, scan| {
        set_echoes(scan, |beam| if beam.bearing_rad.abs() < 0.15 { Echo::Hit(25.0) } else { beam.echo });
    });
    assert_among("no-return-as-wall", ahead);
}

#[test]
fn beams_that_measure_nothing() {
    let mut chance = Chance(3);
    let invalid = with(|_, scan| set_echoes(scan, |beam| if chance.next() < 0.5 { Echo::Invalid } else { beam.echo }));
    assert_only(&["mostly-invalid"], invalid);
}
