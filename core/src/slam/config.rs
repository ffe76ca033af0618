//! The configuration of SLAM: its sections, listed once for robots, for the host's file and for whoever uses the library.

use serde::{Deserialize, Serialize};

use crate::config::{Layout, Section, layout_with_part};
use crate::laser_odometry::{LaserOdometryConfig, Reference};
use crate::low_slam::{LowSlamConfig, LowSlamConfigs};
use crate::matcher::{MatcherConfig, RecoveryConfig};
use crate::ndt::NdtConfig;

/// Gives the macro `declare` what stands in braces, and behind it the sections of SLAM with names, types and documentation: those of matching, and
/// those of the particles. So a configuration that has them among others does not list them again.
#[macro_export]
macro_rules! slam_sections {
    ($declare:ident! { $($given:tt)* }) => {
        $declare! {
            $($given)*
            matching {
                /// Scan filter.
                filter: $crate::filter::FilterConfig,
                /// Reference cells.
                ndt: $crate::ndt::NdtConfig,
                /// Search box.
                search: $crate::matcher::SearchConfig,
                /// Search effort.
                de: $crate::de::DeConfig,
                /// Scan matcher.
                matcher: $crate::matcher::MatcherConfig,
                /// Laser odometry.
                odometry: $crate::laser_odometry::OdometryConfig,
                /// When lost.
                recovery: $crate::matcher::RecoveryConfig,
            }
            particles {
                /// When the particle filter takes a step.
                steps: $crate::slam::StepConfig,
                /// Motion of the particles.
                motion: $crate::motion::ScanMatchingMotionConfig,
                /// Particle filter.
                particles: $crate::low_slam::LowSlamConfig,
                /// Maps of the particles.
                particle_map: $crate::distributed_map::ParticleMapConfig,
                /// Beams that particles look at.
                rays: $crate::rays::RayConfig,
                /// Weights of the particles.
                perception: $crate::perception::PerceptionConfig,
            }
        }
    };
}

macro_rules! slam_config {
    ($( $group:ident { $( $(#[doc = $doc:literal])* $name:ident : $section:ty, )* } )*) => {
        /// The configuration of [`Slam`](super::Slam) with all its parts. The default is a computer's.
        #[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct SlamConfig {
            $($( $(#[doc = $doc])* pub $name: $section, )*)*
        }

        impl SlamConfig {
            /// The fingerprint of what has `layout`, and behind it these sections; see [`Layout`].
            pub const fn layout_after(layout: u32) -> u32 {
                $($( let layout = layout_with_part(layout, stringify!($name), <$section>::LAYOUT); )*)*
                layout
            }

            /// Section and name of the first field that is out of its bounds.
            pub fn out_of_bounds(&self) -> Option<(&'static str, &'static str)> {
                $($(
                    if let Some(field) = self.$name.out_of_bounds() {
                        return Some((stringify!($name), field));
                    }
                )*)*
                None
            }

            /// Calls `visit` with the name of every section and with the section, in order.
            pub fn visit_sections(&self, visit: &mut dyn FnMut(&'static str, &dyn Section)) {
                $($( visit(stringify!($name), &self.$name); )*)*
            }
        }
    };
}
slam_sections!(slam_config! {});

impl SlamConfig {
    /// What fits a microcontroller: two grids of cells instead of four, a little sharper, searches with fewer points and members, 32
    /// particles, beams of up to 8 m, fewer of them weighed and printed.
    pub fn small() -> Self {
        let mut config = Self {
            ndt: NdtConfig { grids: 2, facings: 1, noise_m: 0.025, ..NdtConfig::default() },
            matcher: MatcherConfig { search_points: 16, ..MatcherConfig::default() },
            particles: LowSlamConfig { particles: 32, ..LowSlamConfig::default() },
            ..Self::default()
        };
        config.recovery =
            RecoveryConfig { population: 100, generations: 30, search_points: 32, ..RecoveryConfig::default() };
        config.odometry.witnesses = 0; // a microcontroller has no memory for earlier scans
        config.particle_map.print_step = 5;
        config.rays.range_max_m = 8.0;
        config.perception.beam_step = 6;
        config
    }

    /// The part for laser odometry.
    pub fn laser_odometry(&self) -> LaserOdometryConfig {
        let Self { filter, ndt, search, de, matcher, odometry, recovery, .. } = *self;
        LaserOdometryConfig { filter, ndt, search, de, matcher, odometry, recovery }
    }

    /// The part for the particles.
    pub fn low_slam(&self) -> LowSlamConfigs {
        let Self { particles: filter, particle_map: map, rays, perception, .. } = *self;
        LowSlamConfigs {
            filter,
            map,
            rays,
            perception,
            closes_loops: self.odometry.reference == Reference::RecentScans,
        }
    }
}
