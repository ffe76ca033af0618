//! `--zenoh`, and `watch zenoh:PLACE`: robots in Zenoh.

use std::sync::OnceLock;

use anyhow::Context as _;
use lrfslam_host::monitor::Monitor;
use lrfslam_monitor::{Fleet, Remote};

use super::Failure;

pub(super) use lrfslam_monitor::Place;

/// As `--zenoh` has it.
pub(super) fn parse_place(text: &str) -> Result<Place, String> {
    Place::parse(text)
}

/// Tells of a run in Zenoh, until the process ends.
pub(super) fn tell(place: &Place, name: &str, monitor: &Monitor) -> Result<(), Failure> {
    let told = join(place).and_then(|fleet| fleet.tell(name, monitor.clone()).context("--zenoh"));
    told.map_err(Failure::Start)
}

/// Calls `found` with each robot at a place, until the process ends.
pub(super) fn for_each_robot(place: &Place, found: impl Fn(Remote) + Send + Sync + 'static) -> Result<(), Failure> {
    let looked = join(place).and_then(|fleet| fleet.for_each_robot(found).context("zenoh"));
    looked.map_err(Failure::Start)
}

/// Places that were joined are left when the process ends.
fn join(place: &Place) -> anyhow::Result<Fleet> {
    static JOINED: OnceLock<std::sync::Mutex<Vec<Fleet>>> = OnceLock::new();
    let fleet = Fleet::join(place).with_context(|| format!("zenoh:{}: cannot be joined", place.address()))?;
    let joined = JOINED.get_or_init(Default::default);
    joined.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(fleet.clone());
    Ok(fleet)
}
