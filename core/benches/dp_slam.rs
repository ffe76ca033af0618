//! What DP-SLAM's low level costs: a ray, a sample, a step, the tree; and the memory a particle takes.
//!
//! `cargo bench -p lrfslam-core --bench dp_slam`. The rays are those of a corridor of 4 m width, 3 m long on average, squares of 5 cm;
//! `long_ray` measures rays of 8 m.

mod rig;

use divan::Bencher;
use divan::counter::ItemsCount;
use lrfslam_core::ancestry::{Ancestry, Node, NodeId};
use lrfslam_core::distributed_map::{
    DistributedMap, MapMemory, MapView, ParticleMapConfig, Print, Tile, TileHeader, TileId, Window, WindowFrame,
};
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::low_slam::{LowSlam, LowSlamConfig, LowSlamConfigs};
use lrfslam_core::perception::{PerceptionConfig, PerceptionModel};
use lrfslam_core::rays::Ray;
use rig::SIDE;

fn main() {
    for particles in [50, 200] {
        let (slam, _) = driven(configs(particles, 1), 150);
        let tiles = slam.map().tiles_used();
        let bytes = tiles * (size_of::<Tile<SIDE>>() + size_of::<TileHeader>());
        println!(
            "{particles} draws: {} particles alive, {tiles} tiles, {} bytes per particle alive",
            slam.particles().len(),
            bytes / slam.particles().len()
        );
    }
    divan::main();
}

fn configs(particles: u16, samples_per_particle: u16) -> LowSlamConfigs {
    let filter = LowSlamConfig { particles, particles_min: particles, samples_per_particle };
    LowSlamConfigs { filter, ..Default::default() }
}

/// A filter that has driven so many steps, and the next step.
fn driven(config: LowSlamConfigs, steps: u32) -> (LowSlam<'static, SIDE>, u32) {
    let mut slam = rig::filter(&config, 120_000);
    for step in 0..steps {
        let beams = rig::beams_at(rig::pose_at(step), step);
        slam.step(&rig::as_sweep(&beams), &rig::motion_at(step)).expect("rays fit");
    }
    (slam, steps)
}

/// One sample weighed by a ray that runs 8 m through seen, free squares to its end, 160 to 226 squares.
#[divan::bench]
fn long_ray(bencher: Bencher<'_, '_>) {
    let mut slots = vec![TileId::NONE; 32 * 32];
    let (mut nodes, mut node_tiles) = ([Node::default(); 2], [TileId::NONE; 2]);
    let (mut tiles, mut headers) = (vec![Tile::<SIDE>::UNSEEN; 1000], vec![TileHeader::default(); 1000]);
    let mut directory = vec![TileId::NONE; 1024];
    let memory = MapMemory {
        tiles: &mut tiles,
        headers: &mut headers,
        node_tiles: &mut node_tiles,
        directory: &mut directory,
        ages: &mut [],
    };
    let config = ParticleMapConfig::default();
    let mut map = DistributedMap::new(&config, memory).expect("memory fits");
    let tree = Ancestry::new(&mut nodes).expect("memory fits");
    let mut window = Window::new(&mut slots).expect("memory fits");
    let reach = Point2::new(9.0, 9.0);
    window.open(&map, &tree, WindowFrame::around(reach * -1.0, reach, 32, 0.8), NodeId::ROOT);
    let rays: Vec<Ray> = (0..720)
        .map(|i| {
            let (sin, cos) = lrfslam_core::math::sin_cos((0.5 * i as f32).to_radians());
            Ray { direction: Point2::new(cos, sin), length_m: 8.0, hit: true }
        })
        .collect();
    for _ in 0..4 {
        Print::new(&rays, Pose2::IDENTITY).run(&mut map, &mut window).expect("tiles suffice");
    }
    let model = PerceptionModel::new(&PerceptionConfig::default(), config.square_size_m);
    let view = MapView::new(&map, &window);
    bencher
        .counter(ItemsCount::new(rays.len()))
        .bench_local(|| model.log_likelihood(view, divan::black_box(&rays), Pose2::new(0.01, 0.02, 0.003)));
}

/// A whole step of the filter; items are samples.
#[divan::bench(args = [(50, 1), (50, 10), (100, 1), (200, 1)], sample_count = 60)]
fn step(bencher: Bencher<'_, '_>, (particles, shares): (u16, u16)) {
    let (mut slam, mut step) = driven(configs(particles, shares), 60);
    bencher
        .counter(ItemsCount::new(usize::from(particles * shares)))
        .with_inputs(|| {
            step += 1;
            (rig::beams_at(rig::pose_at(step), step), rig::motion_at(step))
        })
        .bench_local_values(|(beams, motion)| slam.step(&rig::as_sweep(&beams), &motion));
}

/// A generation of the tree alone: half of the leaves go, the others get two children each.
#[divan::bench(args = [16, 64, 256, 1024])]
fn advance(bencher: Bencher<'_, '_>, particles: usize) {
    let mut nodes = vec![Node::default(); 2 * particles];
    let mut tree = Ancestry::new(&mut nodes).expect("memory fits");
    let mut leaves = vec![NodeId::ROOT];
    bencher.counter(ItemsCount::new(particles)).bench_local(|| {
        let survivors = leaves.len().min(particles / 2);
        for leaf in leaves.drain(survivors..).rev() {
            tree.prune(leaf, &mut ());
        }
        let mut next = Vec::with_capacity(particles);
        let mut leaf = Some(tree.first_leaf(NodeId::ROOT));
        while let Some(parent) = leaf {
            leaf = following_leaf(&tree, parent);
            next.extend([tree.add(parent), tree.add(parent)].into_iter().flatten());
        }
        leaves = next;
        leaves.len()
    });
}

fn following_leaf(tree: &Ancestry<'_>, leaf: NodeId) -> Option<NodeId> {
    let sibling = tree.upwards(leaf).find_map(|node| tree.next_sibling(node))?;
    Some(tree.first_leaf(sibling))
}
