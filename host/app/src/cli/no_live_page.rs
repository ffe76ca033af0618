//! `--monitor` of a build without the live page.

use std::net::SocketAddr;

use lrfslam_host::monitor::Monitor;

use super::shared::TellArgs;
use super::{Failure, not_built_in};

/// Some address: it is not served.
pub(super) fn parse_address(_: &str) -> Result<SocketAddr, String> {
    Ok(SocketAddr::from(([127, 0, 0, 1], 0)))
}

/// Says how to get it.
pub(super) fn serve(_: SocketAddr, _: (&str, Monitor), _: TellArgs) -> Result<(), Failure> {
    Err(not_built_in("live page", "monitor"))
}
