use super::super::through::looked_through;
use super::*;
use crate::time::Instant;
use std::vec;
use std::vec::Vec;

/// What a laser at `x` on the axis of a corridor 4 m wide and 20 m long sees, robot frame, with `more` in its way.
fn seen_from(x: f32, more: &dyn Fn(f32) -> f32) -> Vec<Point2> {
    let hit = |degree: i32| {
        let bearing = (degree as f32 - 90.0).to_radians();
        let (sin, cos) = (libm::sinf(bearing), libm::cosf(bearing).max(1e-3));
        let range = (2.0 / sin.abs().max(1e-3)).min((20.0 - x) / cos).min(more(bearing));
        Point2::from_polar(range, bearing)
    };
    (0..=180).map(hit).collect()
}

/// How many of `hits` stand, as two scans from `earlier` say, with so much `more` in the way of each.
fn standing(now: f32, hits: &mut [Point2], earlier: [f32; 2], more: [&dyn Fn(f32) -> f32; 2]) -> usize {
    let mut points = vec![Point2::default(); 2 * 181];
    let witnesses: Vec<KeyScan> = earlier
        .iter()
        .zip(more)
        .zip(points.chunks_mut(181))
        .map(|((x, more), memory)| {
            let mut witness = KeyScan::default();
            witness.keep(memory, &seen_from(*x, more), taken_at(*x));
            witness
        })
        .collect();
    keep_standing(hits, &taken_at(now), &witnesses, &points)
}

/// The robot goes a metre a second.
fn taken_at(x: f32) -> Taken {
    Taken {
        at: Instant::from_micros((x * 1e6) as i64),
        map_from_robot: Pose2::new(x, 0.0, 0.0),
        farthest_m: 20.0,
        beam_rad: core::f32::consts::PI / 180.0,
        ..Default::default()
    }
}

proptest::proptest! {
    #[test]
    fn looked_for_about_anywhere_it_is_found(count in 0_usize..200, split in 0_usize..220, near in 0_usize..220) {
        let items: Vec<usize> = (0..count).collect();
        let asked = core::cell::Cell::new(0);
        let is_before = |item: &usize| {
            asked.set(asked.get() + 1);
            *item < split
        };
        let found = partition_point_near(&items, near, is_before);
        proptest::prop_assert_eq!(found, split.min(count));
        let away = found.abs_diff(near.min(count));
        proptest::prop_assert!(asked.get() <= 2 + 2 * (usize::BITS - away.leading_zeros()), "{} for {away}", asked.get());
    }
}

const NOBODY: &dyn Fn(f32) -> f32 = &|_| f32::MAX;

#[test]
fn walls_stand_and_who_came_since_does_not() {
    let mut walls = seen_from(2.0, NOBODY);
    assert_eq!(standing(2.0, &mut walls, [1.0, 0.0], [NOBODY; 2]), 181);
    // Somebody 1.5 m ahead, 0.4 m wide: 15 beams.
    let mut hits = seen_from(2.0, &|bearing| if bearing.abs() < 0.13 { 1.5 } else { f32::MAX });
    assert_eq!(standing(2.0, &mut hits, [1.0, 0.0], [NOBODY; 2]), 181 - 15);
    assert!(hits[..166].iter().all(|hit| hit.norm() > 1.9), "those that stand come first");
}

/// Nobody has ever seen the place where he stands, for he stood before it all the time.
#[test]
fn who_goes_before_the_robot_is_not_map() {
    let escort = |bearing: f32| if bearing.abs() < 0.4 { 1.2 } else { f32::MAX };
    let mut hits = seen_from(2.0, &escort);
    let kept = standing(2.0, &mut hits, [1.4, 0.8], [&escort; 2]);
    assert!((181 - 51..=181 - 40).contains(&kept), "{kept}");
}

/// He is where he was on his way there, and for one of the witnesses has stood.
#[test]
fn who_stands_is_map_and_who_turns_round_is_not() {
    let at = |range_m: f32| move |bearing: f32| if bearing.abs() < 0.2 / range_m { range_m } else { f32::MAX };
    let hits = || seen_from(2.0, &at(2.0));
    assert_eq!(standing(2.0, &mut hits(), [1.0, 0.0], [&at(3.0), &at(4.0)]), 181);
    assert_eq!(standing(2.0, &mut hits(), [1.0, 0.0], [&at(4.0), &at(4.0)]), 181 - 11);
}

/// A corridor that ends nowhere: only he tells where the robot is in it.
#[test]
fn who_was_not_seen_there_may_walk_and_what_was_hidden_may_be_a_wall() {
    let at = |range_m: f32| move |bearing: f32| if bearing.abs() < 0.2 / range_m { range_m } else { f32::MAX };
    let walking_at = |range_m: f32, more: &dyn Fn(f32) -> f32| {
        let mut witness = KeyScan::default();
        let mut points = vec![Point2::default(); 181];
        witness.keep(&mut points, &seen_from(1.0, more), taken_at(1.0));
        walking(&seen_from(2.5, &at(range_m)), &taken_at(2.5), &[witness], &points).objects.len()
    };
    assert_eq!(walking_at(3.0, NOBODY), 1, "a beam went on where he is");
    assert_eq!(walking_at(3.0, &at(7.0)), 1, "he himself was behind");
    assert_eq!(walking_at(3.0, &at(2.0)), 0, "hidden by what was nearer");
    assert_eq!(walking_at(3.0, &at(4.5)), 0, "he was there");
}

/// Some logs are written in bursts: scans of a second have stamps a millisecond apart.
#[test]
fn only_who_is_fast_for_half_a_metre_cannot_wait() {
    let witness = |x| {
        let mut witness = KeyScan::default();
        witness.keep(&mut [Point2::default()], &[Point2::default()], taken_at(x));
        witness
    };
    let witnesses = [witness(1.0), witness(0.0)];
    let at = |seconds: f32, x| Taken { at: taken_at(seconds).at, ..taken_at(x) };
    assert!(can_wait(&at(1.001, 1.1), &witnesses), "a tenth of a metre in a millisecond");
    let hemmed_in = Taken { farthest_m: 0.5, ..at(2.0, 2.0) };
    assert!(
        can_wait(&hemmed_in, &witnesses),
        "somebody before the laser takes the view of a robot at 1 m/s, and the witnesses saw 20 m"
    );
    assert!(!can_wait(&at(1.1, 1.6), &witnesses), "6 m/s, who sees 20 m");
}

/// A wall across the corridor, `x` ahead.
fn wall(x: f32) -> impl Fn(f32) -> f32 {
    move |bearing| x / libm::cosf(bearing).max(1e-3)
}

#[test]
fn walls_are_looked_through_and_people_are_not() {
    let nothing = |_: f32| f32::MAX;
    let somebody = |left: f32| move |bearing: f32| if (bearing - left).abs() < 0.1 { 1.5 } else { f32::MAX };
    let through = |now: &dyn Fn(f32) -> f32, then: [&dyn Fn(f32) -> f32; 2]| {
        let mut points = vec![Point2::default(); 2 * 181];
        let mut witnesses = [KeyScan::default(); 2];
        for (((witness, x), more), memory) in witnesses.iter_mut().zip([5.0, 5.6]).zip(then).zip(points.chunks_mut(181))
        {
            witness.keep(memory, &seen_from(x, more), taken_at(x));
        }
        looked_through(&seen_from(6.2, now), &taken_at(6.2), &witnesses, &points)
    };
    let behind = through(&nothing, [&wall(5.0), &wall(4.4)]);
    assert!((0.15..0.4).contains(&behind), "a wall at 10 m is gone: {behind}");
    assert!(through(&wall(3.8), [&wall(5.0), &wall(4.4)]) < 0.02, "it stands");
    assert!(through(&nothing, [&nothing, &nothing]) < 0.02);
    assert!(through(&somebody(0.0), [&nothing, &nothing]) < 0.02, "who stands before a wall hides it");
    assert!(through(&nothing, [&somebody(0.3), &somebody(-0.3)]) < 0.02, "who has gone on was no wall");
    assert_eq!(through(&|_| 0.5, [&wall(5.0), &wall(4.4)]), 0.0, "all is hidden");
}

#[test]
fn what_witnesses_look_through_as_well_tells_less() {
    // Across the corridor at 10 m: for the first so many of four it stands.
    let through = |standing: usize| {
        let mut points = vec![Point2::default(); 4 * 181];
        let mut witnesses = [KeyScan::default(); 4];
        for (number, (witness, memory)) in witnesses.iter_mut().zip(points.chunks_mut(181)).enumerate() {
            let x = 4.4 + 0.6 * number as f32;
            let ends = wall(if number < standing { 10.0 - x } else { 20.0 });
            witness.keep(memory, &seen_from(x, &ends), taken_at(x));
        }
        looked_through(&seen_from(6.8, NOBODY), &taken_at(6.8), &witnesses, &points)
    };
    let [opened, at_once] = [through(2), through(4)];
    assert!((0.2..0.5).contains(&at_once), "for none of them: {at_once}");
    assert!(opened < 0.12, "a door that was opened before two of them came: {opened}");
}

#[test]
fn the_way_round_is_in_the_order_of_bearings_wherever_a_scan_begins() {
    let at = |degree: i32| Point2::from_polar(1.0 + (degree % 7).abs() as f32, (degree as f32).to_radians());
    let taken = taken_at(0.0);
    for first in [-180, -135, -91, -90, -1, 0, 45, 179] {
        let points: Vec<Point2> = (first..first + 360).map(|degree| taken.eye + at(degree)).collect();
        let outline = Outline::new(&taken, &points);
        let turned: Vec<f32> = points.iter().map(|point| outline.turned(*point - taken.eye)).collect();
        assert!(turned.is_sorted_by(|a, b| a < b), "from {first}: {turned:?}");
        assert!(turned[0].abs() < 1e-3 && turned[359] < 4.0, "from {first}: {turned:?}");
    }
}

#[test]
fn a_witness_sees_between_hits_that_are_some_beams_apart_and_no_more() {
    let see = |from: f32, to: f32| see_between(Point2::from_polar(2.0, from), Point2::from_polar(7.0, to));
    for from in [-3.0, -1.6, 0.0, 0.8, 2.5, 3.1] {
        assert!(see(from, from + 0.059) && see(from, from - 0.01), "{from}");
        assert!(![0.061, 1.0, 1.6, 3.0].iter().any(|apart| see(from, from + apart)), "{from}");
    }
}
