//! `lrfslam experiment landmark-cost`.

use clap::Args;
use lrfslam_host::output::save_file;
use lrfslam_lab::experiment::{cost_csv, landmark_cost, plot_cost};

use super::out::OutArgs;
use super::{Failure, print};

/// What a step of landmark SLAM costs against the number of landmarks (10 to 500) and of particles.
///
/// Writes cost.csv, a line for each case, and cost.svg. Times are compared with an EKF's of 50 landmarks, measured in the same rounds.
#[derive(Debug, Args)]
pub(super) struct CostArgs {
    /// Rounds over all cases; the least time of each counts.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rounds: u32,
    #[command(flatten)]
    out: OutArgs,
}

pub(super) fn run(args: &CostArgs) -> Result<(), Failure> {
    let mut folder = args.out.folder("landmark-cost")?;
    let rows = landmark_cost(args.rounds);
    let (csv, svg) = (cost_csv(&rows), plot_cost(&rows).map_err(Failure::work)?);
    let saved = folder.save(|place| {
        save_file(&place.join("cost.csv"), csv.as_bytes())?;
        save_file(&place.join("cost.svg"), svg.as_bytes())
    });
    saved.map_err(Failure::Work)?;
    print(&csv)
}
