//! `lrfslam demo` of a build without the simulator.

use lrfslam_host::cli::demo::DemoArgs;
use lrfslam_host::cli::{Failure, not_built_in};

/// Says how to get the demonstration.
pub fn run(_: &DemoArgs) -> Result<String, Failure> {
    Err(not_built_in("simulator", "demo"))
}
