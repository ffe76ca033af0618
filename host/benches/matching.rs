//! What matching costs: NDT build, score per point, one whole match at the thesis's strength, on real scan pairs.
//!
//! `LRFSLAM_DATA=folder cargo bench -p lrfslam-host --bench matching`. Without the real logs a room is used.

use std::path::Path;

use divan::Bencher;
use divan::counter::ItemsCount;
use lrfslam_core::de::{DeConfig, Member};
use lrfslam_core::filter::{FilterConfig, hits, thin};
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::matcher::{MatcherConfig, Prediction, ScanMatcher, SearchConfig};
use lrfslam_core::ndt::{DirectoryEntry, NdtConfig, NdtGrid, NdtTile};
use lrfslam_core::random::RandomStream;
use lrfslam_core::sweep::Sweep;
use lrfslam_host::scans::log::{LogOptions, LogReader};

fn main() {
    divan::main();
}

/// Two scans one after the other: hits of the first, filtered points of both.
struct Pair {
    hits: Vec<Point2>,
    target: Vec<Point2>,
    source: Vec<Point2>,
}

/// Every 1500th pair of the Intel log, or a rectangle of points if the log is not there.
fn pairs() -> Vec<Pair> {
    let folder = std::env::var("LRFSLAM_DATA").unwrap_or_else(|_| "../shared/data".into());
    let file = Path::new(&folder).join("logs/intel.log.gz");
    let Ok(log) = LogReader::open(&file, LogOptions::default()) else {
        eprintln!("no logs/intel.log.gz in LRFSLAM_DATA: a simulated room instead");
        let room: Vec<_> = (0..180).map(|i| Point2::from_polar(4.0, (i as f32).to_radians())).collect();
        return vec![Pair { hits: room.clone(), target: room.clone(), source: room }];
    };
    let scans: Vec<_> = log.filter_map(Result::ok).collect();
    let points = |index: usize, radius_m| {
        let (mut raw, mut memory) = (vec![Point2::default(); 400], vec![Point2::default(); 400]);
        let hits = hits(&Sweep::at_rest(scans[index].scan(), Pose2::IDENTITY), &mut raw);
        let kept = hits.and_then(|hits| thin(&FilterConfig { radius_m }, hits, &mut memory));
        kept.map(<[_]>::to_vec).unwrap_or_default()
    };
    let pair = |i| Pair { hits: points(i, 0.0), target: points(i, 0.1), source: points(i + 1, 0.1) };
    (0..scans.len() - 1).step_by(1500).map(pair).collect()
}

struct Memory {
    directory: Vec<DirectoryEntry>,
    tiles: Vec<NdtTile>,
}

impl Memory {
    fn new() -> Self {
        Self {
            directory: vec![DirectoryEntry::default(); NdtConfig::DIRECTORIES_MAX * 512 * 512],
            tiles: vec![NdtTile::EMPTY; 16000],
        }
    }

    fn grid(&mut self, config: &NdtConfig, hits: &[Point2]) -> NdtGrid<'_> {
        let directory = &mut self.directory[..config.directories() * 512 * 512];
        let mut grid = NdtGrid::new(config, directory, &mut self.tiles).expect("the memory has the right form");
        grid.insert(hits, Pose2::IDENTITY);
        grid
    }
}

/// Into a grid that lives on, as the whole map does: items are points.
#[divan::bench(args = [1, 2, 4])]
fn insert_scan(bencher: Bencher<'_, '_>, grids: u16) {
    let pairs = pairs();
    let mut memory = Memory::new();
    let mut grid = memory.grid(&NdtConfig { grids, ..NdtConfig::default() }, &[]);
    let points: usize = pairs.iter().map(|pair| pair.hits.len()).sum();
    bencher.counter(ItemsCount::new(points)).bench_local(|| {
        for pair in &pairs {
            grid.insert(&pair.hits, Pose2::IDENTITY);
        }
    });
}

/// One evaluation of eq. (4.42) over a scan on one grid: items are points.
#[divan::bench]
fn score(bencher: Bencher<'_, '_>) {
    let pairs = pairs();
    let pair = &pairs[pairs.len() / 2];
    let mut memory = Memory::new();
    let grid = memory.grid(&NdtConfig::default(), &pair.hits);
    let mut pose = Pose2::new(0.05, 0.02, 0.03);
    bencher.counter(ItemsCount::new(pair.source.len())).bench_local(|| {
        pose.x = 0.1 - pose.x;
        grid.search_score(&pair.source, divan::black_box(pose), 0.0)
    });
}

/// One whole match at NP = 100, G = 50 with the stop at fitness 1 switched off; items are matches.
#[divan::bench(args = ["thesis", "default"])]
fn whole_match(bencher: Bencher<'_, '_>, kind: &str) {
    let pairs = pairs();
    let grids = if kind == "default" { 4 } else { 1 };
    let ndt = NdtConfig { cell_size_m: 1.0, grids, ..NdtConfig::default() };
    let mut memories: Vec<_> = pairs.iter().map(|_| Memory::new()).collect();
    let grids = memories.iter_mut().zip(&pairs).map(|(memory, pair)| memory.grid(&ndt, &pair.hits));
    let grids: Vec<_> = grids.collect();
    let mut population = vec![Member::EMPTY; 100];
    let de = DeConfig { stop_fitness: 0.0, ..DeConfig::default() };
    let config = match kind {
        "thesis" => {
            MatcherConfig { newton_steps: 0, prior_position_m: 0.0, prior_heading_deg: 0.0, ..Default::default() }
        }
        _ => MatcherConfig::default(),
    };
    let mut matcher = ScanMatcher::new(&SearchConfig::default(), &de, &config, &mut population);
    let mut rng = RandomStream::new(1, 0, 0);
    bencher.counter(ItemsCount::new(pairs.len())).bench_local(|| {
        for (pair, grid) in pairs.iter().zip(&grids) {
            let score_expected = pair.target.len() as f32;
            let prediction = Prediction::usual(Pose2::IDENTITY, score_expected);
            divan::black_box(matcher.align(grid, &pair.source, &prediction, &mut rng));
        }
    });
}
