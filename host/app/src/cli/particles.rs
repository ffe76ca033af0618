//! Flags for the particle filter that `map`, `run` and `replay` share.

use std::thread::available_parallelism;

use clap::Args;

use super::Failure;
use super::shared::{ConfigArgs, LEVELS, PARTICLES};
use crate::config::RunConfig;

/// How many particles, on how many threads.
#[derive(Debug, Args)]
pub(super) struct ParticleArgs {
    #[arg(long, value_name = "N", help = PARTICLES)]
    particles: Option<u16>,
    /// Scan matching alone, without particles; the same as --levels 0.
    #[arg(long, conflicts_with_all = ["particles", "levels"])]
    matcher_only: bool,
    #[arg(long, value_name = "N", help = LEVELS)]
    levels: Option<u16>,
    /// Threads that share the work [default: one for each core]. Results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
}

impl ParticleArgs {
    /// `defaults`, then `config`, then these flags, checked.
    pub(super) fn load_over(&self, defaults: RunConfig, config: &ConfigArgs) -> Result<RunConfig, Failure> {
        let particles = self.particles.map(|count| format!("particles.particles={count}"));
        let levels = self.levels.map(|levels| format!("hierarchy.levels={levels}"));
        let alone = self.matcher_only.then(|| "hierarchy.levels=0".to_owned());
        config.load_over(defaults, particles.into_iter().chain(levels).chain(alone))
    }

    pub(super) fn threads(&self) -> usize {
        self.threads.map_or_else(|| available_parallelism().map_or(1, usize::from), usize::from)
    }
}
