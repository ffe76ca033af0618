//! `lrfslam watch`: several robots on one page, and as JSON.

use std::io::{BufRead as _, BufReader};
use std::process::Stdio;
use std::time::Duration;

use crate::browser::Browser;
use crate::common::{lrfslam, run};
use crate::page::{LATER, SOON, TOKEN, Watched, floor};

const BOTH_THERE: &str = "lrfslam.robots().length === 2 && lrfslam.robots().every((robot) => robot.map.tiles.size > 0)";

#[test]
fn two_robots_are_watched_and_commanded_on_one_page() {
    let Some(mut browser) = Browser::start() else { return };
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [mut first, second] = [40, 60].map(|scans| {
        let folder = if scans == 40 { &folders[0] } else { &folders[1] };
        Watched::start(folder.path(), "0", scans, &["--monitor-stay"])
    });
    let page_of_both = Watched::run(folders[0].path(), &["watch", "--at", "0", &first.url(), &second.url()]);
    let page = browser.open(&page_of_both.url(), [1280, 800]);
    browser.wait(&page, BOTH_THERE, LATER);
    browser.wait(&page, "lrfslam.robots().every((robot) => robot.status.ended)", LATER);
    // Side by side, each with its name; nothing joins maps of different frames.
    assert_eq!(browser.value(&page, "lrfslam.views().length"), 2);
    let names = browser
        .value(&page, "[...document.querySelectorAll('figcaption')].map((caption) => caption.textContent).join()");
    for run in [&first, &second] {
        assert!(names.as_str().unwrap().contains(&run.host), "{names}");
    }
    assert_eq!(browser.value(&page, "document.getElementById('one').hidden"), true);
    // Words and numbers are of the one that was touched last.
    let box_of = |k: u32| {
        format!(
            "(() => {{ const b = lrfslam.views()[{k}].canvas.getBoundingClientRect(); return [b.left + b.width / 2, b.top + b.height / 2] }})()"
        )
    };
    for (k, scans) in [(1, 60), (0, 40)] {
        let middle = browser.value(&page, &box_of(k));
        browser.click(&page, [0, 1].map(|axis| middle[axis].as_f64().unwrap()));
        browser.wait(&page, &format!("document.getElementById('numbers').innerText.includes('scans\\n{scans}')"), SOON);
    }
    // Stop is of that one alone.
    browser.click_on(&page, "#stop");
    browser.click_on(&page, "dialog [value=stop]");
    assert_eq!(first.child.wait().unwrap().code(), Some(0));
    browser.wait(&page, "lrfslam.robots()[0].link === 'away' && lrfslam.robots()[1].link === 'there'", SOON);
    drop(second);
    browser.wait(&page, "lrfslam.robots().every((robot) => robot.link === 'away')", SOON);
    assert_eq!(browser.faults, Vec::<String>::new());
}

#[test]
fn robots_in_the_same_map_are_put_on_one() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let log = floor();
    let log = log.to_str().unwrap();
    assert_eq!(run(folder.path(), &["map", log, "--out", "floor", "--scans", "120", "-q"]).0, 0);
    let robots = ["one", "two"].map(|out| {
        let scans = if out == "one" { "30" } else { "90" };
        let more = ["--scans", scans, "--out", out, "--monitor=0", "--monitor-stay"];
        Watched::run(folder.path(), &[&["localize", log, "--map", "floor", "--start", "0,0,0"][..], &more].concat())
    });
    let page_of_both = Watched::run(folder.path(), &["watch", "--at", "0", &robots[0].url(), &robots[1].url()]);
    let page = browser.open(&page_of_both.url(), [1280, 800]);
    browser.wait(&page, BOTH_THERE, LATER);
    browser.wait(&page, "lrfslam.robots().every((robot) => robot.status.ended)", LATER);
    browser.wait(&page, "!document.getElementById('one').hidden", SOON);
    browser.press(&page, "t");
    browser.wait(&page, "lrfslam.views().length === 1 && lrfslam.views()[0].robots.length === 2", SOON);
    browser.wait(&page, "lrfslam.views()[0].frames > 0", SOON);
    // They are metres apart; a click near one chooses it.
    for k in [0, 1] {
        let at = format!(
            "(() => {{ const view = lrfslam.views()[0], b = view.canvas.getBoundingClientRect(), [x, y] = lrfslam.robots()[{k}].status.pose, \
             [px, py] = view.camera.pixel(x, y); return [b.left + px, b.top + py] }})()"
        );
        let place = browser.value(&page, &at);
        browser.click(&page, [0, 1].map(|axis| place[axis].as_f64().unwrap()));
        let scans = if k == 0 { 30 } else { 90 };
        browser.wait(&page, &format!("document.getElementById('numbers').innerText.includes('scans\\n{scans}')"), SOON);
    }
    browser.press(&page, "t");
    browser.wait(&page, "lrfslam.views().length === 2", SOON);
    assert_eq!(browser.faults, Vec::<String>::new());
}

#[test]
fn a_script_reads_how_robots_are() {
    let folder = tempfile::tempdir().unwrap();
    let robot = Watched::start(folder.path(), "0", 20, &["--monitor-stay"]);
    let wrong = format!("http://{}/#wrong", robot.host);
    let mut command = lrfslam(folder.path(), &["watch", "--json", &robot.url(), &wrong, "127.0.0.1:9"]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let (mut is_there, mut is_away) = (false, false);
    while !(is_there && is_away) {
        let line: serde_json::Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
        is_there |= line["robot"] == robot.host && line["status"]["scans"] == 20 && line["status"]["mood"] == "good";
        is_away |= line["robot"] == "127.0.0.1:9" && line["fault"] == "nobody answers";
    }
    // Who reads has gone: so does it.
    drop(lines);
    let begun = std::time::Instant::now();
    while child.try_wait().unwrap().is_none() {
        assert!(begun.elapsed() < SOON, "it goes on for nobody");
        std::thread::sleep(Duration::from_millis(20));
    }
    // The same for any program that speaks HTTP.
    assert_eq!(robot.status("GET /robots/0/status", ""), "200");
    assert_eq!(robot.status("GET /robots/1/status", ""), "404");
    assert_eq!(robot.status("GET /robots/0/status", "Origin: http://evil.example\r\n"), "401");
    assert_eq!(robot.status("GET /robots/0/status", &format!("Authorization: Bearer {TOKEN}\r\n")), "200");
    let (code, _, stderr) = run(folder.path(), &["watch", "--json", "--at", "0", "127.0.0.1:9"]);
    assert!(code == 2 && stderr.contains("cannot be used with"), "{stderr}");
}
