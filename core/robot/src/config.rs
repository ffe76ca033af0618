//! Everything that decides what a robot does: with the same scans it then does the same.

use serde::{Deserialize, Serialize};

use lrfslam_core::config::{Layout, NO_LAYOUT, Section, layout_with_part};
use lrfslam_core::de::DeConfig;
use lrfslam_core::distributed_map::ParticleMapConfig;
use lrfslam_core::filter::FilterConfig;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::laser_odometry::{LaserOdometryConfig, OdometryConfig};
use lrfslam_core::low_slam::{LowSlamConfig, LowSlamConfigs, RefinementConfig};
use lrfslam_core::matcher::{MatcherConfig, RecoveryConfig, SearchConfig};
use lrfslam_core::motion::ScanMatchingMotionConfig;
use lrfslam_core::ndt::NdtConfig;
use lrfslam_core::perception::PerceptionConfig;
use lrfslam_core::rays::RayConfig;
use lrfslam_core::slam::StepConfig;

lrfslam_core::config_choice! {
    /// Which laser is plugged in.
    pub enum LaserFamily {
        /// Hokuyo with SCIP.
        Hokuyo = "hokuyo",
        /// SICK LMS2xx.
        Sick = "sick-lms2xx",
    }
    choices "\"hokuyo\" or \"sick-lms2xx\""
}

lrfslam_core::config! {
    /// The laser and its line.
    pub struct LaserConfig {
        /// Which driver.
        family: LaserFamily = LaserFamily::Hokuyo;
        /// Rate to change to if the laser is slower, one that its family knows, bit/s; 0 keeps the one found.
        baud: u32 = 0;
        /// Hokuyo: neighbouring steps merged, 1 to 99; 0 is 1.
        cluster: u8 = 0, in 0..=99;
    }
}

lrfslam_core::config! {
    /// What a robot that does the SLAM itself tells its host.
    pub struct ReportConfig {
        /// A scan is told with its beams if the robot has moved so far since the last one told, m …
        sweep_distance_m: f32 = 0.05, in 0.0..=10.0;
        /// … or turned so far, degrees. Closing of loops and the drawn map live on these; a beam costs a byte or two on the link.
        sweep_rotation_deg: f32 = 2.0, in 0.0..=180.0;
    }
}

/// Declares the configuration of a robot: plain values, and sections.
macro_rules! robot_config {
    (
        values { $( $(#[doc = $value_doc:literal])* $value:ident : $value_type:ty, )* }
        sections { $( $(#[doc = $doc:literal])* $section:ident : $type:ty, )* }
    ) => {
        /// The configuration of a robot with all its parts: what a host gives it.
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
        pub struct RobotConfig {
            $( $(#[doc = $value_doc])* pub $value: $value_type, )*
            $( $(#[doc = $doc])* pub $section: $type, )*
        }

        impl Layout for RobotConfig {
            const LAYOUT: u32 = {
                let layout = NO_LAYOUT;
                $( let layout = layout_with_part(layout, stringify!($value), <$value_type>::LAYOUT); )*
                $( let layout = layout_with_part(layout, stringify!($section), <$type>::LAYOUT); )*
                layout
            };
        }

        impl RobotConfig {
            /// Section and name of the first field that is out of its bounds.
            pub fn out_of_bounds(&self) -> Option<(&'static str, &'static str)> {
                $(
                    if let Some(field) = self.$section.out_of_bounds() {
                        return Some((stringify!($section), field));
                    }
                )*
                None
            }

            /// Calls `visit` with the name of every section and with the section, in order.
            pub fn visit_sections(&self, visit: &mut dyn FnMut(&'static str, &dyn Section)) {
                $( visit(stringify!($section), &self.$section); )*
            }
        }
    };
}

robot_config! {
    values {
        /// Of all random numbers.
        seed: u64,
        /// Where the laser sits on the robot.
        robot_from_lrf: Pose2,
    }
    sections {
        /// The laser.
        laser: LaserConfig,
        /// Scan filter.
        filter: FilterConfig,
        /// Reference cells.
        ndt: NdtConfig,
        /// Search box.
        search: SearchConfig,
        /// Search effort.
        de: DeConfig,
        /// Matcher.
        matcher: MatcherConfig,
        /// Laser odometry.
        odometry: OdometryConfig,
        /// When lost.
        recovery: RecoveryConfig,
        /// When the filter takes a step.
        steps: StepConfig,
        /// Motion of the particles.
        motion: ScanMatchingMotionConfig,
        /// Particles.
        particles: LowSlamConfig,
        /// Their maps.
        particle_map: ParticleMapConfig,
        /// Beams.
        rays: RayConfig,
        /// Weights.
        perception: PerceptionConfig,
        /// Proposal.
        refinement: RefinementConfig,
        /// What the host is told.
        report: ReportConfig,
    }
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
