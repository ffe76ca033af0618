use super::*;
use lrfslam_core::math::{normal, uniform};
use lrfslam_core::random::RandomStream;

fn information(position_m: f64, heading_rad: f64) -> Matrix3<f64> {
    let (p, h) = (position_m.powi(-2), heading_rad.powi(-2));
    Matrix3::from_diagonal(&Vector3::new(p, p, h))
}

/// A square of 4 × 10 nodes, 1 m apart, and the same path with an error of heading at every step.
fn drifted_square(seed: u64) -> (Vec<PoseF64>, PoseGraph) {
    let mut rng = RandomStream::new(seed, 0, 0);
    let (mut truth, mut graph) = (vec![PoseF64::default()], PoseGraph::default());
    graph.add_node(PoseF64::default());
    for index in 0..40 {
        let turn = if index % 10 == 9 { std::f64::consts::FRAC_PI_2 } else { 0.0 };
        let step = PoseF64::new(1.0, 0.0, turn);
        let drifted = PoseF64::new(1.0, 0.0, turn + 0.02 + 0.01 * f64::from(normal(&mut rng)));
        truth.push(truth[index].then(step));
        let node = graph.add_node(graph.nodes()[index].then(drifted));
        let information = information(0.02, 0.02);
        graph.add_edge(Edge { from: index, to: node, from_to: drifted, information, is_closure: false });
    }
    (truth, graph)
}

fn closure(from: usize, to: usize, from_to: PoseF64) -> Edge {
    Edge { from, to, from_to, information: information(0.03, 0.01), is_closure: true }
}

/// The square with three closures, solved.
fn closed_square() -> (Vec<PoseF64>, PoseGraph) {
    let (truth, mut graph) = drifted_square(3);
    for (from, to) in [(0, 39), (2, 38), (10, 30)] {
        graph.add_edge(closure(from, to, truth[from].between(truth[to])));
    }
    graph.solve();
    (truth, graph)
}

fn worst(graph: &PoseGraph, truth: &[PoseF64]) -> f64 {
    graph.nodes().iter().zip(truth).map(|(a, b)| (a.x - b.x).hypot(a.y - b.y)).fold(0.0, f64::max)
}

#[test]
fn derivatives_are_those_of_differences() {
    let edge = closure(0, 1, PoseF64::new(0.3, -0.2, 0.5));
    let ends = [PoseF64::new(1.0, 2.0, 0.7), PoseF64::new(1.5, 1.0, -0.4)];
    let linear = edge.linearise(ends[0], ends[1]);
    for (end, derivative) in [linear.by_from, linear.by_to].iter().enumerate() {
        for axis in 0..3 {
            let mut moved = ends;
            let step = 1e-6;
            match axis {
                0 => moved[end].x += step,
                1 => moved[end].y += step,
                _ => moved[end].heading += step,
            }
            let difference = (edge.linearise(moved[0], moved[1]).error - linear.error) / step;
            assert!((difference - derivative.column(axis)).norm() < 1e-5, "end {end} axis {axis}");
        }
    }
}

#[test]
fn a_path_alone_stays_where_it_is() {
    let (_, mut graph) = drifted_square(1);
    let before = graph.nodes().to_vec();
    assert!(graph.solve().is_empty());
    assert!(worst(&graph, &before) < 1e-9);
}

#[test]
fn one_closure_repairs_a_loop() {
    for seed in 1..=10 {
        let (truth, mut graph) = drifted_square(seed);
        let before = worst(&graph, &truth);
        graph.add_edge(closure(0, 40, truth[0].between(truth[40])));
        assert!(graph.solve().is_empty());
        assert!(before > 2.0 && worst(&graph, &truth) < 0.25 * before, "{before} {}", worst(&graph, &truth));
    }
}

#[test]
fn a_wrong_closure_is_found_out_by_two_right_ones() {
    for seed in 1..=10 {
        let (truth, mut graph) = drifted_square(seed);
        graph.add_edge(closure(5, 25, PoseF64::new(1.0, 1.0, 0.0)));
        graph.add_edge(closure(0, 40, truth[0].between(truth[40])));
        graph.add_edge(closure(1, 39, truth[1].between(truth[39])));
        assert_eq!(graph.solve(), [40], "seed {seed}");
        assert!(worst(&graph, &truth) < 0.8, "{}", worst(&graph, &truth));
        graph.remove_edges(&[40]);
        assert_eq!(graph.edges().len(), 42);
        assert_eq!(graph.edges()[40].to, 40);
    }
}

/// A way that hangs holds its neighbours as it did, to what it is sure of; and what hangs moves with what it hangs on.
#[test]
fn nodes_that_hang_leave_the_solution_of_the_others_as_it_was() {
    let (truth, mut whole) = closed_square();
    let mut less = whole.clone();
    for node in [15, 16, 17] {
        assert!(less.hang(node, 10, information(0.05, 0.005)));
    }
    // The way that comes to the first of them is tied where it hangs.
    assert_eq!(less.edges().len(), whole.edges().len() + 1);
    assert_eq!(less.edges().iter().filter(|edge| edge.is_hanging()).count(), 3);
    let further = closure(5, 35, truth[5].between(truth[35]));
    [&mut whole, &mut less].into_iter().for_each(|graph| {
        graph.add_edge(further);
        graph.solve();
    });
    for node in (0..=40).filter(|node| !(15..=17).contains(node)) {
        let off = whole.nodes()[node].between(less.nodes()[node]);
        assert!(off.distance_m() < 5e-3 && off.heading.abs() < 3e-3, "{node}: {off:?}");
    }
    let from_first = |graph: &PoseGraph| graph.nodes()[10].between(graph.nodes()[16]);
    let before = from_first(&less);
    let pulled = less.nodes()[10].then(PoseF64::new(0.3, -0.2, 0.05));
    less.add_edge(Edge { information: information(1e-4, 1e-4), ..closure(0, 10, less.nodes()[0].between(pulled)) });
    less.solve();
    let (moved, off) = (less.nodes()[10].between(pulled), from_first(&less).between(before));
    assert!(moved.distance_m() < 0.05, "{moved:?}");
    assert!(off.distance_m() < 1e-9 && off.heading.abs() < 1e-9, "{off:?}");
}

/// What is known only later hangs as well, whatever hangs about it already.
#[test]
fn nodes_hang_in_any_order() {
    let (truth, whole) = closed_square();
    let further = closure(5, 35, truth[5].between(truth[35]));
    for order in [[15, 16, 17], [15, 17, 16], [17, 15, 16], [17, 16, 15]] {
        let (mut all, mut less) = (whole.clone(), whole.clone());
        for node in order {
            assert!(less.hang(node, 10, information(0.05, 0.005)), "{node} of {order:?}");
        }
        assert_eq!(less.edges().iter().filter(|edge| edge.is_hanging()).count(), 3);
        for graph in [&mut all, &mut less] {
            graph.add_edge(further);
            graph.solve();
        }
        for node in (0..=40).filter(|node| !(15..=17).contains(node)) {
            let off = all.nodes()[node].between(less.nodes()[node]);
            assert!(off.distance_m() < 5e-3 && off.heading.abs() < 3e-3, "{order:?}, {node}: {off:?}");
        }
    }
}

#[test]
fn what_is_no_plain_part_of_a_way_does_not_hang() {
    let (_, mut graph) = drifted_square(3);
    assert!(!graph.hang(0, 0, information(0.05, 0.005)), "the first node stays");
    assert!(!graph.hang(40, 3, information(0.05, 0.005)), "nor the last one, which the way goes on from");
    assert!(!graph.hang(5, 9, information(0.05, 0.005)), "nor on a newer node");
    assert!(graph.hang(9, 5, information(0.05, 0.005)));
    assert!(!graph.hang(9, 5, information(0.05, 0.005)), "nor twice");
    assert!(!graph.hang(5, 2, information(0.05, 0.005)), "nor a node that another one hangs on");
}

/// Ten steps of a metre that are 6 cm longer than they are believed to be, by three standard deviations each.
#[test]
fn a_path_that_drifts_more_than_it_says_refutes_what_is_right_until_that_is_known() {
    let solved = |variance_factor| {
        let mut graph = PoseGraph::default();
        graph.add_node(PoseF64::default());
        let (step, information) = (PoseF64::new(1.0, 0.0, 0.0), information(0.02, 0.02));
        for from in 0..10 {
            let to = graph.add_node(graph.nodes()[from].then(step));
            graph.add_edge(Edge { from, to, from_to: step, information, is_closure: false });
        }
        graph.add_edge(closure(0, 10, PoseF64::new(10.6, 0.0, 0.0)));
        graph.set_variance_factor(variance_factor);
        (graph.solve().len(), graph.nodes()[10].x)
    };
    let (refuted, end) = solved(1.0);
    assert!(refuted == 1 && end < 10.3, "{end}");
    let (refuted, end) = solved(9.0);
    assert!(refuted == 0 && (end - 10.6).abs() < 0.05, "{end}");
}

/// A robot that was lost twice, and is back in its first piece of map. Nothing tells where the piece between lies: it stays as it is.
#[test]
fn a_piece_that_only_breaks_lead_to_keeps_its_shape() {
    let (_, mut graph) = drifted_square(2);
    let begin = |graph: &mut PoseGraph, pose: PoseF64, steps: usize| {
        let last = graph.nodes().len() - 1;
        let first = graph.add_node(pose);
        graph.add_edge(Edge::break_between(last, first));
        for from in first..first + steps {
            let step = PoseF64::new(8.0, 0.5, 0.002);
            let to = graph.add_node(graph.nodes()[from].then(step));
            graph.add_edge(Edge { from, to, from_to: step, information: information(0.02, 0.003), is_closure: false });
        }
        first
    };
    let alone = begin(&mut graph, PoseF64::new(3.0, -2.0, 2.0), 100);
    let back = begin(&mut graph, PoseF64::new(1.0, 2.0, -1.0), 10);
    graph.add_edge(closure(
        5,
        back,
        graph.nodes()[5].between(graph.nodes()[back]).then(PoseF64::new(0.03, 0.02, 0.003)),
    ));
    graph.add_edge(closure(5, back + 1, graph.nodes()[5].between(graph.nodes()[back + 1])));
    for _ in 0..3 {
        assert!(graph.solve().is_empty());
        for edge in graph.edges().iter().filter(|edge| (alone..alone + 100).contains(&edge.from) && !edge.is_break()) {
            let step = graph.nodes()[edge.from].between(graph.nodes()[edge.to]);
            let off = edge.from_to.between(step);
            assert!(off.distance_m() < 1e-6 && off.heading.abs() < 1e-6, "{}: {off:?}", edge.from - alone);
        }
    }
}

/// Pieces of path that drift, and where they lie: every so often a break, after it anywhere.
fn pieces_of_path(uniform: &mut impl FnMut() -> f64) -> (Vec<PoseF64>, PoseGraph) {
    let (mut truth, mut graph) = (vec![PoseF64::default()], PoseGraph::default());
    graph.add_node(PoseF64::default());
    for from in 0..120 {
        if from % 40 == 39 {
            truth.push(PoseF64::new(100.0 * uniform(), 100.0 * uniform(), 6.0 * uniform()));
            graph.add_node(graph.nodes()[from]);
            graph.add_edge(Edge::break_between(from, from + 1));
            continue;
        }
        let step = PoseF64::new(8.0 * uniform(), 0.3 * uniform(), 0.1 * (uniform() - 0.3));
        let told = PoseF64::new(step.x, step.y + 0.05 * (uniform() - 0.5), step.heading + 0.02 * (uniform() - 0.5));
        truth.push(truth[from].then(step));
        graph.add_node(graph.nodes()[from].then(told));
        let information = information(0.02 + 0.1 * uniform(), 0.003 + 0.01 * uniform());
        graph.add_edge(Edge { from, to: from + 1, from_to: told, information, is_closure: false });
    }
    (truth, graph)
}

/// Steps are right for small turns only: who takes those that make it worse draws the path out, by kilometres in the end.
#[test]
fn no_closures_however_wrong_draw_a_path_out_of_shape() {
    for seed in 0..10 {
        let mut rng = RandomStream::new(seed, 0, 0);
        let mut uniform = || f64::from(uniform(&mut rng));
        let (truth, mut graph) = pieces_of_path(&mut uniform);
        for _ in 0..3 {
            for _ in 0..4 {
                let from = (100.0 * uniform()) as usize;
                let to = from + 1 + ((truth.len() - 1 - from) as f64 * uniform()) as usize;
                let wrong = PoseF64::new(30.0 * uniform() - 15.0, 30.0 * uniform() - 15.0, 6.0 * uniform());
                let right = truth[from].between(truth[to]);
                graph.add_edge(closure(from, to, if uniform() < 0.3 { wrong } else { right }));
            }
            let doubted = graph.solve_anew();
            graph.remove_edges(&doubted);
            graph.solve();
            for edge in graph.edges().iter().filter(|edge| !edge.is_closure && !edge.is_break()) {
                let off = edge.from_to.between(graph.nodes()[edge.from].between(graph.nodes()[edge.to]));
                assert!(off.distance_m() < 1.0 && off.heading.abs() < 0.2, "{seed}: {} by {off:?}", edge.from);
            }
        }
    }
}
