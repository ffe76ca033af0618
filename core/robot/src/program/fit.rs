//! Whether a configuration fits a robot: asked before any of its memory is taken, so that one that does not leaves the robot as it was.

use crate::config::{LaserConfig, LaserFamily, RobotConfig};
use crate::wire::message::{Capacities, PARTICLES_MAX};
use lrfslam_core::geometry::Pose2;
use lrfslam_core::ndt::{NdtConfig, NdtGrid};
use lrfslam_core::slam::SlamMemory;
use lrfslam_core::slam::TILE_SIDE;
use lrfslam_lrf::{hokuyo_scip, sick_lms};

/// Farthest that a laser sits from the robot's centre along either axis, m.
const MOUNTING_MAX_M: f32 = 10.0;
/// Half a turn, and what rounding adds, rad.
const HEADING_MAX: f32 = core::f32::consts::PI + 1e-5;

/// Why a configuration does not fit a robot. Its words are short: the answer has room for 96 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Misfit {
    /// A field of a section; NaN always is.
    #[error("{0}.{1} is out of its bounds")]
    OutOfBounds(&'static str, &'static str),
    /// `robot_from_lrf`.
    #[error("the laser's place on the robot is out of its bounds")]
    Mounting,
    /// Not one of its family's rates, bit/s.
    #[error("laser.baud is {0}: this laser has no such rate")]
    Baud(u32),
    /// More than fit, with their samples.
    #[error("particles.particles is {wanted}, with {samples} samples each there is memory for {room}")]
    Particles {
        /// `particles.particles`.
        wanted: u16,
        /// `particles.samples_per_particle`.
        samples: u16,
        /// That would fit.
        room: usize,
    },
    /// More members of a search than fit.
    #[error("{section}.population is {wanted}, there is memory for {room}")]
    Population {
        /// Which search.
        section: &'static str,
        /// Its population.
        wanted: u16,
        /// That would fit.
        room: usize,
    },
    /// The directory of the matcher's reference cannot be divided among so many.
    #[error("ndt.grids is {wanted}, the memory is divided for {grids}{}", if *.facings == 1 { "" } else { " and ndt.facings = 1" })]
    Grids {
        /// `ndt.grids`.
        wanted: u16,
        /// `ndt.facings`.
        facings: u16,
        /// That would fit.
        grids: u16,
    },
    /// Key scans that would have to be removed again.
    #[error("odometry.reference: there is memory for \"whole-map\" only")]
    Reference,
    /// Beams that go farther than the window about the robot.
    #[error("rays.{field}: of this map there is memory for {}.{} m about the robot", .room_dm / 10, .room_dm % 10)]
    Reach {
        /// Which range.
        field: &'static str,
        /// As far as they may go, dm.
        room_dm: u32,
    },
}

/// What does not fit, if anything.
pub(super) fn misfit(
    config: &RobotConfig,
    capacities: &Capacities,
    memory: &SlamMemory<'_, TILE_SIDE>,
) -> Option<Misfit> {
    let unbounded = || config.out_of_bounds().map(|(section, field)| Misfit::OutOfBounds(section, field));
    let mounting = || (!is_mountable(&config.robot_from_lrf)).then_some(Misfit::Mounting);
    let baud = || (!is_rate(&config.laser)).then_some(Misfit::Baud(config.laser.baud));
    unbounded()
        .or_else(mounting)
        .or_else(baud)
        .or_else(|| particles(config, memory))
        .or_else(|| matching(config, memory))
        .or_else(|| reach(config, capacities))
}

fn is_mountable(robot_from_lrf: &Pose2) -> bool {
    let Pose2 { x, y, heading } = robot_from_lrf;
    x.abs() <= MOUNTING_MAX_M && y.abs() <= MOUNTING_MAX_M && heading.abs() <= HEADING_MAX
}

fn is_rate(laser: &LaserConfig) -> bool {
    let rates: &[u32] = match laser.family {
        LaserFamily::Hokuyo => &hokuyo_scip::driver::RATES,
        LaserFamily::Sick => &sick_lms::driver::RATES,
    };
    laser.baud == 0 || rates.contains(&laser.baud)
}

fn particles(config: &RobotConfig, memory: &SlamMemory<'_, TILE_SIDE>) -> Option<Misfit> {
    let (wanted, samples) = (config.slam.particles.particles, config.slam.particles.samples_per_particle);
    let room = memory.particles.particles_max(samples).min(PARTICLES_MAX);
    (usize::from(wanted) > room).then_some(Misfit::Particles { wanted, samples, room })
}

fn matching(config: &RobotConfig, memory: &SlamMemory<'_, TILE_SIDE>) -> Option<Misfit> {
    let odometry = &memory.odometry;
    let room = odometry.population.len();
    for (section, wanted) in [("de", config.slam.de.population), ("recovery", config.slam.recovery.population)] {
        if usize::from(wanted) > room {
            return Some(Misfit::Population { section, wanted, room });
        }
    }
    let key_scans = config.slam.odometry.key_scans();
    if key_scans > odometry.key_scans.len() || key_scans * odometry.points.len() > odometry.key_points.len() {
        return Some(Misfit::Reference);
    }
    let (ndt, directory) = (config.slam.ndt, odometry.directory.len());
    if NdtGrid::is_directory(&ndt, directory) {
        return None;
    }
    let fits = |grids: &u16| NdtGrid::is_directory(&NdtConfig { grids: *grids, facings: 1, ..ndt }, directory);
    let grids = (1..=4).find(fits).unwrap_or(0);
    Some(Misfit::Grids { wanted: ndt.grids, facings: ndt.facings, grids })
}

fn reach(config: &RobotConfig, capacities: &Capacities) -> Option<Misfit> {
    let room_m = capacities.reach_m(config.slam.particle_map.square_size_m);
    let room_dm = (10.0 * room_m.max(0.0)) as u32;
    let ranges = [("range_max_m", config.slam.rays.range_max_m), ("miss_range_m", config.slam.rays.miss_range_m)];
    let too_far = ranges.into_iter().find(|(_, range_m)| *range_m > room_m);
    too_far.map(|(field, _)| Misfit::Reach { field, room_dm })
}
