//! A graph of poses: nodes are where segments start, edges what was measured between two of them, and the solution is where
//! the nodes are most likely.
//!
//! Minimised is Σ eᵀ Ω e over the edges, e the error of an edge's displacement, by Gauss–Newton steps on sparse normal
//! equations (Cholesky factorisation of `nalgebra-sparse`), damped where they would make it worse (Levenberg and Marquardt).
//! Breaks have no error: they only damp the steps of what nothing else holds. Closures have a robust kernel (Geman–McClure)
//! that is made strict step by step, so that a right closure is believed although it is far off at first, and a wrong one is
//! not although it comes first (graduated non-convexity: Yang, Antonante, Tzoumas & Carlone, RA-L 2020). Node 0 stays.
//!
//! Why not a factor-graph crate: `factrs` 0.3 brings 112 crates, `nalgebra-sparse` 25, most of which are here anyway; three unknowns
//! a node and one kind of edge need little else.

use nalgebra::{DMatrix, Matrix3, Vector3};
use nalgebra_sparse::factorization::CscCholesky;
use nalgebra_sparse::{CooMatrix, CscMatrix};

use crate::pose_f64::{PoseF64, wrap};

/// Steps at most …
const STEPS_MAX: usize = 40;
/// … and trials, with those that made it worse. Chosen.
const TRIALS_MAX: usize = 120;
/// A step that made it worse is tried again with this share of the equations' diagonal added to it …
const DAMPING_MIN: f64 = 1e-4;
/// … and so many times as much each time, …
const DAMPING_CHANGE: f64 = 10.0;
/// … until nothing would move any more. Each step that makes it better lessens that again.
const DAMPING_MAX: f64 = 1e8;
/// A step that moves no node farther (m, rad) is the last one.
const STEP_MIN: f64 = 1e-5;
/// χ² (three degrees of freedom) at which a closure is half believed.
const CHI2_DOUBTED: f64 = 12.0;

/// So many times the worst χ²: every closure is believed to nine tenths and more there.
const ALIKE: f64 = 20.0;

/// What was measured between two nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Index of the first node.
    pub from: usize,
    /// Index of the second node.
    pub to: usize,
    /// The second seen from the first.
    pub from_to: PoseF64,
    /// Inverse of the covariance of (x, y, heading) of that.
    pub information: Matrix3<f64>,
    /// A closure may be wrong; a stretch of path may not.
    pub is_closure: bool,
}

/// The graph; see the [module](self).
#[derive(Debug, Clone)]
pub struct PoseGraph {
    nodes: Vec<PoseF64>,
    edges: Vec<Edge>,
    /// Variances of all edges but closures are so many times what these say.
    variance_factor: f64,
}

impl Default for PoseGraph {
    fn default() -> Self {
        Self { nodes: Vec::new(), edges: Vec::new(), variance_factor: 1.0 }
    }
}

/// An edge's error and how it changes with its nodes.
struct Linear {
    error: Vector3<f64>,
    by_from: Matrix3<f64>,
    by_to: Matrix3<f64>,
}

/// Information of a break: the two nodes may be anywhere. Per m² and rad².
const BREAK_INFORMATION: f64 = 1e-6;
/// What only breaks lead to is held where it is by this much in each step, per m² and rad². The solution is the same for any: chosen far below what is
/// measured, and far above what rounding leaves.
const BREAK_DAMPING: f64 = 1.0;

impl Edge {
    /// Between two pieces of path of which nothing is known but which came first.
    pub fn break_between(from: usize, to: usize) -> Self {
        let information = Matrix3::from_diagonal_element(BREAK_INFORMATION);
        Self { from, to, from_to: PoseF64::default(), information, is_closure: false }
    }

    /// True if it says nothing of where its nodes lie.
    pub fn is_break(&self) -> bool {
        !self.is_closure && self.information[(0, 0)] <= BREAK_INFORMATION
    }

    /// True if it ties a node that is not solved for to the older one that it moves with; see [`PoseGraph::hang`].
    pub fn is_hanging(&self) -> bool {
        !self.is_closure && self.to < self.from
    }

    /// The way along this edge and then along `next`: Σ = J₁ Σ₁ J₁ᵀ + J₂ Σ₂ J₂ᵀ.
    fn followed_by(&self, next: &Self) -> Self {
        let (z, further) = (self.from_to, next.from_to);
        let from_to = z.then(further);
        let (sin, cos) = z.heading.sin_cos();
        let carried = Matrix3::new(1.0, 0.0, z.y - from_to.y, 0.0, 1.0, from_to.x - z.x, 0.0, 0.0, 1.0);
        let turned = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let covariance_of = |edge: &Self| edge.information.try_inverse().unwrap_or_default();
        let covariance =
            carried * covariance_of(self) * carried.transpose() + turned * covariance_of(next) * turned.transpose();
        let information = covariance.try_inverse().unwrap_or_else(|| Matrix3::from_diagonal_element(1.0));
        Self { from: self.from, to: next.to, from_to, information, is_closure: false }
    }

    /// The same measured from the other end.
    pub fn reversed(&self) -> Self {
        let z = self.from_to;
        let (sin, cos) = z.heading.sin_cos();
        let (by_x, by_y) = (sin * z.x - cos * z.y, cos * z.x + sin * z.y);
        let turned = Matrix3::new(-cos, -sin, by_x, sin, -cos, by_y, 0.0, 0.0, -1.0);
        // Of the inverse of the transform, which is the Jacobian of the way back.
        let back = turned.try_inverse().unwrap_or_else(Matrix3::identity);
        let information = back.transpose() * self.information * back;
        Self { from: self.to, to: self.from, from_to: z.between(PoseF64::default()), information, ..*self }
    }

    fn linearise(&self, from: PoseF64, to: PoseF64) -> Linear {
        let (sin, cos) = from.heading.sin_cos();
        let (dx, dy) = (to.x - from.x, to.y - from.y);
        let (x, y) = (cos * dx + sin * dy, cos * dy - sin * dx);
        let z = self.from_to;
        Linear {
            error: Vector3::new(x - z.x, y - z.y, wrap(to.heading - from.heading - z.heading)),
            by_from: Matrix3::new(-cos, -sin, y, sin, -cos, -x, 0.0, 0.0, -1.0),
            by_to: Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0),
        }
    }

    fn chi2(&self, nodes: &[PoseF64]) -> f64 {
        let error = self.linearise(nodes[self.from], nodes[self.to]).error;
        (error.transpose() * self.information * error)[0]
    }
}

/// The way that led through a node, led past it; `None` if it is no plain part of a way.
///
/// * `held` — the node as seen from the older one that it will hang on
/// * `of_way` — its edges, without closures
fn way_round(held: &Edge, of_way: &[Edge]) -> Option<Vec<Edge>> {
    let node = held.to;
    // On what comes before it on new ground it would hang in the air.
    let is_from_new = |edge: &Edge| edge.from + 1 == node;
    let is_held_by = |edge: &Edge| is_from_new(edge) && held.from >= edge.from;
    match *of_way {
        [to, from] | [from, to] if to.to == node && from.from == node && !is_held_by(&to) => {
            // Where the way comes from new ground, that is tied to the old here. One that comes from old ground came from where the last node hung.
            let back = is_from_new(&to).then(|| held.followed_by(&to.reversed()));
            Some([held.followed_by(&from)].into_iter().chain(back).collect())
        }
        // What comes next hangs already, so both edges come here from older nodes.
        [a, b] if a.to == node && b.to == node && !is_held_by(&a) && !is_held_by(&b) => {
            let (older, newer) = if a.from < b.from { (a, b) } else { (b, a) };
            let is_one = older.from == newer.from;
            Some(if is_one { Vec::new() } else { vec![older.followed_by(&newer.reversed())] })
        }
        _ => None,
    }
}

impl PoseGraph {
    /// Adds a node where it is thought to be, and returns its index.
    pub fn add_node(&mut self, pose: PoseF64) -> usize {
        self.nodes.push(pose);
        self.nodes.len() - 1
    }

    /// Adds an edge between two nodes of the graph.
    pub fn add_edge(&mut self, edge: Edge) {
        assert!(edge.from.max(edge.to) < self.nodes.len() && edge.from != edge.to, "an edge joins two nodes");
        self.edges.push(edge);
    }

    /// Where the nodes are.
    pub fn nodes(&self) -> &[PoseF64] {
        &self.nodes
    }

    /// Puts the nodes after the first where somebody else says that they are.
    pub fn move_nodes(&mut self, poses: &[PoseF64]) {
        for (node, pose) in self.nodes.iter_mut().skip(1).zip(poses) {
            *node = *pose;
        }
    }

    /// Puts a node where somebody else says that it is.
    pub fn put(&mut self, node: usize, pose: PoseF64) {
        self.nodes[node] = pose;
    }

    /// All edges, in the order in which they were added.
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// From now on the variances of the path are so many times what its edges say; closures say what they are.
    pub fn set_variance_factor(&mut self, factor: f64) {
        self.variance_factor = factor;
    }

    /// Takes a node out of what is solved: it moves with the older node `on` from now on, and the way that led through it leads through
    /// there. Its closures are forgotten. False if that cannot be: it is no plain part of a way.
    ///
    /// * `information` — how surely the node lies there, seen from `on`
    pub fn hang(&mut self, node: usize, on: usize, information: Matrix3<f64>) -> bool {
        let at = |index: &usize| [self.edges[*index].from, self.edges[*index].to].contains(&node);
        let of_node: Vec<usize> = (0..self.edges.len()).filter(at).collect();
        let of_way: Vec<Edge> =
            of_node.iter().map(|&index| self.edges[index]).filter(|edge| !edge.is_closure).collect();
        if on >= node || of_way.iter().any(|edge| edge.is_break() || edge.is_hanging()) {
            return false;
        }
        let from_to = self.nodes[on].between(self.nodes[node]);
        let held = Edge { from: on, to: node, from_to, information, is_closure: false };
        let Some(led) = way_round(&held, &of_way) else { return false };
        self.remove_edges(&of_node);
        self.edges.extend(led);
        let from_to = self.nodes[node].between(self.nodes[on]);
        self.edges.push(Edge { from: node, to: on, from_to, information, is_closure: false });
        true
    }

    /// Puts the nodes where they are most likely; returns the closures that do not agree with the rest (indices of
    /// edges, ascending). They are believed the less the worse they fit.
    pub fn solve(&mut self) -> Vec<usize> {
        self.solve_from(1.0)
    }

    /// The same, with all closures believed alike at first: where the nodes are now does not count, nor does who came first.
    pub fn solve_anew(&mut self) -> Vec<usize> {
        self.solve_from(ALIKE)
    }

    /// * `doubt` — the worst closure is half believed at first if it is 1, and more than that if it is larger
    fn solve_from(&mut self, doubt: f64) -> Vec<usize> {
        let worst = self.closures().map(|(_, edge)| edge.chi2(&self.nodes)).fold(0.0, f64::max);
        let mut scale = f64::max(doubt * worst, CHI2_DOUBTED);
        let free = self.free_nodes();
        let (mut steps, mut damping) = (0, 0.0);
        for _ in 0..TRIALS_MAX {
            let Some(largest) = self.try_step(scale, damping, &free) else {
                damping = f64::max(DAMPING_CHANGE * damping, DAMPING_MIN);
                if damping > DAMPING_MAX {
                    break;
                }
                continue;
            };
            steps += 1;
            if steps == STEPS_MAX || (scale <= CHI2_DOUBTED && damping == 0.0 && largest < STEP_MIN) {
                break;
            }
            damping = if damping > DAMPING_MIN { damping / DAMPING_CHANGE } else { 0.0 };
            scale = (scale / 2.0).max(CHI2_DOUBTED);
        }
        for edge in self.edges.iter().filter(|edge| edge.is_hanging()) {
            self.nodes[edge.from] = self.nodes[edge.to].then(edge.from_to.between(PoseF64::default()));
        }
        let doubted = self.closures().filter(|(_, edge)| edge.chi2(&self.nodes) > CHI2_DOUBTED);
        doubted.map(|(index, _)| index).collect()
    }

    /// Takes out edges, given by ascending indices.
    pub fn remove_edges(&mut self, indices: &[usize]) {
        indices.iter().rev().for_each(|&index| {
            self.edges.remove(index);
        });
    }

    fn closures(&self) -> impl Iterator<Item = (usize, &Edge)> {
        self.edges.iter().enumerate().filter(|(_, edge)| edge.is_closure)
    }

    /// Place of each node among those that are solved for; `None` for those that hang.
    fn free_nodes(&self) -> Vec<Option<usize>> {
        let mut is_free = vec![true; self.nodes.len()];
        self.edges.iter().filter(|edge| edge.is_hanging()).for_each(|edge| is_free[edge.from] = false);
        let mut places = 0..;
        is_free.into_iter().map(|is_free| if is_free { places.next() } else { None }).collect()
    }

    /// What is minimised: closures count by Geman and McClure's kernel, half believed at `scale`.
    fn cost(&self, scale: f64) -> f64 {
        let of = |edge: &Edge| {
            let chi2 = edge.chi2(&self.nodes);
            if edge.is_closure { scale * chi2 / (scale + chi2) } else { chi2 / self.variance_factor }
        };
        self.edges.iter().filter(|edge| !edge.is_break() && !edge.is_hanging()).map(of).sum()
    }

    /// A step of Levenberg and Marquardt; how far it moves the nodes at most, m and rad. `None` if there is none that makes it better: nothing moves then.
    fn try_step(&mut self, scale: f64, damping: f64, free: &[Option<usize>]) -> Option<f64> {
        let step = self.step(scale, damping, free)?;
        let before = (self.cost(scale), self.nodes.clone());
        for (node, place) in self.nodes.iter_mut().zip(free) {
            let Some(row) = place else { continue };
            let change = step.fixed_view::<3, 1>(3 * row, 0);
            *node = PoseF64::new(node.x + change[0], node.y + change[1], wrap(node.heading + change[2]));
        }
        let largest = step.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
        if largest >= STEP_MIN && self.cost(scale) > before.0 {
            self.nodes = before.1;
            return None;
        }
        Some(largest)
    }

    /// Solution of the normal equations, three numbers a node of `free`; `None` if they are singular.
    ///
    /// * `damping` — share that is added to their diagonal
    fn step(&self, scale: f64, damping: f64, free: &[Option<usize>]) -> Option<DMatrix<f64>> {
        let size = 3 * free.iter().flatten().count();
        let mut matrix = CooMatrix::new(size, size);
        let mut right = DMatrix::zeros(size, 1);
        push_block(&mut matrix, 0, 0, &Matrix3::from_diagonal_element(1e12));
        for edge in &self.edges {
            let (Some(from), Some(to)) = (free[edge.from], free[edge.to]) else { continue };
            let believed = || (scale / (scale + edge.chi2(&self.nodes))).powi(2);
            let weight = if edge.is_closure { believed() } else { 1.0 / self.variance_factor };
            let Linear { error, by_from, by_to } = edge.linearise(self.nodes[edge.from], self.nodes[edge.to]);
            // A break pulls at nothing: two of them would draw and turn a piece between them out of all shape.
            let (error, information) = if edge.is_break() {
                (Vector3::zeros(), Matrix3::from_diagonal_element(BREAK_DAMPING))
            } else {
                (error, edge.information * weight)
            };
            let ends = [(from, by_from), (to, by_to)];
            for (row, by_row) in &ends {
                let weighted = by_row.transpose() * information;
                let mut part = right.fixed_view_mut::<3, 1>(3 * row, 0);
                part -= weighted * error;
                for (column, by_column) in &ends {
                    let mut block = weighted * by_column;
                    if damping > 0.0 && row == column {
                        block.set_diagonal(&((1.0 + damping) * block.diagonal()));
                    }
                    push_block(&mut matrix, *row, *column, &block);
                }
            }
        }
        let factor = CscCholesky::factor(&CscMatrix::from(&matrix)).ok()?;
        Some(factor.solve(&right)).filter(|step| step.iter().all(|value| value.is_finite()))
    }
}

fn push_block(matrix: &mut CooMatrix<f64>, row: usize, column: usize, block: &Matrix3<f64>) {
    for i in 0..3 {
        for j in 0..3 {
            matrix.push(3 * row + i, 3 * column + j, block[(i, j)]);
        }
    }
}

#[cfg(test)]
mod tests;
