//! What is left of a demonstration: the path over the truth, the cloud, and the errors of both.
//!
//! All files are in the map's frame, that of `trajectory.tum` and `map.pgm`; it is the truth that is moved, by the best rigid motion.

use std::fmt::Write as _;
use std::path::Path;

use crate::cli::demo::DemoArgs;
use crate::config::RunConfig;
use anyhow::Result;
use lrfslam_core::scan::RangeScan;
use lrfslam_core::sweep::{Sweep, SweepMotion};
use lrfslam_core::time::Duration;
use lrfslam_firmware_sim::world::{Vector, World};
use lrfslam_host::maps::cloud::{
    Cloud, CloudLook, CloudPoint, EdgeFilter, Paint, Projection, TiltMounting, Track, planar, thin, write_cloud,
};
use lrfslam_host::maps::occupancy::OccupancyMap;
use lrfslam_host::maps::picture::{CloudView, PictureNotes, write_picture};
use lrfslam_host::output::{save_by, save_file};
use lrfslam_host::plural::count;
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::results::report::Source;
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::{TimedPose, by_time, read_trajectory};
use lrfslam_lab::evaluation::{Statistics, alignment, evaluate_in_frame};
use nalgebra::Isometry3;

use super::robot::SimulatedRobot;
use super::session::DriveRecord;
use super::verdict::{Errors, verdict};

/// Poses belong together if their stamps are the same, to the microsecond that is written.
const SAME: Duration = Duration::from_micros(2);
/// Distance from the true surface within which most points should lie, m.
const NEAR_M: f64 = 0.05;
/// Side of the cubes in which one point of the cloud is kept, m.
const VOXEL_M: f32 = 0.02;
/// Points higher than this would hide the rooms in the picture, m.
const CUT_M: f64 = 2.2;
/// At most so many points are measured against the surfaces; evenly taken from all.
const JUDGED_MAX: usize = 200_000;

/// Writes all files into `out`, where those of the mapper are; returns the table of errors.
pub fn write(
    args: &DemoArgs,
    config: &RunConfig,
    robot: &SimulatedRobot,
    drive: &DriveRecord,
    out: &Path,
) -> Result<String> {
    let poses = read_trajectory(&out.join("trajectory.tum"))?;
    let truth_in_world = truth(robot, &drive.level);
    let world_from_map = alignment(&poses, &truth_in_world, SAME)?;
    let truth = moved(&truth_in_world, world_from_map.between(PoseF64::default()));
    save_by(&out.join("truth.tum"), |file| truth.iter().try_for_each(|pose| pose.write_tum(file)))?;
    write_path_picture(&out.join("path.png"), config, (robot, drive), &poses, &truth)?;
    let cloud = cloud(robot, drive, &poses);
    let view = CloudView { azimuth_deg: 250.0, elevation_deg: 40.0, side: 1400 };
    let look = CloudLook { paint: Paint::Height, cut_above_m: CUT_M, view };
    write_cloud(out, &thin(&cloud.points, VOXEL_M), &look)?;
    let distances = distances(&robot.scenario.world, &cloud, world_from_map);
    let aligned = evaluate_in_frame(&poses, &truth, SAME, 10.0)?;
    let errors = Errors {
        path_m: aligned.absolute_m,
        path_deg: aligned.absolute_deg,
        from_start_m: evaluate_in_frame(&poses, &from_start(&poses, &truth), SAME, 10.0)?.absolute_m,
        cloud_m: Statistics::of(&distances),
        cloud_near: share_within(&distances, NEAR_M),
    };
    let verdict = verdict(&errors, &poses, &truth);
    let text = format!("{}\n{verdict}\n", table(args, &errors, &cloud, distances.len(), drive));
    save_file(&out.join("errors.md"), text.as_bytes())?;
    Ok(text)
}

/// The truth, moved so that it begins where the path does.
fn from_start(poses: &[TimedPose], truth: &[TimedPose]) -> Vec<TimedPose> {
    let first = |path: &[TimedPose]| path.first().map_or(PoseF64::default(), |pose| pose.map_from_robot.into());
    moved(truth, first(poses).then(first(truth).between(PoseF64::default())))
}

fn share_within(distances: &[f64], limit_m: f64) -> f64 {
    distances.iter().filter(|distance| **distance <= limit_m).count() as f64 / distances.len().max(1) as f64
}

fn truth(robot: &SimulatedRobot, scans: &[LogScan]) -> Vec<TimedPose> {
    let pose = |scan: RangeScan<'_>| TimedPose {
        stamp: scan.stamp,
        map_from_robot: robot.pose(scan.stamp + scan.middle()).to_f32(),
    };
    let in_order_of_scans: Vec<TimedPose> = scans.iter().map(|kept| pose(kept.scan())).collect();
    by_time(in_order_of_scans)
}

/// `path` in a frame in which its own is at `motion`.
fn moved(path: &[TimedPose], motion: PoseF64) -> Vec<TimedPose> {
    let moved = |pose: &TimedPose| TimedPose {
        map_from_robot: motion.then(PoseF64::from(pose.map_from_robot)).to_f32(),
        ..*pose
    };
    path.iter().map(moved).collect()
}

/// The map drawn from the path as it came out, and the path over the true one.
fn write_path_picture(
    file: &Path,
    config: &RunConfig,
    (robot, drive): (&SimulatedRobot, &DriveRecord),
    path: &[TimedPose],
    truth: &[TimedPose],
) -> Result<()> {
    let mut map = OccupancyMap::new(config.map);
    let mut before: Option<&TimedPose> = None;
    for (scan, pose) in drive.level.iter().zip(path) {
        let motion = before.map_or_else(SweepMotion::default, |before| SweepMotion {
            displacement: before.map_from_robot.between(pose.map_from_robot),
            duration: pose.stamp.since(before.stamp),
        });
        map.insert(&Sweep { scan: scan.scan(), robot_from_lrf: robot.robot_from_lrf(), motion }, pose.map_from_robot);
        before = Some(pose);
    }
    let Some(raster) = map.raster(config.map.picture_px) else { return Ok(()) };
    let notes = PictureNotes { truth, has_times: true, found_after_s: 0.0, trust: &[], contradicted: &[] };
    write_picture(file, &raster, path, &notes)
}

fn cloud(robot: &SimulatedRobot, drive: &DriveRecord, path: &[TimedPose]) -> Cloud {
    let middle = drive.level.first().map_or(Duration::ZERO, |kept| kept.scan().middle());
    // Path, tilt and scans meet on the drive's clock.
    let poses =
        path.iter().map(|pose| (robot.drive_time(pose.stamp) + middle, planar(PoseF64::from(pose.map_from_robot))));
    // The robot stands while the laser tilts: between the poses before and after there may be a minute.
    let path = Track::new(poses, Duration::from_millis(60_000));
    let tilt = Track::new(robot.tilt_readings(), Duration::from_millis(100));
    let projection = Projection { mounting: mounting(robot), path, tilt, edges: Some(EdgeFilter::default()) };
    let mut cloud = Cloud::default();
    for kept in &drive.tilted {
        let scan = RangeScan { stamp: robot.drive_time(kept.stamp), ..kept.scan() };
        projection.add(&scan, &mut cloud);
    }
    cloud
}

/// How the laser tilts on the robot.
pub fn mounting(robot: &SimulatedRobot) -> TiltMounting {
    let [ahead, left, up] = robot.scenario.robot.laser_m;
    TiltMounting { robot_from_axis: Isometry3::translation(ahead, left, up), ..TiltMounting::default() }
}

/// From each point to the nearest true surface, m.
fn distances(world: &World, cloud: &Cloud, world_from_map: PoseF64) -> Vec<f64> {
    let world_from_map = planar(world_from_map);
    let stride = cloud.points.len().div_ceil(JUDGED_MAX).max(1);
    let distance =
        |point: &CloudPoint| world.distance_m(&Vector::from((world_from_map * point.position.cast::<f64>()).coords));
    cloud.points.iter().step_by(stride).map(distance).collect()
}

/// The errors, as Markdown.
fn table(args: &DemoArgs, errors: &Errors, cloud: &Cloud, judged: usize, drive: &DriveRecord) -> String {
    let mut text = String::new();
    let mut row = |name: &str, errors: &Statistics, unit: f64, wanted: &str| {
        let [mean, rmse, median, max] = [errors.mean, errors.rmse, errors.median, errors.max].map(|e| e * unit);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "| {name} | {mean:.2} | {rmse:.2} | {median:.2} | {max:.2} | {wanted} |");
    };
    row("path, position, best aligned, cm", &errors.path_m, 100.0, "RMSE ≤ 3");
    row("path, heading, best aligned, degrees", &errors.path_deg, 1.0, "RMSE ≤ 0.3");
    row("path, position, counted from its start, cm", &errors.from_start_m, 100.0, "");
    row("cloud to true surface, cm", &errors.cloud_m, 100.0, "");
    let lost = match &drive.report.source {
        Source::Laser { laser, .. } => format!("{} damaged, {} not mapped in time", laser.damaged, laser.overrun),
        Source::Robot { .. } | Source::Log { .. } => String::new(),
    };
    format!(
        "Laser {:?}, world {}, seed {}: {} scans mapped in {:.0} s, {} tilted; {lost}; {}.\n\n\
         | error | mean | RMSE | median | max | wanted |\n| --- | --- | --- | --- | --- | --- |\n{text}\n\
         {:.1} % of {judged} cloud points lie within {:.0} cm of a true surface (wanted: 95 %); {} mixed pixels were taken out of {} hits.\n",
        args.lrf,
        args.world,
        args.seed.seed,
        drive.level.len(),
        drive.report.cost.driven_s,
        drive.tilted.len(),
        loops(drive),
        errors.cloud_near * 100.0,
        NEAR_M * 100.0,
        cloud.counts.mixed,
        cloud.counts.hits,
    )
}

fn loops(drive: &DriveRecord) -> String {
    match drive.report.high.map_or(0, |high| high.closures) {
        0 => "no loop closed".to_owned(),
        closures => format!("{} closed", count(closures, "loop")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::scan::{Beam, Echo};
    use lrfslam_core::time::Instant;

    #[test]
    fn middle_of_a_sweep_is_between_its_ends() {
        let beam = |micros| Beam { bearing_rad: 0.0, offset: Duration::from_micros(micros), echo: Echo::Miss };
        let beams = [beam(0), beam(400), beam(1000)];
        let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
        assert_eq!(scan.middle(), Duration::from_micros(500));
    }
}
