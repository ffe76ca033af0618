//! What lrfslam is measured with: trajectories against ground truth, motion models from logs, experiments.
#![forbid(unsafe_code)]

pub mod calibration;
pub mod evaluation;
#[cfg(feature = "experiments")]
pub mod experiment;
#[cfg(feature = "experiments")]
pub mod prove;
