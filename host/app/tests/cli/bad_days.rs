//! Crowds, sparse lasers, slow scans, and robots that are carried away or blind: the example floor and Intel made harder.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use lrfslam_app::config::RunConfig;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::Echo;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_host::output::Aside;
use lrfslam_host::runs::map::{MapRun, RunMemory};
use lrfslam_host::scans::log::{LogReader, LogScan};
use lrfslam_host::trajectory::{TimedPose, read_trajectory};
use lrfslam_lab::evaluation::evaluate_truth;

use crate::common::real_data;

/// Scans of Intel are so far apart.
const INTERVAL: Duration = Duration::from_millis(200);

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(name)
}

fn floor() -> (Vec<LogScan>, Vec<TimedPose>) {
    let log = LogReader::open(&example("floor.log.gz"), RunConfig::default().log_options()).unwrap();
    let truth = read_trajectory(&example("floor.tum.gz")).unwrap();
    (log.map(Result::unwrap).collect(), truth)
}

/// What a run made of some scans: poses that it believes, and pieces that are not joined.
struct Mapped {
    trusted: Vec<TimedPose>,
    pieces_apart: u64,
}

fn mapped(scans: &[LogScan]) -> Mapped {
    let config = RunConfig::default();
    let mut memory = RunMemory::new(&config.mapping(), 2);
    let mut run = MapRun::new(&config.mapping(), 1, &mut memory).unwrap();
    for scan in scans {
        run.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or(Pose2::IDENTITY), None).unwrap();
    }
    Mapped { trusted: run.trusted_trajectory(), pieces_apart: run.high_counts().unwrap().pieces_apart }
}

/// Scans taken one after the other, as if the robot had been carried from one to the next.
fn driven(scans: impl Iterator<Item = LogScan>) -> Vec<LogScan> {
    let stamp = |at: usize| Instant::from_micros(INTERVAL.micros * at as i64);
    scans.enumerate().map(|(at, scan)| LogScan { stamp: stamp(at), ..scan }).collect()
}

/// Which of the scans of a drive it is.
fn index(pose: &TimedPose) -> usize {
    (pose.stamp.micros / INTERVAL.micros) as usize
}

/// Scans seen upside down.
fn mirrored(mut scan: LogScan) -> LogScan {
    let echoes: Vec<Echo> = scan.beams.iter().rev().map(|beam| beam.echo).collect();
    scan.beams.iter_mut().zip(echoes).for_each(|(beam, echo)| beam.echo = echo);
    scan
}

fn intel() -> Option<Vec<LogScan>> {
    let log = LogReader::open(&real_data("logs/intel.log.gz")?, RunConfig::default().log_options()).unwrap();
    Some(log.take(7000).map(Result::unwrap).collect())
}

/// To another place, over ways that it has not seen, and back to the start: what was seen twice lies where it lay.
#[test]
#[ignore = "heavy: run by .ci/run"]
fn a_robot_that_is_carried_away_and_back_draws_nothing_twice() {
    const LEG: usize = 1000;
    let Some(scans) = intel() else { return };
    let legs = [0..LEG, 6000..6000 + LEG, 0..LEG].map(|leg| scans[leg].to_vec());
    let mapped = mapped(&driven(legs.concat().into_iter()));
    let believed = |leg: usize| mapped.trusted.iter().filter(move |pose| index(pose) / LEG == leg);
    let first: HashMap<usize, TimedPose> = believed(0).map(|pose| (index(pose), *pose)).collect();
    let off = |pose: &TimedPose| {
        let there = first.get(&(index(pose) - 2 * LEG))?;
        Some((pose.map_from_robot.position() - there.map_from_robot.position()).norm())
    };
    let worst_m = believed(2).filter_map(off).fold(0.0, f32::max);
    println!("carried away: {} of {} poses believed, worst {worst_m:.3} m", mapped.trusted.len(), 3 * LEG);
    assert!(worst_m < 0.2, "{worst_m}");
    assert!(believed(0).count() == LEG && believed(2).count() * 10 >= LEG * 9, "{}", believed(2).count());
}

#[test]
fn a_covered_laser_on_a_driving_robot_costs_the_way_meanwhile_and_no_more() {
    let (mut scans, truth) = floor();
    for beam in scans[300..420].iter_mut().flat_map(|scan| &mut scan.beams) {
        beam.echo = Echo::Hit(0.08);
    }
    let mapped = mapped(&scans);
    let error = evaluate_truth(&mapped.trusted, &truth, Duration::from_millis(50), 10.0).unwrap().absolute_m;
    println!("covered: {} of {} poses believed, worst {:.3} m", mapped.trusted.len(), scans.len(), error.max);
    assert!(error.max < 0.3 && mapped.pieces_apart == 0, "{error:?}");
    let covered = scans[300].stamp..scans[420].stamp;
    assert!(mapped.trusted.iter().all(|pose| !covered.contains(&pose.stamp)), "no pose while it sees nothing");
    assert!(mapped.trusted.len() >= 600, "{}", mapped.trusted.len());
}

/// A laser that is turned upside down on the way never finds the map again, and the map stays as it was.
#[test]
#[ignore = "heavy: run by .ci/run"]
fn mirrored_scans_are_a_piece_apart() {
    const TURNED: usize = 1500;
    let Some(scans) = intel() else { return };
    let later = scans[TURNED..TURNED + 400].iter().cloned().map(mirrored);
    let mapped = mapped(&driven(scans[..TURNED].iter().cloned().chain(later)));
    let last = mapped.trusted.last().map(index);
    println!("mirrored: poses believed up to scan {last:?}");
    assert!(mapped.pieces_apart >= 1, "{}", mapped.pieces_apart);
    assert!(last.is_some_and(|last| (TURNED - 1..TURNED + 20).contains(&last)), "{last:?}");
}

#[cfg(feature = "experiments")]
#[test]
fn crowds_few_beams_and_slow_scans_cost_little() {
    use lrfslam_lab::experiment::{Degradation, degrade};
    let (scans, truth) = floor();
    // Bounds: a third above what seed 1 has.
    for (name, degradation, rmse_m) in [
        ("people 30 %", Degradation::People(0.3), 0.06),
        ("walkers", Degradation::Walkers(4), 0.06),
        ("every 2nd beam", Degradation::Beams(2), 0.06),
        ("every 4th scan", Degradation::Scans(4), 0.06),
    ] {
        let mapped = mapped(&degrade(&scans, degradation, 1, 0));
        let error = evaluate_truth(&mapped.trusted, &truth, Duration::from_millis(50), 10.0).unwrap().absolute_m;
        println!("{name}: RMSE {:.4} m, worst {:.3} m of {} poses", error.rmse, error.max, error.count);
        assert!(error.rmse <= rmse_m, "{name}: {error:?}");
    }
}

/// Maps the same lap of scans again and again, as the program does, with its path on disk; the run, and the scans kept after each lap.
fn rounds<'m>(lap: &[LogScan], scans: &[LogScan], memory: &'m mut RunMemory) -> (MapRun<'m>, Vec<u64>) {
    let mut run = MapRun::new(&RunConfig::default().mapping(), 1, memory).unwrap();
    let aside = Aside::in_folder(Path::new(env!("CARGO_TARGET_TMPDIR")));
    run.put_aside(aside.clone());
    let mut kept = Vec::new();
    for (at, scan) in scans.iter().enumerate() {
        run.add_scan(&scan.scan(), scan.robot_from_lrf.unwrap_or(Pose2::IDENTITY), None).unwrap();
        if (at + 1) % lap.len() == 0 {
            kept.push(run.high_counts().unwrap().scans_kept);
        }
    }
    println!("scans kept after each lap: {kept:?}; {} bytes of path and steps on disk", aside.bytes());
    // Of most rounds no scan is kept: some 20 bytes of path for each.
    assert!(aside.bytes() > 10 * scans.len() as u64 && aside.fault().is_none(), "{aside:?}");
    (run, kept)
}

/// A robot on its rounds: what is kept is bounded by the building, not by the way, and the map stays good.
#[test]
fn the_same_rounds_again_keep_no_more() {
    let (scans, truth) = floor();
    let lap: Vec<LogScan> = scans.into_iter().step_by(3).collect();
    let laps = driven((0..9).flat_map(|_| lap.iter().cloned()));
    let mut memory = RunMemory::new(&RunConfig::default().mapping(), 2);
    let (run, kept) = rounds(&lap, &laps, &mut memory);
    let [.., before, _, after] = kept[..] else { panic!("nine laps") };
    assert!(after as f64 <= 1.1 * before as f64, "{kept:?}");
    let of_last = |pose: &TimedPose| index(pose).checked_sub(8 * lap.len());
    let poses = run.trusted_trajectory();
    let last = poses.iter().filter_map(|pose| Some(TimedPose { stamp: lap[of_last(pose)?].stamp, ..*pose }));
    let error = evaluate_truth(&last.collect::<Vec<_>>(), &truth, Duration::from_millis(50), 10.0).unwrap().absolute_m;
    println!("last lap: RMSE {:.4} m, worst {:.3} m of {} poses", error.rmse, error.max, error.count);
    assert!(error.rmse <= 0.07 && error.count > lap.len() * 9 / 10, "{error:?}");
}

/// On each of its rounds the robot sees nothing for two seconds, every time somewhere else. Where it was then is known later, and what was
/// kept meanwhile goes.
#[test]
fn rounds_with_moments_without_sight_keep_no_more_either() {
    let (scans, _) = floor();
    let lap: Vec<LogScan> = scans.into_iter().step_by(3).collect();
    let mut laps = driven((0..12).flat_map(|_| lap.iter().cloned()));
    for round in 2..10 {
        let from = round * lap.len() + (round * 29) % (lap.len() - 10);
        for beam in laps[from..from + 10].iter_mut().flat_map(|scan| &mut scan.beams) {
            beam.echo = Echo::Hit(0.08);
        }
    }
    let mut memory = RunMemory::new(&RunConfig::default().mapping(), 2);
    let (_, kept) = rounds(&lap, &laps, &mut memory);
    let [.., before, _, _, _, _, after] = kept[..] else { panic!("twelve laps") };
    assert!(after as f64 <= 1.1 * before as f64, "{kept:?}");
}
