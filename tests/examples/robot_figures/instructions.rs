//! What mapping costs on QEMU's microcontrollers.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, ensure};
use lrfslam_app::config::RunConfig;
use lrfslam_core::scan::RangeScan;
use lrfslam_host::scans::log::LogScan;
use lrfslam_robot::{CompactPools, Mapping, Pools, RobotConfig, StandardPools};
use lrfslam_tests::mcu::Mcu;

use crate::{compact, map, mounting, read, thinned};

/// Cycles that the processor is assumed to take for an instruction: with caches, a Cortex-M7 issues up to two; loads from AXI SRAM and
/// divides wait.
const CYCLES_PER_INSTRUCTION: f64 = 1.3;
const CLOCK_HZ: f64 = 480e6;
/// QEMU's `-icount shift`: an instruction takes 2⁷ ns.
const SHIFT: u32 = 7;

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

pub fn instructions(log: &Path, scans: usize, leave_out: usize) -> anyhow::Result<()> {
    let mut all = read(log, &RunConfig::default())?;
    all.truncate(scans);
    let first = (all.len() - leave_out.min(all.len())) / 2;
    all.drain(first..(first + leave_out).min(all.len()));
    let robot_from_lrf = mounting(&all);
    for (machine, mut config, beams) in
        [("mps2-an500", RobotConfig::default(), 682), ("mps2-an386-compact", compact(RobotConfig::default()), 384)]
    {
        config.robot_from_lrf = robot_from_lrf;
        let Some(mcu) = Mcu::find(&format!("{machine}-figures")) else { return Ok(()) };
        let scans: Vec<LogScan> = all.iter().map(|scan| thinned(scan, beams)).collect();
        let (told, stack) = run(&mcu, &encode(&config, &scans)?)?;
        ensure!(told.len() == scans.len(), "{} of {} scans came back", told.len(), scans.len());
        println!("\n{machine}: {}, {} scans, stack {stack} bytes", log.display(), scans.len());
        print_stages(&told);
        let (mut standard, mut small) = (Box::new(StandardPools::EMPTY), Box::new(CompactPools::EMPTY));
        let memory = if beams == 682 { standard.lend().mapping } else { small.lend().mapping };
        let done = map(&mut Mapping::new(&config, memory)?, &scans);
        let here = done.poses.iter().map(|pose| [pose.x, pose.y, pose.heading].map(f32::to_bits));
        let equal = here.zip(&told).filter(|(here, told)| *here == told.pose).count();
        println!("{} lost", done.tally.lost);
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
