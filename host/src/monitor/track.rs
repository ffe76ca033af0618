//! The path as it was given, and where each of its poses lies now.

use lrfslam_core::geometry::Pose2;

use super::batch::{Batch, GivenPose};
use crate::mapping::high::Stretch;
use crate::pose_f64::{PoseF64, wrap};
use crate::scans::store::ScanStore;

/// A stretch that has moved so far, m, at one of its ends or at what is seen from there, is drawn again.
const MOVED_M: f64 = 0.025;
/// What is seen is so far away, m. Chosen.
const SIGHT_M: f64 = 8.0;

/// See the [module](self).
#[derive(Debug, Default)]
pub(super) struct Track {
    pub stretches: Vec<Stretch>,
    pub poses: Vec<GivenPose>,
    pub scans: ScanStore,
    pub map_piece: usize,
}

impl Track {
    /// Takes what is new; returns the index of the first new pose.
    pub fn take(&mut self, batch: &Batch) -> usize {
        let first = self.poses.len();
        self.stretches.clone_from(&batch.stretches);
        self.map_piece = batch.map_piece;
        let mut beams = Vec::new();
        for given in &batch.poses {
            let scan = given.pose.scan.and_then(|scan| batch.scans.sweep(scan as usize, &mut beams)).map(|sweep| {
                self.scans.add(&sweep);
                self.scans.len() as u32 - 1
            });
            let mut given = *given;
            given.pose.scan = scan;
            self.poses.push(given);
        }
        first
    }

    /// Where a pose lies now, map frame; a bend of its stretch is spread along the way.
    pub fn place(&self, given: &GivenPose) -> Pose2 {
        let Some(stretch) = self.stretches.get(given.stretch) else { return given.pose.start_from_robot };
        let rigid = stretch.map_from_start.then(PoseF64::from(given.pose.start_from_robot));
        let share = f64::from(given.pose.slack_m) / f64::from(stretch.slack_m).max(1e-6);
        let PoseF64 { x, y, heading } = stretch.bend;
        PoseF64::new(rigid.x + share * x, rigid.y + share * y, wrap(rigid.heading + share * heading)).to_f32()
    }

    /// The piece of map that a pose belongs to.
    pub fn piece(&self, given: &GivenPose) -> usize {
        self.stretches.get(given.stretch).map_or(0, |stretch| stretch.piece)
    }

    /// True if a stretch does not lie any more where it lay in `before`.
    pub fn has_moved_since(&self, before: &[Stretch]) -> bool {
        self.stretches.iter().zip(before).any(|(now, then)| {
            let off = |a: PoseF64, b: PoseF64| {
                let moved = (a.x - b.x).hypot(a.y - b.y) + SIGHT_M * wrap(a.heading - b.heading).abs();
                moved > MOVED_M
            };
            now.piece != then.piece || off(now.map_from_start, then.map_from_start) || off(now.bend, then.bend)
        })
    }
}
