//! `lrf-sim surfaces`: the rectangles that a world is made of.

use std::io::{self, BufWriter, Write};

use anyhow::{Context, Result};
use clap::Args;
use lrfslam_firmware_sim::scenario::Scenario;

/// Writes a world's rectangles, one in a line: four corners in order round it, 12 numbers, m.
///
/// With it, `lrfslam experiment map3d` judges a 3D map of that world. People are not in it: they move.
#[derive(Debug, Args)]
pub struct SurfacesArgs {
    #[arg(long, value_name = "NAME|FILE", help = crate::WORLD)]
    world: String,
}

pub fn run(args: &SurfacesArgs) -> Result<()> {
    let scenario = Scenario::load(&args.world)?;
    let mut out = BufWriter::new(io::stdout().lock());
    let written = scenario.world.write_surfaces(&mut out).and_then(|()| out.flush());
    written.context("standard output cannot be written")
}
