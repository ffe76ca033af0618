//! `lrfslam run`, `replay` and `lrf` with lasers that are simulated, and with what is none.

use std::fs;
use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::common::{lrfslam, run};
use lrfslam_core::scan::Echo;
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::pty;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::VirtualLrf;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_firmware_sim::virtual_lrf::sick::{SickModel, VirtualSick};
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::scans::link::Address;
use lrfslam_host::scans::log::{LogOptions, LogScan};

/// A laser at a pseudo-terminal, until dropped.
pub struct Laser {
    stop: Arc<AtomicBool>,
    threads: Vec<std::thread::JoinHandle<()>>,
    link: PathBuf,
}

impl Laser {
    fn new(folder: &Path, mut device: Box<dyn VirtualLrf>) -> Self {
        let (stop, link) = (Arc::new(AtomicBool::new(false)), folder.join("laser"));
        let (flag, name) = (stop.clone(), link.clone());
        let served = std::thread::spawn(move || {
            let plan = FaultPlan::default();
            pty::serve(device.as_mut(), &name, plan, 1, &mut pty::wall_clock(), &flag).expect("a pseudo-terminal");
        });
        while !link.exists() {
            std::thread::sleep(Duration::from_millis(10));
        }
        Self { stop, threads: vec![served], link }
    }

    pub fn hokuyo(folder: &Path) -> Self {
        Self::on_the_floor(folder, HokuyoModel::urg_04lx_ug01())
    }

    /// One that sees the corridor's end: with a shorter view the way along it is a guess.
    pub fn far_sighted(folder: &Path) -> Self {
        Self::on_the_floor(folder, HokuyoModel::utm_30lx())
    }

    fn on_the_floor(folder: &Path, model: HokuyoModel) -> Self {
        let scene = Scenario::load("floor").expect("comes with the program").scene();
        Self::new(folder, Box::new(VirtualHokuyo::new(model, Box::new(scene), 1)))
    }

    fn sick(folder: &Path, baud: u32) -> Self {
        let scene = Scenario::load("room").expect("comes with the program").scene();
        let mut device = VirtualSick::new(SickModel::lms200(), Box::new(scene), 1);
        device.set_baud(baud);
        Self::new(folder, Box::new(device))
    }

    pub fn port(&self) -> String {
        self.link.display().to_string()
    }

    /// The same laser behind a TCP port, one client after the other; as for `--port`.
    fn over_tcp(&mut self) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let address = listener.local_addr().unwrap();
        let (serial, stop) = (Address::Serial(self.port()), self.stop.clone());
        self.threads.push(std::thread::spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                match listener.accept() {
                    Ok((client, _)) => bridge(client, &serial, &stop),
                    Err(_) => std::thread::sleep(Duration::from_millis(10)),
                }
            }
        }));
        format!("tcp:{address}")
    }
}

/// Carries bytes until the client goes.
fn bridge(mut client: std::net::TcpStream, serial: &Address, stop: &AtomicBool) {
    let mut laser = serial.open().expect("the laser's port");
    let mut buffer = [0; 4096];
    client.set_nonblocking(false).unwrap();
    client.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
    while !stop.load(Ordering::Relaxed) {
        match client.read(&mut buffer) {
            Ok(0) => return,
            Ok(count) => laser.send(&buffer[..count]).expect("the laser is there"),
            Err(_) => {}
        }
        let count = laser.receive(&mut buffer, Duration::from_millis(1)).expect("the laser is there");
        if client.write_all(&buffer[..count]).is_err() {
            return;
        }
    }
}

impl Drop for Laser {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.threads.drain(..).for_each(|thread| thread.join().expect("no panic"));
    }
}

fn temporary() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn partial(folder: &Path) -> bool {
    let report: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("run.json")).unwrap()).unwrap();
    report["partial"].as_bool().unwrap()
}

/// `doctor` tells to set it where a laser's "nothing seen" reads as a wall.
#[test]
fn a_laser_and_its_recording_are_limited_by_log_range_max_m() {
    let folder = temporary();
    let laser = Laser::hokuyo(folder.path());
    let near = ["--scans", "30", "-q", "--set", "log.range_max_m=2"];
    let done = |arguments: &[&str], more: &[&str]| {
        let (code, _, stderr) = run(folder.path(), &[arguments, more].concat());
        assert_eq!((code, stderr.as_str()), (0, ""), "{arguments:?}");
    };
    done(&["run", "--lrf", "hokuyo", "--port", &laser.port(), "--out", "near"], &near);
    done(&["replay", "near", "--fast", "--out", "again"], &near);
    done(&["map", "near/laser.rec", "--out", "mapped"], &near);
    done(&["map", "near/laser.rec", "--out", "far"], &near[..3]);
    let path = |name: &str| fs::read(folder.path().join(name).join("trajectory.tum")).unwrap();
    assert_eq!([path("again"), path("mapped")], [path("near"), path("near")]);
    assert_ne!(path("far"), path("near"));

    let recording = folder.path().join("near/laser.rec");
    let read = |range_max_m| read_scans(&recording, LogOptions { range_max_m, ..LogOptions::default() }).unwrap();
    let farther = |scan: &LogScan| {
        scan.beams.iter().filter(|beam| matches!(beam.echo, Echo::Hit(range_m) if range_m >= 2.0)).count()
    };
    let (far, near) = (read(None), read(Some(2.0)));
    assert!(far[0].range_max_m > 2.0 && farther(&far[0]) > 0);
    for (far, near) in far.iter().zip(&near) {
        let misses = |scan: &LogScan| scan.beams.iter().filter(|beam| beam.echo == Echo::Miss).count();
        assert_eq!((near.range_max_m, farther(near)), (2.0, 0));
        assert_eq!(misses(near), misses(far) + farther(far));
    }
}

#[test]
fn a_run_is_recorded_and_replays_to_the_same_bytes() {
    let folder = temporary();
    let laser = Laser::hokuyo(folder.path());
    let arguments = ["run", "--lrf", "auto", "--port", &laser.port(), "--out", "map", "--scans", "30"];
    let (code, stdout, stderr) = run(folder.path(), &arguments);
    assert_eq!(code, 0, "{stderr}");
    assert!(stdout.contains("results in map"), "{stdout}");
    let found = stderr.lines().find(|line| line.starts_with("found a Hokuyo URG-04LX-UG01")).expect(&stderr);
    assert!(found.ends_with("; the same without searching: --lrf hokuyo"), "{found}");

    let replay = ["replay", "map", "--fast", "--scans", "30", "--out"];
    let (code, _, stderr) = run(folder.path(), &[&replay[..], &["again"]].concat());
    assert_eq!(code, 0, "{stderr}");
    let path = |name: &str| fs::read(folder.path().join(name).join("trajectory.tum")).unwrap();
    assert!(path("map").split(|byte| *byte == b'\n').count() >= 30);
    assert_eq!(path("map"), path("again"));
    for (of, out) in [("map/laser.rec", "mapped"), ("map", "from-folder")] {
        let (code, _, stderr) = run(folder.path(), &["map", of, "--scans", "30", "--out", out, "-q"]);
        assert_eq!((code, stderr.as_str()), (0, ""));
        assert_eq!(path(out), path("map"), "`map` maps a recording as `replay` does");
    }
    // Into the folder of the recording itself, which stays.
    let recording = fs::read(folder.path().join("map/laser.rec")).unwrap();
    let over = ["map", "map", "--out", "map", "--overwrite", "--scans", "20", "-q"];
    assert_eq!(run(folder.path(), &over).0, 0);
    assert!(fs::read(folder.path().join("map/laser.rec")).unwrap() == recording && path("map") != path("again"));

    // One that is there is kept.
    let kept = [&arguments[..6], &["other", "--record", "map/laser.rec"]].concat();
    let (code, _, stderr) = run(folder.path(), &kept);
    assert!(code == 2 && stderr.contains("map/laser.rec: is there already"), "{stderr}");
    assert_eq!(fs::read(folder.path().join("map/laser.rec")).unwrap(), recording);

    damaged_and_cut(folder.path(), &recording);
}

/// Replays of `recording`: cut, with a flipped bit, and damaged in the middle.
fn damaged_and_cut(folder: &Path, recording: &[u8]) {
    let (mut flipped, mut damaged) = (recording.to_vec(), recording.to_vec());
    flipped[recording.len() / 2] ^= 1;
    damaged[recording.len() / 2..][..40].fill(0xA5);
    let cut = &recording[..recording.len() * 3 / 4];
    for (name, bytes, code, words) in [
        ("cut", cut, 1, "ends in the middle (was the program killed, or the file cut?)"),
        ("flipped", &flipped, 0, "the recording had 1 flipped bit, which was mended"),
        ("damaged", &damaged, 1, "damaged.rec: the recording is damaged in 1 place, the first at byte"),
    ] {
        fs::write(folder.join(format!("{name}.rec")), bytes).unwrap();
        let (ended, stdout, stderr) = run(folder, &["replay", &format!("{name}.rec"), "--fast", "--out", name]);
        assert_eq!((ended, partial(&folder.join(name))), (code, code == 1), "{name}: {stderr}");
        assert!(stderr.contains(words), "{stderr}");
        assert!(stdout.contains(" scans in "), "what came before is used: {stdout}");
    }
}

#[test]
fn a_laser_is_looked_at() {
    let folder = temporary();
    let laser = Laser::sick(folder.path(), 19_200);
    let port = laser.port();
    let (code, stdout, stderr) = run(folder.path(), &["lrf", "info", "--lrf", "sick-lms2xx", "--port", &port]);
    assert!(code == 0 && stdout.contains("model") && stdout.contains("LMS"), "{stdout}{stderr}");
    let (code, stdout, stderr) = run(folder.path(), &["lrf", "scan", "--lrf", "auto", "--port", &port]);
    // Half a degree; on a slow line the driver asks for whole scans, of two turns of the mirror.
    assert!(code == 0 && stdout.starts_with("361 beams: "), "{stdout}{stderr}");
    assert!(
        stderr.contains("found a SICK LMS200 at 38400 baud; the same without searching: --lrf sick-lms2xx"),
        "{stderr}"
    );
}

#[test]
fn a_laser_of_another_family_is_named() {
    let folder = temporary();
    let laser = Laser::sick(folder.path(), 9600);
    let (code, _, stderr) = run(folder.path(), &["lrf", "info", "--lrf", "hokuyo", "--port", &laser.port()]);
    let words = "no Hokuyo answers, but a SICK LMS2xx does at 9600 baud: try --lrf sick-lms2xx\n";
    assert!(code == 1 && stderr.ends_with(words), "{code}: {stderr}");
}

#[test]
fn a_hokuyo_is_mapped_over_tcp() {
    let folder = temporary();
    let mut laser = Laser::hokuyo(folder.path());
    let port = laser.over_tcp();
    let arguments = ["run", "--lrf", "hokuyo", "--port", &port, "--scans", "5", "--no-record", "-q", "--out", "map"];
    let (code, stdout, stderr) = run(folder.path(), &arguments);
    assert_eq!((code, stderr.as_str()), (0, ""), "{stdout}");
    assert!(folder.path().join("map/trajectory.tum").exists());
    assert!(!folder.path().join("map/laser.rec").exists());
    let (code, _, stderr) = run(folder.path(), &["lrf", "info", "--lrf", "auto", "--port", &port]);
    assert!(code == 0 && stderr.contains("found a Hokuyo"), "{stderr}");
}

#[test]
fn the_latest_runs_are_kept() {
    let folder = temporary();
    let laser = Laser::hokuyo(folder.path());
    let arguments = ["run", "--lrf", "hokuyo", "--port", &laser.port(), "--scans", "3", "--keep-runs", "2"];
    let runs = || {
        let names = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.filter(|name| name.starts_with("run-")).collect();
        names.sort();
        names
    };
    let all: Vec<Vec<String>> = (0..3)
        .map(|_| {
            let before = runs().len();
            let (code, _, stderr) = run(folder.path(), &arguments);
            assert_eq!(code, 0, "{stderr}");
            assert_eq!(stderr.contains(": removed, since later runs are kept"), before == 2, "{stderr}");
            runs()
        })
        .collect();
    assert_eq!(all.iter().map(Vec::len).collect::<Vec<_>>(), [1, 2, 2]);
    assert!(all[2][0] == all[1][1] && !all[2].contains(&all[0][0]), "the oldest went: {all:?}");
    let (code, _, stderr) = run(folder.path(), &[&arguments[..], &["--out", "named"]].concat());
    assert!(code == 2 && stderr.contains("cannot be used with"), "{stderr}");
}

#[test]
fn a_port_that_is_none_is_given_up_after_ten_seconds() {
    let folder = temporary();
    fs::write(folder.path().join("file"), "text").unwrap();
    let words = [("there-is-none", "(is it plugged in?)"), ("./file", "this is not a serial port")];
    std::thread::scope(|scope| {
        for (port, words) in words {
            let folder = folder.path();
            scope.spawn(move || {
                let started = Instant::now();
                let arguments = ["run", "--lrf", "hokuyo", "--port", port, "--record", "laser.rec", "-q"];
                let (code, _, stderr) = run(folder, &arguments);
                let took = started.elapsed().as_secs();
                assert!(code == 1 && stderr.contains(words), "{code}: {stderr}");
                assert!(stderr.ends_with("gave up after 10 s (--wait waits for it)\n"), "{stderr}");
                assert!((10..20).contains(&took), "{took} s");
            });
        }
    });
    assert!(!folder.path().join("laser.rec").exists(), "nothing was heard, so nothing is recorded");
}

#[test]
fn with_wait_a_laser_may_come_later() {
    let folder = temporary();
    let port = folder.path().join("laser").display().to_string();
    let arguments = ["lrf", "scan", "--lrf", "hokuyo", "--wait", "--port", &port];
    let waiting = lrfslam(folder.path(), &arguments).stdout(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(13));
    let _laser = Laser::hokuyo(folder.path());
    let done = waiting.wait_with_output().unwrap();
    assert!(done.status.success());
    assert!(String::from_utf8(done.stdout).unwrap().contains(" beams: "));
}

#[test]
fn a_program_that_is_killed_leaves_a_recording_that_replays() {
    let folder = temporary();
    let laser = Laser::hokuyo(folder.path());
    let arguments = ["run", "--lrf", "hokuyo", "--port", &laser.port(), "--record", "drive.rec", "-q"];
    let mut host = lrfslam(folder.path(), &arguments).spawn().unwrap();
    let file = folder.path().join("drive.rec");
    while fs::metadata(&file).map_or(0, |file| file.len()) < 60_000 {
        std::thread::sleep(Duration::from_millis(20));
    }
    host.kill().unwrap();
    host.wait().unwrap();
    let (code, stdout, stderr) = run(folder.path(), &["replay", "drive.rec", "--fast", "--out", "again"]);
    assert!(code == 1 && stderr.contains("was the program killed"), "{stderr}");
    let scans: u32 = stdout.split_whitespace().next().unwrap().parse().unwrap();
    assert!(scans > 10, "{stdout}");
}

#[test]
fn what_cannot_work_is_refused_at_the_start() {
    let folder = temporary();
    let refused = |lrf: &str, port: &str, more: &[&str]| {
        let arguments = [&["run", "--lrf", lrf, "--port", port][..], more].concat();
        let (code, _, stderr) = run(folder.path(), &arguments);
        assert_eq!(code, 2, "{stderr}");
        stderr
    };
    let tcp = refused("sick-lms2xx", "tcp:127.0.0.1:4001", &[]);
    assert!(tcp.contains("cannot be reached over TCP") && tcp.contains("serial port"), "{tcp}");
    let baud = refused("auto", "/dev/ttyUSB0", &["--baud", "115200"]);
    assert!(baud.contains("--lrf auto finds the rate itself"), "{baud}");
    let twice = refused("hokuyo", "/dev/ttyUSB0", &["--record", "a", "--no-record"]);
    assert!(twice.contains("cannot be used with"), "{twice}");
}
