//! Experiments on real scans: what the methods are worth, measured.

mod match_pairs;

pub use match_pairs::{Contender, MatchPairsConfig, MatchPairsError, MatchPairsReport, match_pairs};
