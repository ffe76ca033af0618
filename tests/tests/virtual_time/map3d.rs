//! A simulated laser is tilted while its robot stands; its cloud lies on the surfaces of the world (thesis, chapter 5).

use std::fs;
use std::path::Path;

use lrfslam_core::time::Duration;
use lrfslam_firmware_sim::fault::FaultPlan;
use lrfslam_firmware_sim::log::{LogFiles, LogPlan, Pace, write_log};
use lrfslam_firmware_sim::lrf_model::LrfModel;
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_firmware_sim::world::Vector;
use lrfslam_host::maps::cloud::{Cloud, EdgeFilter, Projection, TiltMounting, Track, planar, read_tilt};
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::scans::log::{LogOptions, LogReader};
use lrfslam_host::trajectory::read_trajectory;
use lrfslam_lab::experiment::{CloudError, judge_cloud, read_surfaces};
use nalgebra::{Isometry3, Point3};

const WORLD: &str = include_str!("../../../examples/tilting.toml");

/// The first stop of the drive as files: level log, truth, tilted log, encoder, surfaces.
fn write_stop(folder: &Path, lrf: LrfModel) -> Scenario {
    let scenario = Scenario::parse(WORLD, "tilting.toml", Path::new("")).unwrap();
    let pace = Pace::Rate { hz: 5.0, seconds: Some(20.0) };
    let plan = LogPlan { lrf, pace, snapshot: false, fault: FaultPlan::default(), seed: 3 };
    let mut files: [Vec<u8>; 4] = Default::default();
    let [log, truth, tilted, tilt] = &mut files;
    write_log(&scenario, &plan, &mut LogFiles { log, truth, tilted: Some(tilted), tilt: Some(tilt) }).unwrap();
    for (name, bytes) in ["level.log", "level.tum", "tilted.log", "tilt.txt"].iter().zip(files) {
        fs::write(folder.join(name), bytes).unwrap();
    }
    let mut surfaces = Vec::new();
    scenario.world.write_surfaces(&mut surfaces).unwrap();
    fs::write(folder.join("surfaces.txt"), surfaces).unwrap();
    scenario
}

/// The cloud that the host makes of these files.
fn cloud(folder: &Path) -> Cloud {
    let gap = Duration::from_millis(30_000);
    let poses = read_trajectory(&folder.join("level.tum")).unwrap();
    let path = poses.iter().map(|pose| (pose.stamp, planar(PoseF64::from(pose.map_from_robot))));
    let projection = Projection {
        // The laser of tilting.toml: 0.1 m ahead of the robot's centre, 0.4 m high.
        mounting: TiltMounting {
            robot_from_axis: Isometry3::translation(0.1, 0.0, 0.4),
            axis_from_lrf: Isometry3::identity(),
        },
        path: Track::new(path, gap),
        tilt: Track::new(read_tilt(&folder.join("tilt.txt")).unwrap(), gap),
        edges: Some(EdgeFilter::default()),
    };
    let mut cloud = Cloud::default();
    for scan in LogReader::open(&folder.join("tilted.log"), LogOptions::default()).unwrap() {
        projection.add(&scan.unwrap().scan(), &mut cloud);
    }
    cloud
}

fn error_of(lrf: LrfModel) -> CloudError {
    let folder = tempfile::tempdir().unwrap();
    let scenario = write_stop(folder.path(), lrf);
    let points: Vec<Point3<f64>> = cloud(folder.path()).points.iter().map(|point| point.position.cast()).collect();
    let surfaces = read_surfaces(&folder.path().join("surfaces.txt")).unwrap();
    assert_eq!(surfaces.len(), scenario.world.rectangles().len());
    // Both ends agree on how far a point is from the world.
    for point in points.iter().step_by(500) {
        let here = judge_cloud(&[*point], &surfaces).max_m;
        assert!((here - scenario.world.distance_m(&Vector::new(point.x, point.y, point.z))).abs() < 1e-5);
    }
    judge_cloud(&points, &surfaces)
}

#[test]
fn cloud_of_a_lms200_lies_on_the_surfaces_to_its_noise() {
    let error = error_of(LrfModel::LMS200);
    assert!(error.points > 10_000, "{error:?}");
    // 5 mm of noise, and half an encoder step (0.8 mrad) at up to 8 m.
    assert!(error.median_m < 0.004 && error.most_m < 0.012 && error.near > 0.995, "{error:?}");
}

#[test]
fn cloud_of_a_cheap_hokuyo_lies_within_five_centimetres() {
    let error = error_of(LrfModel::URG_04LX_UG01);
    assert!(error.near > 0.9 && error.median_m < 0.025, "{error:?}");
    assert!(error.median_m > 0.005, "its noise is there: {error:?}");
}
