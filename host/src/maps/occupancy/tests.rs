use super::*;
use lrfslam_core::time::{Duration, Instant};

fn config() -> MapConfig {
    MapConfig { cell_size_m: 0.5, miss_clears_m: 1.0, ..MapConfig::default() }
}

fn insert(map: &mut OccupancyMap, beams: &[(f32, Echo)], pose: Pose2) {
    let beams: Vec<Beam> = beams
        .iter()
        .map(|&(degrees, echo)| Beam { bearing_rad: degrees.to_radians(), offset: Duration::ZERO, echo })
        .collect();
    let scan = RangeScan { stamp: Instant::default(), range_max_m: 80.0, beams: &beams };
    map.insert(&Sweep::at_rest(scan, Pose2::IDENTITY), pose);
}

fn picture(map: &OccupancyMap, side_max: u32) -> Vec<String> {
    let raster = map.raster(side_max).unwrap();
    let sign = |o: &Occupancy| match o {
        Occupancy::Unknown => '?',
        Occupancy::Free => '.',
        Occupancy::Occupied => '#',
    };
    raster.pixels.chunks(raster.width).map(|row| row.iter().map(sign).collect()).collect()
}

#[test]
fn hit_clears_its_way_one_miss_or_invalid_beam_nothing() {
    let beams = [(0.0, Echo::Hit(2.0)), (90.0, Echo::Miss), (180.0, Echo::Invalid), (-90.0, Echo::Hit(0.6))];
    let drawn = |config| {
        let mut map = OccupancyMap::new(config);
        insert(&mut map, &beams, Pose2::new(0.2, 0.2, 0.0));
        picture(&map, 100)
    };
    assert_eq!(drawn(config()), ["....#", "#????"]);
    assert_eq!(drawn(MapConfig { miss_apart_rad: 0.0, ..config() }), [".????", ".????", "....#", "#????"]);
}

#[test]
fn misses_free_a_cell_if_they_looked_at_it_from_directions_far_apart() {
    // All look at the cell about (2.2, 2.2), 0.7 m away, in these directions.
    let seen = |directions_deg: &[f32]| {
        let mut map = OccupancyMap::new(MapConfig { miss_apart_rad: 1.5, ..config() });
        for degrees in directions_deg {
            let [sin, cos] = [degrees.to_radians().sin(), degrees.to_radians().cos()];
            insert(&mut map, &[(*degrees, Echo::Miss)], Pose2::new(2.2 - 0.7 * cos, 2.2 - 0.7 * sin, 0.0));
        }
        map.occupancy(CellIndex { column: 4, row: 4 })
    };
    assert_eq!(seen(&[10.0; 100]), Occupancy::Unknown);
    assert_eq!(seen(&[10.0, 25.0, 40.0, 55.0, 70.0]), Occupancy::Unknown);
    assert_eq!(seen(&[10.0, 120.0]), Occupancy::Free);
    // The shorter way round counts: these two are 40 degrees apart, the next two opposite.
    assert_eq!(seen(&[-170.0, 150.0]), Occupancy::Unknown);
    assert_eq!(seen(&[-170.0, 10.0]), Occupancy::Free);
}

#[test]
fn misses_between_near_hits_end_at_the_line_between_them() {
    let drawn = |miss_gap_m| {
        let mut map = OccupancyMap::new(MapConfig { miss_gap_m, miss_apart_rad: 0.0, miss_clears_m: 3.0, ..config() });
        // A wall 1.3 m ahead, and a pane in it straight ahead.
        let wall = |degrees: f32| (degrees, Echo::Hit(1.3 / degrees.to_radians().cos()));
        insert(&mut map, &[wall(-30.0), (0.0, Echo::Miss), wall(30.0)], Pose2::new(0.2, 0.2, 0.0));
        (1..7).map(|column| map.occupancy(CellIndex { column, row: 0 }) == Occupancy::Free).collect::<Vec<_>>()
    };
    assert_eq!(drawn(2.5), [true, false, false, false, false, false]);
    // The hits are 1.5 m apart.
    assert_eq!(drawn(1.4), [true; 6]);
    assert_eq!(drawn(0.0), [true; 6]);
}

#[test]
fn misses_never_count_against_hits() {
    let drawn = |miss_apart_rad| {
        let mut map = OccupancyMap::new(MapConfig { miss_apart_rad, ..config() });
        insert(&mut map, &[(0.0, Echo::Hit(0.6))], Pose2::new(0.2, 0.2, 0.0));
        (0..100).for_each(|_| insert(&mut map, &[(0.0, Echo::Miss)], Pose2::new(0.2, 0.2, 0.0)));
        insert(&mut map, &[(180.0, Echo::Miss)], Pose2::new(1.7, 0.2, 0.0));
        picture(&map, 100)
    };
    assert_eq!(drawn(config().miss_apart_rad), [".#."]);
    // As one more pass each they would see through the wall.
    assert_eq!(drawn(0.0), ["...."]);
}

#[test]
fn far_hit_is_cleared_but_not_drawn() {
    let mut map = OccupancyMap::new(MapConfig { draw_range_m: 1.0, ..config() });
    insert(&mut map, &[(0.0, Echo::Hit(30.0))], Pose2::new(0.2, 0.2, 0.0));
    assert_eq!(picture(&map, 100), ["..."]);
}

#[test]
fn passer_by_fades_and_wall_stays() {
    let mut map = OccupancyMap::new(config());
    insert(&mut map, &[(0.0, Echo::Hit(1.0))], Pose2::new(0.2, 0.2, 0.0));
    for _ in 0..70_000 {
        insert(&mut map, &[(0.0, Echo::Hit(2.0))], Pose2::new(0.2, 0.2, 0.0));
    }
    assert_eq!(picture(&map, 100), ["....#"]);
}

#[test]
fn large_map_is_drawn_smaller_and_keeps_its_walls() {
    let mut map = OccupancyMap::new(config());
    insert(&mut map, &[(0.0, Echo::Hit(9.6)), (90.0, Echo::Hit(4.6))], Pose2::new(-3.3, 0.2, 0.0));
    let full = map.raster(100).unwrap();
    let small = map.raster(7).unwrap();
    assert_eq!((full.width, full.cells_per_pixel()), (20, 1));
    assert_eq!((small.width <= 7, small.pixels.contains(&Occupancy::Occupied)), (true, true));
    assert_eq!(small.pixel_size_m, f64::from(small.cells_per_pixel()) * 0.5);
    let (x, y) = full.position(Point2::new(full.origin_m.0 as f32, full.origin_m.1 as f32));
    assert_eq!((x, y), (0.0, full.height as f64));
}

#[test]
fn places_a_world_apart_do_not_fill_the_memory() {
    let mut map = OccupancyMap::new(config());
    for pose in [Pose2::new(-3e8, 0.0, 0.0), Pose2::new(3e8, 3e8, 0.0), Pose2::new(f32::NAN, 0.0, 0.0)] {
        insert(&mut map, &[(0.0, Echo::Hit(2.0))], pose);
    }
    assert!(map.memory_bytes() < 1 << 20);
    let raster = map.raster(2000).unwrap();
    assert!(raster.width <= 2000 && raster.height <= 2000);
    assert!(OccupancyMap::new(config()).raster(10).is_none());
}

/// A laser that turns by a radian while its mirror goes round, in a square room: every wall is one cell thick, as if it stood.
#[test]
fn a_fast_turn_draws_straight_walls() {
    let (turn_rad, sweep_s) = (1.0_f32, 0.1_f32);
    let beams: Vec<Beam> = (0..720)
        .map(|index| {
            let part = index as f32 / 719.0 - 0.5;
            let (bearing_rad, heading) = (index as f32 * std::f32::consts::TAU / 720.0, turn_rad * part);
            let ahead = Point2::from_polar(1.0, bearing_rad + heading);
            let range_m = 3.25 / ahead.x.abs().max(ahead.y.abs());
            let offset = Duration::from_micros(((part + 0.5) * sweep_s * 1e6) as i64);
            Beam { bearing_rad, offset, echo: Echo::Hit(range_m) }
        })
        .collect();
    let scan = RangeScan { stamp: Instant::default(), range_max_m: 80.0, beams: &beams };
    let motion = SweepMotion {
        displacement: Pose2::new(0.0, 0.0, turn_rad),
        duration: Duration::from_micros((sweep_s * 1e6) as i64),
    };
    let off_walls = |motion| {
        let mut map = OccupancyMap::new(config());
        map.insert(&Sweep { scan, robot_from_lrf: Pose2::IDENTITY, motion }, Pose2::IDENTITY);
        let walls = (-12..12).flat_map(|row| (-12..12).map(move |column| CellIndex { column, row }));
        let is_wall = |cell: &CellIndex| [cell.column, cell.row].into_iter().any(|index| index == 6 || index == -7);
        let occupied: Vec<_> = walls.filter(|cell| map.occupancy(*cell) == Occupancy::Occupied).collect();
        assert!(occupied.len() > 30, "{occupied:?}");
        occupied.iter().filter(|cell| !is_wall(cell)).count()
    };
    assert_eq!(off_walls(motion), 0);
    assert!(off_walls(SweepMotion::default()) > 10, "{}", off_walls(SweepMotion::default()));
}
