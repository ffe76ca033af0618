//! `lrf-sim log`: a drive as a CARMEN log.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use flate2::{Compression, GzBuilder, write::GzEncoder};
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::log::{LogFiles, LogPlan, Pace, write_log};
use lrfslam_firmware_sim::lrf_model::{LrfErrors, LrfModel};
use lrfslam_firmware_sim::scenario::Scenario;

/// Writes a drive through a world as a CARMEN log, and the true path beside it.
///
/// Names that end in .gz are compressed. The same arguments give the same bytes.
#[derive(Debug, Args)]
pub struct LogArgs {
    #[arg(long, value_name = "NAME|FILE", help = crate::WORLD)]
    world: String,
    /// Drive on to here after the route; may be given more than once
    #[arg(long, value_name = "X,Y", value_parser = place)]
    then: Vec<[f64; 2]>,
    /// The laser
    #[arg(long, default_value = "lms200", value_parser = model)]
    lrf: LrfModel,
    /// The log
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The true path, TUM [default: beside the log, with .tum instead of .log]
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Scans that were taken while the laser was tilted, as a log of their own; left out without this
    #[arg(long, value_name = "FILE")]
    tilted: Option<PathBuf>,
    /// Readings of the tilt's encoder: lines of time and tilt, s and rad, up is positive
    #[arg(long, value_name = "FILE")]
    tilt: Option<PathBuf>,
    /// Scans per second
    #[arg(long, value_name = "HZ", default_value_t = 5.0)]
    rate: f64,
    /// So many scans instead, evenly spread over the way
    #[arg(long, value_name = "N", conflicts_with_all = ["rate", "seconds"])]
    scans: Option<usize>,
    /// End after so many seconds of the drive; needed where the robot has no route
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// From beam to beam, degrees, instead of the laser's own
    #[arg(long, value_name = "DEG")]
    resolution: Option<f64>,
    /// Standard deviation of the ranges, millimetres, instead of the laser's own errors
    #[arg(long, value_name = "MM")]
    noise: Option<f64>,
    /// All beams of a scan leave at once: no distortion by the motion
    #[arg(long)]
    snapshot: bool,
    /// A laser without errors
    #[arg(long, conflicts_with = "noise")]
    perfect: bool,
    /// What goes wrong on the laser's line, such as damage=0.01,unplug=20: the chance that a scan is lost, seconds from one unplugging
    /// to the next
    #[arg(long, default_value = "none", value_parser = FaultPlan::parse)]
    fault: FaultPlan,
    /// Start of the random numbers: the same seed and input give the same results
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Say nothing but errors; the exit code tells how it ended
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(args: &LogArgs) -> Result<()> {
    let scenario = Scenario::load(&args.world)?.driving_on(&args.then).context("--then")?;
    let pace = match args.scans {
        Some(count) => Pace::Count(count),
        None => Pace::Rate { hz: args.rate, seconds: args.seconds },
    };
    let plan = LogPlan { lrf: args.laser()?, pace, snapshot: args.snapshot, fault: args.fault, seed: args.seed };
    let truth_name = args.truth.clone().unwrap_or_else(|| beside(&args.out));
    ensure_apart(&args.outputs(&truth_name))?;
    let (mut log, mut truth) = (Output::create(&args.out)?, Output::create(&truth_name)?);
    let mut tilted = args.tilted.as_deref().map(Output::create).transpose()?;
    let mut tilt = args.tilt.as_deref().map(Output::create).transpose()?;
    let report = write_log(
        &scenario,
        &plan,
        &mut LogFiles {
            log: &mut log,
            truth: &mut truth,
            tilted: tilted.as_mut().map(|out| out as &mut dyn Write),
            tilt: tilt.as_mut().map(|out| out as &mut dyn Write),
        },
    )?;
    Output::finish([Some(log), Some(truth), tilted, tilt].into_iter().flatten().collect())?;
    if args.quiet {
        return Ok(());
    }
    println!(
        "{}: {} scans, {:.1} m in {:.1} s; the truth is in {}",
        args.out.display(),
        report.scans,
        report.way_m,
        report.seconds,
        truth_name.display()
    );
    if report.lost > 0 {
        println!("{} scans lost on the line", report.lost);
    }
    if report.tilted > 0 {
        println!(
            "{} scans of the tilted laser {}",
            report.tilted,
            if args.tilted.is_some() { "apart" } else { "left out" }
        );
    }
    Ok(())
}

impl LogArgs {
    /// Files that are written, and the options that name them.
    fn outputs<'a>(&'a self, truth: &'a PathBuf) -> [(&'static str, Option<&'a PathBuf>); 4] {
        let [tilted, tilt] = [self.tilted.as_ref(), self.tilt.as_ref()];
        [("--out", Some(&self.out)), ("--truth", Some(truth)), ("--tilted", tilted), ("--tilt", tilt)]
    }

    fn laser(&self) -> Result<LrfModel> {
        let mut lrf = self.lrf;
        if let Some(resolution_deg) = self.resolution {
            let fits = (0.05..=30.0).contains(&resolution_deg);
            ensure!(fits, "--resolution: expected 0.05 to 30 degrees, found {resolution_deg}");
            lrf.resolution_deg = resolution_deg;
        }
        if let Some(noise_mm) = self.noise {
            ensure!((0.0..=1000.0).contains(&noise_mm), "--noise: expected 0 to 1000 mm, found {noise_mm}");
            lrf.errors = LrfErrors::gaussian(noise_mm / 1000.0);
        }
        if self.perfect {
            lrf.errors = LrfErrors::NONE;
        }
        Ok(lrf)
    }
}

/// Two numbers, m.
fn place(text: &str) -> Result<[f64; 2], String> {
    let number = |text: &str| text.trim().parse().ok().filter(|metres: &f64| metres.abs() <= 1e6);
    let numbers = text.split_once(',').and_then(|(x, y)| Some([number(x)?, number(y)?]));
    numbers.ok_or_else(|| "expected X,Y in metres, e.g. 29.5,9.5".to_owned())
}

/// No two files are one: the second would be written over the first. Devices may be shared.
fn ensure_apart(named: &[(&str, Option<&PathBuf>)]) -> Result<()> {
    let mut known: Vec<(&str, PathBuf)> = Vec::new();
    for (name, path) in named.iter().filter_map(|(name, path)| Some((*name, (*path)?))) {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let there = fs::canonicalize(path).ok();
        let is_file = there.as_ref().is_none_or(|file| file.is_file());
        let new = || fs::canonicalize(folder).ok().zip(path.file_name()).map(|(folder, name)| folder.join(name));
        let Some(whole) = there.or_else(new).filter(|_| is_file) else { continue };
        let other = known.iter().find(|(_, file)| *file == whole);
        if let Some((other, _)) = other {
            bail!("{other} and {name} are the same file: {}", path.display());
        }
        known.push((name, whole));
    }
    Ok(())
}

/// A model by its name.
pub fn model(name: &str) -> Result<LrfModel, String> {
    let known = LrfModel::ALL;
    let found = known.iter().find(|model| model.name == name).copied();
    found.ok_or_else(|| format!("expected one of {}", known.map(|model| model.name).join(", ")))
}

/// `drive.log.gz` → `drive.tum`.
fn beside(log: &Path) -> PathBuf {
    let name = log.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.strip_suffix(".gz").unwrap_or(&name);
    let stem = stem.strip_suffix(".log").unwrap_or(stem);
    log.with_file_name(format!("{stem}.tum"))
}

/// A file, compressed if its name says so; no time of day goes into it. It is written under its name and `.part`, and put in its
/// place when it is whole: what was there before stays until then. A device or a pipe is written to at once.
struct Output {
    encoder: Encoder,
    path: PathBuf,
    /// Until it is finished.
    temporary: Option<PathBuf>,
}

enum Encoder {
    Plain(BufWriter<File>),
    Gzip(GzEncoder<BufWriter<File>>),
}

impl Output {
    fn create(path: &Path) -> Result<Self> {
        let is_file = fs::metadata(path).map_or(true, |about| about.is_file());
        // A link is followed.
        let linked = fs::canonicalize(path).ok().filter(|_| is_file);
        let target = linked.unwrap_or_else(|| path.to_owned());
        let mut name = target.clone().into_os_string();
        name.push(".part");
        let temporary = is_file.then(|| PathBuf::from(name));
        let file = File::create(temporary.as_deref().unwrap_or(&target));
        let file = BufWriter::new(file.with_context(|| format!("{}: cannot be made", path.display()))?);
        let encoder = match path.extension().is_some_and(|extension| extension == "gz") {
            true => Encoder::Gzip(GzBuilder::new().write(file, Compression::best())),
            false => Encoder::Plain(file),
        };
        Ok(Self { encoder, path: target, temporary })
    }

    /// All that was written is on disk, under the temporary name.
    fn flush_all(&mut self) -> io::Result<()> {
        let file = match &mut self.encoder {
            Encoder::Plain(file) => file,
            Encoder::Gzip(file) => {
                file.try_finish()?;
                file.get_mut()
            }
        };
        file.flush()?;
        if self.temporary.is_some() { file.get_ref().sync_all() } else { Ok(()) }
    }

    /// Puts the files in their places, once all of them are whole.
    fn finish(mut files: Vec<Self>) -> Result<()> {
        for file in &mut files {
            file.flush_all().with_context(|| format!("{}: cannot be written", file.path.display()))?;
        }
        for file in &mut files {
            let Some(temporary) = &file.temporary else { continue };
            let placed = fs::rename(temporary, &file.path);
            placed.with_context(|| format!("{}: cannot be written", file.path.display()))?;
            file.temporary = None;
        }
        Ok(())
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        // Nobody is left to be told.
        self.temporary.take().map(fs::remove_file);
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.encoder {
            Encoder::Plain(file) => file.write(bytes),
            Encoder::Gzip(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.encoder {
            Encoder::Plain(file) => file.flush(),
            Encoder::Gzip(file) => file.flush(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_is_named_after_the_log() {
        let named = |log: &str| beside(Path::new(log)).display().to_string();
        assert_eq!(named("a/drive.log.gz"), "a/drive.tum");
        assert_eq!([named("drive.log"), named("drive")], ["drive.tum", "drive.tum"]);
    }

    #[test]
    fn two_outputs_are_not_one_file() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a.log"), folder.path().join("./a.log"));
        let apart = |first: &Path, second: &Path| {
            ensure_apart(&[("--out", Some(&first.to_owned())), ("--truth", Some(&second.to_owned())), ("--tilt", None)])
        };
        assert!(apart(&a, &b).unwrap_err().to_string().starts_with("--out and --truth are the same file"));
        fs::write(&a, "").unwrap();
        std::os::unix::fs::symlink("a.log", folder.path().join("link")).unwrap();
        assert!(apart(&a, &folder.path().join("link")).is_err());
        assert!(apart(&a, &folder.path().join("a.tum")).is_ok());
        assert!(apart(Path::new("/dev/null"), Path::new("/dev/null")).is_ok());
    }

    #[test]
    fn places_are_within_reach() {
        assert_eq!(place("1.5, -2"), Ok([1.5, -2.0]));
        for text in ["nan,0", "inf,0", "0,1e308", "1", "a,b"] {
            assert!(place(text).is_err(), "{text}");
        }
    }

    #[test]
    fn unknown_lasers_are_refused_in_words() {
        assert_eq!(model("utm-30lx").unwrap().rate_hz, 40.0);
        assert!(model("lms9000").unwrap_err().starts_with("expected one of lms200, lms200-3016"));
    }

    #[test]
    fn what_was_there_stays_until_all_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let (plain, packed) = (folder.path().join("a.log"), folder.path().join("b.log.gz"));
        let all = || [&plain, &packed].map(|path| Output::create(path).unwrap());
        let read = |path: &Path| fs::read(path).unwrap_or_default();
        for file in &mut all() {
            file.write_all(b"half").unwrap();
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "dropped, they leave nothing");
        fs::write(&plain, "old").unwrap();
        let mut files = Vec::from(all());
        files.iter_mut().for_each(|file| file.write_all(b"new").unwrap());
        assert_eq!(read(&plain), b"old");
        Output::finish(files).unwrap();
        let mut text = String::new();
        let unpacked = io::Read::read_to_string(&mut flate2::read::GzDecoder::new(&read(&packed)[..]), &mut text);
        assert_eq!((read(&plain).as_slice(), unpacked.is_ok(), text.as_str()), (&b"new"[..], true, "new"));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
