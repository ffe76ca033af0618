//! The Gaussian of EKF-SLAM: robot and landmarks in one state, with its whole covariance (thesis eq. 4.3, 4.14).
//!
//! State: x, y, heading, scale of distances, scale of turns, then x and y of each landmark, m.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::covariance::Symmetric;
use super::sight::{Place, View, inverse};
use super::travel::Travel;
use super::{ROBOT, RobotCovariance, RobotState, wrap_angle};

/// Jacobian of a sighting by x, y, heading of the robot and x, y of the landmark.
pub type SightJacobian = SMatrix<f64, 2, 5>;

/// Mean and covariance over lent memory.
#[derive(Debug)]
pub struct Belief<'m> {
    mean: &'m mut [f64],
    covariance: Symmetric<'m>,
    work: &'m mut [[f64; 4]],
}

impl<'m> Belief<'m> {
    /// A robot at the map's origin, with this covariance, and no landmark; `None` if the memory does not hold a robot.
    pub fn new(
        mean: &'m mut [f64],
        covariance: &'m mut [f64],
        work: &'m mut [[f64; 4]],
        start: &RobotCovariance,
    ) -> Option<Self> {
        let mut belief = Self { mean, covariance: Symmetric::new(covariance), work };
        let is_enough = belief.mean.len() >= ROBOT && belief.work.len() >= ROBOT && belief.covariance.grow(ROBOT);
        belief.set_robot(&RobotState::new(0.0, 0.0, 0.0, 1.0, 1.0));
        belief.set_robot_covariance(start);
        is_enough.then_some(belief)
    }

    /// Landmarks for which there is memory.
    pub fn landmarks_max(&self) -> usize {
        let order = self.mean.len().min(self.work.len()).min(self.covariance.order_max());
        order.saturating_sub(ROBOT) / 2
    }

    /// Landmarks in the state.
    pub fn landmarks(&self) -> usize {
        self.covariance.order().saturating_sub(ROBOT) / 2
    }

    /// The covariance of all.
    pub fn covariance(&self) -> &Symmetric<'m> {
        &self.covariance
    }

    fn at(&self, index: usize) -> f64 {
        self.mean.get(index).copied().unwrap_or(0.0)
    }

    fn put(&mut self, index: usize, value: f64) {
        if let Some(number) = self.mean.get_mut(index) {
            *number = value;
        }
    }

    /// The robot's numbers.
    pub fn robot(&self) -> RobotState {
        RobotState::from_fn(|row, _| self.at(row))
    }

    /// Puts the robot elsewhere.
    pub fn set_robot(&mut self, robot: &RobotState) {
        for (index, value) in robot.iter().enumerate() {
            self.put(index, *value);
        }
    }

    /// Covariance of the robot's numbers.
    pub fn robot_covariance(&self) -> RobotCovariance {
        RobotCovariance::from_fn(|row, column| self.covariance.at(row, column))
    }

    /// Replaces it.
    pub fn set_robot_covariance(&mut self, covariance: &RobotCovariance) {
        for row in 0..ROBOT {
            for column in 0..=row {
                self.covariance.set(row, column, covariance[(row, column)]);
            }
        }
    }

    /// Position of a landmark, m.
    pub fn landmark(&self, landmark: usize) -> Vector2<f64> {
        let first = row_of(landmark);
        Vector2::new(self.at(first), self.at(first + 1))
    }

    /// Its covariance, m².
    pub fn landmark_covariance(&self, landmark: usize) -> Matrix2<f64> {
        let first = row_of(landmark);
        Matrix2::from_fn(|row, column| self.covariance.at(first + row, first + column))
    }

    /// Covariance between what sightings of two landmarks depend on, see [`SightJacobian`].
    fn block(&self, a: usize, b: usize) -> SMatrix<f64, 5, 5> {
        let (rows, columns) = (rows_of(a), rows_of(b));
        let index = |list: [usize; 5], place: usize| list.get(place).copied().unwrap_or(0);
        SMatrix::from_fn(|row, column| self.covariance.at(index(rows, row), index(columns, column)))
    }

    /// Covariance between the expected sightings of two landmarks: Hₐ P H_bᵀ.
    pub fn between(&self, a: usize, by_a: &SightJacobian, b: usize, by_b: &SightJacobian) -> Matrix2<f64> {
        by_a * self.block(a, b) * by_b.transpose()
    }

    /// Prediction (eq. 4.4–4.7): moves the robot. Costs O(landmarks).
    pub fn predict(&mut self, travel: &Travel) {
        let robot = self.robot();
        let (jacobian, noise) = travel.jacobian_and_noise(&robot);
        let own = jacobian * self.robot_covariance() * jacobian.transpose() + noise;
        for row in ROBOT..self.covariance.order() {
            let cross = jacobian * RobotState::from_fn(|column, _| self.covariance.at(row, column));
            for (column, value) in cross.iter().enumerate() {
                self.covariance.set(row, column, *value);
            }
        }
        self.set_robot_covariance(&own);
        self.set_robot(&travel.moved(&robot));
    }

    /// Update by one sighting (eq. 3.22–3.24), in Joseph's form; false, and nothing has changed, if its covariance is not positive.
    ///
    /// (I − KH) P (I − KH)ᵀ + KRKᵀ is P − K Bᵀ − B Kᵀ with B = P Hᵀ − ½ K S: one symmetric product of rank two, O(landmarks²).
    ///
    /// * `noise` — of the sighting; `invariant` — see `turn_with`
    pub fn correct(
        &mut self,
        landmark: usize,
        jacobian: &SightJacobian,
        innovation: Vector2<f64>,
        noise: &Matrix2<f64>,
        invariant: bool,
    ) -> bool {
        let rows = rows_of(landmark);
        let s = self.between(landmark, jacobian, landmark, jacobian) + noise;
        let s = (s + s.transpose()) * 0.5;
        let Some(inverse) = inverse(&s) else { return false };
        let order = self.covariance.order();
        for (row, work) in self.work.iter_mut().enumerate().take(order) {
            let of_row =
                SVector::<f64, 5>::from_iterator(rows.into_iter().map(|column| self.covariance.at(row, column)));
            let a = jacobian * of_row;
            let k = inverse * a;
            let b = a - s * k * 0.5;
            *work = [k.x, k.y, b.x, b.y];
        }
        let Some(used) = self.work.get(..order) else { return false };
        self.covariance.add_symmetric_product(used, -1.0);
        let change = |work: &[f64; 4]| work[0] * innovation.x + work[1] * innovation.y;
        if invariant {
            self.turn_with(change);
        } else {
            for (number, work) in self.mean.iter_mut().zip(used) {
                *number += change(work);
            }
        }
        let heading = wrap_angle(self.at(2));
        self.put(2, heading);
        true
    }

    /// Applies the correction as a motion of the plane, so that what is not observable stays so (Barrau & Bonnabel, arXiv:1510.06263, 2015).
    ///
    /// The right-invariant error of a position is ξ = e − J p̂ e_θ. A correction by ξ turns robot and landmarks about the map's origin. In the
    /// coordinates of the state this adds J (p⁺ − p⁻) e_θ to each position's error, once more a symmetric product of rank two.
    fn turn_with(&mut self, change: impl Fn(&[f64; 4]) -> f64) {
        let order = self.covariance.order();
        let turn = self.work.get(2).map_or(0.0, &change);
        let turn_variance = self.covariance.at(2, 2);
        let (sinc, versine) = exponential(turn);
        let (sin, cos) = libm::sincos(turn);
        for first in (0..order).filter(|row| *row == 0 || (*row >= ROBOT && (row - ROBOT).is_multiple_of(2))) {
            let [dx, dy] = [first, first + 1].map(|row| self.work.get(row).map_or(0.0, &change));
            let (x, y) = (self.at(first), self.at(first + 1));
            let (xi_x, xi_y) = (dx + y * turn, dy - x * turn);
            let moved_x = cos * x - sin * y + sinc * xi_x - versine * xi_y;
            let moved_y = sin * x + cos * y + versine * xi_x + sinc * xi_y;
            self.put(first, moved_x);
            self.put(first + 1, moved_y);
            // g of the symmetric product: J (p⁺ − p⁻).
            self.set_work(first, y - moved_y, turn_variance);
            self.set_work(first + 1, moved_x - x, turn_variance);
        }
        for row in 2..ROBOT {
            let value = self.at(row) + self.work.get(row).map_or(0.0, &change);
            self.put(row, value);
            self.set_work(row, 0.0, turn_variance);
        }
        if let Some(used) = self.work.get(..order) {
            self.covariance.add_symmetric_product(used, 1.0);
        }
    }

    fn set_work(&mut self, row: usize, g: f64, turn_variance: f64) {
        let q = self.covariance.at(row, 2) + 0.5 * turn_variance * g;
        if let Some(work) = self.work.get_mut(row) {
            *work = [g, 0.0, q, 0.0];
        }
    }

    /// Augmentation (eq. 4.13–4.20); false, and nothing has changed, if there is no room. Costs O(landmarks).
    pub fn add(&mut self, place: &Place, noise: &Matrix2<f64>) -> bool {
        let first = self.covariance.order();
        if self.landmarks() >= self.landmarks_max() || !self.covariance.grow(2) {
            return false;
        }
        let pose = self.robot_covariance().fixed_view::<3, 3>(0, 0).into_owned();
        let own = place.by_robot * pose * place.by_robot.transpose()
            + place.by_sighting * noise * place.by_sighting.transpose();
        for row in 0..first {
            let of_row = nalgebra::Vector3::from_fn(|column, _| self.covariance.at(row, column));
            let cross = place.by_robot * of_row;
            self.covariance.set(first, row, cross.x);
            self.covariance.set(first + 1, row, cross.y);
        }
        self.covariance.set(first, first, own.m11);
        self.covariance.set(first + 1, first, 0.5 * (own.m12 + own.m21));
        self.covariance.set(first + 1, first + 1, own.m22);
        self.put(first, place.at.x);
        self.put(first + 1, place.at.y);
        true
    }

    /// Takes a landmark out; the last takes its place. Costs O(landmarks).
    pub fn remove(&mut self, landmark: usize) {
        let Some(last) = self.landmarks().checked_sub(1) else { return };
        let moved = self.landmark(last);
        self.put(row_of(landmark), moved.x);
        self.put(row_of(landmark) + 1, moved.y);
        self.covariance.remove_pair(row_of(landmark));
    }
}

/// The Jacobian of a view by robot and landmark.
pub fn joined(view: &View) -> SightJacobian {
    let mut jacobian = SightJacobian::zeros();
    jacobian.fixed_view_mut::<2, 3>(0, 0).copy_from(&view.by_robot);
    jacobian.fixed_view_mut::<2, 2>(0, 3).copy_from(&view.by_landmark);
    jacobian
}

/// sin(a)/a and (1 − cos a)/a: the exponential of the plane's motions.
fn exponential(angle: f64) -> (f64, f64) {
    if angle.abs() < 1e-6 {
        return (1.0 - angle * angle / 6.0, 0.5 * angle);
    }
    let (sin, cos) = libm::sincos(angle);
    (sin / angle, (1.0 - cos) / angle)
}

/// First row of a landmark in the state.
fn row_of(landmark: usize) -> usize {
    ROBOT + 2 * landmark
}

fn rows_of(landmark: usize) -> [usize; 5] {
    [0, 1, 2, row_of(landmark), row_of(landmark) + 1]
}
