//! What a robot says, held against what a robot can say: a broken or hostile one must not fill memory or disk.
//!
//! Bounds go by area, by what a robot's program sends, and by the time between messages; a robot that keeps to its program never meets them.

use std::collections::BTreeSet;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::slam::TILE_SIDE;
use lrfslam_core::time::Instant;
use lrfslam_robot::wire::message::{FromRobot, Identity, ScanPose, Segment, TileUpdate};
use lrfslam_robot::wire::sweep::SweepPart;

/// Farthest that a robot is from where it began, along either axis, m.
const POSITION_MAX_M: f32 = 10_000.0;
/// From one scan told to the next a robot goes no farther than this, m …
const JUMP_MAX_M: f32 = 20.0;
/// … and so much for each second between them, m/s.
const SPEED_MAX_MPS: f32 = 20.0;
/// Tiles at different places: all of a map of 200 m by 200 m in squares of 0.1 m.
const TILES_MAX: usize = 65_536;
/// Blocks of 8 × 8 tiles that they lie in: they are drawn in blocks.
const BLOCKS_MAX: usize = 8_192;
/// Bytes of a scan's echoes: a beam takes at least one.
const SWEEP_BYTES_MAX: usize = 16_384;

/// A message that no robot's program sends.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("the robot's message {message} cannot be true: {why}")]
pub struct Absurd {
    /// Which message.
    pub message: &'static str,
    /// What is wrong with it.
    pub why: String,
}

/// Says of each message whether a robot can mean it.
#[derive(Debug, Clone, Default)]
pub struct Judge {
    /// Stamp, number and pose of the last scan.
    last: Option<(Instant, u32, Pose2)>,
    step: u32,
    /// Places of tiles, and of their blocks.
    tiles: BTreeSet<(i16, i16)>,
    blocks: BTreeSet<(i16, i16)>,
    /// Stamp of the scan whose parts come, and bytes of them so far.
    sweep: Option<(Instant, usize)>,
}

/// An error about `message`, unless `right`.
fn check(right: bool, message: &'static str, why: impl FnOnce() -> String) -> Result<(), Absurd> {
    if right { Ok(()) } else { Err(Absurd { message, why: why() }) }
}

fn is_near(pose: &Pose2) -> bool {
    // Also false for NaN.
    pose.x.abs() <= POSITION_MAX_M && pose.y.abs() <= POSITION_MAX_M && pose.heading.is_finite()
}

impl Judge {
    /// Holds the next message against the ones before.
    ///
    /// # Errors
    /// If no robot's program sends it; nothing has changed then.
    pub fn check(&mut self, message: &FromRobot<'_>) -> Result<(), Absurd> {
        match message {
            FromRobot::Identity(identity) => identify(identity),
            FromRobot::Scan(scan) => self.scan(scan),
            FromRobot::Segment(segment) => self.segment(segment),
            FromRobot::Tile(tile) => self.tile("Tile", tile),
            FromRobot::Left(tile) => self.tile("Left", tile),
            FromRobot::Sweep(part) => self.sweep(part),
            FromRobot::Configured
            | FromRobot::Refused(_)
            | FromRobot::MapBegin
            | FromRobot::MapEnd(_)
            | FromRobot::Said(_)
            | FromRobot::Recall(_) => Ok(()),
        }
    }

    fn scan(&mut self, scan: &ScanPose) -> Result<(), Absurd> {
        let ScanPose { stamp, number, moved, odometry, .. } = scan;
        let absurd = || format!("scan {number} is at {} m, {} m", odometry.x, odometry.y);
        check(is_near(odometry) && is_near(moved), "Scan", absurd)?;
        if let Some((before, last, from)) = self.last {
            let seconds = stamp.since(before).micros as f32 * 1e-6;
            check(*number > last && seconds >= 0.0, "Scan", || format!("scan {number} comes after scan {last}"))?;
            let way_m = from.between(*odometry).position().norm();
            let far = || format!("scan {number} is {way_m:.0} m from the one before, {seconds:.1} s later");
            check(way_m <= JUMP_MAX_M + SPEED_MAX_MPS * seconds, "Scan", far)?;
        }
        self.last = Some((*stamp, *number, *odometry));
        Ok(())
    }

    fn segment(&mut self, segment: &Segment) -> Result<(), Absurd> {
        let Segment { step, since_step, particles, .. } = segment;
        let order = || format!("step {step} since step {since_step}, after step {}", self.step);
        check(step > since_step && *step > self.step, "Segment", order)?;
        let far = particles.iter().find(|node| !is_near(&node.map_from_robot));
        check(far.is_none(), "Segment", || format!("step {step} has a particle at {far:?}"))?;
        self.step = *step;
        Ok(())
    }

    fn tile(&mut self, message: &'static str, tile: &TileUpdate<'_>) -> Result<(), Absurd> {
        let TileUpdate { column, row, squares } = tile;
        let wanted = 2 * TILE_SIDE * TILE_SIDE;
        let bytes = squares.len();
        check(bytes == wanted, message, || format!("{bytes} bytes of squares instead of {wanted}"))?;
        let (place, block) = ((*column, *row), (column >> 3, row >> 3));
        let is_new = |set: &BTreeSet<_>, place| usize::from(!set.contains(&place));
        let tiles = self.tiles.len() + is_new(&self.tiles, place);
        let blocks = self.blocks.len() + is_new(&self.blocks, block);
        let wide = || format!("a map of {tiles} tiles in {blocks} blocks is larger than any building");
        check(tiles <= TILES_MAX && blocks <= BLOCKS_MAX, message, wide)?;
        self.tiles.insert(place);
        self.blocks.insert(block);
        Ok(())
    }

    fn sweep(&mut self, part: &SweepPart<'_>) -> Result<(), Absurd> {
        let before = self.sweep.filter(|(stamp, _)| *stamp == part.stamp).map_or(0, |(_, bytes)| bytes);
        let bytes = before + part.echoes.len();
        check(bytes <= SWEEP_BYTES_MAX, "Sweep", || format!("a scan of {bytes} bytes, and it goes on"))?;
        let numbers = [part.range_max_m, part.bearing_rad, part.bearing_step_rad];
        let motion = &part.motion.displacement;
        check(numbers.iter().all(|number| number.abs() <= 1e4) && is_near(motion), "Sweep", || {
            format!("a scan to {} m, from {} rad", part.range_max_m, part.bearing_rad)
        })?;
        self.sweep = Some((part.stamp, bytes)).filter(|_| !part.is_last);
        Ok(())
    }
}

fn identify(identity: &Identity<'_>) -> Result<(), Absurd> {
    let side = identity.capacities.tile_side;
    check(usize::from(side) == TILE_SIDE, "Identity", || format!("tiles of {side} squares instead of {TILE_SIDE}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrfslam_core::sweep::SweepMotion;
    use lrfslam_core::time::Duration;
    use lrfslam_robot::wire::message::PathNode;

    fn scan(number: u32, x: f32) -> FromRobot<'static> {
        let stamp = Instant::from_micros(i64::from(number) * 100_000);
        let (moved, odometry) = (Pose2::IDENTITY, Pose2::new(x, 0.0, 0.0));
        FromRobot::Scan(ScanPose { stamp, number, step: 0, moved, odometry, undetermined: None, is_lost: false })
    }

    fn tile(column: i16, row: i16, squares: &[u8]) -> FromRobot<'_> {
        FromRobot::Left(TileUpdate { column, row, squares })
    }

    fn part(stamp: i64, range_max_m: f32, echoes: &[u8]) -> FromRobot<'_> {
        FromRobot::Sweep(SweepPart {
            stamp: Instant::from_micros(stamp),
            range_max_m,
            motion: SweepMotion::default(),
            bearing_rad: 0.0,
            bearing_step_rad: 0.01,
            offset: Duration::ZERO,
            offset_step: Duration::ZERO,
            is_last: false,
            echoes,
        })
    }

    /// What is said of the last of these, and how many were taken before.
    fn judged<'a>(messages: impl IntoIterator<Item = FromRobot<'a>>) -> (usize, String) {
        let mut judge = Judge::default();
        let mut taken = 0;
        for message in messages {
            if let Err(absurd) = judge.check(&message) {
                return (taken, absurd.to_string());
            }
            taken += 1;
        }
        (taken, String::new())
    }

    #[test]
    fn a_robot_drives_and_does_not_jump() {
        assert_eq!(judged((1..100).map(|number| scan(number, 0.2 * number as f32))), (99, String::new()));
        for (after, why) in [
            (scan(2, 4000.0), "Scan cannot be true: scan 2 is 4000 m from the one before, 0.1 s later"),
            (scan(2, f32::NAN), "Scan cannot be true: scan 2 is at NaN m, 0 m"),
            (scan(2, 1e30), "Scan cannot be true: scan 2 is at "),
            (scan(1, 0.0), "Scan cannot be true: scan 1 comes after scan 1"),
        ] {
            let (taken, said) = judged([scan(1, 0.0), after]);
            assert!(taken == 1 && said.contains(why), "{said}");
        }
    }

    #[test]
    fn a_map_is_of_a_building() {
        let squares = [1; 2 * TILE_SIDE * TILE_SIDE];
        let dense = (0..200).flat_map(|row| (0..200).map(move |column| (column, row)));
        assert_eq!(judged(dense.map(|(column, row)| tile(column, row, &squares))).0, 40_000);
        let spread = (-100..100).flat_map(|row| (-100..100).map(move |column| (300 * column, 300 * row)));
        let (taken, said) = judged(spread.map(|(column, row)| tile(column, row, &squares)));
        assert_eq!(taken, BLOCKS_MAX);
        assert!(said.contains("message Left cannot be true: a map of 8193 tiles in 8193 blocks is larger"), "{said}");
        assert!(judged([tile(0, 0, &squares[..5])]).1.contains("5 bytes of squares instead of 128"));
    }

    #[test]
    fn a_scan_ends_and_a_path_goes_on() {
        let (taken, said) = judged((0..1000).map(|_| part(1, 8.0, &[0; 900])));
        assert!(taken == 18 && said.contains("Sweep cannot be true: a scan of 17100 bytes"), "{taken} {said}");
        assert!(judged([part(1, f32::INFINITY, &[])]).1.contains("Sweep"));
        let segment = |step, since_step, x| {
            let particles = [PathNode { parent: 0, map_from_robot: Pose2::new(x, 0.0, 0.0) }].into_iter().collect();
            FromRobot::Segment(Segment { step, since_step, stamp: Instant::default(), best: 0, particles })
        };
        assert_eq!(judged([segment(1, 0, 0.0), segment(3, 1, 0.1)]).0, 2);
        assert!(judged([segment(1, 0, 0.0), segment(1, 0, 0.1)]).1.contains("Segment"));
        assert!(judged([segment(1, 0, f32::NAN)]).1.contains("Segment"));
    }
}
