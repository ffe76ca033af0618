//! A foreign driver reads the simulated lasers: MRPT's `rawlog-grabber` (Debian: `apt install mrpt-apps`), where it is installed.
//!
//! All but the URG-04LX by its serial port: MRPT asks it for 115200 baud before it asks for SCIP 2.0, and SCIP 1.1 refuses. What is left, 19200 baud,
//! carries less than one scan a second.
//!
//! Ten minutes, on a machine that does nothing else: `cargo test -p lrfslam-tests --test live mrpt -- --ignored --nocapture`; `LRFSLAM_MRPT_SECONDS=20` for less.

use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::pty::{serve, wall_clock};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::virtual_lrf::SensorModel;
use lrfslam_firmware_sim::virtual_lrf::hokuyo::HokuyoModel;
use lrfslam_firmware_sim::virtual_lrf::sick::SickModel;

/// A laser, what MRPT is told of it, and how many scans a second it is to get.
struct Laser {
    name: &'static str,
    model: SensorModel,
    driver: &'static str,
    settings: &'static str,
    rate: f64,
}

fn lasers() -> Vec<Laser> {
    let sick = |name, model, settings, rate| Laser {
        name,
        model: SensorModel::Sick(model),
        driver: "CSickLaserSerial",
        settings,
        rate,
    };
    let hokuyo =
        |name, model, rate| Laser { name, model: SensorModel::Hokuyo(model), driver: "CHokuyoURG", settings: "", rate };
    let fast = "COM_baudRate = 500000\nmm_mode = 1\nFOV = 180\nresolution = 50\n";
    let fast_cm = "COM_baudRate = 500000\nmm_mode = 0\nFOV = 180\nresolution = 100\n";
    let slow_cm = "COM_baudRate = 38400\nmm_mode = 0\nFOV = 180\nresolution = 100\n";
    let slow = "COM_baudRate = 38400\nmm_mode = 1\nFOV = 180\nresolution = 50\n";
    vec![
        sick("lms200, 500000 baud, 0.5 deg", SickModel::lms200(), fast, 37.5),
        sick("lms291, 500000 baud, 1 deg", SickModel::lms291(), fast_cm, 75.0),
        sick("lms200-3016, 38400 baud, 1 deg", SickModel::lms200_3016(), slow_cm, 75.0 / 8.0),
        sick("lms200-old, 38400 baud, 0.5 deg", SickModel::lms200().with_old_firmware(), slow, 37.5 / 8.0),
        hokuyo("urg-04lx-usb", HokuyoModel::urg_04lx_usb(), 10.0),
        hokuyo("urg-04lx-ug01", HokuyoModel::urg_04lx_ug01(), 10.0),
        hokuyo("utm-30lx", HokuyoModel::utm_30lx(), 40.0),
    ]
}

fn is_installed() -> bool {
    let found = Command::new("rawlog-grabber").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    found.is_ok()
}

/// One that has begun to save scans: it gives up for good if its first attempt fails, as on a busy machine, and is started again then.
fn grabber(folder: &Path) -> Option<Child> {
    for _ in 0..5 {
        let said = File::create(folder.join("said")).unwrap();
        // What it says of each second is to be read while it runs.
        let mut grabber = Command::new("stdbuf");
        grabber.args(["-oL", "rawlog-grabber"]).arg(folder.join("grabber.ini"));
        grabber.current_dir(folder).stdin(Stdio::piped());
        let mut grabber = grabber.stdout(said.try_clone().unwrap()).stderr(said).spawn().unwrap();
        for _ in 0..20 {
            std::thread::sleep(Duration::from_secs(1));
            if std::fs::read_to_string(folder.join("said")).unwrap().contains("Saved ") {
                return Some(grabber);
            }
        }
        println!("{}: no scan in 20 s, started again", folder.display());
        let _ = grabber.kill();
        let _ = grabber.wait();
    }
    None
}

/// The scans that MRPT saved in a usual second, and on average, from the fifth second on. Where it gives up on a laser for some seconds, as on a
/// busy machine, the average is less.
fn rate(laser: Laser, seconds: u64, folder: &Path) -> (f64, f64) {
    let link = folder.join("laser");
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let scene = Box::new(Scenario::load("room").expect("comes with the program").scene());
            let mut device = laser.model.clone().seeing(scene, 1, None);
            serve(device.as_mut(), &link, FaultPlan::default(), 1, &mut wall_clock(), &stop).unwrap();
        });
        while !link.exists() {
            std::thread::sleep(Duration::from_millis(20));
        }
        let config = format!(
            "[global]\nrawlog_prefix = {folder}/data\ntime_between_launches = 10\nSF_max_time_span = 0.005\nuse_sensoryframes = 0\n\
             [LASER]\ndriver = {}\nprocess_rate = 200\nsensorLabel = L\npose_x = 0\npose_y = 0\npose_z = 0\npose_yaw = 0\n\
             pose_pitch = 0\npose_roll = 0\nCOM_port_LIN = {}\n{}",
            laser.driver,
            link.display(),
            laser.settings,
            folder = folder.display(),
        );
        std::fs::write(folder.join("grabber.ini"), config).unwrap();
        if let Some(mut grabber) = grabber(folder) {
            std::thread::sleep(Duration::from_secs(seconds));
            // Any key ends it.
            let _ = grabber.stdin.take().unwrap().write_all(b"\n");
            let _ = grabber.wait();
        }
        stop.store(true, Ordering::Relaxed);
    });
    let said = std::fs::read_to_string(folder.join("said")).unwrap();
    let saved = |line: &str| line.split_once("Saved ")?.1.split_once(' ')?.0.parse().ok();
    let each_second: Vec<f64> = said.lines().filter_map(saved).collect();
    let mut settled = each_second.get(5..).unwrap_or(&[]).to_vec();
    settled.sort_by(f64::total_cmp);
    let usual = settled.get(settled.len() / 2).copied().unwrap_or(0.0);
    let begun_anew = said.matches("Will retry").count();
    println!("{}: {} scans, begun anew {begun_anew} times", laser.name, each_second.iter().sum::<f64>());
    (usual, settled.iter().sum::<f64>() / settled.len().max(1) as f64)
}

#[test]
#[ignore = "ten minutes; run with --ignored"]
fn mrpt_reads_every_laser_at_its_rate() {
    if !is_installed() {
        println!("skipped: rawlog-grabber is not installed (Debian: apt install mrpt-apps)");
        return;
    }
    let seconds = std::env::var("LRFSLAM_MRPT_SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(600);
    let folder = tempfile::tempdir().unwrap();
    let rates: Vec<(&str, f64, (f64, f64))> = std::thread::scope(|scope| {
        let runs: Vec<_> = lasers()
            .into_iter()
            .enumerate()
            .map(|(index, laser)| {
                let folder = folder.path().join(index.to_string());
                std::fs::create_dir(&folder).unwrap();
                (laser.name, laser.rate, scope.spawn(move || rate(laser, seconds, &folder)))
            })
            .collect();
        runs.into_iter().map(|(name, wanted, run)| (name, wanted, run.join().unwrap())).collect()
    });
    for (name, wanted, (usual, mean)) in &rates {
        println!("{name}: {usual} scans in a usual second, {mean:.2} on average, of {wanted:.2}");
    }
    for (name, wanted, (usual, mean)) in rates {
        // Seconds have whole scans.
        assert!((usual - wanted).abs() <= f64::max(1.0, 0.03 * wanted), "{name}: {usual} of {wanted:.2}");
        assert!(mean > 0.97 * wanted && mean < 1.03 * wanted, "{name}: {mean:.2} of {wanted:.2}");
    }
}
