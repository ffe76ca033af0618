//! `lrfslam watch`: several robots on one page, or in one stream of JSON.

use std::io::{Write as _, stdout};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use clap::Args;
use lrfslam_monitor::{LOOPBACK, Remote, Robot};
use serde_json::json;

use super::Failure;
use super::laser::interrupt_flag;
use super::live_page::{parse_address, serve_all};
use super::shared::TellArgs;

/// Watch several robots on one page, until ctrl-C: side by side, and on one map where they localize in, or continue, the same one.
///
/// With --json there is no page: each second a line of JSON for each robot, with how things stand there or why that is not known.
#[derive(Debug, Args)]
pub(super) struct WatchArgs {
    /// Links that `--monitor` has printed, with their tokens.
    #[arg(required = true, value_name = "LINK", value_parser = Remote::parse)]
    links: Vec<Remote>,
    /// Where this page is served, as with --monitor.
    #[arg(long, value_name = "ADDR", default_value_t = LOOPBACK, value_parser = parse_address, conflicts_with = "json")]
    at: SocketAddr,
    #[command(flatten)]
    tell: TellArgs,
}

/// How soon ctrl-C is noticed.
const NOTICED_AFTER: Duration = Duration::from_millis(50);
/// From one line of a robot to the next.
const LINE_EVERY: Duration = Duration::from_secs(1);

pub(super) fn run(args: &WatchArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    if args.tell.is_json() {
        print_lines(&args.links, stop);
        return Ok(());
    }
    serve_all(args.at, args.links.iter().cloned().map(Robot::there).collect(), args.tell)?;
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(NOTICED_AFTER);
    }
    Ok(())
}

/// Prints what the robots tell, as it comes.
fn print_lines(links: &[Remote], stop: &AtomicBool) {
    let (tell, told) = channel();
    for link in links {
        let (link, tell) = (link.clone(), tell.clone());
        std::thread::spawn(move || follow(&link, &tell));
    }
    while !stop.load(Ordering::Relaxed) {
        match told.recv_timeout(NOTICED_AFTER) {
            // Who reads has gone.
            Ok(line) if stdout().write_all(line.as_bytes()).is_err() => return,
            Ok(_) => {}
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

/// Asks a robot for ever; one that is away does not hold up the others.
fn follow(link: &Remote, tell: &Sender<String>) {
    loop {
        let line = match link.status() {
            Ok(status) => json!({ "robot": link.host(), "status": status }),
            Err(why) => json!({ "robot": link.host(), "fault": why.to_string() }),
        };
        if tell.send(format!("{line}\n")).is_err() {
            return;
        }
        std::thread::sleep(LINE_EVERY);
    }
}
