//! Normal equations of a graph of poses, three unknowns a node, and their solution.
//!
//! Of each row of the symmetric matrix is kept what stands from its first entry to the diagonal. A path joins each node to the next one,
//! so Cholesky's factor fills just that: sparser storage, or another order of the unknowns, would save nothing worth a crate.
//!
//! Source: George & Liu, *Computer Solution of Large Sparse Positive Definite Systems*, 1981, chapter 4 (envelope method).

use nalgebra::{Matrix3, Vector3};

/// Matrix and right-hand side.
pub(super) struct NormalEquations {
    rows: Vec<Row>,
    right: Vec<f64>,
}

/// A row from its first entry to the diagonal.
struct Row {
    first: usize,
    entries: Vec<f64>,
}

impl Row {
    fn entry(&mut self, column: usize) -> &mut f64 {
        let missing = self.first.saturating_sub(column);
        self.entries.splice(0..0, std::iter::repeat_n(0.0, missing));
        self.first -= missing;
        &mut self.entries[column - self.first]
    }

    /// `value` less the products of what this row and `other` have before `column`.
    fn reduce(&self, other: &Self, column: usize, value: f64) -> f64 {
        let first = self.first.max(other.first);
        let (own, others) = (self.before(first, column), other.before(first, column));
        own.iter().zip(others).fold(value, |value, (a, b)| value - a * b)
    }

    fn before(&self, first: usize, column: usize) -> &[f64] {
        &self.entries[first.min(column) - self.first..column - self.first]
    }
}

impl NormalEquations {
    /// All zero.
    pub(super) fn new(nodes: usize) -> Self {
        let rows = (0..3 * nodes).map(|row| Row { first: row, entries: vec![0.0] });
        Self { rows: rows.collect(), right: vec![0.0; 3 * nodes] }
    }

    /// Adds to the matrix at two nodes; above the diagonal nothing is kept.
    pub(super) fn add_block(&mut self, row: usize, column: usize, block: &Matrix3<f64>) {
        for i in 0..3 {
            for j in (0..3).filter(|j| 3 * column + j <= 3 * row + i) {
                *self.rows[3 * row + i].entry(3 * column + j) += block[(i, j)];
            }
        }
    }

    /// Subtracts from the right-hand side at a node.
    pub(super) fn subtract_right(&mut self, row: usize, part: &Vector3<f64>) {
        self.right[3 * row..].iter_mut().zip(part.iter()).for_each(|(right, part)| *right -= part);
    }

    /// The solution, three numbers a node; `None` if the matrix is not positive definite.
    pub(super) fn solve(mut self) -> Option<Vec<f64>> {
        self.factorise()?;
        let Self { rows, right: mut x } = self;
        for (i, row) in rows.iter().enumerate() {
            let value = row.before(row.first, i).iter().zip(&x[row.first..]).fold(x[i], |value, (a, b)| value - a * b);
            x[i] = value / row.entries[i - row.first];
        }
        for (i, row) in rows.iter().enumerate().rev() {
            let below = (i + 1..rows.len()).filter(|&k| rows[k].first <= i);
            let value = below.fold(x[i], |value, k| value - rows[k].entries[i - rows[k].first] * x[k]);
            x[i] = value / row.entries[i - row.first];
        }
        Some(x).filter(|x| x.iter().all(|value| value.is_finite()))
    }

    /// Puts Cholesky's factor in the matrix's place.
    fn factorise(&mut self) -> Option<()> {
        for i in 0..self.rows.len() {
            let (done, rest) = self.rows.split_at_mut(i);
            let row = &mut rest[0];
            for j in row.first..i {
                let value = row.reduce(&done[j], j, row.entries[j - row.first]);
                row.entries[j - row.first] = value / done[j].entries[j - done[j].first];
            }
            let pivot = row.reduce(row, i, row.entries[i - row.first]);
            row.entries[i - row.first] = Some(pivot.sqrt()).filter(|root| *root > 0.0)?;
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A path of `nodes`, some of them joined to earlier ones, and a matrix with its full size.
    fn example(nodes: usize) -> (NormalEquations, Vec<Vec<f64>>) {
        let mut equations = NormalEquations::new(nodes);
        let mut full = vec![vec![0.0; 3 * nodes]; 3 * nodes];
        let joined = (1..nodes).map(|node| (node - 1, node)).chain([(5, 1), (2, 7), (0, nodes - 1)]);
        for (at, (a, b)) in joined.enumerate() {
            let lever = Matrix3::new(1.0, 0.1 * at as f64, 0.3, -0.2, 1.5, 0.1, 0.4, 0.0, 2.0);
            for (row, column, block) in [
                (a, a, 2.0 * Matrix3::identity()),
                (b, b, lever.transpose() * lever + Matrix3::identity()),
                (a, b, -lever),
                (b, a, -lever.transpose()),
            ] {
                let block = if row == column { block + 3.0 * Matrix3::identity() } else { block };
                equations.add_block(row, column, &block);
                (0..9).for_each(|k| full[3 * row + k / 3][3 * column + k % 3] += block[(k / 3, k % 3)]);
            }
            equations.subtract_right(b, &Vector3::new(1.0, -2.0, 0.5 * at as f64));
        }
        (equations, full)
    }

    #[test]
    fn solution_fulfils_the_equations() {
        let (equations, full) = example(12);
        let right = equations.right.clone();
        let x = equations.solve().unwrap();
        for (row, right) in full.iter().zip(right) {
            let product: f64 = row.iter().zip(&x).map(|(a, x)| a * x).sum();
            assert!((product - right).abs() < 1e-9, "{product} {right}");
        }
    }

    #[test]
    fn what_is_not_positive_definite_has_no_solution() {
        let (mut equations, _) = example(12);
        equations.add_block(4, 4, &Matrix3::from_diagonal_element(-1e6));
        assert_eq!(equations.solve(), None);
        assert_eq!(NormalEquations::new(2).solve(), None);
    }
}
