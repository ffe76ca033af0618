//! `lrfslam cloud`: scans of a tilted laser to a cloud of points.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use lrfslam_core::time::Duration;
use nalgebra::{Isometry3, Translation3};
use serde::Serialize;

use super::Failure;
use super::cloud_summary::{log_summary, stops_summary};
use super::map::stem;
use super::out::OutArgs;
use super::shared::{ConfigArgs, SeedArgs, TellArgs, within};
use lrfslam_host::maps::cloud::{
    Cloud, CloudCounts, CloudLook, EdgeFilter, Paint, PlaneConfig, Projection, RegisterConfig, StopReport,
    TiltMounting, Track, judge_stops, planar, read_stops, read_tilt, thin, write_cloud,
};
use lrfslam_host::maps::picture::CloudView;
use lrfslam_host::output::save_json;
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::program::Program;
use lrfslam_host::runs::scans::read_scans;
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::{TimedPose, read_trajectory};

/// Make a 3D map from the scans of a tilted laser.
///
/// INPUT is a log with --trajectory (the robot's path, as `lrfslam map` writes it) and --tilt (the tilt's encoder), or a folder
/// in 3DTK's format (scanNNN.3d, scanNNN.pose): stops of a robot, which are then matched with each other, and judged. Written
/// are cloud.ply and cloud.pcd (binary, coloured), cloud.png (for people) and cloud.json.
#[derive(Debug, Args)]
pub(super) struct CloudArgs {
    /// A log, or a folder in 3DTK's format.
    input: PathBuf,
    #[command(flatten)]
    out: OutArgs,
    #[command(flatten)]
    tilted: TiltArgs,
    /// With a folder: where its stops were.
    #[arg(long, value_enum, default_value_t = Poses::Matched)]
    poses: Poses,
    /// One point is kept for each cube of this side, m; 0 keeps all.
    #[arg(long, value_name = "METRES", default_value_t = 0.02, value_parser = not_negative)]
    voxel: f64,
    /// Keep the points in free air that a laser reports at edges.
    #[arg(long)]
    keep_edges: bool,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    tell: TellArgs,
}

/// What a log needs besides itself.
#[derive(Debug, Args)]
pub(super) struct TiltArgs {
    /// With a log: the robot's path, TUM or lines `t x y theta`.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// With a log: readings of the tilt's encoder, lines `t tilt` (s, rad; up is positive), at any rate.
    #[arg(long, value_name = "FILE")]
    tilt: Option<PathBuf>,
    /// The tilt axis above the floor, m.
    #[arg(long, value_name = "METRES", default_value_t = 0.0, value_parser = metres)]
    height: f64,
    /// The laser's mirror ahead of the tilt axis, when it looks ahead, m.
    #[arg(long, value_name = "METRES", default_value_t = 0.0, allow_hyphen_values = true, value_parser = metres)]
    mirror_ahead: f64,
    /// And above it, m.
    #[arg(long, value_name = "METRES", default_value_t = 0.0, allow_hyphen_values = true, value_parser = metres)]
    mirror_above: f64,
    /// Nothing is placed between poses or readings farther apart than this, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = not_negative)]
    gap: f64,
    #[command(flatten)]
    config: ConfigArgs,
}

/// What the colour of a point tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PaintBy {
    /// How high it is; the lowest and highest hundredth of the points share the ends of the scale.
    Height,
    /// When it was measured.
    Time,
}

impl From<PaintBy> for Paint {
    fn from(by: PaintBy) -> Self {
        match by {
            PaintBy::Height => Self::Height,
            PaintBy::Time => Self::Time,
        }
    }
}

/// How the cloud looks.
#[derive(Debug, Clone, Copy, Args)]
struct LookArgs {
    /// What colours tell.
    #[arg(long, value_enum, default_value_t = PaintBy::Height)]
    colour: PaintBy,
    /// In the picture, points higher than this are left out: a ceiling hides what is below, m.
    #[arg(long, value_name = "METRES", default_value_t = 1000.0, allow_hyphen_values = true, value_parser = metres)]
    cut_above: f64,
    /// The picture is seen from this direction, counter-clockwise from ahead, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 200.0, allow_hyphen_values = true, value_parser = metres)]
    azimuth: f64,
    /// From this high: 0 from the side, 90 from above, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 35.0, allow_hyphen_values = true, value_parser = metres)]
    elevation: f64,
    /// Longer side of the picture, pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 1200, value_parser = clap::value_parser!(u32).range(200..=8000))]
    side: u32,
}

impl LookArgs {
    fn look(&self) -> CloudLook {
        let view = CloudView { azimuth_deg: self.azimuth, elevation_deg: self.elevation, side: self.side as usize };
        CloudLook { paint: self.colour.into(), cut_above_m: self.cut_above, view }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Poses {
    /// As our own matching finds them.
    Matched,
    /// As the data's .pose files have them.
    Given,
}

fn metres(text: &str) -> Result<f64, String> {
    within(text, -1000.0, 1000.0)
}

fn not_negative(text: &str) -> Result<f64, String> {
    within(text, 0.0, 1000.0)
}

/// What `cloud.json` says.
#[derive(Debug, Serialize)]
pub(super) struct CloudReport {
    program: Program,
    input: String,
    seed: u64,
    voxel_m: f64,
    pub(super) counts: CloudCounts,
    pub(super) points: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    poses: Option<Poses>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) stops: Vec<StopReport>,
}

pub(super) fn run(args: &CloudArgs) -> Result<(), Failure> {
    let (cloud, stops) = if args.input.is_dir() {
        from_stops(args)?
    } else {
        (from_log(&args.input, &args.tilted, edges(args), None)?, Vec::new())
    };
    let points = thin(&cloud.points, args.voxel as f32);
    let report = CloudReport {
        program: Program::THIS,
        input: args.input.display().to_string(),
        seed: args.seed.seed,
        voxel_m: args.voxel,
        counts: cloud.counts,
        points: points.len(),
        poses: args.input.is_dir().then_some(args.poses),
        stops,
    };
    let mut folder = args.out.folder(&stem(&args.input, "cloud"))?;
    let saved = folder.save(|stage| {
        write_cloud(stage, &points, &args.look.look())?;
        save_json(&stage.join("cloud.json"), &report)
    });
    saved.map_err(Failure::Work)?;
    args.tell.print(&report, || {
        let summary = if report.stops.is_empty() { log_summary(&report) } else { stops_summary(&report) };
        format!("{summary}results in {}\n", folder.named().display())
    })
}

fn edges(args: &CloudArgs) -> Option<EdgeFilter> {
    (!args.keep_edges).then(EdgeFilter::default)
}

/// The stops of a folder, matched and judged, and their clouds together.
fn from_stops(args: &CloudArgs) -> Result<(Cloud, Vec<StopReport>), Failure> {
    if let Some(flag) =
        args.tilted.trajectory.as_ref().map(|_| "--trajectory").or(args.tilted.tilt.as_ref().map(|_| "--tilt"))
    {
        return Err(Failure::start(anyhow::anyhow!("{flag} goes with a log; {} is a folder", args.input.display())));
    }
    let stops = read_stops(&args.input).map_err(Failure::start)?;
    let planes = PlaneConfig { seed: args.seed.seed, ..PlaneConfig::default() };
    let matching = RegisterConfig { seed: args.seed.seed, ..RegisterConfig::default() };
    let judged = judge_stops(&stops, &planes, &matching, edges(args)).map_err(Failure::work)?;
    let mut cloud = Cloud::default();
    let poses = if args.poses == Poses::Given { &judged.given } else { &judged.map_from_lrf };
    for (stop, map_from_lrf) in stops.iter().zip(poses) {
        cloud.append(stop.cloud(*map_from_lrf, edges(args)));
    }
    Ok((cloud, judged.stops))
}

/// Every scan of a log, carried along the path.
///
/// * `truth` — the path is moved so that its first pose lies where this one, at that time, has it
pub(super) fn from_log(
    input: &Path,
    args: &TiltArgs,
    edges: Option<EdgeFilter>,
    truth: Option<&Path>,
) -> Result<Cloud, Failure> {
    let (Some(trajectory), Some(tilt)) = (&args.trajectory, &args.tilt) else {
        return Err(Failure::start(anyhow::anyhow!("{}: a log needs --trajectory and --tilt", input.display())));
    };
    let config = args.config.load()?;
    let poses = read_trajectory(trajectory).map_err(Failure::start)?;
    let world_from_map = truth.map_or(Ok(Isometry3::identity()), |truth| world_from_map(truth, &poses))?;
    let readings = read_tilt(tilt).map_err(Failure::start)?;
    let scans = read_scans(input, config.log_options()).map_err(Failure::Start)?;
    // A path made by `lrfslam map` has the pose of the middle of each sweep under the scan's time.
    let middle = scans.first().map_or(Duration::ZERO, |scan| scan.scan().middle());
    let place = |pose: &TimedPose| world_from_map * planar(PoseF64::from(pose.map_from_robot));
    let path = poses.iter().map(|pose| (pose.stamp + middle, place(pose)));
    let gap = Duration::from_micros((args.gap * 1e6) as i64);
    let (path, tilt) = (Track::new(path, gap), Track::new(readings, gap));
    let mut cloud = Cloud::default();
    let mounting = |scan: &LogScan| {
        let robot_from_lrf = scan.robot_from_lrf.unwrap_or_else(|| config.robot_from_lrf());
        mounting(args, PoseF64::from(robot_from_lrf))
    };
    let Some(mounting) = scans.first().map(mounting) else { return Ok(cloud) };
    let projection = Projection { mounting, path, tilt, edges };
    scans.iter().for_each(|scan| projection.add(&scan.scan(), &mut cloud));
    Ok(cloud)
}

/// Where the map's frame lies in that of the true path, by the first of `poses`.
fn world_from_map(truth: &Path, poses: &[TimedPose]) -> Result<Isometry3<f64>, Failure> {
    let apart = Duration::from_millis(1000);
    let true_poses = read_trajectory(truth).map_err(Failure::start)?;
    let true_path = true_poses.iter().map(|pose| (pose.stamp, planar(PoseF64::from(pose.map_from_robot))));
    let (Some(first), true_path) = (poses.first(), Track::new(true_path, apart)) else {
        return Ok(Isometry3::identity());
    };
    let world_from_robot = true_path.at(first.stamp).ok_or_else(|| {
        let (file, time) = (truth.display(), first.stamp.as_secs_f64());
        Failure::start(anyhow::anyhow!("{file}: no pose within 1 s of {time:.3} s, where the path begins"))
    })?;
    Ok(world_from_robot * planar(PoseF64::from(first.map_from_robot)).inverse())
}

fn mounting(args: &TiltArgs, robot_from_lrf: PoseF64) -> TiltMounting {
    let lift = Translation3::new(0.0, 0.0, args.height);
    TiltMounting {
        robot_from_axis: lift * planar(robot_from_lrf),
        axis_from_lrf: Isometry3::translation(args.mirror_ahead, 0.0, args.mirror_above),
    }
}
