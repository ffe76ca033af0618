//! `lrfslam lrf`: what is plugged in, and one scan of it.

use std::ops::ControlFlow;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use lrfslam_core::geometry::Point2;
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::time::Duration;
use lrfslam_lrf::driver::Identity;
use serde::Serialize;

use super::laser::{LaserArgs, interrupt_flag, say, source_failure};
use super::shared::JsonArgs;
use super::{Failure, print};
use lrfslam_host::maps::picture::scan_png;
use lrfslam_host::output::write_file;
use lrfslam_host::scans::live::{Item, ScanSource, for_each_scan};

/// Look at a laser range finder: what it is, and one scan.
#[derive(Debug, Args)]
pub(super) struct LrfArgs {
    #[command(subcommand)]
    command: LrfCommand,
}

#[derive(Debug, Subcommand)]
enum LrfCommand {
    /// Print what is connected: model, firmware, field of view, its own words on how it is.
    Info(InfoArgs),
    /// Take one scan: a summary as text, and all of it as a table or picture if asked.
    Scan(ScanArgs),
}

#[derive(Debug, Args)]
struct InfoArgs {
    #[command(flatten)]
    laser: LaserArgs,
    #[command(flatten)]
    json: JsonArgs,
}

#[derive(Debug, Args)]
struct ScanArgs {
    #[command(flatten)]
    laser: LaserArgs,
    #[command(flatten)]
    json: JsonArgs,
    /// Write the scan as a picture, seen from above.
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Print every beam: bearing in degrees, range in metres or "miss" or "invalid", milliseconds after the stamp.
    #[arg(long, conflicts_with = "json")]
    table: bool,
}

pub(super) fn run(args: &LrfArgs) -> Result<(), Failure> {
    match &args.command {
        LrfCommand::Info(args) => info(args),
        LrfCommand::Scan(scan) => one_scan(scan),
    }
}

/// Runs the laser until `done` finds what it wants in an item.
fn until(laser: &LaserArgs, mut done: impl FnMut(&Item<'_>) -> bool) -> Result<bool, Failure> {
    let stop = interrupt_flag().map_err(Failure::Start)?;
    let source = ScanSource::Live(laser.live().map_err(Failure::Start)?);
    let mut found = false;
    let report = for_each_scan(&source, stop, &mut |item| {
        if let Item::Said(text) = &item {
            say(text);
        }
        found = found || done(&item);
        if found { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    report.map_err(source_failure)?;
    Ok(found)
}

fn info(args: &InfoArgs) -> Result<(), Failure> {
    let mut told = None;
    until(&args.laser, |item| {
        if let Item::Identified(identity) = item {
            told = Some((Told::new(identity), describe(identity)));
        }
        told.is_some()
    })?;
    let Some((report, text)) = told else { return Err(interrupted("nothing was found")) };
    print(&args.json.choose(&report, || text)?)
}

fn one_scan(args: &ScanArgs) -> Result<(), Failure> {
    let (mut report, mut text, mut picture) = (None, String::new(), None);
    let found = until(&args.laser, |item| {
        let Item::Scan(scan) = item else { return false };
        report = Some(ScanReport::new(scan));
        text = summarise(scan);
        if args.table {
            text.push_str(&table(scan));
        }
        picture = args.png.as_ref().map(|_| scan_png(scan));
        true
    })?;
    if !found {
        return Err(interrupted("no scan came"));
    }
    if let (Some(path), Some(picture)) = (&args.png, picture) {
        let written = picture.and_then(|bytes| write_file(path, &bytes));
        written.map_err(|error| Failure::work(anyhow::anyhow!("{}: {error}", path.display())))?;
    }
    print(&args.json.choose(&report, || text)?)
}

fn interrupted(what: &str) -> Failure {
    Failure::Interrupted(anyhow::anyhow!("interrupted; {what}"))
}

/// What is connected, as JSON; what the sensor does not say is left out.
#[derive(Debug, Serialize)]
struct Told {
    model: String,
    #[serde(skip_serializing_if = "String::is_empty")]
    serial: String,
    #[serde(skip_serializing_if = "String::is_empty")]
    firmware: String,
    #[serde(skip_serializing_if = "String::is_empty")]
    state: String,
    view_rad: [f32; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    beams: Option<u16>,
    range_max_m: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    turn_s: Option<f32>,
}

impl Told {
    fn new(identity: &Identity) -> Self {
        Self {
            model: identity.model.trim().to_owned(),
            serial: identity.serial.trim().to_owned(),
            firmware: identity.firmware.trim().to_owned(),
            state: identity.state.trim().to_owned(),
            view_rad: [identity.angle_min_rad, identity.angle_max_rad],
            beams: Some(identity.beams).filter(|beams| *beams > 0),
            range_max_m: identity.range_max_m,
            turn_s: Some(identity.turn.as_secs_f32()).filter(|turn_s| *turn_s > 0.0),
        }
    }
}

/// A scan, as JSON.
#[derive(Debug, Serialize)]
struct ScanReport {
    stamp_s: f64,
    range_max_m: f32,
    beams: Vec<BeamReport>,
}

#[derive(Debug, Serialize)]
struct BeamReport {
    bearing_rad: f32,
    echo: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    range_m: Option<f32>,
    /// After the stamp.
    offset_s: f32,
}

impl ScanReport {
    fn new(scan: &RangeScan<'_>) -> Self {
        let beam = |beam: &Beam| {
            let (echo, range_m) = match beam.echo {
                Echo::Hit(range_m) => ("hit", Some(range_m)),
                Echo::Miss => ("miss", None),
                Echo::Invalid => ("invalid", None),
            };
            BeamReport { bearing_rad: beam.bearing_rad, echo, range_m, offset_s: beam.offset.as_secs_f32() }
        };
        let beams = scan.beams.iter().map(beam).collect();
        Self { stamp_s: scan.stamp.as_secs_f64(), range_max_m: scan.range_max_m, beams }
    }
}

fn describe(identity: &Identity) -> String {
    let [from, to] = [identity.angle_min_rad, identity.angle_max_rad].map(f32::to_degrees);
    let mut text = String::new();
    let beams = match identity.beams {
        0 => String::new(),
        beams => format!(", {beams} beams"),
    };
    let turns = match identity.turn {
        Duration::ZERO => String::new(),
        turn => format!("{:.1} turns a second", 1.0 / turn.as_secs_f32()),
    };
    let lines = [
        ("model", identity.model.trim().to_owned()),
        ("serial", identity.serial.to_string()),
        ("firmware", identity.firmware.trim().to_owned()),
        ("state", identity.state.to_string()),
        ("view", format!("{from:.2} to {to:.2} deg{beams}")),
        ("range", format!("up to {:.3} m", identity.range_max_m)),
        ("mirror", turns),
    ];
    for (name, value) in lines.iter().filter(|(_, value)| !value.is_empty()) {
        text.push_str(&format!("{name:<9} {value}\n"));
    }
    text
}

fn summarise(scan: &RangeScan<'_>) -> String {
    let count = |wanted: fn(&Beam) -> bool| scan.beams.iter().filter(|beam| wanted(beam)).count();
    let ranges = || scan.beams.iter().filter_map(|beam| Point2::of_hit(beam).map(|point| point.norm()));
    let nearest = ranges().fold(f32::INFINITY, f32::min);
    let farthest = ranges().fold(0.0, f32::max);
    let mut text = format!(
        "{} beams: {} hits, {} misses, {} invalid\n",
        scan.beams.len(),
        count(|beam| matches!(beam.echo, Echo::Hit(_))),
        count(|beam| beam.echo == Echo::Miss),
        count(|beam| beam.echo == Echo::Invalid),
    );
    if nearest.is_finite() {
        text.push_str(&format!("nearest {nearest:.3} m, farthest {farthest:.3} m\n"));
    }
    text + &plan(scan)
}

/// Columns and rows of the plan in text; a character is about twice as high as wide.
const PLAN: (usize, usize) = (61, 31);

/// The scan seen from above, as text: `#` hit, `.` free, `^` the laser, which looks up.
fn plan(scan: &RangeScan<'_>) -> String {
    let reach = scan.beams.iter().filter_map(|beam| Point2::of_hit(beam).map(|point| point.norm())).fold(0.5, f32::max);
    let (columns, rows) = PLAN;
    let mut cells = vec![b' '; columns * rows];
    let mut put = |x: f32, y: f32, mark: u8| {
        let column = ((1.0 - y / reach) * 0.5 * (columns - 1) as f32).round() as usize;
        let row = ((1.0 - x / reach) * 0.5 * (rows - 1) as f32).round() as usize;
        let place = row.min(rows - 1) * columns + column.min(columns - 1);
        if let Some(cell) = cells.get_mut(place).filter(|cell| **cell != b'#') {
            *cell = mark;
        }
    };
    for point in scan.beams.iter().filter_map(Point2::of_hit) {
        (0..40).for_each(|part| put(point.x * part as f32 / 40.0, point.y * part as f32 / 40.0, b'.'));
        put(point.x, point.y, b'#');
    }
    put(0.0, 0.0, b'^');
    let line = |row: &[u8]| String::from_utf8_lossy(row).trim_end().to_owned() + "\n";
    cells.chunks(columns).map(line).collect()
}

fn table(scan: &RangeScan<'_>) -> String {
    let mut text = format!("stamp {:.6} s\nbearing_deg range_m offset_ms\n", scan.stamp.as_secs_f64());
    for beam in scan.beams {
        let range = match beam.echo {
            Echo::Hit(range_m) => format!("{range_m:.3}"),
            Echo::Miss => "miss".to_owned(),
            Echo::Invalid => "invalid".to_owned(),
        };
        let offset_ms = beam.offset.micros as f64 / 1000.0;
        text.push_str(&format!("{:.3} {range} {offset_ms:.3}\n", beam.bearing_rad.to_degrees()));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::time::Instant;

    #[test]
    fn what_a_sensor_does_not_say_is_not_told() {
        let mut identity = Identity { beams: 682, turn: Duration::from_millis(100), ..Identity::default() };
        let told = describe(&identity);
        assert!(told.contains(", 682 beams") && told.contains("10.0 turns a second"), "{told}");
        (identity.beams, identity.turn) = (0, Duration::ZERO);
        let told = describe(&identity);
        assert!(!told.contains("beams") && !told.contains("turns"), "{told}");
    }

    #[test]
    fn plan_shows_a_wall_ahead() {
        let beams: Vec<Beam> = (-40..=40)
            .map(|step| {
                let bearing_rad = step as f32 * 0.01;
                Beam { bearing_rad, offset: Duration::ZERO, echo: Echo::Hit(2.0 / bearing_rad.cos()) }
            })
            .collect();
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        let picture = plan(&scan);
        let rows: Vec<&str> = picture.lines().collect();
        assert!(rows[1].contains("#########"), "{picture}");
        assert!(rows[15].contains('^'));
    }

    #[test]
    fn json_tells_the_three_kinds_of_beam_apart() {
        let beam = |echo| Beam { bearing_rad: 0.5, offset: Duration::from_micros(500), echo };
        let beams = [beam(Echo::Hit(1.5)), beam(Echo::Miss), beam(Echo::Invalid)];
        let scan = RangeScan { stamp: Instant::from_micros(1_500_000), range_max_m: 8.0, beams: &beams };
        let told = serde_json::to_value(ScanReport::new(&scan)).unwrap();
        assert_eq!((&told["stamp_s"], &told["beams"][0]["range_m"]), (&1.5.into(), &1.5.into()));
        let echoes: Vec<_> = told["beams"].as_array().unwrap().iter().map(|beam| beam["echo"].clone()).collect();
        assert_eq!(echoes, ["hit", "miss", "invalid"]);
        assert!(told["beams"][1].get("range_m").is_none());
    }

    #[test]
    fn table_tells_the_three_kinds_of_beam_apart() {
        let beam = |echo| Beam { bearing_rad: 0.0, offset: Duration::from_micros(500), echo };
        let beams = [beam(Echo::Hit(1.5)), beam(Echo::Miss), beam(Echo::Invalid)];
        let scan = RangeScan { stamp: Instant::from_micros(1_500_000), range_max_m: 8.0, beams: &beams };
        let expected = "stamp 1.500000 s\nbearing_deg range_m offset_ms\n0.000 1.500 0.500\n0.000 miss 0.500\n0.000 invalid 0.500\n";
        assert_eq!(table(&scan), expected);
    }
}
