//! How uncertain every node is as seen from one of them: along the surest way through the graph.
//!
//! An upper bound for the marginal covariances of the graph, which are dear: other ways only add certainty.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::pose_graph::{Edge, PoseGraph};

/// What adds up along a way through the graph.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Reach {
    /// Variance of the position along each axis but for that of the heading on the way, m².
    pub position: f64,
    /// Variance of the heading, rad².
    pub heading: f64,
    /// Length of the way, m; closures are short cuts.
    pub travel_m: f64,
}

impl Reach {
    /// Standard deviation of the position, m. A heading that is off in the middle of the way bends the rest of it.
    pub fn position_m(&self) -> f64 {
        let lever = self.travel_m / 3.0;
        (self.position + self.heading * lever * lever).sqrt()
    }

    /// Standard deviation of the heading, rad.
    pub fn heading_rad(&self) -> f64 {
        self.heading.sqrt()
    }

    /// With all variances so many times as large.
    pub fn inflated(&self, factor: f64) -> Self {
        Self { position: factor * self.position, heading: factor * self.heading, ..*self }
    }

    fn plus(&self, edge: &Edge) -> Self {
        let covariance = edge.information.try_inverse().unwrap_or_default();
        let length = if edge.is_closure { 0.0 } else { edge.from_to.distance_m() };
        // Whoever made a saved map may have written any numbers: a way that becomes surer by going on has no end.
        let variance = |axis: usize| covariance[(axis, axis)].max(0.0);
        Self {
            position: self.position + variance(0).max(variance(1)),
            heading: self.heading + variance(2),
            travel_m: self.travel_m + length,
        }
    }
}

/// From `node` to every node of the graph, by Dijkstra's algorithm on the variance of the position; `None` where no way leads.
pub fn reach_from(graph: &PoseGraph, node: usize) -> Vec<Option<Reach>> {
    let mut edges_of = vec![Vec::new(); graph.nodes().len()];
    for edge in graph.edges() {
        edges_of[edge.from].push((edge, edge.to));
        edges_of[edge.to].push((edge, edge.from));
    }
    let mut reached: Vec<Option<Reach>> = vec![None; edges_of.len()];
    let mut open = BinaryHeap::new();
    let start = Reach::default();
    reached[node] = Some(start);
    open.push((Reverse(key(&start)), node));
    while let Some((Reverse(at), node)) = open.pop() {
        let Some(here) = reached[node].filter(|here| key(here) == at) else { continue };
        for (edge, neighbour) in &edges_of[node] {
            let there = here.plus(edge);
            if reached[*neighbour].is_none_or(|known| key(&there) < key(&known)) {
                reached[*neighbour] = Some(there);
                open.push((Reverse(key(&there)), *neighbour));
            }
        }
    }
    reached
}

/// Order of variances, which are not negative: as their bits.
fn key(reach: &Reach) -> u64 {
    reach.position.to_bits()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose_f64::PoseF64;
    use nalgebra::Matrix3;

    #[test]
    fn a_closure_is_a_short_cut() {
        let mut graph = PoseGraph::default();
        let step = PoseF64::new(2.0, 0.0, 0.0);
        for index in 0..6 {
            graph.add_node(PoseF64::new(2.0 * f64::from(index), 0.0, 0.0));
        }
        let edge = |from, to, variance: f64, is_closure| {
            let information = Matrix3::from_diagonal_element(1.0 / variance);
            Edge { from, to, from_to: step, information, is_closure }
        };
        (0..4).for_each(|from| graph.add_edge(edge(from, from + 1, 0.01, false)));
        let alone = reach_from(&graph, 0);
        assert!((alone[4].unwrap().position - 0.04).abs() < 1e-9 && (alone[4].unwrap().travel_m - 8.0).abs() < 1e-9);
        assert_eq!(alone[5], None);
        graph.add_edge(edge(4, 0, 0.001, true));
        let closed = reach_from(&graph, 0);
        assert!((closed[4].unwrap().position - 0.001).abs() < 1e-9 && closed[4].unwrap().travel_m == 0.0);
        assert!((closed[3].unwrap().position - 0.011).abs() < 1e-9);
    }

    /// A way to and fro over an edge of negative variance would be surer each time, a thousand million times over.
    #[test]
    fn what_cannot_be_a_variance_has_an_end() {
        let mut graph = PoseGraph::default();
        (0..3).for_each(|_| _ = graph.add_node(PoseF64::default()));
        let edge = |from, variance: f64| {
            let information = Matrix3::from_diagonal_element(1.0 / variance);
            Edge { from, to: from + 1, from_to: PoseF64::default(), information, is_closure: false }
        };
        graph.add_edge(edge(0, 1e9));
        graph.add_edge(edge(1, -1.0));
        let far = reach_from(&graph, 0)[2].unwrap();
        assert!((far.position - 1e9).abs() < 1.0 && (far.heading - 1e9).abs() < 1.0, "{far:?}");
    }
}
