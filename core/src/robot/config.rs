//! Everything that decides what a robot does: with the same scans it then does the same.

use serde::{Deserialize, Serialize};

use super::sweep_report::ReportConfig;
use crate::config::Section as _;
use crate::de::DeConfig;
use crate::distributed_map::ParticleMapConfig;
use crate::filter::FilterConfig;
use crate::geometry::Pose2;
use crate::laser_odometry::{LaserOdometryConfig, OdometryConfig};
use crate::low_slam::{LowSlamConfig, LowSlamConfigs, RefinementConfig};
use crate::matcher::{MatcherConfig, RecoveryConfig, SearchConfig};
use crate::motion::ScanMatchingMotionConfig;
use crate::ndt::NdtConfig;
use crate::perception::PerceptionConfig;
use crate::rays::RayConfig;
use crate::slam::StepConfig;

/// Which laser is plugged in.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum LaserFamily {
    /// Hokuyo with SCIP.
    #[default]
    Hokuyo,
    /// SICK LMS2xx.
    Sick,
}

/// The laser and its line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LaserConfig {
    /// Which driver.
    pub family: LaserFamily,
    /// Rate to change to if the laser is slower, bit/s; 0 keeps the one found.
    pub baud: u32,
    /// Hokuyo: neighbouring steps merged, 1..=99; 0 is 1.
    pub cluster: u8,
}

/// The configuration of a robot with all its parts: what a host gives it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RobotConfig {
    /// Of all random numbers.
    pub seed: u64,
    /// Where the laser sits on the robot.
    pub robot_from_lrf: Pose2,
    /// The laser.
    pub laser: LaserConfig,
    /// Scan filter.
    pub filter: FilterConfig,
    /// Reference cells.
    pub ndt: NdtConfig,
    /// Search box.
    pub search: SearchConfig,
    /// Search effort.
    pub de: DeConfig,
    /// Matcher.
    pub matcher: MatcherConfig,
    /// Laser odometry.
    pub odometry: OdometryConfig,
    /// When lost.
    pub recovery: RecoveryConfig,
    /// When the filter takes a step.
    pub steps: StepConfig,
    /// Motion of the particles.
    pub motion: ScanMatchingMotionConfig,
    /// Particles.
    pub particles: LowSlamConfig,
    /// Their maps.
    pub particle_map: ParticleMapConfig,
    /// Beams.
    pub rays: RayConfig,
    /// Weights.
    pub perception: PerceptionConfig,
    /// Proposal.
    pub refinement: RefinementConfig,
    /// What the host is told.
    pub report: ReportConfig,
}

impl Default for RobotConfig {
    /// What fits a microcontroller: two grids of cells instead of four, a little sharper, searches with fewer points and members, 32
    /// particles, beams of up to 8 m, fewer of them weighed and printed.
    fn default() -> Self {
        Self {
            seed: 1,
            robot_from_lrf: Pose2::IDENTITY,
            laser: LaserConfig::default(),
            filter: FilterConfig::default(),
            ndt: NdtConfig { grids: 2, noise_m: 0.025, ..NdtConfig::default() },
            search: SearchConfig::default(),
            de: DeConfig::default(),
            matcher: MatcherConfig { search_points: 16, ..MatcherConfig::default() },
            odometry: OdometryConfig::default(),
            recovery: RecoveryConfig {
                population: 100,
                generations: 30,
                search_points: 32,
                ..RecoveryConfig::default()
            },
            steps: StepConfig::default(),
            motion: ScanMatchingMotionConfig::default(),
            particles: LowSlamConfig { particles: 32, ..LowSlamConfig::default() },
            particle_map: ParticleMapConfig { print_step: 5, ..ParticleMapConfig::default() },
            rays: RayConfig { range_max_m: 8.0, ..RayConfig::default() },
            perception: PerceptionConfig { beam_step: 6, ..PerceptionConfig::default() },
            refinement: RefinementConfig::default(),
            report: ReportConfig::default(),
        }
    }
}

impl RobotConfig {
    /// Name of the first field that is out of its bounds.
    pub fn out_of_bounds(&self) -> Option<&'static str> {
        let sections = [
            self.filter.out_of_bounds(),
            self.ndt.out_of_bounds(),
            self.search.out_of_bounds(),
            self.de.out_of_bounds(),
            self.matcher.out_of_bounds(),
            self.odometry.out_of_bounds(),
            self.recovery.out_of_bounds(),
            self.steps.out_of_bounds(),
            self.motion.out_of_bounds(),
            self.particles.out_of_bounds(),
            self.particle_map.out_of_bounds(),
            self.rays.out_of_bounds(),
            self.perception.out_of_bounds(),
            self.refinement.out_of_bounds(),
            self.report.out_of_bounds(),
        ];
        sections.into_iter().flatten().next()
    }

    /// The part for laser odometry.
    pub fn laser_odometry(&self) -> LaserOdometryConfig {
        LaserOdometryConfig {
            filter: self.filter,
            ndt: self.ndt,
            search: self.search,
            de: self.de,
            matcher: self.matcher,
            odometry: self.odometry,
            recovery: self.recovery,
        }
    }

    /// The part for the particles.
    pub fn low_slam(&self) -> LowSlamConfigs {
        LowSlamConfigs {
            filter: self.particles,
            map: self.particle_map,
            rays: self.rays,
            perception: self.perception,
            refinement: self.refinement,
        }
    }
}
