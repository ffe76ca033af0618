//! Two sessions in one process, over the loopback.

use std::net::TcpListener;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Instant;

use axum::http::{Method, StatusCode};
use lrfslam_host::monitor::About;

use super::told::known;
use super::*;

static STOP: AtomicBool = AtomicBool::new(false);
const SOON: Duration = Duration::from_secs(20);

fn places() -> [Place; 2] {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    [format!("listen:127.0.0.1:{port}"), format!("127.0.0.1:{port}")].map(|text| Place::parse(&text).unwrap())
}

fn monitor(what: &str) -> Monitor {
    Monitor::start(About { what: what.to_owned(), ..About::default() }, &STOP).unwrap().0
}

fn ask(robot: &Remote, method: Method, path: &str) -> Option<(StatusCode, Vec<u8>)> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
    runtime.block_on(robot.ask(method, path)).map(|(status, bytes)| (status, bytes.to_vec()))
}

#[test]
fn a_place_is_a_router_or_an_address_to_listen_at() {
    let read = |text: &str| Place::parse(text).map(|place| (place.address().to_owned(), place.listens));
    assert_eq!(read("router"), Ok(("router:7447".to_owned(), false)));
    assert_eq!(read("10.0.0.7:7000"), Ok(("10.0.0.7:7000".to_owned(), false)));
    assert_eq!(read("[::1]"), Ok(("[::1]:7447".to_owned(), false)));
    assert_eq!(read("listen:0.0.0.0"), Ok(("0.0.0.0:7447".to_owned(), true)));
    for wrong in ["", "listen:", ":7447", "a b", "router:port", "::1", "a\"]", "tcp/router", "router:70000"] {
        assert!(read(wrong).is_err(), "{wrong}");
    }
    for name in ["", "a/b", "**", "a b", "a?b", &"x".repeat(65)] {
        assert!(!is_name(name), "{name}");
    }
    assert!(is_name("robot-7.left_2"));
    assert_eq!((known(""), known("7-9"), known("7"), known("a-b")), (Some((0, 0)), Some((7, 9)), None, None));
}

#[test]
fn a_robot_in_zenoh_is_found_and_says_what_its_page_does() {
    let [listen, connect] = places();
    let watcher = Fleet::join(&listen).unwrap();
    let (tell, found) = channel();
    watcher.for_each_robot(move |robot| tell.send(robot).unwrap()).unwrap();
    let (fleet, monitor) = (Fleet::join(&connect).unwrap(), monitor("a test"));
    fleet.tell("r2", monitor.clone()).unwrap();
    let robot = found.recv_timeout(SOON).unwrap();
    assert_eq!(robot.host(), "r2");
    assert_eq!(robot.status().unwrap()["what"], "a test");
    let (status, all) = ask(&robot, Method::GET, "/robots/0/changes?0-0").unwrap();
    let begun = Instant::now();
    assert!(status == StatusCode::OK && all == monitor.changes(0, 0), "{} bytes", all.len());
    // Who has all there is waits for more, as at the page.
    let newest = format!("/robots/0/changes?{}-{}", monitor.instance(), monitor.revision());
    assert!(ask(&robot, Method::GET, &newest).is_some() && begun.elapsed() < SOON);
    // Nobody commands, and nobody asks for what there is not.
    assert_eq!(ask(&robot, Method::POST, "/robots/0/stop").unwrap().0, StatusCode::FORBIDDEN);
    assert!(ask(&robot, Method::GET, "/robots/0/changes?of-all").is_none());
    // One name, one robot.
    let other = Fleet::join(&connect).unwrap();
    assert!(other.tell("a/b", monitor.clone()).is_err());
    let taken = watcher.tell("r2", monitor.clone()).unwrap_err().to_string();
    assert!(taken.contains("r2 already"), "{taken}");
    assert_eq!(found.recv_timeout(Duration::from_millis(300)).err(), Some(RecvTimeoutError::Timeout));
}

#[test]
fn what_is_no_robot_or_no_state_is_left_out() {
    let [listen, connect] = places();
    let watcher = Fleet::join(&listen).unwrap();
    let (tell, found) = channel();
    watcher.for_each_robot(move |robot| tell.send(robot).unwrap()).unwrap();
    let stranger = Fleet::join(&connect).unwrap().session;
    let mut tokens = Vec::new();
    for name in (0..ROBOTS_MAX + 8).map(|number| format!("robot{number}")).chain(["x".repeat(65)]) {
        tokens.push(stranger.liveliness().declare_token(format!("{ROOT}/{name}")).wait().unwrap());
    }
    let large = vec![0_u8; crate::remote::STATE_BYTES_MAX + 1];
    let answer = move |query: zenoh::query::Query| {
        query.reply(query.key_expr(), &large[..]).wait().unwrap();
    };
    stranger.declare_queryable(format!("{ROOT}/robot0/changes")).callback(answer).background().wait().unwrap();
    let talk = |query: zenoh::query::Query| {
        query.reply(query.key_expr(), "no JSON").wait().unwrap();
    };
    stranger.declare_queryable(format!("{ROOT}/robot0/status")).callback(talk).background().wait().unwrap();
    let mut robots: Vec<Remote> = Vec::new();
    while let Ok(robot) = found.recv_timeout(if robots.len() < ROBOTS_MAX { SOON } else { Duration::from_millis(500) })
    {
        robots.push(robot);
    }
    assert_eq!(robots.len(), ROBOTS_MAX);
    let robot = robots.iter().find(|robot| robot.host() == "robot0").unwrap();
    assert!(robot.status().is_err());
    assert!(ask(robot, Method::GET, "/robots/0/changes?0-0").is_none());
}
