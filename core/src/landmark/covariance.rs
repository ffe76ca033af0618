//! A symmetric matrix kept as its lower triangle: it cannot become unsymmetric, and needs half the memory.

/// Symmetric matrix over lent memory: row i has i + 1 numbers, one row after the other.
#[derive(Debug)]
pub struct Symmetric<'m> {
    packed: &'m mut [f64],
    order: usize,
}

/// Numbers that a matrix of `order` needs.
pub const fn packed_len(order: usize) -> usize {
    order * (order + 1) / 2
}

impl<'m> Symmetric<'m> {
    /// The matrix of order 0.
    pub fn new(packed: &'m mut [f64]) -> Self {
        Self { packed, order: 0 }
    }

    /// Rows and columns.
    pub fn order(&self) -> usize {
        self.order
    }

    /// Rows and columns for which there is memory.
    pub fn order_max(&self) -> usize {
        let mut order = 0;
        while packed_len(order + 1) <= self.packed.len() {
            order += 1;
        }
        order
    }

    /// Row `row` up to the diagonal; empty if there is none.
    pub fn row(&self, row: usize) -> &[f64] {
        let start = packed_len(row);
        self.packed.get(start..start + row + 1).unwrap_or(&[])
    }

    fn row_mut(&mut self, row: usize) -> &mut [f64] {
        let start = packed_len(row);
        self.packed.get_mut(start..start + row + 1).unwrap_or(&mut [])
    }

    /// Element; 0 outside.
    pub fn at(&self, row: usize, column: usize) -> f64 {
        let (low, high) = if row < column { (row, column) } else { (column, row) };
        self.row(high).get(low).copied().unwrap_or(0.0)
    }

    /// Changes an element and its mirror image; outside nothing happens.
    pub fn set(&mut self, row: usize, column: usize, value: f64) {
        let (low, high) = if row < column { (row, column) } else { (column, row) };
        if let Some(element) = self.row_mut(high).get_mut(low) {
            *element = value;
        }
    }

    /// Adds `added` rows of zeros; false, and nothing has changed, if there is no memory.
    pub fn grow(&mut self, added: usize) -> bool {
        let order = self.order + added;
        let Some(rows) = self.packed.get_mut(packed_len(self.order)..packed_len(order)) else { return false };
        rows.fill(0.0);
        self.order = order;
        true
    }

    /// Takes out the rows `first` and `first + 1`; the last two take their place. Costs O(order).
    pub fn remove_pair(&mut self, first: usize) {
        let last = self.order.saturating_sub(2);
        if first < last {
            for other in 0..last {
                if other == first || other == first + 1 {
                    continue;
                }
                self.set(first, other, self.at(last, other));
                self.set(first + 1, other, self.at(last + 1, other));
            }
            self.set(first, first, self.at(last, last));
            self.set(first + 1, first, self.at(last + 1, last));
            self.set(first + 1, first + 1, self.at(last + 1, last + 1));
        }
        self.order = last;
    }

    /// Adds `sign` · (u vᵀ + v uᵀ), where u and v have two columns each: `work` has a row (u₀, u₁, v₀, v₁) for each row.
    ///
    /// The only change that costs O(order²): 4 products for each element of the triangle.
    pub fn add_symmetric_product(&mut self, work: &[[f64; 4]], sign: f64) {
        for (row, of_row) in work.iter().enumerate().take(self.order) {
            let [u0, u1, v0, v1] = of_row.map(|number| sign * number);
            for (element, [a, b, c, d]) in self.row_mut(row).iter_mut().zip(work) {
                *element += u0 * c + u1 * d + v0 * a + v1 * b;
            }
        }
    }

    /// True if the matrix, a little raised, has a Cholesky factor, which takes the place of its elements: for tests and diagnosis, O(order³).
    ///
    /// * `raise` — what is added to the diagonal first, as a share of it
    pub fn is_positive(&mut self, raise: f64) -> bool {
        for row in 0..self.order {
            for column in 0..=row {
                let before: f64 = self.row(row).iter().zip(self.row(column)).take(column).map(|(a, b)| a * b).sum();
                let element = self.at(row, column) * if row == column { 1.0 + raise } else { 1.0 } - before;
                let value = match row == column {
                    true if element < 0.0 || element.is_nan() => return false,
                    true => libm::sqrt(element),
                    false if self.at(column, column) > 0.0 => element / self.at(column, column),
                    false => 0.0,
                };
                self.set(row, column, value);
            }
        }
        true
    }
}
