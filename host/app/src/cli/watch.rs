//! `lrfslam watch`: several robots on one page.

use std::net::SocketAddr;
use std::sync::atomic::Ordering;
use std::time::Duration;

use clap::Args;
use lrfslam_monitor::{LOOPBACK, Remote, Robot};

use super::Failure;
use super::laser::interrupt_flag;
use super::live_page::{parse_address, serve_all};
use super::shared::TellArgs;

/// Watch several robots on one page, until ctrl-C: side by side, and on one map where they localize in, or continue, the same one.
#[derive(Debug, Args)]
pub(super) struct WatchArgs {
    /// Links that `--monitor` has printed, with their tokens.
    #[arg(required = true, value_name = "LINK", value_parser = Remote::parse)]
    links: Vec<Remote>,
    /// Where this page is served, as with --monitor.
    #[arg(long, value_name = "ADDR", default_value_t = LOOPBACK, value_parser = parse_address)]
    at: SocketAddr,
    #[command(flatten)]
    tell: TellArgs,
}

/// How soon ctrl-C is noticed.
const NOTICED_AFTER: Duration = Duration::from_millis(50);

pub(super) fn run(args: &WatchArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    serve_all(args.at, args.links.iter().cloned().map(Robot::there).collect(), args.tell)?;
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(NOTICED_AFTER);
    }
    Ok(())
}
