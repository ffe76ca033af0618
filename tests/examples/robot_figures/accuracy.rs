//! How far off the robot's path is, by where the scans' hits lie.

use std::path::Path;

use anyhow::{Context as _, ensure};
use lrfslam_app::config::RunConfig;
use lrfslam_core::geometry::Point2;
use lrfslam_core::geometry::Pose2;
use lrfslam_host::mapping::mapper::Mapper;
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::read_trajectory;
use lrfslam_robot::{CompactPools, LaserConfig, Mapping, Pools, RobotConfig, StandardPools};
use lrfslam_tests::robot_rig::Tally;

use crate::{MappedPath, compact, map, mounting, read, thinned};

/// Of the robot's random numbers, one run each.
const SEEDS: [u64; 3] = [1, 2, 3];

/// Mean distance between where the hits lie by one path and by another, m: as the paths are, and after the rigid motion that brings one map best
/// onto the other.
struct MapError {
    in_place: f64,
    aligned: f64,
}

fn map_error(scans: &[LogScan], poses: &[Pose2], truth: &[Pose2]) -> MapError {
    let robot_from_lrf = mounting(scans);
    let hits = scans.iter().zip(poses).zip(truth).flat_map(|((scan, pose), truth)| {
        let hits = scan.beams.iter().filter_map(Point2::of_hit);
        hits.map(move |hit| {
            let hit = robot_from_lrf.transform(hit);
            [pose.transform(hit), truth.transform(hit)].map(|hit| [f64::from(hit.x), f64::from(hit.y)])
        })
    });
    let pairs: Vec<[[f64; 2]; 2]> = hits.collect();
    let count = pairs.len().max(1) as f64;
    let mean = |which: usize, axis: usize| pairs.iter().map(|pair| pair[which][axis]).sum::<f64>() / count;
    let centres = [[mean(0, 0), mean(0, 1)], [mean(1, 0), mean(1, 1)]];
    let centred =
        |pair: &[[f64; 2]; 2]| [0, 1].map(|which| [0, 1].map(|axis| pair[which][axis] - centres[which][axis]));
    // The heading of the best rotation: Umeyama 1991, in the plane.
    let (mut sin, mut cos) = (0.0, 0.0);
    for [[ax, ay], [bx, by]] in pairs.iter().map(centred) {
        (sin, cos) = (sin + ax * by - ay * bx, cos + ax * bx + ay * by);
    }
    let (sin, cos) = f64::atan2(sin, cos).sin_cos();
    let rotated = |[x, y]: [f64; 2]| [cos * x - sin * y, sin * x + cos * y];
    let distance = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| (ax - bx).hypot(ay - by);
    MapError {
        in_place: pairs.iter().map(|[a, b]| distance(*a, *b)).sum::<f64>() / count,
        aligned: pairs.iter().map(centred).map(|[a, b]| distance(rotated(a), b)).sum::<f64>() / count,
    }
}

impl std::fmt::Display for MapError {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{:.3} m ({:.3} m in place)", self.aligned, self.in_place)
    }
}

fn on_this_computer(scans: &[LogScan], config: &RunConfig) -> anyhow::Result<Vec<Pose2>> {
    let mut memory = config.mapping().mapper_memory(1);
    let mut mapper = Mapper::new(&config.slam(), 1, &mut memory)?;
    let robot_from_lrf = mounting(scans);
    let pose = |scan: &LogScan| Ok(mapper.add_scan(&scan.scan(), robot_from_lrf, None)?.0.map_from_robot);
    scans.iter().map(pose).collect()
}

pub fn accuracy(log: &Path, truth: Option<&Path>, set: &[String]) -> anyhow::Result<()> {
    let of_computer = RunConfig::load_over(RunConfig::default(), None, set)?;
    let of_robot = RunConfig::load_over(RunConfig::for_robot(), None, set)?.robot(0, LaserConfig::default());
    let scans = read(log, &of_computer)?;
    let robot_from_lrf = mounting(&scans);
    let computer = on_this_computer(&scans, &of_computer)?;
    let truth = truth.map(|path| true_poses(path, &scans)).transpose()?;
    println!("{}: {} scans", log.display(), scans.len());
    let report = |name: &str, poses: &[Pose2]| {
        let from_truth = truth.as_ref().map(|truth| format!("{} from the truth, ", map_error(&scans, poses, truth)));
        let from_truth = from_truth.unwrap_or_default();
        println!("{name:<24} map error {from_truth}{} from this computer", map_error(&scans, poses, &computer));
    };
    report("this computer", &computer);
    let thin: Vec<LogScan> = scans.iter().map(|scan| thinned(scan, 384)).collect();
    for seed in SEEDS {
        let mut pools = Box::new(StandardPools::EMPTY);
        let config = RobotConfig { seed, robot_from_lrf, ..of_robot };
        let done = map(&mut Mapping::new(&config, pools.lend().mapping)?, &scans);
        report(&format!("robot, 512 KiB, seed {seed}"), &done.poses);
        println!("{:>24} {}", "", counts(&done));
        let mut pools = Box::new(CompactPools::EMPTY);
        let config = RobotConfig { seed, robot_from_lrf, ..compact(of_robot) };
        let done = map(&mut Mapping::new(&config, pools.lend().mapping)?, &thin);
        report(&format!("robot, 192 KiB, seed {seed}"), &done.poses);
        println!("{:>24} {}", "", counts(&done));
    }
    Ok(())
}

/// A path with a pose for every scan of the log, beside another or that of this computer.
pub fn distance(log: &Path, path: &Path, other: Option<&Path>) -> anyhow::Result<()> {
    let scans = read(log, &RunConfig::default())?;
    let poses = |path: &Path| -> anyhow::Result<Vec<Pose2>> {
        let poses = read_trajectory(path)?;
        let (found, expected) = (poses.len(), scans.len());
        ensure!(found == expected, "{}: {found} poses, expected one for each of {expected} scans", path.display());
        Ok(poses.iter().map(|pose| pose.map_from_robot).collect())
    };
    let other = other.map_or_else(|| on_this_computer(&scans, &RunConfig::default()), poses)?;
    println!("map error {}", map_error(&scans, &poses(path)?, &other));
    Ok(())
}

fn counts(done: &MappedPath) -> String {
    let MappedPath { steps, refused, tally, .. } = done;
    let Tally { tiles, dropped, ndt_dropped, ndt_evicted, lost, .. } = tally;
    format!(
        "{steps} steps, {tiles} tiles at most, {dropped} particles and {ndt_dropped} points found no room, {ndt_evicted} of the matcher's tiles forgotten, {lost} scans lost, {refused} too large"
    )
}

/// The true pose at each scan, seen from the first.
fn true_poses(path: &Path, scans: &[LogScan]) -> anyhow::Result<Vec<Pose2>> {
    let truth = read_trajectory(path)?;
    let nearest = |scan: &LogScan| truth.iter().min_by_key(|pose| pose.stamp.since(scan.stamp).micros.abs());
    let poses: Vec<Pose2> = scans.iter().filter_map(nearest).map(|pose| pose.map_from_robot).collect();
    let first = *poses.first().context("the truth has no pose")?;
    Ok(poses.iter().map(|pose| first.between(*pose)).collect())
}
