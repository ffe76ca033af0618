//! Time and memory of DP-SLAM's low level while its map grows: an endless corridor, 0.1 m a scan, CSV on stdout.
//!
//! `cargo run --release -p lrfslam-core --example growing_corridor -- [particles] [scans]`. Time per scan must stay flat. Tiles grow by
//! the corridor's own area, once, not once for each particle.

#[path = "../benches/rig/mod.rs"]
mod rig;

use lrfslam_core::low_slam::{LowSlamConfig, LowSlamConfigs};
use std::time::Instant;

/// Scans averaged in a line.
const SCANS_PER_LINE: u32 = 50;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let particles = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(100);
    let scans: u32 = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(3000);
    let filter = LowSlamConfig { particles, ..Default::default() };
    let mut slam = rig::filter(&LowSlamConfigs { filter, ..Default::default() }, 200_000);
    println!("scan,path_m,step_us,weigh_us,particles,ess,nodes,depth,tiles,tiles_agreed,dropped,error_m");
    let (mut step_us, mut weigh_us, mut particles, mut ess) = (0.0, 0.0, 0, 0.0);
    for scan in 0..scans {
        let beams = rig::beams_at(rig::pose_at(scan), scan);
        let motion = rig::motion_at(scan);
        let start = Instant::now();
        let mut weighing_us = 0.0;
        let report = slam
            .step_with(&rig::as_sweep(&beams), &motion, |weighing, samples, window| {
                let start = Instant::now();
                weighing.weigh(0..weighing.particles(), samples, window);
                weighing_us = start.elapsed().as_secs_f64() * 1e6;
            })
            .expect("rays fit");
        step_us += start.elapsed().as_secs_f64() * 1e6 / f64::from(SCANS_PER_LINE);
        weigh_us += weighing_us / f64::from(SCANS_PER_LINE);
        particles += report.particles;
        ess += report.effective_sample_size / SCANS_PER_LINE as f32;
        if (scan + 1) % SCANS_PER_LINE == 0 {
            let origin = rig::pose_at(0);
            let error_m = (origin.between(rig::pose_at(scan)).position() - report.map_from_robot.position()).norm();
            println!(
                "{},{:.1},{step_us:.0},{weigh_us:.0},{},{ess:.1},{},{},{},{},{},{error_m:.3}",
                scan + 1,
                0.1 * scan as f32,
                particles / SCANS_PER_LINE as usize,
                report.nodes,
                report.depth,
                report.tiles,
                slam.map().tiles_agreed(),
                report.dropped,
            );
            (step_us, weigh_us, particles, ess) = (0.0, 0.0, 0, 0.0);
        }
    }
}
