//! `lrfslam doctor`: what is wrong or unusual with scans, in plain words.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::Failure;
use super::continuing::ReadAhead;
use super::laser::{EndArgs, LaserArgs, interrupt_flag};
use super::map::open_scans;
use super::progress::Progress;
use super::record::TopicArgs;
use super::shared::{ConfigArgs, LOG, TellArgs};
use crate::config::RunConfig;
use lrfslam_host::doctor::{Diagnosis, Doctor, Finding, FollowerMemory, STRETCHES_MAX, Severity, SmearLimits};
use lrfslam_host::plural::count;
use lrfslam_host::results::report::{Ending, Source};

/// Say what is wrong or unusual with a log, a recording or a laser, and what to set.
///
/// Looks at beams, times and ranges, at what stands in the view, and compares odometry and scans. Nothing is written. Of a laser now, 20 seconds
/// are looked at, or what --seconds or --scans say: drive it around meanwhile, since some faults only show in motion.
#[derive(Debug, Args)]
pub(super) struct DoctorArgs {
    #[arg(help = LOG, required_unless_present = "LaserArgs", conflicts_with = "LaserArgs")]
    log: Option<PathBuf>,
    #[command(flatten)]
    topic: TopicArgs,
    #[command(flatten)]
    laser: Option<LaserArgs>,
    #[command(flatten)]
    end: EndArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    tell: TellArgs,
}

/// Seconds of a live laser.
const LIVE_S: f64 = 20.0;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct DoctorReport {
    source: Source,
    scans: u64,
    severity: Severity,
    findings: Vec<Finding>,
    fault: Option<String>,
}

pub(super) fn run(args: &DoctorArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    let config = args.config.load()?;
    let (scans, end) = match (&args.log, &args.laser) {
        (Some(log), _) => (open_scans(log, args.topic.log_options(&config), stop, args.tell.sayer())?, args.end),
        (None, Some(laser)) => {
            let scans = laser.scans(config.log_options().range_max_m, stop, args.tell.sayer())?;
            (scans, args.end.or_seconds(LIVE_S))
        }
        (None, None) => return Err(Failure::start(anyhow::anyhow!("neither a log nor a laser"))),
    };
    let mut scans = ReadAhead::new(scans, end);
    scans.wait(stop)?;
    let (report, fault) = examine(&mut scans, &config, args.tell)?;
    let ending = scans.ending(fault.is_some(), stop);
    args.tell.print(&report, || words(&report))?;
    match (ending, fault) {
        (_, Some(fault)) => Err(Failure::Work(fault.context("only what came before was looked at"))),
        (Ending::Interrupted, None) => Err(Failure::Interrupted(anyhow::anyhow!("only a part was looked at"))),
        _ if report.severity == Severity::Wrong => {
            let wrong = report.findings.iter().filter(|finding| finding.severity == Severity::Wrong);
            let kinds: Vec<&str> = wrong.map(|finding| finding.kind).collect();
            Err(Failure::Unwell(anyhow::anyhow!("wrong: {}", kinds.join(", "))))
        }
        _ => Ok(()),
    }
}

/// Looks at every scan; what ended them early is told beside what was found.
fn examine(
    scans: &mut ReadAhead,
    config: &RunConfig,
    tell: TellArgs,
) -> Result<(DoctorReport, Option<anyhow::Error>), Failure> {
    let smear = SmearLimits { error_m: config.speed.error_m, error_rad: config.speed.error_deg.to_radians() };
    let mut memory = FollowerMemory::new(&config.slam(), &config.memory);
    let mut doctor = Doctor::new(smear, &mut memory).map_err(Failure::Start)?;
    let progress = Progress::new(scans.scans(), tell.is_quiet());
    let (mut seen, mut fault) = (0, None);
    for scan in scans.by_ref() {
        let robot_from_lrf = |told: Option<_>| told.unwrap_or_else(|| config.robot_from_lrf());
        if let Err(error) = scan.and_then(|scan| doctor.add_scan(&scan, robot_from_lrf(scan.robot_from_lrf))) {
            fault = Some(error);
            break;
        }
        seen += 1;
        progress.set(seen);
    }
    progress.clear();
    scans.scans().end();
    let source = scans.scans().source(true);
    let diagnosis = doctor.finish(&source);
    let severity = diagnosis.severity();
    let Diagnosis { findings } = diagnosis;
    let told = fault.as_ref().map(|error| format!("{error:#}"));
    Ok((DoctorReport { source, scans: seen, severity, findings, fault: told }, fault))
}

/// The report for people: the worst first.
fn words(report: &DoctorReport) -> String {
    let mut text = String::new();
    for finding in &report.findings {
        // Writing to a string cannot fail.
        let _ = match finding.severity {
            Severity::Wrong => writeln!(text, "WRONG    {}: {}", finding.kind, finding.found),
            Severity::Unusual => writeln!(text, "unusual  {}: {}", finding.kind, finding.found),
            Severity::Note => writeln!(text, "         {}: {}", finding.kind, finding.found),
        };
        if finding.severity == Severity::Note {
            continue;
        }
        let places: Vec<String> = finding.at.iter().map(ToString::to_string).collect();
        let more = if places.len() == STRETCHES_MAX { ", …" } else { "" };
        let lines =
            [("at", places.join("; ") + more), ("means", finding.means.to_owned()), ("do", finding.advice.clone())];
        for (name, line) in lines.iter().filter(|(_, line)| !line.is_empty()) {
            let _ = writeln!(text, "         {name:<6} {line}");
        }
    }
    let number = |severity| report.findings.iter().filter(|finding| finding.severity == severity).count() as u64;
    let (wrong, unusual) = (number(Severity::Wrong), number(Severity::Unusual));
    let scans = count(report.scans, "scan");
    let _ = match (wrong, unusual) {
        (0, 0) => writeln!(text, "{scans}: nothing is wrong"),
        (0, _) => writeln!(text, "{scans}: nothing is wrong, {} unusual", things(unusual)),
        _ => writeln!(text, "{scans}: {} wrong, {unusual} unusual", things(wrong)),
    };
    text
}

fn things(number: u64) -> String {
    format!("{} {}", count(number, "thing"), if number == 1 { "is" } else { "are" })
}
