//! Flags for the particle filter that `map`, `run` and `replay` share.

use std::path::Path;
use std::thread::available_parallelism;

use clap::Args;

use super::Failure;
use crate::config::RunConfig;

/// How many particles, on how many threads.
#[derive(Debug, Args)]
pub(super) struct ParticleArgs {
    /// Particles of DP-SLAM; the same as --set particles.particles=N.
    #[arg(long, value_name = "N")]
    particles: Option<u16>,
    /// Scan matching alone, without particles; the same as --levels 0.
    #[arg(long, conflicts_with_all = ["particles", "levels"])]
    matcher_only: bool,
    /// Levels of SLAM: 1, particles over whole maps; 2, loops closed as well; the same as --set hierarchy.levels=N.
    #[arg(long, value_name = "N")]
    levels: Option<u16>,
    /// Threads that share the work [default: one for each core]. Results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: Option<u16>,
}

impl ParticleArgs {
    /// Defaults, then the file, then the overrides `set`, then these flags, checked.
    pub(super) fn load(&self, file: Option<&Path>, set: &[String]) -> Result<RunConfig, Failure> {
        self.load_over(RunConfig::default(), file, set)
    }

    /// The same with other defaults.
    pub(super) fn load_over(
        &self,
        defaults: RunConfig,
        file: Option<&Path>,
        set: &[String],
    ) -> Result<RunConfig, Failure> {
        let mut overrides = set.to_vec();
        overrides.extend(self.particles.map(|count| format!("particles.particles={count}")));
        overrides.extend(self.levels.map(|levels| format!("hierarchy.levels={levels}")));
        overrides.extend(self.matcher_only.then(|| "hierarchy.levels=0".to_owned()));
        RunConfig::load_over(defaults, file, &overrides).map_err(Failure::start)
    }

    pub(super) fn threads(&self) -> usize {
        self.threads.map_or_else(|| available_parallelism().map_or(1, usize::from), usize::from)
    }
}
