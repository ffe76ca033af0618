use super::*;
use crate::ancestry::{Ancestry, Node, NodeId};
use crate::chords::Chord;
use crate::geometry::{Point2, Pose2};
use crate::math::{sin_cos, uniform};
use crate::random::RandomStream;
use crate::rays::Ray;
use proptest::prelude::*;
use std::collections::HashMap;
use std::vec;
use std::vec::Vec;

const SIDE: usize = 4;
const CONFIG: ParticleMapConfig = ParticleMapConfig { square_size_m: 0.25, print_step: 1 };
type WholeMap = HashMap<(i32, i32), Square>;

/// Memory for a map, to be lent.
struct Memory {
    nodes: Vec<Node>,
    tiles: Vec<Tile<SIDE>>,
    headers: Vec<TileHeader>,
    node_tiles: Vec<TileId>,
    directory: Vec<TileId>,
    slots: Vec<TileId>,
}

impl Memory {
    fn new(tiles: usize, nodes: usize) -> Self {
        Self {
            nodes: vec![Node::default(); nodes],
            tiles: vec![Tile::UNSEEN; tiles],
            headers: vec![TileHeader::default(); tiles],
            node_tiles: vec![TileId::NONE; nodes],
            directory: vec![TileId::NONE; 16],
            slots: vec![TileId::NONE; 16 * 16],
        }
    }

    fn lend(&mut self) -> (Ancestry<'_>, DistributedMap<'_, SIDE>, Window<'_>) {
        let memory = MapMemory {
            tiles: &mut self.tiles,
            headers: &mut self.headers,
            node_tiles: &mut self.node_tiles,
            directory: &mut self.directory,
            ages: &mut [],
        };
        let map = DistributedMap::new(&CONFIG, memory).unwrap();
        (Ancestry::new(&mut self.nodes).unwrap(), map, Window::new(&mut self.slots).unwrap())
    }
}

/// A particle of a filter that copies whole maps.
#[derive(Clone)]
struct Copying {
    node: NodeId,
    map: WholeMap,
}

struct Rig<'m> {
    tree: Ancestry<'m>,
    map: DistributedMap<'m, SIDE>,
    window: Window<'m>,
    particles: Vec<Copying>,
    rng: RandomStream,
    centre: Point2,
}

impl<'m> Rig<'m> {
    fn new(memory: &'m mut Memory, seed: u64) -> Self {
        let (tree, map, window) = memory.lend();
        let particles = vec![Copying { node: NodeId::ROOT, map: WholeMap::new() }];
        Self { tree, map, window, particles, rng: RandomStream::new(seed, 0, 0), centre: Point2::default() }
    }

    fn prune(&mut self, index: usize) {
        let leaf = self.particles[index].node;
        if let Some(merged) = self.tree.prune(leaf, &mut self.map)
            && let Some(particle) = self.tree.particle(merged)
        {
            self.particles[particle].node = merged;
        }
    }

    /// `children[i]` is the number of survivors that descend from particle i.
    fn resample(&mut self, children: &[usize]) {
        for index in 0..self.particles.len() {
            self.tree.set_particle(self.particles[index].node, index as u16);
        }
        for (index, count) in children.iter().enumerate() {
            if *count == 0 {
                self.prune(index);
            }
        }
        let mut survivors = Vec::new();
        for (particle, count) in self.particles.iter().zip(children) {
            for _ in 0..*count {
                let node = if *count == 1 { particle.node } else { self.tree.add(particle.node).unwrap() };
                survivors.push(Copying { node, map: particle.map.clone() });
            }
        }
        self.particles = survivors;
    }

    /// Prints a random scan of a few rays into every particle's map, and into its copy.
    fn print(&mut self) {
        let tile_m = SIDE as f32 * CONFIG.square_size_m;
        let reach = Point2::new(5.5, 5.5);
        let side = self.window.side();
        let frame = WindowFrame::around(self.centre - reach, self.centre + reach, side, tile_m);
        self.window.open(&self.map, &self.tree, frame, self.tree.first_leaf(NodeId::ROOT));
        for index in 0..self.particles.len() {
            assert_eq!(self.window.leaf(), self.particles[index].node, "particles are in the tree's order");
            let rays: Vec<Ray> = (0..3).map(|_| self.random_ray()).collect();
            let offset = Point2::new(self.random(-0.5, 0.5), self.random(-0.5, 0.5));
            let at = self.centre + offset;
            let pose = Pose2::new(at.x, at.y, self.random(-3.0, 3.0));
            self.print_copy(index, &rays, pose);
            Print::new(&rays, pose).run(&mut self.map, &mut self.window).unwrap();
            self.compare_window(index);
            if index + 1 < self.particles.len() {
                self.window.next_leaf(&self.map, &self.tree).unwrap();
            }
        }
        assert_eq!(self.window.next_leaf(&self.map, &self.tree), None);
    }

    fn print_copy(&mut self, index: usize, rays: &[Ray], pose: Pose2) {
        let corner = self.window.place_of(0);
        let origin = (i32::from(corner.column) * SIDE as i32, i32::from(corner.row) * SIDE as i32);
        let start = self.window.to_squares::<SIDE>(pose.position(), CONFIG.square_size_m);
        let (sin, cos) = sin_cos(pose.heading);
        for ray in rays {
            let direction = Point2::new(
                cos * ray.direction.x - sin * ray.direction.y,
                sin * ray.direction.x + cos * ray.direction.y,
            );
            let (chords, cut) = self.window.ray::<SIDE>(start, direction, ray.length_m / CONFIG.square_size_m);
            let chords: Vec<Chord> = chords.collect();
            for (place, chord) in chords.iter().enumerate() {
                let square = self.particles[index].map.entry((chord.x + origin.0, chord.y + origin.1)).or_default();
                let is_end = ray.hit && !cut && place + 1 == chords.len();
                *square = if is_end { square.stopped(chord.length()) } else { square.passed(chord.length()) };
            }
        }
    }

    /// What the window shows is what the copy holds.
    fn compare_window(&self, index: usize) {
        let corner = self.window.place_of(0);
        let origin = (i32::from(corner.column) * SIDE as i32, i32::from(corner.row) * SIDE as i32);
        let view = MapView::new(&self.map, &self.window);
        for ((x, y), square) in &self.particles[index].map {
            let (x, y) = (x - origin.0, y - origin.1);
            let reach = 6 * SIDE as i32..10 * SIDE as i32;
            if reach.contains(&x) && reach.contains(&y) {
                assert_eq!(view.square(x, y), *square);
            }
        }
    }

    /// What a particle sees anywhere is what the copy holds, and no tile is in use that nobody owns.
    fn compare_all(&self) {
        for particle in &self.particles {
            let mut seen: HashMap<TilePlace, &Tile<SIDE>> = HashMap::new();
            for (place, tile) in self.map.tiles_seen_from(&self.tree, particle.node) {
                seen.entry(place).or_insert(tile);
            }
            let mut squares = WholeMap::new();
            for (place, tile) in seen {
                for (y, row) in tile.rows().iter().enumerate() {
                    for (x, square) in row.iter().enumerate().filter(|(_, square)| **square != Square::UNSEEN) {
                        let corner = (i32::from(place.column) * SIDE as i32, i32::from(place.row) * SIDE as i32);
                        squares.insert((corner.0 + x as i32, corner.1 + y as i32), *square);
                    }
                }
            }
            let copy = particle.map.iter().filter(|(_, square)| **square != Square::UNSEEN);
            assert_eq!(squares.len(), copy.clone().count());
            assert!(copy.clone().all(|(place, square)| squares.get(place) == Some(square)));
            self.compare_squares(particle);
        }
    }

    /// Squares looked up one by one are those of the copy; of places never seen, too.
    fn compare_squares(&self, particle: &Copying) {
        let middle = |(column, row): (i32, i32)| Point2::new(column as f32 + 0.5, row as f32 + 0.5);
        let at = |place| middle(place) * CONFIG.square_size_m;
        for (place, square) in &particle.map {
            assert_eq!(self.map.square_at(&self.tree, particle.node, at(*place)), *square);
            let beside = (place.0, place.1 + 1000);
            let far = particle.map.get(&beside).copied().unwrap_or_default();
            assert_eq!(self.map.square_at(&self.tree, particle.node, at(beside)), far);
        }
    }

    fn random(&mut self, low: f32, high: f32) -> f32 {
        low + uniform(&mut self.rng) * (high - low)
    }

    fn random_ray(&mut self) -> Ray {
        let (sin, cos) = sin_cos(self.random(-3.0, 3.0));
        Ray { direction: Point2::new(cos, sin), length_m: self.random(0.1, 4.0), hit: uniform(&mut self.rng) < 0.7 }
    }

    /// Random numbers of children, at most `limit` in all.
    fn random_children(&mut self, limit: usize) -> Vec<usize> {
        let mut room = limit;
        let mut children: Vec<usize> = (0..self.particles.len())
            .map(|_| {
                let count = ((uniform(&mut self.rng) * 2.6) as usize).min(room);
                room -= count;
                count
            })
            .collect();
        if children.iter().all(|count| *count == 0) {
            children[0] = 2.min(limit);
        }
        children
    }

    fn generation(&mut self, limit: usize) {
        let children = self.random_children(limit);
        self.resample(&children);
        self.centre = self.centre + Point2::new(self.random(-0.7, 0.9), self.random(-0.8, 0.8));
        self.print();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn map_read_through_every_particle_is_the_one_a_copying_filter_holds(seed in any::<u64>()) {
        let mut memory = Memory::new(6000, 20);
        let mut rig = Rig::new(&mut memory, seed);
        for _ in 0..30 {
            rig.generation(10);
            rig.compare_all();
        }
    }
}

#[test]
fn nothing_is_known_of_a_point_that_is_nowhere() {
    let mut memory = Memory::new(10, 2);
    let (tree, mut map, mut window) = memory.lend();
    window.open(
        &map,
        &tree,
        WindowFrame::around(Point2::new(-3.0, -3.0), Point2::new(3.0, 3.0), 16, 1.0),
        NodeId::ROOT,
    );
    let ray = Ray { direction: Point2::new(1.0, 0.0), length_m: 1.0, hit: true };
    Print::new(&[ray], Pose2::new(0.1, 0.1, 0.0)).run(&mut map, &mut window).unwrap();
    let at = |x: f32| map.square_at(&tree, NodeId::ROOT, Point2::new(x, 0.1));
    assert_eq!((at(1.1).hits(), at(0.6).hits(), at(0.6).distance()), (1, 0, 8));
    for nowhere in [f32::NAN, f32::INFINITY, -1e30, 40_000.0, 1.4, -0.1] {
        assert_eq!(at(nowhere), Square::UNSEEN, "{nowhere}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]
    #[test]
    fn tiles_that_were_away_are_seen_again_as_they_were(seed in any::<u64>()) {
        let mut memory = Memory::new(6000, 20);
        let mut rig = Rig::new(&mut memory, seed);
        rig.map.keep_free(3);
        let everywhere = Region { columns: [i16::MIN, i16::MAX], rows: [i16::MIN, i16::MAX] };
        let mut were_away = 0;
        for _ in 0..40 {
            rig.centre = rig.centre + Point2::new(0.6, 0.0);
            let middle = (rig.centre.x as i16, rig.centre.y as i16);
            let is_far = |place: &TilePlace| (place.column - middle.0).abs() > 7 || (place.row - middle.1).abs() > 7;
            let places: Vec<TilePlace> = rig.map.settled_places().filter(is_far).collect();
            let used = rig.map.tiles_used();
            let mut away = Vec::new();
            for place in &places {
                let mut bytes = [0; 2 * SIDE * SIDE];
                rig.map.settled_tile(*place).unwrap().to_bytes(&mut bytes).unwrap();
                prop_assert!(rig.map.let_go(*place) && !rig.map.let_go(*place));
                away.push(bytes);
            }
            prop_assert_eq!(rig.map.tiles_used(), used - places.len());
            rig.generation(10);
            for (place, bytes) in places.iter().zip(&away) {
                let tile = || Tile::from_bytes(bytes).unwrap();
                let used = rig.map.tiles_used();
                let [first, second, third] = [(); 3].map(|()| rig.map.hold(*place, tile()));
                prop_assert!(rig.map.settled_tile(*place).is_none() && rig.map.tiles_used() == used);
                prop_assert_eq!(rig.map.restore(first.unwrap(), &everywhere), Restored::Done);
                prop_assert_eq!(rig.map.restore(second.unwrap(), &everywhere), Restored::IsKnown);
                prop_assert_eq!(rig.map.restore(third.unwrap(), &Region::default()), Restored::IsElsewhere);
                prop_assert_eq!(rig.map.tiles_used(), used + 1);
            }
            rig.compare_all();
            were_away += places.len();
        }
        prop_assert!(were_away > 100, "{}", were_away);
    }
}

#[test]
fn a_tile_that_a_particle_has_changed_stays() {
    let mut memory = Memory::new(200, 20);
    let mut rig = Rig::new(&mut memory, 3);
    rig.print();
    let settled: Vec<TilePlace> = rig.map.settled_places().collect();
    rig.resample(&[2]);
    rig.print();
    let changed: Vec<TilePlace> =
        settled.iter().copied().filter(|place| rig.map.settled_tile(*place).is_none()).collect();
    assert!(!changed.is_empty());
    assert!(changed.iter().all(|place| !rig.map.let_go(*place)));
    rig.compare_all();
    // One line is left: its changes are everybody's.
    rig.resample(&[1, 0]);
    assert!(changed.iter().all(|place| rig.map.let_go(*place)));
}

#[test]
fn tiles_kept_free_are_for_those_that_come_back() {
    let mut memory = Memory::new(40, 20);
    let mut rig = Rig::new(&mut memory, 4);
    let tile = Tile::from_bytes(&[1; 2 * SIDE * SIDE]).unwrap();
    rig.map.keep_free(30);
    let rays = [Ray { direction: Point2::new(1.0, 0.0), length_m: 20.0, hit: true }];
    let frame = WindowFrame::around(Point2::new(-1.0, -1.0), Point2::new(12.0, 1.0), 16, 1.0);
    rig.window.open(&rig.map, &rig.tree, frame, NodeId::ROOT);
    assert_eq!(Print::new(&rays, Pose2::new(0.1, 0.1, 0.0)).run(&mut rig.map, &mut rig.window), Err(PoolFullError));
    assert_eq!(rig.map.tiles_used(), 9);
    let far = Region { columns: [100, 130], rows: [0, 1] };
    let mut hold = |column| rig.map.hold(TilePlace { column, row: 0 }, tile.clone());
    let held: Vec<HeldTile> = (100..130).map(|column| hold(column).unwrap()).collect();
    assert_eq!(hold(99), Err(PoolFullError));
    assert_eq!((rig.map.tiles_used(), rig.map.room_to_hold()), (9, 30));
    for tile in held {
        assert_eq!(rig.map.restore(tile, &far), Restored::Done);
    }
    assert_eq!((rig.map.tiles_used(), rig.map.room_to_hold()), (39, 0));
    assert!(Tile::<SIDE>::from_bytes(&[0; 3]).is_none());
}

#[test]
fn no_tile_leaks_over_a_hundred_thousand_generations() {
    let mut memory = Memory::new(4000, 8);
    let mut rig = Rig::new(&mut memory, 5);
    for _ in 0..100_000 {
        let children = rig.random_children(4);
        rig.resample(&children);
        // The robot stays about the origin, so that the history all agree on stays small.
        rig.centre = Point2::new(rig.random(-2.0, 2.0), rig.random(-2.0, 2.0));
        rig.particles.iter_mut().for_each(|particle| particle.map.clear());
        let rays = [rig.random_ray()];
        let frame = WindowFrame::around(Point2::new(-7.0, -7.0), Point2::new(7.0, 7.0), 16, 1.0);
        let pose = Pose2::new(rig.centre.x, rig.centre.y, 0.0);
        rig.window.open(&rig.map, &rig.tree, frame, rig.tree.first_leaf(NodeId::ROOT));
        loop {
            Print::new(&rays, pose).run(&mut rig.map, &mut rig.window).unwrap();
            if rig.window.next_leaf(&rig.map, &rig.tree).is_none() {
                break;
            }
        }
    }
    for index in 0..rig.particles.len() {
        rig.tree.set_particle(rig.particles[index].node, index as u16);
    }
    (1..rig.particles.len()).for_each(|index| rig.prune(index));
    assert_eq!(rig.tree.nodes_used(), 1);
    let seen = rig.map.tiles_seen_from(&rig.tree, NodeId::ROOT).count();
    assert_eq!(rig.map.tiles_used(), seen);
    assert!(seen <= 14 * 14, "{seen} tiles for a place of 14 × 14");
}

/// So a robot with little memory and a computer weigh particles to the same bits.
#[test]
fn positions_in_windows_and_tiles_of_other_sizes_differ_by_whole_squares() {
    let mut memory = Memory::new(4, 8);
    let (tree, map, mut window) = memory.lend();
    let mut rng = RandomStream::new(11, 0, 0);
    for _ in 0..2000 {
        let mut draw = || 40.0 * uniform(&mut rng) - 20.0;
        let point = Point2::new(draw(), draw());
        let mut fractions = |side| {
            window.open(&map, &tree, WindowFrame::around(point, point, side, 0.4), NodeId::ROOT);
            let positions = [window.to_squares::<4>(point, 0.1), window.to_squares::<16>(point, 0.1)];
            positions.map(|Point2 { x, y, .. }| [x - libm::floorf(x), y - libm::floorf(y)].map(f32::to_bits))
        };
        let [small, large] = [fractions(4), fractions(64)];
        assert!(small[0] == small[1] && small == large, "{point:?}: {small:x?} {large:x?}");
    }
}

mod printing;
