//! Poses of a segment, which are packed and put aside once none of its scans is stored any more: of known ground a robot that drives
//! for a day keeps its path alone, and that on disk.

use lrfslam_core::geometry::Pose2;
use lrfslam_core::time::{Duration, Instant};

use super::segment::SegmentPose;
use crate::output::{Aside, Kept};

/// In order. Packed, a pose is some 20 bytes instead of 40, and comes out bit by bit as it was.
#[derive(Debug, Clone, Default)]
pub struct SegmentPoses {
    /// None if they are packed.
    poses: Vec<SegmentPose>,
    packed: Packed,
}

/// Poses without scans, one after the other.
#[derive(Debug, Clone, Default)]
struct Packed {
    bytes: Kept,
    count: usize,
}

/// From the stamp before, µs; pose; slack, m; whether it is a guess.
type PackedPose = (i64, Pose2, f32, bool);

impl SegmentPoses {
    /// Adds one at the end.
    pub(super) fn push(&mut self, pose: SegmentPose) {
        self.unpack();
        self.poses.push(pose);
    }

    /// Their number.
    pub fn len(&self) -> usize {
        self.poses.len() + self.packed.count
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The last one.
    pub fn last(&self) -> Option<SegmentPose> {
        self.poses.last().copied().or_else(|| self.packed.iter().last())
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = SegmentPose> {
        self.packed.iter().chain(self.poses.iter().copied())
    }

    /// Those whose scans are stored, with these.
    pub fn with_scans(&self) -> impl Iterator<Item = (SegmentPose, u32)> {
        self.poses.iter().filter_map(|pose| Some((*pose, pose.scan?)))
    }

    /// True if scans of them are stored.
    pub(super) fn have_scans(&self) -> bool {
        self.with_scans().next().is_some()
    }

    /// Nobody knows where the last ones from `known` on were taken.
    pub(super) fn doubt_from(&mut self, known: usize) {
        self.unpack();
        self.poses.iter_mut().skip(known).for_each(|pose| pose.is_lost = true);
    }

    /// No more of them come.
    pub(super) fn close(&mut self) {
        if self.have_scans() {
            self.poses.shrink_to_fit();
        } else {
            self.pack();
        }
    }

    /// What is packed goes to the disk.
    pub(super) fn put_aside(&mut self, aside: &Aside) {
        self.packed.bytes.put_aside(aside);
    }

    /// Gives away their scans.
    pub(super) fn take_scans(&mut self) -> Vec<u32> {
        let scans = self.poses.iter_mut().filter_map(|pose| pose.scan.take()).collect();
        self.pack();
        scans
    }

    fn pack(&mut self) {
        self.unpack();
        let mut before = Instant::default();
        let mut bytes = Vec::new();
        for SegmentPose { stamp, start_from_robot, slack_m, is_lost, .. } in &self.poses {
            let packed: PackedPose = (stamp.since(before).micros, *start_from_robot, *slack_m, *is_lost);
            before = *stamp;
            match postcard::to_extend(&packed, bytes) {
                Ok(longer) => bytes = longer,
                // Numbers into memory; if it failed, they would stay as they are.
                Err(_) => return,
            }
        }
        self.packed = Packed { bytes: Kept::Here(bytes.into_boxed_slice()), count: self.poses.len() };
        self.poses = Vec::new();
    }

    fn unpack(&mut self) {
        let packed = std::mem::take(&mut self.packed);
        if packed.count > 0 {
            self.poses = packed.iter().collect();
        }
    }
}

impl FromIterator<SegmentPose> for SegmentPoses {
    fn from_iter<I: IntoIterator<Item = SegmentPose>>(poses: I) -> Self {
        let mut poses = Self { poses: poses.into_iter().collect(), packed: Packed::default() };
        poses.close();
        poses
    }
}

impl Packed {
    fn iter(&self) -> impl Iterator<Item = SegmentPose> {
        let (bytes, mut taken, mut stamp) = (self.bytes.read(), 0, Instant::default());
        std::iter::from_fn(move || {
            let ((micros, start_from_robot, slack_m, is_lost), rest) =
                postcard::take_from_bytes::<PackedPose>(bytes.get(taken..)?).ok()?;
            (taken, stamp) = (bytes.len() - rest.len(), stamp + Duration { micros });
            Some(SegmentPose { stamp, start_from_robot, slack_m, scan: None, is_lost })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(number: u16) -> SegmentPose {
        SegmentPose {
            stamp: Instant::from_micros(1_700_000_000_000_000 + 200_000 * i64::from(number)),
            start_from_robot: Pose2::new(f32::from(number) / 3.0, -f32::from(number) / 7.0, 0.1),
            slack_m: f32::from(number) / 9.0,
            scan: number.is_multiple_of(2).then_some(u32::from(number)),
            is_lost: number == 5,
        }
    }

    #[test]
    fn packed_poses_come_out_as_they_were_but_for_their_scans() {
        let poses: Vec<SegmentPose> = (0..200).map(pose).collect();
        let mut packed: SegmentPoses = poses.iter().copied().collect();
        assert!(packed.have_scans() && packed.iter().eq(poses.iter().copied()));
        assert_eq!(packed.take_scans(), (0..200).step_by(2).collect::<Vec<u32>>());
        let silent = |pose: &SegmentPose| SegmentPose { scan: None, ..*pose };
        assert!(packed.poses.is_empty() && !packed.have_scans());
        assert!(packed.iter().eq(poses.iter().map(silent)));
        assert_eq!((packed.len(), packed.last()), (200, poses.last().map(silent)));
        let bytes = packed.packed.bytes.read().len();
        assert!(bytes < 21 * 200, "{bytes} bytes");
        packed.push(pose(200));
        assert_eq!((packed.len(), packed.last()), (201, Some(pose(200))));
    }

    #[test]
    fn poses_put_aside_are_on_disk_and_come_out_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let aside = Aside::in_folder(folder.path());
        let mut all = [0, 100].map(|first| (first..first + 100).map(pose).collect::<SegmentPoses>());
        for poses in &mut all {
            let before: Vec<SegmentPose> = poses.iter().map(|pose| SegmentPose { scan: None, ..pose }).collect();
            poses.put_aside(&aside);
            assert!(poses.have_scans(), "scans are wanted");
            poses.take_scans();
            poses.put_aside(&aside);
            assert!(matches!(poses.packed.bytes, Kept::Aside { .. }));
            assert!(poses.iter().eq(before.iter().copied()) && poses.last() == before.last().copied());
        }
    }

    #[test]
    fn poses_that_never_had_a_scan_are_packed_when_no_more_come() {
        let mut poses = SegmentPoses::default();
        (0..10).for_each(|number| poses.push(SegmentPose { scan: None, ..pose(number) }));
        poses.doubt_from(8);
        poses.close();
        assert!(poses.poses.is_empty());
        let doubted: Vec<bool> = poses.iter().map(|pose| pose.is_lost).collect();
        assert_eq!(
            doubted,
            [5, 8, 9].iter().fold(vec![false; 10], |mut all, k| {
                all[*k] = true;
                all
            })
        );
    }
}
