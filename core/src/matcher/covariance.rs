//! How far a match may be off.

use nalgebra::Matrix3;

use crate::ndt::{Linearisation, Scatter};

/// Variance of what nothing is known about; m², rad².
pub(super) const NOTHING_KNOWN: f32 = 1e4;

/// Covariance of a match from the score's derivatives there: H⁻¹ B H⁻¹, H the score's curvature, B the scatter of its gradient.
///
/// H⁻¹ alone, as is usual, takes every point for an independent witness with the width of its cell. That width is mostly `noise_m` and says
/// nothing of how far points really are from their cells' means; B does. As there are few runs and a pose fitted to them, B is raised by
/// (runs / (runs − 3))². A gradient that is left at the pose, by a search that stopped early or a pull towards the prediction, is an error
/// too and is added as one.
///
/// Source: Huber 1967 (H⁻¹ B H⁻¹); Bell & McCaffrey 2002 (few clusters, their jackknife taken at an even leverage of 3 / runs).
pub(super) fn covariance(at: &Linearisation, scatter: &Scatter) -> Matrix3<f32> {
    let guard = Matrix3::from_diagonal_element(1.0 / NOTHING_KNOWN);
    let curvature = at.hessian + guard;
    let curvature = if curvature.cholesky().is_some() { curvature } else { at.information + guard };
    let few = scatter.runs / (scatter.runs - 3.0).max(1.0);
    let gradient = scatter.gradient * (few * few) + at.gradient * at.gradient.transpose() + guard;
    let inverse = curvature.try_inverse().unwrap_or_else(|| Matrix3::from_diagonal_element(NOTHING_KNOWN));
    inverse * gradient * inverse
}
