//! What the robot's program costs on a microcontroller, and how well it maps with the memory of one.
//!
//! * `robot_figures accuracy LOG [TRUTH]` — the robot's mapping, in the memory of the two images, beside that of this computer
//! * `robot_figures instructions LOG SCANS` — the same on QEMU's microcontrollers, counted by stage, and compared bit by bit
//!
//! `firmware-sim/firmware/figures` builds what the second needs, and runs both.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, bail, ensure};
use lrfslam_core::geometry::Pose2;
use lrfslam_core::robot::{CompactPools, Mapping, RobotConfig, StandardPools};
use lrfslam_core::scan::RangeScan;
use lrfslam_host::config::RunConfig;
use lrfslam_host::log::{LogReader, LogScan};
use lrfslam_host::mapper::{Mapper, MapperMemory};
use lrfslam_host::trajectory::read_trajectory;
use lrfslam_tests::mcu::Mcu;

/// Cycles that the processor is assumed to take for an instruction: with caches, a Cortex-M7 issues up to two; loads from AXI SRAM and
/// divides wait.
const CYCLES_PER_INSTRUCTION: f64 = 1.3;
const CLOCK_HZ: f64 = 480e6;
/// Of the robot's random numbers, one run each.
const SEEDS: [u64; 3] = [1, 2, 3];
/// QEMU's `-icount shift`: an instruction takes 2⁷ ns.
const SHIFT: u32 = 7;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["accuracy", log] => accuracy(log, None),
        ["accuracy", log, truth] => accuracy(log, Some(truth)),
        ["instructions", log, scans] => instructions(log, scans.parse().context("SCANS is a number")?),
        _ => bail!("expected: accuracy LOG [TRUTH], or instructions LOG SCANS"),
    }
}

fn read(log: &str) -> anyhow::Result<Vec<LogScan>> {
    let reader = LogReader::open(Path::new(log), RunConfig::default().log_options())?;
    Ok(reader.collect::<Result<_, _>>()?)
}

fn mounting(scans: &[LogScan]) -> Pose2 {
    scans.first().and_then(|scan| scan.robot_from_lrf).unwrap_or_default()
}

/// The second image has memory for 384 beams: with more, every second one is left out.
fn thinned(scan: &LogScan, beams: usize) -> LogScan {
    let keep_every = scan.beams.len().div_ceil(beams).max(1);
    LogScan { beams: scan.beams.iter().step_by(keep_every).copied().collect(), ..scan.clone() }
}

/// The smaller memory: fewer particles, beams and metres.
fn compact() -> RobotConfig {
    let mut config = RobotConfig::default();
    config.particles.particles = 12;
    config.rays.range_max_m = 4.0;
    // They take little time: all of it may look at more.
    config.matcher.search_points = 32;
    (config.particle_map.print_step, config.perception.beam_step) = (3, 4);
    config
}

struct Mapped {
    poses: Vec<Pose2>,
    steps: u32,
    dropped: usize,
    ndt_dropped: u32,
    ndt_evicted: u32,
    lost: u32,
    refused: u32,
    tiles: usize,
}

fn map(mapping: &mut Mapping<'_>, scans: &[LogScan]) -> Mapped {
    let mut mapped = Mapped {
        poses: Vec::new(),
        steps: 0,
        dropped: 0,
        ndt_dropped: 0,
        ndt_evicted: 0,
        lost: 0,
        refused: 0,
        tiles: 0,
    };
    for scan in scans {
        match mapping.add_scan(&scan.scan()) {
            Ok(done) => {
                mapped.poses.push(done.report.map_from_robot);
                mapped.ndt_dropped += done.report.odometry.inserted.dropped;
                mapped.ndt_evicted += done.report.odometry.inserted.evicted;
                mapped.lost += u32::from(done.report.odometry.is_lost);
                mapped.dropped += done.report.filter.map_or(0, |filter| filter.dropped);
                mapped.tiles = mapped.tiles.max(done.report.filter.map_or(0, |filter| filter.tiles));
            }
            Err(_) => {
                mapped.refused += 1;
                mapped.poses.push(mapped.poses.last().copied().unwrap_or_default());
            }
        }
    }
    mapped.steps = mapping.steps();
    mapped
}

/// Mean distance between where the hits lie by one path and by another, m.
fn map_error(scans: &[LogScan], poses: &[Pose2], truth: &[Pose2]) -> f64 {
    let (mut sum, mut count) = (0.0, 0_u64);
    let robot_from_lrf = mounting(scans);
    for ((scan, pose), truth) in scans.iter().zip(poses).zip(truth) {
        for hit in scan.beams.iter().filter_map(|beam| beam.hit_in_lrf()) {
            let hit = robot_from_lrf.transform(hit);
            sum += f64::from((pose.transform(hit) - truth.transform(hit)).norm());
            count += 1;
        }
    }
    sum / count.max(1) as f64
}

fn on_this_computer(scans: &[LogScan]) -> anyhow::Result<Vec<Pose2>> {
    let config = RunConfig::default();
    let mut memory = MapperMemory::new(&config, 1);
    let mut mapper = Mapper::new(&config, 1, &mut memory)?;
    let robot_from_lrf = mounting(scans);
    let pose = |scan: &LogScan| Ok(mapper.add_scan(&scan.scan(), robot_from_lrf, None)?.0.map_from_robot);
    scans.iter().map(pose).collect()
}

fn accuracy(log: &str, truth: Option<&str>) -> anyhow::Result<()> {
    let scans = read(log)?;
    let robot_from_lrf = mounting(&scans);
    let computer = on_this_computer(&scans)?;
    let truth = truth.map(|path| true_poses(path, &scans)).transpose()?;
    println!("{log}: {} scans", scans.len());
    let report = |name: &str, poses: &[Pose2]| {
        let from_truth = truth.as_ref().map(|truth| format!("{:.3}", map_error(&scans, poses, truth)));
        let from_truth = from_truth.unwrap_or("-".into());
        println!(
            "{name:<24} map error {from_truth:>6} m from the truth, {:.3} m from this computer",
            map_error(&scans, poses, &computer)
        );
    };
    report("this computer", &computer);
    let thin: Vec<LogScan> = scans.iter().map(|scan| thinned(scan, 384)).collect();
    for seed in SEEDS {
        let mut pools = Box::new(StandardPools::EMPTY);
        let config = RobotConfig { seed, robot_from_lrf, ..RobotConfig::default() };
        let done = map(&mut Mapping::new(&config, pools.lend().mapping)?, &scans);
        report(&format!("robot, 512 KiB, seed {seed}"), &done.poses);
        println!("{:>24} {}", "", counts(&done));
        let mut pools = Box::new(CompactPools::EMPTY);
        let config = RobotConfig { seed, robot_from_lrf, ..compact() };
        let done = map(&mut Mapping::new(&config, pools.lend().mapping)?, &thin);
        report(&format!("robot, 192 KiB, seed {seed}"), &done.poses);
        println!("{:>24} {}", "", counts(&done));
    }
    Ok(())
}

fn counts(done: &Mapped) -> String {
    let Mapped { steps, tiles, dropped, ndt_dropped, ndt_evicted, lost, refused, .. } = done;
    format!(
        "{steps} steps, {tiles} tiles at most, {dropped} particles and {ndt_dropped} points found no room, {ndt_evicted} of the matcher's tiles forgotten, {lost} scans lost, {refused} too large"
    )
}

/// The true pose at each scan, seen from the first.
fn true_poses(path: &str, scans: &[LogScan]) -> anyhow::Result<Vec<Pose2>> {
    let truth = read_trajectory(Path::new(path))?;
    let nearest = |scan: &LogScan| truth.iter().min_by_key(|pose| pose.stamp.since(scan.stamp).micros.abs());
    let poses: Vec<Pose2> = scans.iter().filter_map(nearest).map(|pose| pose.map_from_robot).collect();
    let first = *poses.first().context("the truth has no pose")?;
    Ok(poses.iter().map(|pose| first.between(*pose)).collect())
}

/// The recording as the image reads it.
fn encode(config: &RobotConfig, scans: &[LogScan]) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut room = [0; 1024];
    bytes.extend_from_slice(postcard::to_slice(config, &mut room)?);
    for scan in scans {
        let RangeScan { stamp, range_max_m, beams } = scan.scan();
        bytes.extend_from_slice(postcard::to_slice(&(stamp, range_max_m, beams.len() as u16), &mut room)?);
        for beam in beams {
            bytes.extend_from_slice(postcard::to_slice(&(beam.bearing_rad, beam.offset, beam.echo), &mut room)?);
        }
    }
    let mut image = (bytes.len() as u32).to_le_bytes().to_vec();
    image.append(&mut bytes);
    Ok(image)
}

/// What the image said of one scan.
#[derive(Debug, Clone, PartialEq)]
struct Told {
    is_step: bool,
    /// Matching, weighing, printing; instructions.
    stages: [f64; 3],
    pose: [u32; 3],
}

fn instructions(log: &str, scans: usize) -> anyhow::Result<()> {
    let all = read(log)?;
    let robot_from_lrf = mounting(&all);
    for (machine, mut config, beams) in
        [("mps2-an500", RobotConfig::default(), 682), ("mps2-an386-compact", compact(), 384)]
    {
        config.robot_from_lrf = robot_from_lrf;
        let Some(mcu) = Mcu::find(&format!("{machine}-figures")) else { return Ok(()) };
        let scans: Vec<LogScan> = all.iter().take(scans).map(|scan| thinned(scan, beams)).collect();
        let (told, stack) = run(&mcu, &encode(&config, &scans)?)?;
        ensure!(told.len() == scans.len(), "{} of {} scans came back", told.len(), scans.len());
        println!("\n{machine}: {log}, {} scans, stack {stack} bytes", scans.len());
        print_stages(&told);
        let (mut standard, mut small) = (Box::new(StandardPools::EMPTY), Box::new(CompactPools::EMPTY));
        let memory = if beams == 682 { standard.lend().mapping } else { small.lend().mapping };
        let done = map(&mut Mapping::new(&config, memory)?, &scans);
        let here = done.poses.iter().map(|pose| [pose.x, pose.y, pose.heading].map(f32::to_bits));
        let equal = here.zip(&told).filter(|(here, told)| *here == told.pose).count();
        println!("{equal} of {} poses equal those of this computer bit for bit", told.len());
    }
    Ok(())
}

fn print_stages(told: &[Told]) {
    println!("{:<34} {:>8} {:>8} {:>8}   million instructions", "", "mean", "median", "largest");
    let row = |name: &str, mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64 / 1e6;
        let (median, largest) = (values.get(values.len() / 2), values.last());
        let million = |value: Option<&f64>| value.map_or(0.0, |value| value / 1e6);
        println!("{name:<34} {mean:>8.2} {:>8.2} {:>8.2}", million(median), million(largest));
        million(largest)
    };
    let steps = || told.iter().filter(|told| told.is_step);
    row("matching, every scan", told.iter().map(|told| told.stages[0]).collect());
    row("weighing, scans with a step", steps().map(|told| told.stages[1]).collect());
    row("resampling and printing, likewise", steps().map(|told| told.stages[2]).collect());
    let largest = row("all, every scan", told.iter().map(|told| told.stages.iter().sum()).collect());
    let all = told.iter().map(|told| told.stages.iter().sum::<f64>()).sum::<f64>() / told.len().max(1) as f64;
    let milliseconds = |instructions: f64| instructions * CYCLES_PER_INSTRUCTION / CLOCK_HZ * 1e3;
    println!(
        "at 480 MHz and {CYCLES_PER_INSTRUCTION} cycles an instruction: mean {:.0} ms, largest {:.0} ms; a scan every 100 ms",
        milliseconds(all),
        milliseconds(largest * 1e6),
    );
}

/// Runs an image on a recording to its end.
fn run(mcu: &Mcu, recording: &[u8]) -> anyhow::Result<(Vec<Told>, String)> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("recording");
    std::fs::write(&file, recording)?;
    let at = mcu.psram() + 8;
    let mut command: Command = mcu.qemu();
    command.args(["-serial", "null", "-serial", "stdio", "-icount", &format!("shift={SHIFT}")]);
    command.args(["-device", &format!("loader,file={},addr={at:#x},force-raw=on", file.display())]);
    let mut qemu = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().context("starting qemu-system-arm")?;
    let output = BufReader::new(qemu.stdout.take().context("its output")?);
    let mut told = Vec::new();
    let mut stack = Err(anyhow::anyhow!("the image stopped early"));
    for line in output.lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["scan", is_step, a, b, c, x, y, heading] => told.push(Told {
                is_step: is_step == "1",
                stages: [counted(a)?, counted(b)?, counted(c)?],
                pose: [bits(x)?, bits(y)?, bits(heading)?],
            }),
            ["done", _, bytes] => {
                stack = Ok(bytes.to_owned());
                break;
            }
            _ => {}
        }
    }
    qemu.kill()?;
    qemu.wait()?;
    Ok((told, stack?))
}

/// Microseconds of QEMU's clock as instructions.
fn counted(micros: &str) -> anyhow::Result<f64> {
    Ok(micros.parse::<f64>()? * 1000.0 / f64::from(1 << SHIFT))
}

fn bits(word: &str) -> anyhow::Result<u32> {
    Ok(u32::from_str_radix(word, 16)?)
}
