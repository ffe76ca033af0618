//! Single prints, and memory that does not fit.

use super::*;

#[test]
fn full_pool_stops_the_print_and_it_goes_on_when_there_is_room() {
    let mut memory = Memory::new(4, 8);
    let (tree, mut map, mut window) = memory.lend();
    let frame = WindowFrame::around(Point2::new(-7.0, -7.0), Point2::new(7.0, 7.0), 16, 1.0);
    window.open(&map, &tree, frame, NodeId::ROOT);
    let rays = [Ray { direction: Point2::new(1.0, 0.0), length_m: 4.5, hit: true }];
    let mut print = Print::new(&rays, Pose2::new(0.1, 0.1, 0.0));
    assert_eq!(print.run(&mut map, &mut window), Err(PoolFullError));
    assert_eq!(print.run(&mut map, &mut window), Err(PoolFullError));
    let mut skipped = 0;
    let report = loop {
        match print.run(&mut map, &mut window) {
            Ok(report) => break report,
            Err(PoolFullError) => print.skip_square(),
        }
        skipped += 1;
    };
    assert_eq!(report, PrintReport { rays_cut: 0, squares_left_out: skipped });
    assert_eq!((map.tiles_used(), skipped), (3, 7));
}

#[test]
fn a_printed_scan_looks_like_this() {
    let mut memory = Memory::new(40, 8);
    let (tree, mut map, mut window) = memory.lend();
    let frame = WindowFrame::around(Point2::new(0.0, 0.0), Point2::new(2.9, 0.9), 16, 1.0);
    window.open(&map, &tree, frame, NodeId::ROOT);
    let ray = |x, y, length_m, hit| Ray { direction: Point2::new(x, y), length_m, hit };
    let rays = [ray(1.0, 0.0, 2.0, true), ray(0.8, 0.6, 0.6, false), ray(-1.0, 0.0, 9.0, true)];
    let report = Print::new(&rays, Pose2::new(0.6, 0.3, 0.0)).run(&mut map, &mut window).unwrap();
    assert_eq!(report.rays_cut, 1, "the third ray left the frame and marks no end");
    let view = MapView::new(&map, &window);
    let corner = view.to_squares(Point2::new(0.0, 0.0));
    let picture: Vec<_> = (0..4)
        .rev()
        .map(|y| {
            let symbol = |x: i32| {
                let square = view.square(corner.x as i32 + x, corner.y as i32 + y);
                if square.hits() > 0 {
                    '#'
                } else if square.distance() > 0 {
                    '.'
                } else {
                    '?'
                }
            };
            (0..12).map(symbol).collect::<std::string::String>()
        })
        .collect();
    assert_eq!(picture, ["????????????", "???..???????", "?.........#?", "????????????"]);
}

#[test]
fn memory_that_does_not_fit_is_refused() {
    let mut memory = Memory::new(4, 8);
    memory.directory.pop();
    let lent = MapMemory {
        tiles: &mut memory.tiles,
        headers: &mut memory.headers,
        node_tiles: &mut memory.node_tiles,
        directory: &mut memory.directory,
        ages: &mut [],
    };
    assert_eq!(DistributedMap::new(&CONFIG, lent).unwrap_err(), MapMemoryError::Directory(15));
    assert_eq!(Window::new(&mut [TileId::NONE; 8]).unwrap_err(), WindowMemoryError(8));
}
