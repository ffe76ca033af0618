//! A stretch of scans as one step, and the restart in a map of them.

use super::*;

/// A stretch of scans taken at known poses, seen from its start.
struct Known<'s>(&'s [(Pose2, Vec<Beam>)]);

impl Stretch for Known<'_> {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn scan(&mut self, index: usize) -> Option<(Pose2, Sweep<'_>)> {
        self.0.get(index).map(|(pose, beams)| (*pose, as_sweep(beams)))
    }
}

/// The squares that a particle sees, by place.
fn seen(slam: &LowSlam<'_, SIDE>, particle: usize) -> Vec<(crate::distributed_map::TilePlace, Vec<u8>)> {
    let leaf = slam.particles()[particle].node;
    let mut tiles: Vec<_> = Vec::new();
    for (place, tile) in slam.map().tiles_seen_from(slam.ancestry(), leaf) {
        if tiles.iter().all(|(known, _)| *known != place) {
            let squares = tile.rows().iter().flatten();
            tiles.push((place, squares.flat_map(|square| std::format!("{square:?}").into_bytes()).collect()));
        }
    }
    tiles.sort_by_key(|(place, _)| *place);
    tiles
}

fn still() -> ScanMatchingMotion {
    let config = ScanMatchingMotionConfig { forward_m: 0.0, lateral_m: 0.0, heading_deg: 0.0, ..Default::default() };
    ScanMatchingMotion::new(&config, &MatchedMotion::default())
}

#[test]
fn restarted_filter_has_the_map_it_is_given_and_nothing_else() {
    let mut config = configs(20);
    config.map.print_step = 1;
    let scans: Vec<(Pose2, Vec<Beam>)> =
        path(12).enumerate().map(|(step, pose)| (pose, scan_at(pose, step as u32))).collect();
    let (mut used, mut fresh) = (Memory::new(20, 20, 6000), Memory::new(20, 20, 6000));
    let mut slam = LowSlam::new(&config, 5, used.lend()).unwrap();
    let mut before = Pose2::IDENTITY;
    for (step, pose) in path(40).enumerate() {
        slam.step(&as_sweep(&scan_at(pose, step as u32)), &biased(before, pose)).unwrap();
        before = pose;
    }
    let mut other = LowSlam::new(&config, 5, fresh.lend()).unwrap();
    let end = scans[11].0;
    for slam in [&mut slam, &mut other] {
        slam.restart_at(end);
        for (pose, beams) in &scans {
            assert_eq!(slam.refer_to(&as_sweep(beams), *pose), Ok(0));
        }
        assert_eq!((slam.particles().len(), slam.particles()[0].map_from_robot), (1, end));
    }
    assert_eq!(seen(&slam, 0), seen(&other, 0));
    assert_eq!((slam.map().tiles_used(), slam.ancestry().nodes_used()), (other.map().tiles_used(), 1));
    let pose = end * Pose2::new(0.08, 0.0, 0.1);
    let report = slam.step(&as_sweep(&scan_at(pose, 77)), &biased(end, pose)).unwrap();
    assert_eq!(report.samples, 20);
    assert!(distance(report.map_from_robot, pose) < 0.05, "{report:?}");
    // Its 20 particles go on in the map of the other one, which was told the same scans.
    let (expected, tiles) = (seen(&other, 0), other.map().tiles_used());
    slam.go_on_in(&mut other, end);
    assert_eq!((slam.particles().len(), slam.particles()[0].map_from_robot), (1, end));
    assert_eq!((seen(&slam, 0), slam.map().tiles_used()), (expected, tiles));
    let report = slam.step(&as_sweep(&scan_at(pose, 78)), &biased(end, pose)).unwrap();
    assert!(report.samples == 20 && distance(report.map_from_robot, pose) < 0.05, "{report:?}");
}

/// Particles that are not moved apart: a stretch prints what its scans print one by one, and moves them to its end.
#[test]
fn a_stretch_prints_its_scans_where_they_were_taken() {
    let mut config = configs(5);
    config.map.print_step = 1;
    let scans: Vec<(Pose2, Vec<Beam>)> =
        path(9).enumerate().map(|(step, pose)| (pose, scan_at(pose, step as u32))).collect();
    let (mut memory, mut one_by_one) = (Memory::new(5, 5, 6000), Memory::new(5, 5, 6000));
    let mut slam = LowSlam::new(&config, 5, memory.lend()).unwrap();
    let end = scans[8].0;
    let all = |weighing: &Weighing<'_, '_, SIDE>, samples: &mut [Sample], window: &mut Window<'_>| {
        weighing.weigh_all(samples, window);
    };
    slam.step_along(&mut Known(&scans), end, &still(), all).unwrap();
    let mut other = LowSlam::new(&config, 5, one_by_one.lend()).unwrap();
    other.restart_at(Pose2::IDENTITY);
    scans.iter().for_each(|(pose, beams)| assert_eq!(other.refer_to(&as_sweep(beams), *pose), Ok(0)));
    assert_eq!(seen(&slam, 0), seen(&other, 0));
    assert_eq!(slam.particles()[0].map_from_robot, end);
}

/// The start of a second stretch is 0.2 m beside what is believed: the weights of its scans together find it.
#[test]
fn a_stretch_is_weighed_as_one() {
    let mut config = configs(200);
    config.filter.samples_per_particle = 5;
    let scans = |from: usize| -> Vec<(Pose2, Vec<Beam>)> {
        let start = path(60).nth(from).unwrap();
        let own = path(60).skip(from).take(20).enumerate();
        own.map(|(step, pose)| (start.between(pose), scan_at(pose, (from + step) as u32))).collect()
    };
    let mut memory = Memory::new(200, 1000, 20000);
    let mut slam = LowSlam::new(&config, 5, memory.lend()).unwrap();
    let all = |weighing: &Weighing<'_, '_, SIDE>, samples: &mut [Sample], window: &mut Window<'_>| {
        weighing.weigh_all(samples, window);
    };
    let places: Vec<Pose2> = path(60).collect();
    let first = scans(0);
    slam.step_along(&mut Known(&first), places[20] * Pose2::new(0.15, -0.12, 0.03), &still(), all).unwrap();
    let wide = ScanMatchingMotionConfig { forward_m: 0.1, lateral_m: 0.1, heading_deg: 2.0, ..Default::default() };
    let wide = ScanMatchingMotion::new(&wide, &MatchedMotion::default());
    let second = scans(20);
    let report = slam.step_along(&mut Known(&second), places[20].between(places[40]), &wide, all).unwrap();
    assert!(distance(report.map_from_robot, places[40]) < 0.06, "{report:?} {:?}", places[40]);
}
