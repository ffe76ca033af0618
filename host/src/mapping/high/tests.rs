use lrfslam_core::time::Instant;
use nalgebra::Matrix3;

use super::pieces::Pieces;
use super::refining::Places;
use super::test_world::{ahead, room_and_corridor, sees, stretched, sweep_of, to_and_fro};
use super::*;

/// A straight path of nine segments of a metre, well known.
fn straight() -> HighSlam<'static> {
    let mut high = HighSlam::new(&HighConfigs::default(), None);
    let (step, information) = (PoseF64::new(1.0, 0.0, 0.0), Matrix3::from_diagonal_element(1e4));
    for from in 0..9 {
        let to = high.graph.add_node(high.graph.nodes()[from].then(step));
        high.graph.add_edge(Edge { from, to, from_to: step, information, is_closure: false });
        high.segments.push(Segment::empty());
        high.pieces.goes_on(from);
    }
    high
}

/// One that puts the robot `off_m` too far ahead.
fn closure(newer: usize, off_m: f64) -> Closure {
    let older_from_newer = PoseF64::new(newer as f64 + off_m, 0.0, 0.0);
    Closure { older: 0, newer, older_from_newer, moves_m: off_m as f32, weak_axis: None }
}

#[test]
fn what_the_graph_refutes_is_counted() {
    let mut high = straight();
    high.graph.add_edge(closure(8, 0.01).edge());
    high.graph.add_edge(closure(9, 4.0).edge());
    high.solve();
    let counts = high.counts();
    assert_eq!((counts.closures, counts.closures_refuted), (1, 1));
}

/// Nobody knows how long the first step was, and the path has it 3 m too long; two wrong closures agree with that nearly, and three
/// right ones do not.
#[test]
fn right_closures_that_were_refuted_one_by_one_win_together() {
    let mut high = straight();
    let (first, mut rest) = (high.graph.edges()[0], high.graph.edges()[1..].to_vec());
    high.graph = PoseGraph::default();
    (0..10).for_each(|node| _ = high.graph.add_node(PoseF64::new(f64::from(node) + 3.0, 0.0, 0.0)));
    high.graph.put(0, PoseF64::default());
    let information = Matrix3::from_diagonal_element(0.1);
    rest.push(Edge { from_to: PoseF64::new(4.0, 0.0, 0.0), information, ..first });
    rest.iter().for_each(|edge| high.graph.add_edge(*edge));
    let mut closed = |newer, off_m| {
        high.graph.add_edge(closure(newer, off_m).edge());
        high.solve();
        let counts = high.counts();
        (counts.closures, counts.closures_refuted, (high.graph.nodes()[9].x - 9.0).abs() < 0.05)
    };
    assert_eq!([closed(4, 3.2), closed(5, 3.2)], [(1, 0, false), (2, 0, false)]);
    assert_eq!([closed(6, 0.0), closed(7, 0.0)], [(2, 1, false), (2, 2, false)]);
    assert_eq!(closed(8, 0.0), (3, 2, true));
}

#[test]
fn what_waits_in_vain_is_counted_if_it_still_disagrees() {
    let mut high = straight();
    assert!(high.closer.confirmed(closure(1, 4.0), high.graph.nodes()).is_empty());
    assert!(high.closer.confirmed(closure(2, 1.5), high.graph.nodes()).is_empty());
    high.graph.put(2, PoseF64::new(3.0, 0.0, 0.0));
    high.close_loops(1 + WAITING_SEGMENTS);
    assert_eq!(high.counts().closures_refuted, 0, "both may find a second one yet");
    high.close_loops(3 + WAITING_SEGMENTS);
    assert_eq!(high.counts().closures_refuted, 1, "the path has moved to where one of them is");
}

/// A path that has drifted far more than it says is searched around farther, and does not hold out against a closure any more.
#[test]
fn a_path_surer_than_it_may_be_is_believed_less() {
    let seen = |expected: bool| {
        let mut high = straight();
        (0..10).for_each(|_| high.variance_factor.observe(if expected { 0.5 } else { 3.0 }, 0.3));
        high.graph.add_edge(closure(9, 0.4).edge());
        high.solve();
        let reach = reach_from(&high.graph, 0)[8].unwrap();
        let HighCounts { closures_refuted, drift_ratio, .. } = high.counts();
        (closures_refuted, high.window(Pose2::IDENTITY, &reach).distance_m, drift_ratio)
    };
    let (told, surer) = (seen(true), seen(false));
    assert_eq!((told.0, surer.0), (1, 0));
    assert!(surer.1 > told.1 && surer.2 > 2.0 && told.2 == 1.0, "{surer:?} {told:?}");
}

/// In the middle of a bare corridor a node is known to half a metre, and never better: judged again it leaves the graph all the same, and
/// hangs no surer than that.
#[test]
fn known_ground_that_stays_unsure_is_let_go_when_it_is_judged_again() {
    let visits = |along_m: f64| {
        let mut high = straight();
        let mut edges = high.graph.edges().to_vec();
        high.graph = PoseGraph::default();
        (0..10).for_each(|node| _ = high.graph.add_node(PoseF64::new(f64::from(node), 0.0, 0.0)));
        edges[6].information = Matrix3::from_diagonal_element(along_m.powi(-2));
        edges.iter().for_each(|edge| high.graph.add_edge(*edge));
        high.graph.add_edge(Edge { information: edges[6].information, ..closure(8, 0.0).edge() });
        high
    };
    let hung = |high: &HighSlam<'_>| high.graph.edges().iter().find(|edge| edge.is_hanging()).copied();
    let mut unsure = visits(0.5);
    unsure.let_go_if_known(8, f64::from(placing::REFERENCE_SIGMA_M));
    assert!(hung(&unsure).is_none());
    unsure.let_go_if_known(8, known::AGAIN_SIGMA_M);
    let edge = hung(&unsure).expect("it hangs");
    assert!((edge.information[(0, 0)].powf(-0.5) - 0.5).abs() < 0.01, "{edge:?}");
    let mut lost = visits(0.7);
    lost.let_go_if_known(8, known::AGAIN_SIGMA_M);
    assert!(hung(&lost).is_none());
}

/// Mean distance of the last 12 m from where they were, m.
fn off_m(high: &HighSlam<'_>, places: &[f32]) -> f32 {
    let path: Vec<Pose2> = high.trajectory().map(|pose| pose.map_from_robot).collect();
    let last = path.iter().rev().zip(places.iter().rev()).take(120);
    last.map(|(at, truth)| (at.x - path[0].x - (truth + 4.0)).hypot(at.y - path[0].y)).sum::<f32>() / 120.0
}

#[test]
fn what_is_too_long_within_a_stretch_is_refined() {
    let mut high = HighSlam::new(&HighConfigs::default(), None);
    let places = to_and_fro(stretched, false, 0.0, |sweep, low| _ = high.add_scan(sweep, low).unwrap());
    let before_m = off_m(&high, &places);
    let way_m = |high: &HighSlam<'_>| high.segments.iter().map(|segment| segment.travel_m).sum::<f32>();
    let told = (high.poses(), way_m(&high), high.graph.edges().to_vec());
    high.refine();
    let after_m = off_m(&high, &places);
    assert!(before_m > 0.06 && after_m < 0.3 * before_m, "{before_m} m before, {after_m} m after");
    assert!(told == (high.poses(), way_m(&high), high.graph.edges().to_vec()), "what was told of the way stays");
}

#[test]
fn what_lies_too_far_off_to_be_met_near_is_refined() {
    let mut high = HighSlam::new(&HighConfigs::default(), None);
    let places = to_and_fro(ahead, false, 0.0, |sweep, low| _ = high.add_scan(sweep, low).unwrap());
    let before_m = off_m(&high, &places);
    high.refine();
    let after_m = off_m(&high, &places);
    assert!(before_m > 0.06 && after_m < 0.5 * before_m, "{before_m} m before, {after_m} m after");
}

/// One that puts the robot at `x_m`.
fn lies_at(x_m: f64) -> Closure {
    closure(0, x_m)
}

#[test]
fn stops_matched_both_ways_lie_halfway_if_these_agree() {
    let told = |back: Option<f64>| {
        let there = Places { near: Some(closure(3, 0.0)), best: None };
        there.and_back(Places { near: back.map(lies_at), best: None }).map(|closure| closure.older_from_newer.x)
    };
    assert!((told(Some(-3.06)).unwrap() - 3.03).abs() < 1e-12);
    assert_eq!(told(Some(-3.2)), None, "they disagree");
    assert_eq!(told(None), Some(3.0), "found one way only");
}

#[test]
fn a_better_place_about_counts_if_both_ways_say_so() {
    let told = |best: Option<f64>, best_back: Option<f64>| {
        let there = Places { near: Some(closure(3, 0.0)), best: best.map(lies_at) };
        let back = Places { near: Some(lies_at(-3.0)), best: best_back.map(lies_at) };
        there.and_back(back).map(|closure| closure.older_from_newer.x)
    };
    assert_eq!(told(Some(3.04), Some(-3.02)), Some(3.0), "the same place");
    assert_eq!(told(Some(3.04), None), Some(3.0), "as far as was found");
    assert!((told(Some(3.54), Some(-3.5)).unwrap() - 3.52).abs() < 1e-12);
    assert_eq!(told(Some(3.54), None), None, "one way only: neither");
    assert_eq!(told(None, Some(-3.5)), None);
    assert_eq!(told(Some(3.54), Some(-3.0)), None, "they disagree");
    let best = |x| Places { near: None, best: Some(lies_at(x)) };
    let alone = best(3.54).and_back(best(-3.5)).map(|closure| closure.older_from_newer.x);
    assert!((alone.unwrap() - 3.52).abs() < 1e-12, "nothing was found near");
}

#[test]
fn a_better_place_lies_along_the_way() {
    let thought = Pose2::new(1.0, 2.0, std::f32::consts::FRAC_PI_2);
    let is_along = |x, y| refining::is_along(Pose2::new(x, y, thought.heading), thought);
    assert!(is_along(1.05, 2.6) && !is_along(1.15, 2.6));
}

/// What the low level tells well is not made worse by what noisy hits say of a few scans.
#[test]
fn what_is_told_well_stays() {
    let mut high = HighSlam::new(&HighConfigs::default(), None);
    let places = to_and_fro(|x| x, true, 0.03, |sweep, low| _ = high.add_scan(sweep, low).unwrap());
    let before_m = off_m(&high, &places);
    high.refine();
    let after_m = off_m(&high, &places);
    assert!(after_m < before_m + 0.003, "{before_m} m before, {after_m} m after");
}

/// A robot is carried back to a corridor. If its latest way looks alike, and the room before it does not, it is another corridor.
#[test]
fn pieces_are_not_joined_if_the_way_before_says_otherwise() {
    let pieces_apart = |other_half_m: f32| {
        let mut high = HighSlam::new(&HighConfigs::default(), None);
        let mut stamp = 0;
        let mut drive = |high: &mut HighSlam<'_>, half_m: f32, is_lost: bool, scans: u16| {
            for step in 0..scans {
                let at = Pose2::new(-4.0 + 0.1 * f32::from(step), 0.0, 0.0);
                let beams = sees(&room_and_corridor(half_m), at);
                stamp += 200_000;
                let low =
                    LowPose { map_from_robot: at, undetermined: None, is_lost, is_blind: false, is_frozen: false };
                high.add_scan(&sweep_of(&beams, stamp), &low).unwrap();
            }
        };
        drive(&mut high, 4.0, false, 160);
        drive(&mut high, 4.0, true, 10);
        drive(&mut high, other_half_m, false, 160);
        high.pieces_apart()
    };
    assert_eq!((pieces_apart(4.0), pieces_apart(2.0)), (0, 1));
}

/// Who is lost is somewhere else soon: after ten scans, or after four seconds of slow ones; not after two, nor while the laser is covered.
#[test]
fn a_new_piece_begins_after_ten_lost_scans_or_some_slow_ones() {
    let lost = LowPose {
        map_from_robot: Pose2::IDENTITY,
        undetermined: None,
        is_lost: true,
        is_blind: false,
        is_frozen: false,
    };
    let (found, blind) = (LowPose { is_lost: false, ..lost }, LowPose { is_blind: true, ..lost });
    let begins_at = |micros: i64, scans: &[LowPose]| {
        let mut pieces = Pieces::default();
        let stamps = (0..).map(|k| Instant::from_micros(k * micros));
        scans.iter().zip(stamps).position(|(low, stamp)| pieces.is_away(low, stamp))
    };
    assert_eq!(begins_at(200_000, &[lost; 20]), Some(9));
    assert_eq!(begins_at(1_000_000, &[lost; 20]), Some(4));
    assert_eq!(begins_at(10_000_000, &[lost; 20]), Some(2));
    assert_eq!(begins_at(1_000_000, &[found, lost, lost, lost, lost, found, lost, lost, lost, lost]), None);
    assert_eq!(begins_at(1_000_000, &[lost, lost, blind, blind, blind, blind, lost]), Some(6));
    assert_eq!(begins_at(200_000, &[&[lost; 9], &[blind; 90][..], &[found]].concat()), None);
}
