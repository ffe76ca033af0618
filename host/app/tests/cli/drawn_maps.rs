//! What a map says, held against what is true: as a ROS robot would read it, with the path on it and the scans that it was drawn from, and
//! in a building with panes that no beam comes back from. `cargo test -p lrfslam --all-features --test cli drawn_maps -- --nocapture` prints the figures.

use std::path::Path;

use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::grid::{CellIndex, cells_on_ray};
use lrfslam_core::scan::RangeScan;
use lrfslam_core::sweep::Sweep;
use lrfslam_core::time::Instant;
use lrfslam_firmware_sim::lrf_model::{LrfModel, SimulatedLrf};
use lrfslam_firmware_sim::scenario::Scenario;
use lrfslam_host::maps::io::write_map;
use lrfslam_host::maps::occupancy::{MapConfig, Occupancy, OccupancyMap};
use lrfslam_host::scans::log::{LogOptions, LogReader};
use lrfslam_host::trajectory::{read_trajectory, with_poses};

use crate::common::{mapped, real_data, run};
use crate::map_server::{Cell, ServedMap};

/// A served map against the path on it and the scans of its log.
#[derive(Debug)]
struct Figures {
    /// Free, unknown, occupied.
    cells: [usize; 3],
    poses: usize,
    poses_not_free: usize,
    /// Share of the hits that lie in an occupied cell or beside one.
    hits_on_walls: f64,
    /// Share of them that lie in an occupied cell.
    hits_in_walls: f64,
    /// Free cells that no beam passed on its way to a hit.
    free_without_hits: usize,
    /// Those of them that no pose of the path sees but through an occupied cell.
    free_behind_walls: usize,
}

/// Maps `log` with the options `set`, and judges what was written.
fn figures(log: &Path, set: &[&str]) -> Figures {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [&["map", log.to_str().unwrap(), "--out", "out", "--quiet"], set].concat();
    assert_eq!(run(folder.path(), &arguments), (0, String::new(), String::new()));
    judge(log, &folder.path().join("out"))
}

fn centre_of(map: &ServedMap, index: usize) -> Point2 {
    let at = |origin: f64, cell: usize| (origin + (cell as f64 + 0.5) * map.resolution_m) as f32;
    Point2::new(at(map.origin_m[0], index % map.width), at(map.origin_m[1], index / map.width))
}

/// Marks the cells of the map that a beam passes; what it passes elsewhere is in none.
fn mark_passed(map: &ServedMap, passed: &mut [bool], from: Point2, hit: Point2) {
    let size_m = map.resolution_m as f32;
    let first = CellIndex::containing(centre_of(map, 0), size_m);
    for cell in cells_on_ray(from, hit, size_m) {
        let (column, row) = ((cell.column - first.column) as usize, (cell.row - first.row) as usize);
        if column < map.width && row < map.height {
            passed[row * map.width + column] = true;
        }
    }
}

fn judge(log: &Path, out: &Path) -> Figures {
    let map = ServedMap::load(&out.join("map.yaml"));
    let scans = LogReader::open(log, LogOptions::default()).unwrap().map(Result::unwrap).collect();
    let (scans, poses) = with_poses(scans, &read_trajectory(&out.join("trajectory.tum")).unwrap());
    let path: Vec<Pose2> = poses.iter().map(|pose| pose.map_from_robot).collect();
    let is = |point: Point2, wanted: Cell| map.at(f64::from(point.x), f64::from(point.y)) == wanted;
    let size_m = map.resolution_m as f32;
    let (mut hits, mut on_walls, mut in_walls) = (0, 0, 0);
    let mut passed = vec![false; map.cells.len()];
    for (scan, pose) in scans.iter().zip(&path) {
        let map_from_lrf = *pose * scan.robot_from_lrf.unwrap_or_default();
        for hit in scan.beams.iter().filter_map(Point2::of_hit) {
            let hit = map_from_lrf.transform(hit);
            mark_passed(&map, &mut passed, map_from_lrf.position(), hit);
            let near =
                [-1.0, 0.0, 1.0].map(|x| [-1.0, 0.0, 1.0].map(|y| Point2::new(hit.x + x * size_m, hit.y + y * size_m)));
            hits += 1;
            in_walls += usize::from(is(hit, Cell::Occupied));
            on_walls += usize::from(near.into_iter().flatten().any(|place| is(place, Cell::Occupied)));
        }
    }
    let alone = (0..map.cells.len()).filter(|index| map.cells[*index] == Cell::Free && !passed[*index]);
    let alone: Vec<Point2> = alone.map(|index| centre_of(&map, index)).collect();
    let seen = |place: &Point2| {
        let near = path.iter().filter(|pose| (pose.position() - *place).norm() <= 3.2);
        near.clone().any(|pose| {
            cells_on_ray(pose.position(), *place, size_m).all(|cell| {
                let middle = |at: i32| (at as f32 + 0.5) * size_m;
                !is(Point2::new(middle(cell.column), middle(cell.row)), Cell::Occupied)
            })
        })
    };
    Figures {
        cells: map.counts(),
        poses: path.len(),
        poses_not_free: path.iter().filter(|pose| !is(pose.position(), Cell::Free)).count(),
        hits_on_walls: on_walls as f64 / hits as f64,
        hits_in_walls: in_walls as f64 / hits as f64,
        free_without_hits: alone.len(),
        free_behind_walls: alone.iter().filter(|place| !seen(place)).count(),
    }
}

#[test]
fn the_path_lies_on_free_cells_and_the_hits_on_walls() {
    let log = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/floor.log.gz");
    let floor = figures(&log, &[]);
    println!("floor {floor:?}");
    assert_eq!((floor.poses, floor.poses_not_free), (806, 0), "{floor:?}");
    assert!(floor.hits_on_walls > 0.97 && floor.hits_in_walls > 0.6, "{floor:?}");
    assert!(floor.cells.iter().all(|count| *count > 1000), "free, unknown and walls: {floor:?}");
}

/// Minutes in a debug build: `LRFSLAM_DATA=... cargo test --release -p lrfslam --all-features --test cli drawn_maps -- --ignored --nocapture`
#[test]
#[ignore = "heavy: run by .ci/run"]
fn real_logs_have_no_free_cells_behind_walls() {
    for (name, hits_on_walls) in [("logs/intel.log.gz", 0.97), ("logs/aces.clf.gz", 0.91)] {
        let (Some(log), Some(results)) = (real_data(name), mapped(name)) else { continue };
        let map = judge(&log, &results);
        println!("{name}: {map:?}");
        assert_eq!(map.poses_not_free, 0, "{map:?}");
        assert!(map.hits_on_walls > hits_on_walls, "{map:?}");
        assert!(map.free_behind_walls <= map.free_without_hits && map.free_without_hits < 20, "{map:?}");
    }
    // What it would be if any beam without return cleared its way.
    let Some(log) = real_data("logs/aces.clf.gz") else { return };
    let any_miss = figures(&log, &["--set", "map.miss_apart_rad=0", "--set", "map.miss_gap_m=0"]);
    println!("aces, any miss clears: {any_miss:?}");
    assert!(any_miss.free_behind_walls > 100, "{any_miss:?}");
}

/// A corridor with dark doors and windows, and a hall behind it with a glass front: what is left out gives no echo.
const PANES: &str = "
[[polygon]]
open = true
points = [[3.9, 0], [8, 0]]
[[polygon]]
open = true
points = [[10, 0], [15, 0]]
[[polygon]]
open = true
points = [[15.9, 0], [20, 0], [20, -4], [34, -4], [34, -2]]
[[polygon]]
open = true
points = [[34, 4], [34, 6], [20, 6], [20, 2], [14, 2]]
[[polygon]]
open = true
points = [[12, 2], [5.9, 2]]
[[polygon]]
open = true
points = [[5, 2], [0, 2], [0, 0], [3, 0]]

[robot]
route = [[1, 1], [22, 1], [27, 1], [27, -2], [31.5, -2], [31.5, 4], [24, 4]]
speed_mps = 0.5
turn_degps = 45
";

/// The same floor is free: rectangles, x from and to, y from and to, m.
const PANES_FREE: [[f32; 4]; 2] = [[0.0, 20.0, 0.0, 2.0], [20.0, 34.0, -4.0, 6.0]];

const HALL: &str = "
[[polygon]]
points = [[0, 0], [30, 0], [30, 20], [0, 20]]

[robot]
route = [[2, 2], [15, 4], [15, 10], [6, 10], [6, 15], [26, 15], [26, 4]]
speed_mps = 0.5
turn_degps = 45
";
const HALL_FREE: [[f32; 4]; 1] = [[0.0, 30.0, 0.0, 20.0]];

/// Of a map drawn from the true path: cells drawn free that are not, and the share drawn free of the floor within 3 m of the path.
#[derive(Debug)]
struct Truth {
    free: usize,
    wrongly_free: usize,
    of_near_floor: f64,
}

fn against_truth(world: &str, floor: &[[f32; 4]], lrf: LrfModel, config: MapConfig) -> Truth {
    let scenario = Scenario::parse(world, "test", Path::new("")).unwrap();
    let (scene, drive) = (scenario.scene(), scenario.drive());
    let mut laser = SimulatedLrf::new(lrf, 1);
    let mut map = OccupancyMap::new(config);
    let mut path = Vec::new();
    for step in 0..drive.end().unwrap().micros / 200_000 {
        let at = Instant::from_micros(step * 200_000);
        let beams = laser.snapshot(&scene, at);
        let pose = drive.pose(at);
        let pose = Pose2::new(pose.x as f32, pose.y as f32, pose.heading as f32);
        let scan = RangeScan { stamp: at, range_max_m: lrf.range_m[1] as f32, beams: &beams };
        map.insert(&Sweep::at_rest(scan, Pose2::IDENTITY), pose);
        path.push(pose.position());
    }
    let inside = |place: Point2, margin_m: f32| {
        floor.iter().any(|[left, right, low, high]| {
            (left - margin_m..right + margin_m).contains(&place.x)
                && (low - margin_m..high + margin_m).contains(&place.y)
        })
    };
    let raster = map.raster(16_000).unwrap();
    let mut truth = Truth { free: 0, wrongly_free: 0, of_near_floor: 0.0 };
    let (mut near, mut near_free) = (0, 0);
    let size_m = config.cell_size_m;
    for row in -200..600 {
        for column in -200..1000 {
            let place = Point2::new((column as f32 + 0.5) * size_m, (row as f32 + 0.5) * size_m);
            let is_free = map.occupancy(CellIndex { column, row }) == Occupancy::Free;
            truth.free += usize::from(is_free);
            truth.wrongly_free += usize::from(is_free && !inside(place, 0.1));
            if inside(place, -0.1) && path.iter().any(|pose| (*pose - place).norm() < 3.0) {
                near += 1;
                near_free += usize::from(is_free);
            }
        }
    }
    assert_eq!(
        truth.free,
        raster.pixels.iter().filter(|pixel| **pixel == Occupancy::Free).count(),
        "all were looked at"
    );
    truth.of_near_floor = near_free as f64 / near as f64;
    truth
}

#[test]
fn a_pane_is_not_free_because_no_beam_came_back() {
    let any_miss = MapConfig { miss_apart_rad: 0.0, miss_gap_m: 0.0, ..MapConfig::default() };
    for (lrf, wrong_share) in [(LrfModel::LMS200, 0.5), (LrfModel::URG_04LX_UG01, 0.3)] {
        let [before, after] =
            [any_miss, MapConfig::default()].map(|config| against_truth(PANES, &PANES_FREE, lrf, config));
        println!("panes, {}, any miss clears: {before:?}\npanes, {}: {after:?}", lrf.name, lrf.name);
        assert!((after.wrongly_free as f64) < wrong_share * before.wrongly_free as f64, "{before:?} {after:?}");
        assert!(after.of_near_floor > 0.98, "{after:?}");
    }
}

/// From most places the laser does not reach across: misses are much of what there is.
#[test]
fn a_hall_wider_than_the_laser_sees_stays_free() {
    for lrf in [LrfModel::LMS200, LrfModel::URG_04LX_UG01] {
        let hall = against_truth(HALL, &HALL_FREE, lrf, MapConfig::default());
        println!("hall, {}: {hall:?}", lrf.name);
        assert!(hall.of_near_floor > 0.85 && hall.wrongly_free < 50, "{hall:?}");
    }
}

/// What a ROS robot reads is what was drawn; unknown is not free.
#[test]
fn map_server_reads_what_was_drawn() {
    let scenario = Scenario::parse(PANES, "test", Path::new("")).unwrap();
    let mut map = OccupancyMap::new(MapConfig::default());
    let beams = SimulatedLrf::new(LrfModel::LMS200, 1).snapshot(&scenario.scene(), Instant::default());
    let scan = RangeScan { stamp: Instant::default(), range_max_m: 8.0, beams: &beams };
    map.insert(&Sweep::at_rest(scan, Pose2::IDENTITY), Pose2::new(-3.0, 7.0, 0.5));
    let raster = map.raster(16_000).unwrap();
    let folder = tempfile::tempdir().unwrap();
    write_map(folder.path(), "map", &raster).unwrap();
    let served = ServedMap::load(&folder.path().join("map.yaml"));
    let drawn = |wanted| raster.pixels.iter().filter(|pixel| **pixel == wanted).count();
    assert_eq!(served.counts(), [Occupancy::Free, Occupancy::Unknown, Occupancy::Occupied].map(drawn));
    assert!(served.counts().iter().all(|count| *count > 0));
    for row in 0..served.height {
        for column in 0..served.width {
            let [x, y] = [(column, 0), (row, 1)]
                .map(|(cell, axis)| served.origin_m[axis] + (cell as f64 + 0.5) * served.resolution_m);
            let expected = match map.occupancy(CellIndex::containing(Point2::new(x as f32, y as f32), 0.05)) {
                Occupancy::Free => Cell::Free,
                Occupancy::Unknown => Cell::Unknown,
                Occupancy::Occupied => Cell::Occupied,
            };
            assert_eq!(served.at(x, y), expected, "{x} {y}");
        }
    }
}
