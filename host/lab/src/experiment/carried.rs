//! Is a robot that is picked up and set down elsewhere drawn over its map? A log cut and put together anew, drive after drive: **along one
//! stretch, from there along another one, and along the first one again**. The robot is told nothing; its path with the whole log is the truth.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::ops::Range;

use lrfslam_core::geometry::Pose2;
use lrfslam_core::math::uniform;
use lrfslam_core::random::RandomStream;
use lrfslam_core::time::{Duration, Instant};
use serde::Serialize;

use super::envelope::{Degradation, degrade};
use crate::evaluation::alignment;
use lrfslam_host::mapping::MappingConfig;
use lrfslam_host::pose_f64::PoseF64;
use lrfslam_host::runs::map::{MapRun, RunMemory};
use lrfslam_host::scans::log::LogScan;
use lrfslam_host::trajectory::TimedPose;

/// Who is carried less far than this from where it was picked up may have driven there, m.
const CARRIED_M: f32 = 3.0;
/// Places to set the robot down at that are tried for a drive.
const TRIES: usize = 1000;
/// Noticed in time is within this, s.
const SOON_S: f64 = 2.0;
/// Found again in time is within this way, m.
const NEAR_M: f64 = 10.0;

/// How a drive is put together, and what counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarriedConfig {
    /// Along the first stretch, m of way.
    pub before_m: f64,
    /// Along the other one, and back along the first one, m of way.
    pub after_m: f64,
    /// A pose farther than this from the truth is wrong, m.
    pub wrong_m: f64,
    /// What is made of the scans of each drive.
    pub harder: Degradation,
}

/// A log cut and put together anew.
#[derive(Debug, Clone, PartialEq)]
pub struct CarriedDrive {
    /// The scans; times go on as if the robot had never been touched.
    pub scans: Vec<LogScan>,
    /// Where the robot was, a pose for each scan, in the frame of the true path.
    pub truth: Vec<TimedPose>,
    /// When the first stretch, the other one, and the way back begin, on the drive's clock.
    pub begins: [Instant; 3],
    /// When the first stretch, and the other one, begin in the log, s.
    pub log_s: [f64; 2],
}

/// What became of one stretch of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct CarriedStretch {
    /// Scans in it.
    pub scans: usize,
    /// From its first scan to the first one that was called lost, s.
    pub lost_after_s: Option<f64>,
    /// From its first scan to the first one of which the run said, then and there, where the robot is, and was right, m of way.
    pub right_after_m: Option<f64>,
    /// Scans whose pose the results believe; …
    pub believed: usize,
    /// … of these, wrong, in the frame of the stretch most of whose poses are believed.
    pub wrong: usize,
    /// Largest error of a pose believed, m.
    pub worst_m: f64,
}

/// What became of a drive.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CarriedRun {
    /// Of the cuts, the degradation and the mapping.
    pub seed: u64,
    /// When the first stretch, and the other one, begin in the log, s.
    pub log_s: [f64; 2],
    /// Before the robot was carried, after, and after it was carried back.
    pub stretches: [CarriedStretch; 3],
    /// How far to trust the map, as the run itself says.
    pub trust: String,
}

/// Scans of a log whose true pose is known, and it, in the order of time; a time that runs back is left out.
///
/// * `truth` — the true path, in any order
pub fn on_true_path(scans: Vec<LogScan>, truth: &[TimedPose]) -> (Vec<LogScan>, Vec<TimedPose>) {
    let poses: HashMap<Instant, TimedPose> = truth.iter().map(|pose| (pose.stamp, *pose)).collect();
    let mut last: Option<Instant> = None;
    let known = scans.into_iter().filter_map(|scan| {
        let pose = *poses.get(&scan.stamp).filter(|pose| last.is_none_or(|last| pose.stamp > last))?;
        last = Some(scan.stamp);
        Some((scan, pose))
    });
    known.unzip()
}

impl CarriedDrive {
    /// Cuts a drive out of `scans`, each with its pose in `truth`, as [`on_true_path`] has them; the same `seed` makes the same cuts.
    ///
    /// # Errors
    /// If the true path is too short, or nowhere far enough from where the robot is picked up.
    pub fn cut(config: &CarriedConfig, seed: u64, scans: &[LogScan], truth: &[TimedPose]) -> anyhow::Result<Self> {
        let way_m = way(truth);
        let driven_m = way_m.last().copied().unwrap_or_default();
        // From a scan on, so far; the way never gets shorter.
        let stretch = |first: usize, length_m: f64| {
            let from_m = way_m.get(first).copied().unwrap_or_default();
            first..(way_m.partition_point(|way_m| way_m - from_m < length_m) + 1).min(way_m.len())
        };
        let starts = |length_m: f64| way_m.partition_point(|way_m| driven_m - way_m >= length_m);
        let mut rng = RandomStream::new(seed, 0, 0);
        let mut any = |starts: usize| ((starts as f32 * uniform(&mut rng)) as usize).min(starts.saturating_sub(1));
        let longest_m = config.before_m.max(config.after_m);
        anyhow::ensure!(
            starts(longest_m) > 0,
            "the true path is {driven_m:.1} m long; expected one of {longest_m} m at least"
        );
        let begins = any(starts(longest_m));
        let from = stretch(begins, config.before_m);
        let picked_up = truth[from.end - 1].map_from_robot.position();
        let is_far = |first: &usize| (truth[*first].map_from_robot.position() - picked_up).norm() >= CARRIED_M;
        let other = (0..TRIES).map(|_| any(starts(config.after_m))).find(is_far).ok_or_else(|| {
            anyhow::anyhow!("nothing of the true path is {CARRIED_M} m away from where the robot is picked up")
        })?;
        let (other, back) = (stretch(other, config.after_m), stretch(begins, config.after_m));
        Ok(Self::joined(scans, truth, [from, other, back]))
    }

    fn joined(scans: &[LogScan], truth: &[TimedPose], stretches: [Range<usize>; 3]) -> Self {
        let log_s = [0, 1].map(|k| scans[stretches[k].start].stamp.as_secs_f64());
        let (mut joined, mut poses): (Vec<LogScan>, Vec<TimedPose>) = (Vec::new(), Vec::new());
        let begins = stretches.map(|stretch| {
            let begins = match joined.as_slice() {
                [.., before, last] => Instant::from_micros(2 * last.stamp.micros - before.stamp.micros),
                _ => scans[stretch.start].stamp,
            };
            let later = begins.micros - scans[stretch.start].stamp.micros;
            for (scan, pose) in scans[stretch.clone()].iter().zip(&truth[stretch]) {
                let stamp = Instant::from_micros(scan.stamp.micros + later);
                joined.push(LogScan { stamp, ..scan.clone() });
                poses.push(TimedPose { stamp, ..*pose });
            }
            begins
        });
        Self { scans: joined, truth: poses, begins, log_s }
    }

    fn stretch_of(&self, stamp: Instant) -> usize {
        usize::from(stamp >= self.begins[1]) + usize::from(stamp >= self.begins[2])
    }
}

/// Way driven up to each pose, m.
fn way(truth: &[TimedPose]) -> Vec<f64> {
    let mut way_m = 0.0;
    let mut before: Option<Pose2> = None;
    let each = truth.iter().map(|TimedPose { map_from_robot: now, .. }| {
        way_m += before.map_or(0.0, |before| f64::from((now.position() - before.position()).norm()));
        before = Some(*now);
        way_m
    });
    each.collect()
}

/// What was said of a scan when it was taken.
struct Said {
    is_lost: bool,
    /// The pose, if it is believed.
    pose: Option<TimedPose>,
}

/// Maps a drive, and judges its path.
///
/// * `config` — of mapping, and where the laser sits if the log does not say
///
/// # Errors
/// If a scan is too large for the memory, or no pose at all is believed.
pub fn run_carried(
    (config, robot_from_lrf): (&MappingConfig, Pose2),
    carried: &CarriedConfig,
    seed: u64,
    drive: &CarriedDrive,
) -> anyhow::Result<CarriedRun> {
    let mut memory = RunMemory::new(config, 1);
    let mut map = MapRun::new(config, seed, &mut memory)?;
    let mut said = Vec::new();
    for scan in &degrade(&drive.scans, carried.harder, seed, 0) {
        let step = map.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or(robot_from_lrf), None)?;
        let pose = map.trusted_trajectory().last().copied().filter(|pose| pose.stamp == scan.stamp);
        said.push((scan.stamp, Said { is_lost: step.odometry.is_lost, pose }));
    }
    map.finish();
    let stretches = judge(carried.wrong_m, drive, &map.trusted_trajectory(), &said)?;
    Ok(CarriedRun { seed, log_s: drive.log_s, stretches, trust: map.quality().trust })
}

/// * `path` — of the results, as far as they believe it
fn judge(
    wrong_m: f64,
    drive: &CarriedDrive,
    path: &[TimedPose],
    said: &[(Instant, Said)],
) -> anyhow::Result<[CarriedStretch; 3]> {
    let of = |k: usize| -> Vec<TimedPose> {
        path.iter().filter(|pose| drive.stretch_of(pose.stamp) == k).copied().collect()
    };
    let parts = [0, 1, 2].map(of);
    let most = parts.iter().max_by_key(|part| part.len()).map_or(path, Vec::as_slice);
    let truth_from_map = alignment(most, &drive.truth, Duration::ZERO)?;
    let way_m = way(&drive.truth);
    let number = |stamp: Instant| drive.truth.binary_search_by_key(&stamp, |pose| pose.stamp).ok();
    let error_m = |pose: &TimedPose| {
        let truth = number(pose.stamp).map(|number| PoseF64::from(drive.truth[number].map_from_robot));
        truth.map(|truth| truth.between(truth_from_map.then(PoseF64::from(pose.map_from_robot))).distance_m())
    };
    let mut stretches = [CarriedStretch::default(); 3];
    for (stamp, said) in said {
        let k = drive.stretch_of(*stamp);
        let stretch = &mut stretches[k];
        stretch.scans += 1;
        if said.is_lost && stretch.lost_after_s.is_none() {
            stretch.lost_after_s = Some(stamp.since(drive.begins[k]).micros as f64 / 1e6);
        }
        let is_right = said.pose.as_ref().and_then(error_m).is_some_and(|error_m| error_m <= wrong_m);
        if let (None, true, Some(at), Some(from)) =
            (stretch.right_after_m, is_right, number(*stamp), number(drive.begins[k]))
        {
            stretch.right_after_m = Some(way_m[at] - way_m[from]);
        }
    }
    for (stretch, part) in stretches.iter_mut().zip(&parts) {
        let errors: Vec<f64> = part.iter().filter_map(error_m).collect();
        stretch.believed = errors.len();
        stretch.wrong = errors.iter().filter(|error_m| **error_m > wrong_m).count();
        stretch.worst_m = errors.iter().copied().fold(0.0, f64::max);
    }
    Ok(stretches)
}

/// A line for each stretch of each drive.
pub fn carried_csv(runs: &[CarriedRun]) -> String {
    let mut text = String::from(
        "seed,stretch,log_first_s,log_other_s,scans,lost_after_s,right_after_m,believed,wrong,worst_m,trust\n",
    );
    let cell = |number: Option<f64>| number.map_or(String::new(), |number| format!("{number:.2}"));
    for CarriedRun { seed, log_s: [first_s, other_s], stretches, trust } in runs {
        for (name, stretch) in NAMES.iter().zip(stretches) {
            let CarriedStretch { scans, lost_after_s, right_after_m, believed, wrong, worst_m } = stretch;
            let (lost, right) = (cell(*lost_after_s), cell(*right_after_m));
            // Writing to a string cannot fail. The sentence has commas, and no quotation marks.
            let _ = writeln!(
                text,
                "{seed},{name},{first_s:.3},{other_s:.3},{scans},{lost},{right},{believed},{wrong},{worst_m:.3},\"{trust}\""
            );
        }
    }
    text
}

/// The stretches of a drive.
const NAMES: [&str; 3] = ["before", "elsewhere", "back"];

/// What came out, stretch by stretch, as a table in Markdown; and below it each drive of which something wrong is believed.
pub fn carried_markdown(runs: &[CarriedRun]) -> String {
    let mut text = String::from(
        "| stretch | drives | lost within 2 s | never lost | right within 10 m | scans | believed, % | of these wrong | in drives | worst, m |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for (k, name) in NAMES.iter().enumerate() {
        let of = || runs.iter().map(|run| &run.stretches[k]);
        let sum = |number: fn(&CarriedStretch) -> usize| of().map(number).sum::<usize>();
        let count = |is: &dyn Fn(&CarriedStretch) -> bool| of().filter(|stretch| is(stretch)).count();
        let soon = count(&|stretch| stretch.lost_after_s.is_some_and(|after_s| after_s <= SOON_S));
        let never = count(&|stretch| stretch.lost_after_s.is_none());
        let right = count(&|stretch| stretch.right_after_m.is_some_and(|after_m| after_m <= NEAR_M));
        let (scans, believed, wrong) = (sum(|s| s.scans), sum(|s| s.believed), sum(|s| s.wrong));
        let (in_drives, worst_m) = (count(&|stretch| stretch.wrong > 0), of().map(|s| s.worst_m).fold(0.0, f64::max));
        let share = 100.0 * believed as f64 / scans.max(1) as f64;
        let _ = writeln!(
            text,
            "| {name} | {} | {soon} | {never} | {right} | {scans} | {share:.1} | {wrong} | {in_drives} | {worst_m:.2} |",
            runs.len()
        );
    }
    let wrong = |run: &&CarriedRun| run.stretches.iter().any(|stretch| stretch.wrong > 0);
    if runs.iter().any(|run| wrong(&run)) {
        text.push_str("\nWhat the runs say of maps in which something wrong is believed:\n\n");
    }
    for CarriedRun { seed, log_s: [first_s, other_s], stretches, trust } in runs.iter().filter(wrong) {
        let wrong: usize = stretches.iter().map(|stretch| stretch.wrong).sum();
        let _ = writeln!(text, "- seed {seed}, from {first_s:.1} s to {other_s:.1} s: {wrong} scans; {trust}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: CarriedConfig =
        CarriedConfig { before_m: 20.0, after_m: 8.0, wrong_m: 0.5, harder: Degradation::None };

    /// A drive of 100 m along a line, half a metre and half a second a scan.
    fn log() -> (Vec<LogScan>, Vec<TimedPose>) {
        let stamp = |number: u64| Instant::from_micros(500_000 * number as i64);
        let scan = |number: u64| LogScan {
            stamp: stamp(number),
            range_max_m: 8.0,
            beams: Vec::new(),
            map_from_robot_odometry: None,
            robot_from_lrf: None,
            line: number + 1,
        };
        let pose =
            |number: u64| TimedPose { stamp: stamp(number), map_from_robot: Pose2::new(0.5 * number as f32, 3.0, 0.0) };
        ((0..=200).map(scan).collect(), (0..=200).map(pose).collect())
    }

    fn cut(seed: u64) -> CarriedDrive {
        let (scans, truth) = log();
        CarriedDrive::cut(&CONFIG, seed, &scans, &truth).unwrap()
    }

    #[test]
    fn a_drive_goes_on_elsewhere_and_comes_back_without_a_gap_in_time() {
        for seed in 1..20 {
            let drive = cut(seed);
            let at = |number: usize| drive.truth[number].map_from_robot.x;
            assert_eq!((drive.scans.len(), drive.truth.len()), (41 + 17 + 17, 75), "both ends of each stretch");
            assert_eq!((at(40) - at(0), at(57) - at(41), at(74) - at(58)), (20.0, 8.0, 8.0));
            assert!((at(41) - at(40)).abs() >= CARRIED_M && at(58) == at(0), "seed {seed}");
            let gaps = drive.scans.windows(2).map(|pair| pair[1].stamp.since(pair[0].stamp).micros);
            assert!(gaps.into_iter().all(|gap| gap == 500_000));
            assert_eq!(drive.begins, [0, 41, 58].map(|number: usize| drive.scans[number].stamp));
            assert!(drive.scans.iter().zip(&drive.truth).all(|(scan, pose)| scan.stamp == pose.stamp));
            assert_eq!(drive.log_s[1], f64::from(at(41)), "a second a metre");
        }
        assert!(cut(1) == cut(1) && cut(1) != cut(2));
    }

    #[test]
    fn a_path_too_short_to_be_carried_along_is_told() {
        let (scans, truth) = log();
        let refused =
            |count: usize| CarriedDrive::cut(&CONFIG, 1, &scans[..count], &truth[..count]).unwrap_err().to_string();
        assert_eq!(refused(31), "the true path is 15.0 m long; expected one of 20 m at least");
        assert_eq!(refused(0), "the true path is 0.0 m long; expected one of 20 m at least");
    }

    #[test]
    fn scans_without_a_true_pose_and_times_that_run_back_are_left_out() {
        let (mut scans, mut truth) = log();
        truth.remove(7);
        scans[20].stamp = scans[3].stamp;
        let (scans, truth) = on_true_path(scans, &truth);
        assert_eq!((scans.len(), truth.len()), (199, 199));
        assert!(truth.windows(2).all(|pair| pair[0].stamp < pair[1].stamp));
    }

    #[test]
    fn poses_drawn_over_the_first_stretch_are_wrong_and_those_apart_are_not() {
        let drive = cut(1);
        // In its own frame; the first scan of the other stretch is taken for the next one of the first, and the way back is right from its third metre on.
        let frame = Pose2::new(1.0, 2.0, 0.7);
        let seen = |number: usize| {
            let Pose2 { x, y, .. } = drive.truth[number].map_from_robot;
            let x = if drive.stretch_of(drive.truth[number].stamp) == 1 { x + 2.0 } else { x };
            TimedPose { map_from_robot: frame * Pose2::new(x, y, 0.0), ..drive.truth[number] }
        };
        let path: Vec<TimedPose> = (0..75).filter(|number| !(50..64).contains(number)).map(seen).collect();
        let said = |number: usize| {
            let pose = (!(50..64).contains(&number)).then(|| seen(number));
            (drive.truth[number].stamp, Said { is_lost: (50..64).contains(&number), pose })
        };
        let said: Vec<_> = (0..75).map(said).collect();
        let [before, elsewhere, back] = judge(0.5, &drive, &path, &said).unwrap();
        let sums = |s: CarriedStretch| (s.scans, s.believed, s.wrong, s.lost_after_s);
        assert_eq!(sums(before), (41, 41, 0, None));
        assert_eq!(sums(elsewhere), (17, 9, 9, Some(4.5)));
        assert_eq!(sums(back), (17, 11, 0, Some(0.0)));
        assert_eq!((before.right_after_m, elsewhere.right_after_m, back.right_after_m), (Some(0.0), None, Some(3.0)));
        assert!((elsewhere.worst_m - 2.0).abs() < 1e-3 && back.worst_m < 1e-3, "{elsewhere:?} {back:?}");
        let run = |seed| CarriedRun {
            seed,
            log_s: drive.log_s,
            stretches: [before, elsewhere, back],
            trust: "do, or not".to_owned(),
        };
        let csv = carried_csv(&[run(1), run(2)]);
        assert!(csv.lines().nth(5).unwrap().ends_with(",17,4.50,,9,9,2.000,\"do, or not\""), "{csv}");
        let table = carried_markdown(&[run(1), run(2)]);
        assert!(table.contains("\n| elsewhere | 2 | 0 | 0 | 0 | 34 | 52.9 | 18 | 2 | 2.00 |\n"), "{table}");
        assert!(table.contains("\n| back | 2 | 2 | 0 | 2 | 34 | 64.7 | 0 | 0 | 0.00 |\n"), "{table}");
        assert!(table.ends_with(": 9 scans; do, or not\n"), "{table}");
    }
}
