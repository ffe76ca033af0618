use std::fs::File;
use std::io::Read as _;
use std::process::Command;

use lrfslam_host::monitor::About;
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, tcgetattr};

use super::*;

/// Set for the program that panics: this test, once more.
const PANICS: &str = "LRFSLAM_TEST_PANICS";

#[test]
fn the_terminal_is_given_back_after_a_panic() {
    static STOP: AtomicBool = AtomicBool::new(false);
    if std::env::var_os(PANICS).is_some() {
        let (monitor, _feed) = Monitor::start(About::default(), &STOP).unwrap();
        let _screen = Screen::open(&monitor).unwrap();
        held::say("said meanwhile");
        panic!("on purpose");
    }
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap();
    let open = || rustix::fs::open(&name, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).unwrap();
    let terminal = open();
    let before = tcgetattr(&terminal).unwrap().local_modes;
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "tui::tests::the_terminal_is_given_back_after_a_panic", "--nocapture"]);
    let mut program = command.env(PANICS, "1").stdin(open()).stdout(open()).stderr(open()).spawn().unwrap();
    drop(command);
    let reader = std::thread::spawn(move || {
        let (mut seen, mut bytes) = (Vec::new(), [0; 4096]);
        let mut screen = File::from(master);
        // Linux has an error at the end, when nobody has the terminal open.
        while let Ok(count @ 1..) = screen.read(&mut bytes) {
            seen.extend_from_slice(&bytes[..count]);
        }
        String::from_utf8_lossy(&seen).into_owned()
    });
    assert!(!program.wait().unwrap().success());
    let after = tcgetattr(&terminal).unwrap().local_modes;
    drop(terminal);
    let seen = reader.join().unwrap();
    assert!(after == before && after.contains(LocalModes::ICANON | LocalModes::ECHO), "{after:?}");
    assert!(seen.contains("\u{1b}[?1049h"), "{seen:?}");
    let (_, last) = seen.split_once("\u{1b}[?1049l").expect("the screen is left");
    assert!(
        last.contains("said meanwhile") && last.contains("on purpose") && !last.contains("\u{1b}[?1049"),
        "{last:?}"
    );
}
