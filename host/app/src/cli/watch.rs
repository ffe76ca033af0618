//! `lrfslam watch`: several robots on one page, or in one stream of JSON.

use std::io::{Write as _, stdout};
use std::net::SocketAddr;
use std::sync::Arc;
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
use super::zenoh::{self, Place, parse_place};

/// Watch several robots on one page, until ctrl-C: side by side, and on one map where they localize in, or continue, the same one.
///
/// With --json there is no page: each second a line of JSON for each robot, with how things stand there or why that is not known.
#[derive(Debug, Args)]
pub(super) struct WatchArgs {
    /// Links that `--monitor` has printed, with their tokens; or zenoh:HOST[:PORT] of a router or zenoh:listen:IP[:PORT], for all robots there.
    #[arg(required = true, value_name = "LINK", value_parser = parse_link)]
    links: Vec<Link>,
    /// Where this page is served, as with --monitor.
    #[arg(long, value_name = "ADDR", default_value_t = LOOPBACK, value_parser = parse_address, conflicts_with = "json")]
    at: SocketAddr,
    #[command(flatten)]
    tell: TellArgs,
}

/// Where robots are watched.
#[derive(Debug, Clone)]
enum Link {
    /// The page of one.
    Page(Remote),
    /// As many as there are.
    Zenoh(Place),
}

fn parse_link(text: &str) -> Result<Link, String> {
    match text.strip_prefix("zenoh:") {
        Some(place) => parse_place(place).map(Link::Zenoh),
        None => Remote::parse(text).map(Link::Page),
    }
}

/// How soon ctrl-C is noticed.
const NOTICED_AFTER: Duration = Duration::from_millis(50);
/// From one line of a robot to the next.
const LINE_EVERY: Duration = Duration::from_secs(1);

impl WatchArgs {
    fn pages(&self) -> Vec<Remote> {
        let page = |link: &Link| match link {
            Link::Page(page) => Some(page.clone()),
            Link::Zenoh(_) => None,
        };
        self.links.iter().filter_map(page).collect()
    }

    fn places(&self) -> Vec<&Place> {
        let mut places = Vec::new();
        for link in &self.links {
            if let Link::Zenoh(place) = link {
                places.push(place);
            }
        }
        places
    }
}

pub(super) fn run(args: &WatchArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    let (pages, places) = (args.pages(), args.places());
    if args.tell.is_json() {
        return print_lines(&pages, &places, stop);
    }
    let server = Arc::new(serve_all(args.at, pages.into_iter().map(Robot::there).collect(), args.tell)?);
    for place in places {
        server.let_grow();
        let (server, tell) = (server.clone(), args.tell);
        zenoh::for_each_robot(place, move |robot: Remote| {
            tell.say(&format!("in Zenoh: {}", robot.host()));
            server.add(Robot::there(robot));
        })?;
    }
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(NOTICED_AFTER);
    }
    Ok(())
}

/// Prints what the robots tell, as it comes.
fn print_lines(pages: &[Remote], places: &[&Place], stop: &AtomicBool) -> Result<(), Failure> {
    let (tell, told) = channel();
    let begin = move |robot: Remote| {
        let tell = tell.clone();
        std::thread::spawn(move || follow(&robot, &tell));
    };
    pages.iter().cloned().for_each(&begin);
    for place in places {
        zenoh::for_each_robot(place, begin.clone())?;
    }
    while !stop.load(Ordering::Relaxed) {
        match told.recv_timeout(NOTICED_AFTER) {
            // Who reads has gone.
            Ok(line) if stdout().write_all(line.as_bytes()).is_err() => return Ok(()),
            Ok(_) => {}
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
    }
    Ok(())
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
