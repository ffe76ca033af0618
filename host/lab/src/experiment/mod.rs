//! Experiments: what the methods are worth, measured on simulated and real scans (thesis, chapter 5).
//!
//! All take a log and the true path of its scans; where that comes from (a simulator, or a path made with the whole log) is the
//! caller's business.

mod carried;
mod endurance;
mod envelope;
mod findings;
mod growth;
mod landmark_cost;
mod loops;
mod map3d;
mod match_pairs;
mod motion_model;
mod normalised;
mod pair;
mod particle_paths;
mod plots;
mod starts;
mod sweep;
mod told_starts;

pub use carried::{
    CarriedConfig, CarriedDrive, CarriedRun, CarriedStretch, carried_csv, carried_markdown, on_true_path, run_carried,
};
pub use endurance::{LongDrive, Stretch, endurance_csv, endurance_markdown, plot_endurance, run_endurance};
pub use envelope::{
    Degradation, ENVELOPE_ROWS, EnvelopeRow, EnvelopeRun, Told, degrade, envelope_csv, envelope_markdown,
    plot_envelope, run_envelope,
};
pub use findings::{Experiment, markdown};
pub use growth::{Growth, GrowthError, plot_growth, read_growth};
pub use landmark_cost::{CostRow, cost_csv, landmark_cost, plot_cost};
pub use loops::{LoopRun, loop_csv, loop_markdown, run_loop};
pub use map3d::{CloudError, Surface, judge_cloud, read_surfaces};
pub use match_pairs::{MatchPairsConfig, MatchPairsError, MatchPairsReport, match_pairs};
pub use motion_model::{AxisModel, MotionModel, fit_motion_model};
pub use normalised::{AxisShares, NormalisedError, NormalisedSummary, normalised_csv, plot_normalised};
pub use pair::{Contender, Rig};
pub use particle_paths::{ParticlePaths, particle_paths, plot_particle_paths};
pub use plots::{PlotError, plot_distributions, plot_errors};
pub use starts::{StartFound, StartOutcome, StartsConfig, starts_csv, starts_summary, try_starts};
pub use sweep::{CaseSummary, Method, PairError, SweepCase, SweepConfig, SweepError, SweepReport, sweep, write_csv};
pub use told_starts::{ToldStarts, told_starts_markdown, try_told_starts};
