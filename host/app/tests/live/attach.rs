//! `lrfslam attach` to the robot's program as a process would run it, with a simulated laser on a pseudo-terminal: three parties on their
//! own clocks.

use std::fs;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;

use crate::common::{lrfslam, run};
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::pty;
use lrfslam_firmware_sim::robot_process::{HostLine, Wiring, serve};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::{HokuyoModel, VirtualHokuyo};
use lrfslam_host::trajectory::{TimedPose, read_trajectory};
use lrfslam_robot::StandardPools;
use lrfslam_robot::wire::frame::{MAX_FRAME, encode};
use lrfslam_robot::wire::key::Key;
use lrfslam_robot::wire::session::{LAYOUT, Packet, VERSION};

/// A robot and its laser, until dropped.
pub struct Bench {
    stop: Arc<AtomicBool>,
    threads: Vec<std::thread::JoinHandle<()>>,
    /// As for `--port`.
    pub port: String,
}

impl Bench {
    /// The host's line is a pseudo-terminal in `folder`, or TCP; so many of its frames are damaged.
    pub fn new(folder: &Path, is_tcp: bool, damage: f32) -> Self {
        Self::with_key(folder, is_tcp, damage, None)
    }

    /// The same of a robot that may have a key.
    pub fn with_key(folder: &Path, is_tcp: bool, damage: f32, key: Option<Key>) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let laser = folder.join("laser");
        let terminal = folder.join("robot");
        let host = match is_tcp {
            true => HostLine::Tcp(SocketAddr::from(([127, 0, 0, 1], 0))),
            false => HostLine::Terminal(terminal.clone()),
        };
        let wiring = Wiring { laser: laser.clone(), host, key, faults: (damage, 5) };
        let (say, said) = channel();
        let flags = [stop.clone(), stop.clone()];
        let [laser_stop, robot_stop] = flags;
        let lasers = std::thread::spawn(move || {
            let scene = Scenario::load("floor").expect("comes with the program").scene();
            let mut device = VirtualHokuyo::new(HokuyoModel::urg_04lx_ug01(), Box::new(scene), 1);
            let served = pty::serve(&mut device, &laser, FaultPlan::default(), 1, &mut pty::wall_clock(), &laser_stop);
            served.expect("a pseudo-terminal");
        });
        let robots = std::thread::spawn(move || {
            let say = std::sync::Mutex::new(say);
            let say = |text: &str| {
                let _ = say.lock().unwrap().send(text.to_owned());
            };
            serve::<StandardPools>(&wiring, &robot_stop, &say).expect("its line");
        });
        let port = if is_tcp {
            let first = said.recv_timeout(Duration::from_secs(20)).expect("it says where it listens");
            format!("tcp:{}", first.strip_prefix("listening at ").expect("it says where it listens"))
        } else {
            (0..1000).find(|_| {
                terminal.exists() || {
                    std::thread::sleep(Duration::from_millis(20));
                    false
                }
            });
            terminal.display().to_string()
        };
        Self { stop, threads: vec![lasers, robots], port }
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.threads.drain(..).for_each(|thread| thread.join().expect("no panic"));
    }
}

/// The robot drives straight ahead; every scan is there once.
fn check_path(path: &[TimedPose]) {
    for pair in path.windows(2) {
        let gap = pair[1].stamp.since(pair[0].stamp).micros;
        assert!((50_000..150_000).contains(&gap), "{gap} µs between scans");
        let step = pair[0].map_from_robot.between(pair[1].map_from_robot);
        assert!(step.position().norm() < 0.25, "{step:?}");
    }
    let last = path.last().expect("a path").map_from_robot;
    assert!(last.y.abs() < 0.2 && last.heading.abs() < 0.1, "{last:?}");
}

/// Until so many bytes are stored.
fn wait_for_bytes(journal: &Path, bytes: u64) {
    let is_there = (0..3000).any(|_| {
        std::thread::sleep(Duration::from_millis(20));
        fs::metadata(journal).is_ok_and(|journal| journal.len() > bytes)
    });
    assert!(is_there, "nothing came");
}

fn report(out: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(out.join("run.json")).unwrap()).unwrap()
}

#[test]
fn a_robot_is_configured_heard_stopped_and_let_go() {
    let folder = tempfile::tempdir().unwrap();
    let bench = Bench::new(folder.path(), true, 0.0);
    let arguments = ["attach", "--port", &bench.port, "--lrf", "hokuyo", "--out", "map", "--scans", "60"];
    let (code, stdout, stderr) = run(folder.path(), &arguments);
    assert_eq!(code, 0, "{stderr}");
    assert!(stdout.ends_with("results in map\n"), "{stdout}");
    assert!(stderr.contains("laser is URG-04LX-UG01") && stderr.contains("laser is off"), "{stderr}");
    let out = folder.path().join("map");
    let mut names: Vec<_> = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    let written = ["map.pgm", "map.png", "map.yaml", "robot-map.pgm", "robot-map.yaml", "robot.journal", "run.json"];
    for name in written.into_iter().chain(["trajectory.tum"]) {
        assert!(names.iter().any(|found| found == name), "{name} is not in {names:?}");
    }
    let [free, unknown, occupied] = crate::map_server::ServedMap::load(&out.join("robot-map.yaml")).counts();
    assert!(free > 100 && unknown > 100 && occupied > 20, "{free} {unknown} {occupied}");
    let path = read_trajectory(&out.join("trajectory.tum")).unwrap();
    assert!(path.len() >= 60, "{}", path.len());
    check_path(&path);
    let report = report(&out);
    let robot = &report["robot"];
    assert_eq!((&robot["is_from_start"], &robot["is_map_complete"]), (&true.into(), &true.into()));
    assert_eq!(
        (&robot["missing_scans"], &robot["untold_sweeps"], &report["partial"]),
        (&0.into(), &0.into(), &false.into())
    );
    assert!(
        report["beams"]["hits"].as_u64() > Some(2000) && report["high"]["scans_kept"].as_u64() > Some(4),
        "{report}"
    );
    // Let go, it takes another configuration, and begins another map.
    let line = format!("attach --port {} --lrf hokuyo --out next --scans 5 --particles 20 -q", bench.port);
    let arguments: Vec<&str> = line.split(' ').collect();
    assert_eq!(run(folder.path(), &arguments), (0, String::new(), String::new()));
    let first = read_trajectory(&folder.path().join("next/trajectory.tum")).unwrap()[0];
    assert!(first.map_from_robot.position().norm() < 0.1 && first.stamp > path[path.len() - 1].stamp, "{first:?}");
}

#[test]
fn a_host_that_is_killed_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let bench = Bench::new(folder.path(), false, 0.02);
    let arguments = ["attach", "--port", &bench.port, "--lrf", "hokuyo", "--out", "map", "-q"];
    let journal = folder.path().join("map/robot.journal");
    let mut host = lrfslam(folder.path(), &arguments).spawn().unwrap();
    wait_for_bytes(&journal, 60_000);
    host.kill().unwrap();
    host.wait().unwrap();
    std::thread::sleep(Duration::from_millis(500));
    let (code, _, stderr) = run(folder.path(), &[&arguments[..], &["--resume", "--scans", "80"]].concat());
    assert_eq!((code, stderr.as_str()), (0, ""));
    let path = read_trajectory(&folder.path().join("map/trajectory.tum")).unwrap();
    assert!(path.len() >= 80, "{}", path.len());
    check_path(&path);
    let report = report(&folder.path().join("map"));
    assert_eq!((&report["robot"]["missing_scans"], &report["robot"]["is_from_start"]), (&0.into(), &true.into()));
}

#[test]
fn a_host_that_is_killed_before_it_replaced_anything_goes_on_too() {
    let folder = tempfile::tempdir().unwrap();
    let bench = Bench::new(folder.path(), false, 0.0);
    fs::create_dir(folder.path().join("map")).unwrap();
    fs::write(folder.path().join("map/run.json"), "old").unwrap();
    let arguments = ["attach", "--port", &bench.port, "--lrf", "hokuyo", "--out", "map", "-q"];
    let mut host = lrfslam(folder.path(), &[&arguments[..], &["--overwrite"]].concat()).spawn().unwrap();
    wait_for_bytes(&folder.path().join("map.part/robot.journal"), 20_000);
    host.kill().unwrap();
    host.wait().unwrap();
    assert_eq!(fs::read_to_string(folder.path().join("map/run.json")).unwrap(), "old");
    let (code, _, stderr) = run(folder.path(), &[&arguments[..], &["--resume", "--scans", "50"]].concat());
    assert_eq!((code, stderr.as_str()), (0, ""));
    let report = report(&folder.path().join("map"));
    assert_eq!((&report["robot"]["missing_scans"], &report["robot"]["is_from_start"]), (&0.into(), &true.into()));
    assert!(!folder.path().join("map.part").exists());
}

#[test]
fn a_robot_that_starts_anew_gets_a_folder_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let bench = Bench::new(folder.path(), false, 0.0);
    let port = bench.port.clone();
    let arguments = ["attach", "--port", &port, "--lrf", "hokuyo", "--out", "map", "-q"];
    let mut host = lrfslam(folder.path(), &[&arguments[..], &["--scans", "70"]].concat()).spawn().unwrap();
    let journal = folder.path().join("map/robot.journal");
    wait_for_bytes(&journal, 30_000);
    drop(bench);
    let bench = Bench::new(folder.path(), false, 0.0);
    assert_eq!((host.wait().unwrap().code(), &bench.port), (Some(0), &port));
    for (out, is_partial) in [("map", true), ("map-2", false)] {
        let path = read_trajectory(&folder.path().join(out).join("trajectory.tum")).unwrap();
        assert!(path.len() > 10 && path[0].map_from_robot.position().norm() < 0.1, "{out}: {:?}", path[0]);
        check_path(&path);
        assert_eq!(report(&folder.path().join(out))["partial"], is_partial, "{out}");
    }
    // It was let go; one that maps already is made to begin anew, and that is no life of its own.
    let again = ["--scans", "10", "--restart", "--out", "again"];
    let keep = [&arguments[..], &["--scans", "10", "--keep-running", "--overwrite"]].concat();
    assert_eq!(run(folder.path(), &keep).0, 0);
    let (code, _, stderr) = run(folder.path(), &[&arguments[..5], &again[..], &["--seed", "2"]].concat());
    assert_eq!(code, 0, "{stderr}");
    assert!(folder.path().join("again/trajectory.tum").exists() && !folder.path().join("again-2").exists());
    assert_eq!(report(&folder.path().join("again"))["robot"]["is_from_start"], true);
}

#[test]
fn a_robot_that_refuses_a_configuration_takes_the_next_one() {
    let folder = tempfile::tempdir().unwrap();
    let bench = Bench::new(folder.path(), true, 0.0);
    let arguments = ["attach", "--port", &bench.port, "--lrf", "hokuyo", "-q", "--out"];
    for (out, change, why) in [
        ("grids", ["--set", "ndt.grids=1"], "ndt.grids is 1, the memory is divided for 2"),
        ("baud", ["--lrf-baud", "12345"], "laser.baud is 12345: this laser has no such rate"),
    ] {
        let started = std::time::Instant::now();
        let (code, _, stderr) = run(folder.path(), &[&arguments[..], &[out], &change].concat());
        assert_eq!((code, stderr), (1, format!("lrfslam: the robot refuses: {why}\n")));
        assert!(started.elapsed() < Duration::from_secs(4), "nothing is waited for");
    }
    let quiet = run(folder.path(), &[&arguments[..], &["map", "--scans", "10"]].concat());
    assert_eq!(quiet, (0, String::new(), String::new()));
}

/// It says hello, and would take whatever comes.
#[test]
fn a_robot_with_another_configuration_layout_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let robot = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = format!("tcp:{}", robot.local_addr().unwrap());
    let heard = std::thread::spawn(move || {
        let (mut line, _) = robot.accept().unwrap();
        let layout = LAYOUT ^ 1;
        let hello = Packet::Hello {
            version: VERSION,
            epoch: 7,
            peer: None,
            next: 0,
            base: 0,
            credit: 32,
            is_heard: false,
            layout,
        };
        let (mut payload, mut frame) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        let payload = postcard::to_slice(&hello, &mut payload).unwrap();
        line.write_all(encode(payload, &mut frame).unwrap()).unwrap();
        let mut heard = Vec::new();
        line.read_to_end(&mut heard).unwrap();
        heard
    });
    let (code, _, stderr) = run(folder.path(), &["attach", "--port", &port, "--lrf", "hokuyo", "-q"]);
    let why = "the robot's program has another configuration layout: build both from the same version";
    assert_eq!((code, stderr), (1, format!("lrfslam: {why}\n")));
    let heard = heard.join().unwrap();
    assert!(heard.len() < 60, "{} bytes: hellos, and no configuration", heard.len());
    assert!(!folder.path().join("robot-map/robot.journal").exists(), "nothing was taken from it");
}

#[test]
fn what_cannot_be_attached_to_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let resume = ["attach", "--port", "x", "--lrf", "hokuyo", "--resume", "--out", "robot-map"];
    let (code, _, stderr) = run(folder.path(), &resume);
    assert_eq!((code, stderr.as_str()), (2, "lrfslam: robot-map: nothing to resume, there is no robot.journal\n"));
    fs::create_dir(folder.path().join("robot-map")).unwrap();
    fs::write(folder.path().join("robot-map/robot.journal"), "something else").unwrap();
    let (code, _, stderr) = run(folder.path(), &resume);
    assert!(code == 2 && stderr.contains("robot-map/robot.journal: expected a robot's journal"), "{stderr}");
    // Nothing is there: said once, and given up.
    let started = std::time::Instant::now();
    let (code, _, stderr) = run(folder.path(), &["attach", "--port", "no-port", "--lrf", "hokuyo", "--out", "none"]);
    assert!(code == 1 && (9.0..20.0).contains(&started.elapsed().as_secs_f64()), "{code} {stderr}");
    assert_eq!(stderr.matches("trying again").count(), 1, "{stderr}");
    assert!(stderr.contains("given up after 10 s (--wait waits as long as it takes)"), "{stderr}");
    assert!(!stderr.contains("no-port: no-port"), "{stderr}");
    let (code, _, stderr) = run(folder.path(), &["attach", "--port", "x", "--lrf", "ld06"]);
    assert!(code == 2 && stderr.contains("hokuyo"), "{stderr}");
    let set = ["attach", "--port", "x", "--lrf", "hokuyo", "--set", "report.sweep_distance_m=-1"];
    let (code, _, stderr) = run(folder.path(), &set);
    assert!(code == 2 && stderr.contains("report.sweep_distance_m is -1.0, expected 0.0 to 10.0"), "{stderr}");
}
