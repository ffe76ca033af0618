//! Whether there is memory for what a configuration asks for: said before anything begins.

use anyhow::bail;
use lrfslam_core::distributed_map::Tile;

use crate::config::RunConfig;

/// Squares along the side of a tile of the particles' maps.
const TILE_SIDE: usize = 16;
/// A cell of the drawn map, bytes.
const DRAWN_CELL: f64 = 6.0;

/// What the system can give, bytes; `None` where it does not say.
fn free_bytes() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.split_whitespace().next()?.parse::<f64>().ok().map(|kibibytes| 1024.0 * kibibytes)
}

/// # Errors
/// If a number asks for more memory than is free; it is named.
pub(super) fn ensure_room(config: &RunConfig) -> anyhow::Result<()> {
    free_bytes().map_or(Ok(()), |free| ensure_room_in(free, config))
}

fn ensure_room_in(free: f64, config: &RunConfig) -> anyhow::Result<()> {
    let (tiles, map) = (config.memory.map_tiles, &config.map);
    let tile_bytes = size_of::<Tile<TILE_SIDE>>() as f64 * f64::from(tiles);
    // A single scan with far hits all round draws so much.
    let drawn_bytes = DRAWN_CELL * (2.0 * f64::from(map.draw_range_m) / f64::from(map.cell_size_m)).powi(2);
    let drawn = format!("map.draw_range_m = {} in cells of {} m", map.draw_range_m, map.cell_size_m);
    for (what, bytes) in [(format!("memory.map_tiles = {tiles}"), tile_bytes), (drawn, drawn_bytes)] {
        if bytes > free {
            bail!("{what} asks for {:.1} GB of memory, {:.1} GB are free: choose less", bytes * 1e-9, free * 1e-9);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_named_and_the_defaults_fit_a_small_computer() {
        assert!(ensure_room_in(256e6, &RunConfig::default()).is_ok());
        let mut config = RunConfig::default();
        config.memory.map_tiles = 16_777_216;
        let error = ensure_room_in(4e9, &config).unwrap_err().to_string();
        assert!(
            error.starts_with("memory.map_tiles = 16777216 asks for ") && error.contains("4.0 GB are free"),
            "{error}"
        );
        let mut config = RunConfig::default();
        config.map.draw_range_m = 1000.0;
        let error = ensure_room_in(4e9, &config).unwrap_err().to_string();
        assert!(error.starts_with("map.draw_range_m = 1000 in cells of 0.05 m asks for 9.6 GB"), "{error}");
    }
}
