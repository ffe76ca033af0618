//! `--zenoh`, and `watch zenoh:PLACE`, of a build without Zenoh.

use lrfslam_host::monitor::Monitor;

use super::{Failure, how_to_build_in};

/// There is none.
#[derive(Debug, Clone)]
pub(super) enum Place {}

/// Says how to get it.
pub(super) fn parse_place(_: &str) -> Result<Place, String> {
    Err(how_to_build_in("Zenoh", "zenoh"))
}

pub(super) fn tell(place: &Place, _: &str, _: &Monitor) -> Result<(), Failure> {
    match *place {}
}

#[cfg(feature = "monitor")]
pub(super) fn for_each_robot(
    place: &Place,
    _: impl Fn(lrfslam_monitor::Remote) + Send + Sync + 'static,
) -> Result<(), Failure> {
    match *place {}
}
