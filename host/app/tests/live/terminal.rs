//! `--tui` on a terminal: what is seen, keys, and that the terminal is as it was afterwards.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::path::Path;
use std::process::Child;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rustix::fs::{Mode, OFlags};
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};

use crate::common::lrfslam;

const ENTERED: &str = "\u{1b}[?1049h";
const LEFT: &str = "\u{1b}[?1049l";

/// The program on a terminal of its own.
struct Shown {
    program: Child,
    keys: File,
    terminal: OwnedFd,
    seen: Arc<Mutex<Vec<u8>>>,
}

impl Shown {
    fn start(folder: &Path, arguments: &[&str]) -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        let open = || rustix::fs::open(&name, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).unwrap();
        let terminal = open();
        let size = Winsize { ws_row: 30, ws_col: 100, ws_xpixel: 0, ws_ypixel: 0 };
        tcsetwinsize(&terminal, size).unwrap();
        let mut command = lrfslam(folder, arguments);
        let program = command.stdin(open()).stdout(open()).stderr(open()).spawn().unwrap();
        let mut screen = File::from(master);
        let keys = screen.try_clone().unwrap();
        let seen = Arc::new(Mutex::new(Vec::new()));
        let heard = seen.clone();
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count) = screen.read(&mut bytes) {
                heard.lock().unwrap().extend_from_slice(&bytes[..count]);
            }
        });
        Self { program, keys, terminal, seen }
    }

    fn text(&self) -> String {
        String::from_utf8_lossy(&self.seen.lock().unwrap()).into_owned()
    }

    fn wait_for(&self, wanted: &str) {
        let since = Instant::now();
        while !screen(&self.text()).contains(wanted) {
            assert!(since.elapsed() < Duration::from_secs(60), "{wanted:?} does not come: {}", screen(&self.text()));
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn press(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).unwrap();
    }

    /// Exit code, and what is on the terminal after the view is left.
    fn end(mut self) -> (Option<i32>, String) {
        let since = Instant::now();
        let code = loop {
            if let Some(status) = self.program.try_wait().unwrap() {
                break status.code();
            }
            assert!(since.elapsed() < Duration::from_secs(120), "it does not end: {:?}", self.text());
            std::thread::sleep(Duration::from_millis(20));
        };
        std::thread::sleep(Duration::from_millis(300));
        let modes = tcgetattr(&self.terminal).unwrap().local_modes;
        assert!(modes.contains(LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG), "{modes:?}");
        let text = self.text();
        assert_eq!((text.matches(ENTERED).count(), text.matches(LEFT).count()), (1, 1), "{text:?}");
        (code, text.split_once(LEFT).expect("it was left").1.to_owned())
    }
}

impl Drop for Shown {
    fn drop(&mut self) {
        let _ = self.program.kill().and_then(|()| self.program.wait());
    }
}

/// The rows that a terminal shows after `text`; of what is alike from one picture to the next nothing is sent again.
fn screen(text: &str) -> String {
    let mut rows = vec![vec![' '; 100]; 30];
    let (mut row, mut column) = (0, 0);
    let mut letters = text.chars();
    while let Some(letter) = letters.next() {
        if letter != '\u{1b}' {
            rows.get_mut(row).and_then(|row| row.get_mut(column)).into_iter().for_each(|cell| *cell = letter);
            column += 1;
            continue;
        }
        let rest = letters.as_str();
        let end = rest.find(|letter: char| letter.is_ascii_alphabetic()).unwrap_or(rest.len());
        let (sequence, _) = rest.split_at(end);
        if rest[end..].starts_with('H')
            && let Some((down, across)) = sequence.trim_start_matches('[').split_once(';')
        {
            (row, column) = (down.parse::<usize>().unwrap() - 1, across.parse::<usize>().unwrap() - 1);
        }
        letters = rest.get(end + 1..).unwrap_or_default().chars();
    }
    rows.iter().map(|row| row.iter().collect::<String>() + "\n").collect()
}

fn log() -> String {
    format!("{}/../../examples/floor.log.gz", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn a_run_is_seen_and_its_keys_do_what_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let log = log();
    let mut shown = Shown::start(folder.path(), &["map", &log, "--out", "seen", "--tui"]);
    shown.wait_for("on the map");
    shown.press("p");
    shown.wait_for("paused");
    shown.press("++f-0s");
    shown.wait_for("results are saved now");
    shown.press("\u{1b}[A\u{1b}[D");
    shown.press("q");
    shown.wait_for("stopping");
    let (code, after) = shown.end();
    assert_eq!(code, Some(130), "{after}");
    assert!(after.contains("results in seen") && after.contains("partial"), "{after:?}");
    assert!(folder.path().join("seen/map.png").exists());
}

#[test]
fn a_whole_run_ends_as_without_the_view() {
    let folder = tempfile::tempdir().unwrap();
    let log = log();
    let shown = Shown::start(folder.path(), &["map", &log, "--scans", "60", "--out", "seen", "--tui"]);
    let (code, after) = shown.end();
    assert_eq!(code, Some(0), "{after}");
    assert!(after.contains("results in seen"), "{after:?}");
}

#[test]
fn the_terminal_is_given_back_when_it_ends_at_once_and_after_a_fault() {
    let folder = tempfile::tempdir().unwrap();
    let log = log();
    let mut shown = Shown::start(folder.path(), &["map", &log, "--out", "twice", "--tui"]);
    shown.wait_for("on the map");
    shown.press("p");
    shown.wait_for("paused");
    shown.press("\u{3}\u{3}");
    assert_eq!(shown.end().0, Some(130));
    let shown = Shown::start(folder.path(), &["map", &log, "--out", "ended", "--tui"]);
    shown.wait_for("on the map");
    let program = Pid::from_child(&shown.program);
    kill_process(program, Signal::TERM).unwrap();
    assert_eq!(shown.end().0, Some(130));
    // Nothing is at the port: it is given up, and said.
    let shown = Shown::start(folder.path(), &["attach", "--port", "no-port", "--lrf", "hokuyo", "--tui"]);
    let (code, after) = shown.end();
    assert!(code == Some(1) && after.contains("lrfslam: no-port") && after.contains("given up"), "{after:?}");
}
