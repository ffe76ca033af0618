//! `lrfslam experiment endurance`: a long log, and what becomes of time, memory and error.

use std::path::PathBuf;
use std::sync::atomic::Ordering;

use anyhow::anyhow;
use clap::Args;
use lrfslam_core::time::Duration;

use super::out::OutArgs;
use super::shared::{ConfigArgs, LOG, SeedArgs, TRUTH, TellArgs, with_folder};
use super::{Failure, interrupt_flag};
use lrfslam_host::output::write_file;
use lrfslam_host::results::report::Ending;
use lrfslam_host::runs::map::About;
use lrfslam_host::runs::scans::Scans;
use lrfslam_host::trajectory::read_trajectory;
use lrfslam_lab::experiment::{LongDrive, endurance_csv, endurance_markdown, plot_endurance, run_endurance};

/// Does it keep working? Maps a long log once, and tells time, memory, sizes of files and error hour after hour.
///
/// On one thread, as fast as it can. Writes endurance.csv, a line for each stretch, endurance.md and endurance.svg; Ctrl-C ends
/// it early, with those of the stretches so far.
#[derive(Debug, Args)]
pub(super) struct EnduranceArgs {
    #[arg(help = LOG)]
    log: PathBuf,
    #[arg(long, value_name = "FILE", help = TRUTH)]
    truth: PathBuf,
    /// Length of a stretch, s.
    #[arg(long = "stretch", value_name = "S", default_value_t = 3600, value_parser = clap::value_parser!(i64).range(1..=86_400))]
    stretch_s: i64,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    config: ConfigArgs,
    #[command(flatten)]
    tell: TellArgs,
}

pub(super) fn run(args: &EnduranceArgs) -> Result<(), Failure> {
    let stop = interrupt_flag().map_err(Failure::start)?;
    let config = args.config.load()?;
    let mut scans = Scans::open(&args.log, config.log_options(), stop, args.tell.sayer()).map_err(Failure::Start)?;
    let truth = read_trajectory(&args.truth).map_err(Failure::start)?;
    let mut folder = args.out.folder("endurance")?;
    let every = Duration::from_millis(1000 * args.stretch_s);
    let drive = LongDrive {
        config: &config.mapping(),
        robot_from_lrf: config.robot_from_lrf(),
        seed: args.seed.seed,
        every,
        about: About { config, source: scans.source(false), odometry: false, ending: Ending::Running, fault: None },
    };
    let stretches = run_endurance(&drive, scans, &truth, |stretch| {
        args.tell.say(&format!(
            "{:.0} s: {} scans, half of them in less than {:.1} ms, 99.9 % in less than {:.1} ms; {:.0} MB",
            stretch.until_s,
            stretch.scans,
            stretch.p50_ms,
            stretch.p999_ms,
            stretch.memory_bytes as f64 / 1e6
        ));
    });
    let is_stopped = stop.load(Ordering::Relaxed);
    let stretches = stretches.map_err(if is_stopped { Failure::Interrupted } else { Failure::Work })?;
    let table = endurance_markdown(&stretches);
    let figure = plot_endurance(&stretches).map_err(Failure::work)?;
    let files =
        [("endurance.csv", endurance_csv(&stretches)), ("endurance.md", table.clone()), ("endurance.svg", figure)];
    folder
        .save(|stage| Ok(files.iter().try_for_each(|(name, text)| write_file(&stage.join(name), text.as_bytes()))?))
        .map_err(Failure::Work)?;
    args.tell.print(&stretches, || with_folder(&table, folder.named()))?;
    if is_stopped {
        Err(Failure::Interrupted(anyhow!("stopped before the log's end: the results are of a part")))
    } else {
        Ok(())
    }
}
