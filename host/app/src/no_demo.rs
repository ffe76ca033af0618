//! `lrfslam demo` of a build without the simulator.

use crate::cli::demo::DemoArgs;
use crate::cli::{Failure, not_built_in};

/// Says how to get the demonstration.
pub fn run(_: &DemoArgs) -> Result<String, Failure> {
    Err(not_built_in("simulator", "demo"))
}
