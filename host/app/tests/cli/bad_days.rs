//! Crowds, sparse lasers, slow scans, and robots that are carried away or blind: the example floor made harder.

use std::path::{Path, PathBuf};

use lrfslam_app::config::RunConfig;
use lrfslam_core::geometry::Pose2;
use lrfslam_core::scan::Echo;
use lrfslam_core::time::{Duration, Instant};
use lrfslam_host::runs::map::{MapRun, RunMemory};
use lrfslam_host::scans::log::{LogReader, LogScan};
use lrfslam_host::trajectory::{TimedPose, read_trajectory};
#[cfg(feature = "experiments")]
use lrfslam_lab::evaluation::evaluate_truth;

/// Scans of the example floor are so far apart, s; the truth has a pose for each.
const INTERVAL: Duration = Duration::from_millis(250);

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

/// The scans named by `order`, one after the other, as if the robot had been carried from one to the next; and where each was taken.
fn drive(order: impl Iterator<Item = usize>) -> (Vec<LogScan>, Vec<Pose2>) {
    let (scans, truth) = floor();
    let taken = |(at, index): (usize, usize)| {
        let stamp = Instant::from_micros(INTERVAL.micros * at as i64);
        let near = truth.iter().min_by_key(|pose| pose.stamp.since(scans[index].stamp).micros.abs()).unwrap();
        (LogScan { stamp, ..scans[index].clone() }, near.map_from_robot)
    };
    order.enumerate().map(taken).unzip()
}

/// The farthest that a believed pose is off the true one, m, with the first poses laid on one another.
fn worst_m(mapped: &Mapped, truth: &[Pose2]) -> f32 {
    let off = |pose: &TimedPose| {
        let place = truth[(pose.stamp.micros / INTERVAL.micros) as usize];
        (truth[0].between(place).position() - pose.map_from_robot.position()).norm()
    };
    mapped.trusted.iter().map(off).fold(0.0, f32::max)
}

/// To another room and back: both are one map in the end, though the robot was lost twice.
#[test]
fn a_robot_that_is_carried_away_and_back_draws_nothing_twice() {
    let (scans, truth) = drive((0..420).chain(560..806).chain(100..300));
    let mapped = mapped(&scans);
    let worst_m = worst_m(&mapped, &truth);
    println!("carried away: {} of {} poses believed, worst {worst_m:.3} m", mapped.trusted.len(), scans.len());
    assert!(worst_m < 0.5, "{worst_m}");
    assert!(mapped.trusted.len() * 100 >= scans.len() * 65, "{} of {}", mapped.trusted.len(), scans.len());
}

#[test]
fn a_covered_laser_on_a_driving_robot_costs_the_way_meanwhile_and_no_more() {
    let (mut scans, truth) = drive(0..806);
    for beam in scans[300..420].iter_mut().flat_map(|scan| &mut scan.beams) {
        beam.echo = Echo::Hit(0.08);
    }
    let mapped = mapped(&scans);
    let worst_m = worst_m(&mapped, &truth);
    println!("covered: {} of {} poses believed, worst {worst_m:.3} m", mapped.trusted.len(), scans.len());
    assert!(worst_m < 0.5, "{worst_m}");
    let covered = 300 * INTERVAL.micros..420 * INTERVAL.micros;
    assert!(mapped.trusted.iter().all(|pose| !covered.contains(&pose.stamp.micros)), "no pose while it sees nothing");
    assert!(mapped.trusted.len() >= 400, "{}", mapped.trusted.len());
}

/// A laser that is turned upside down on the way never finds the map again, and the map stays as it was.
#[test]
fn mirrored_scans_are_a_piece_apart() {
    let (mut scans, truth) = drive(0..806);
    for scan in &mut scans[400..] {
        let echoes: Vec<Echo> = scan.beams.iter().rev().map(|beam| beam.echo).collect();
        scan.beams.iter_mut().zip(echoes).for_each(|(beam, echo)| beam.echo = echo);
    }
    let mapped = mapped(&scans);
    let worst_m = worst_m(&mapped, &truth);
    println!("mirrored: {} poses believed, worst {worst_m:.3} m", mapped.trusted.len());
    assert!(mapped.pieces_apart >= 1 && worst_m < 1.0, "{} {worst_m}", mapped.pieces_apart);
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
