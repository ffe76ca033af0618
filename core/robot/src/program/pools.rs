//! All memory of a robot in one value of fixed size, for a microcontroller's statics.

use super::report::LedgerEntry;
use crate::wire::frame::MAX_FRAME;
use crate::wire::session::SessionMemory;
use lrfslam_core::scan::{Beam, Echo};
use lrfslam_core::slam::{SlamMemory, SlamPools, TILE_SIDE};
use lrfslam_core::time::Duration;

/// Bytes of the longest telegram: a URG-04LX's 682 beams, or any of an LMS2xx.
const TELEGRAM: usize = 2304;

/// Memory that a [`Robot`](super::Robot) works in, lent by the caller.
#[derive(Debug)]
pub struct RobotMemory<'m> {
    /// Of the mapping.
    pub mapping: SlamMemory<'m, TILE_SIDE>,
    /// Of the link.
    pub link: SessionMemory<'m>,
    /// One telegram of the laser.
    pub telegram: &'m mut [u8],
    /// One scan.
    pub beams: &'m mut [Beam],
    /// What the host has of the map; 4ⁿ entries, one for each tile of a square about the robot.
    pub ledger: &'m mut [LedgerEntry],
}

/// Memory of a robot in one value, of any size.
pub trait Pools {
    /// Pools that nobody uses yet.
    const EMPTY: Self;

    /// The pools as slices.
    fn lend(&mut self) -> RobotMemory<'_>;
}

/// Pools of a robot as arrays; all zero, so that a static of it costs no flash.
///
/// The parameters are those of [`SlamPools`], and the number of bytes that wait for the host.
#[derive(Debug)]
pub struct RobotPools<
    const TILES: usize,
    const WINDOW: usize,
    const PARTICLES: usize,
    const NODES: usize,
    const BEAMS: usize,
    const NDT_TILES: usize,
    const NDT_PLACES: usize,
    const QUEUE: usize,
> {
    slam: SlamPools<TILES, WINDOW, PARTICLES, NODES, BEAMS, NDT_TILES, NDT_PLACES>,
    telegram: [u8; TELEGRAM],
    beams: [Beam; BEAMS],
    ledger: [LedgerEntry; WINDOW],
    queue: [u8; QUEUE],
    frame: [u8; MAX_FRAME],
}

/// 32 particles at 8 m within 512 KiB of RAM, stack and buffers included: a Cortex-M7 such as the STM32H743.
pub type StandardPools = RobotPools<1728, 1024, 32, 64, 682, 966, 8192, 16384>;

/// 12 particles at 4 m within 192 KiB: a Cortex-M4F such as the STM32F405.
pub type CompactPools = RobotPools<448, 256, 12, 24, 384, 407, 2048, 6144>;

/// 64 particles at 8 m, and minutes that a host may be away: a robot with a Linux computer.
pub type LargePools = RobotPools<16384, 1024, 64, 128, 682, 16384, 32768, 1_048_576>;

impl<
    const TILES: usize,
    const WINDOW: usize,
    const PARTICLES: usize,
    const NODES: usize,
    const BEAMS: usize,
    const NDT_TILES: usize,
    const NDT_PLACES: usize,
    const QUEUE: usize,
> Pools for RobotPools<TILES, WINDOW, PARTICLES, NODES, BEAMS, NDT_TILES, NDT_PLACES, QUEUE>
{
    const EMPTY: Self = Self {
        slam: SlamPools::EMPTY,
        telegram: [0; TELEGRAM],
        // A hit at no range is all zero; nobody reads it before a scan is there.
        beams: [Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Hit(0.0) }; BEAMS],
        ledger: [LedgerEntry::EMPTY; WINDOW],
        queue: [0; QUEUE],
        frame: [0; MAX_FRAME],
    };

    fn lend(&mut self) -> RobotMemory<'_> {
        RobotMemory {
            mapping: self.slam.lend(),
            link: SessionMemory { queue: &mut self.queue, frame: &mut self.frame },
            telegram: &mut self.telegram,
            beams: &mut self.beams,
            ledger: &mut self.ledger,
        }
    }
}
