//! Scans kept in memory, so that the map can be drawn again when the path behind it has changed.
//!
//! Twelve bytes a beam: bearing and range as they lie in the middle of the sweep, and which way the wall faces; invalid beams are left out. Saved, it
//! is two or three: ranges to 0.1 mm and bearings to 10 µrad, from beam to beam.

use lrfslam_core::facing::{Facing, face};
use lrfslam_core::geometry::{Point2, Pose2};
use lrfslam_core::scan::{Beam, Echo, RangeScan};
use lrfslam_core::sweep::Sweep;
use lrfslam_core::time::{Duration, Instant};
use serde::{Deserialize, Serialize, Serializer};

/// Units of a saved range in a metre, and of a saved bearing in a radian.
const RANGE_UNITS: f64 = 1e4;
const BEARING_UNITS: f64 = 1e5;

#[derive(Debug, Clone, Copy, PartialEq)]
struct KeptBeam {
    bearing_rad: f32,
    /// Negative: nothing was seen.
    range_m: f32,
    /// In the robot frame. A scan is drawn in many submaps, and its walls face the same way in each.
    facing: Facing,
}

impl KeptBeam {
    /// Which way its wall faces is not known yet.
    fn new(bearing_rad: f32, range_m: f32) -> Self {
        Self { bearing_rad, range_m, facing: Facing::UNKNOWN }
    }

    /// Where it hit, robot frame; `None` if it hit nothing up to `range_max_m`.
    fn hit(&self, robot_from_lrf: Pose2, range_max_m: f32) -> Option<Point2> {
        let near = (0.0..=range_max_m).contains(&self.range_m);
        let hit = || robot_from_lrf.transform(Point2::from_polar(self.range_m, self.bearing_rad));
        near.then(|| Point2 { facing: self.facing, ..hit() })
    }
}

#[derive(Debug, Clone, PartialEq)]
struct KeptScan {
    stamp: Instant,
    range_max_m: f32,
    robot_from_lrf: Pose2,
    /// Of a forgotten scan there are none, and their memory waits for the next one: robots that drive for a day would break it to pieces.
    beams: Vec<KeptBeam>,
}

/// A scan as it is saved: numbers from beam to beam, of which most are small.
#[derive(Debug, Serialize, Deserialize)]
struct SavedScan {
    stamp: Instant,
    range_max_m: f32,
    robot_from_lrf: Pose2,
    bearing_steps: Vec<i32>,
    range_steps: Vec<i32>,
}

/// See the [module](self).
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(from = "Vec<SavedScan>")]
pub struct ScanStore {
    scans: Vec<KeptScan>,
    /// Places of scans that were forgotten: the next ones come there.
    free: Vec<u32>,
}

impl ScanStore {
    /// Keeps a scan; returns its place, which is that of a [forgotten](Self::forget) one if there is any.
    pub fn add(&mut self, sweep: &Sweep<'_>) -> u32 {
        let kept = |Beam { bearing_rad, echo, .. }| match echo {
            Echo::Hit(range_m) => Some(KeptBeam::new(bearing_rad, range_m)),
            Echo::Miss => Some(KeptBeam::new(bearing_rad, -1.0)),
            Echo::Invalid => None,
        };
        let kept = sweep.scan.beams.iter().map(sweep.middle_beam()).filter_map(kept);
        let RangeScan { stamp, range_max_m, .. } = sweep.scan;
        let scan = |mut beams: Vec<KeptBeam>| {
            face_walls(&mut beams, sweep.robot_from_lrf);
            KeptScan { stamp, range_max_m, robot_from_lrf: sweep.robot_from_lrf, beams }
        };
        if let Some(place) = self.free.pop()
            && let Some(free) = self.scans.get_mut(place as usize)
        {
            let mut beams = std::mem::take(&mut free.beams);
            // No more than that: growing doubles.
            beams.reserve_exact(sweep.scan.beams.len());
            beams.extend(kept);
            *free = scan(beams);
            return place;
        }
        let mut beams: Vec<KeptBeam> = kept.collect();
        beams.shrink_to_fit();
        self.scans.push(scan(beams));
        (self.scans.len() - 1) as u32
    }

    /// Lets a scan go. Nobody may name its place any more.
    pub fn forget(&mut self, index: u32) {
        if let Some(kept) = self.scans.get_mut(index as usize) {
            kept.beams.clear();
            self.free.push(index);
        }
    }

    /// Places of scans, those of forgotten ones with them.
    pub fn len(&self) -> usize {
        self.scans.len()
    }

    /// Scans held.
    pub fn kept(&self) -> usize {
        self.scans.len() - self.free.len()
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.scans.is_empty()
    }

    /// Bytes of the beams held.
    pub fn memory_bytes(&self) -> usize {
        self.scans.iter().map(|kept| kept.beams.len()).sum::<usize>() * size_of::<KeptBeam>()
    }

    /// Where the laser of scan `index` sits on the robot.
    pub fn robot_from_lrf(&self, index: usize) -> Pose2 {
        self.scans.get(index).map_or(Pose2::IDENTITY, |kept| kept.robot_from_lrf)
    }

    /// Hits of scan `index` up to `range_max_m`, robot frame.
    pub fn hits(&self, index: usize, range_max_m: f32) -> impl Iterator<Item = Point2> + '_ {
        let robot_from_lrf = self.robot_from_lrf(index);
        self.beams_of(index).iter().filter_map(move |beam| beam.hit(robot_from_lrf, range_max_m))
    }

    /// Beams of scan `index`; none of one that was forgotten.
    pub fn beams(&self, index: usize) -> usize {
        self.beams_of(index).len()
    }

    fn beams_of(&self, index: usize) -> &[KeptBeam] {
        self.scans.get(index).map_or(&[], |kept| &kept.beams)
    }

    /// Scan `index`, its beams written over `beams`; `None` past the last one.
    pub fn sweep<'b>(&self, index: usize, beams: &'b mut Vec<Beam>) -> Option<Sweep<'b>> {
        let kept = self.scans.get(index)?;
        beams.clear();
        beams.extend(self.beams_of(index).iter().map(|beam| Beam {
            bearing_rad: beam.bearing_rad,
            offset: Duration::ZERO,
            echo: if beam.range_m < 0.0 { Echo::Miss } else { Echo::Hit(beam.range_m) },
        }));
        let scan = RangeScan { stamp: kept.stamp, range_max_m: kept.range_max_m, beams };
        Some(Sweep::at_rest(scan, kept.robot_from_lrf))
    }
}

/// Scan by scan, as a building's take 30 MB once more.
impl Serialize for ScanStore {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.scans.iter().map(SavedScan::from))
    }
}

impl From<&KeptScan> for SavedScan {
    fn from(kept: &KeptScan) -> Self {
        let beams = kept.beams.iter();
        Self {
            stamp: kept.stamp,
            range_max_m: kept.range_max_m,
            robot_from_lrf: kept.robot_from_lrf,
            bearing_steps: steps(beams.clone().map(|beam| beam.bearing_rad), BEARING_UNITS),
            range_steps: steps(beams.map(|beam| beam.range_m), RANGE_UNITS),
        }
    }
}

impl From<Vec<SavedScan>> for ScanStore {
    fn from(saved: Vec<SavedScan>) -> Self {
        let mut store = Self::default();
        for SavedScan { stamp, range_max_m, robot_from_lrf, bearing_steps, range_steps } in saved {
            let ranges = values(&range_steps, RANGE_UNITS);
            let beams = values(&bearing_steps, BEARING_UNITS).zip(ranges);
            let mut beams: Vec<KeptBeam> =
                beams.map(|(bearing_rad, range_m)| KeptBeam::new(bearing_rad, range_m)).collect();
            face_walls(&mut beams, robot_from_lrf);
            store.scans.push(KeptScan { stamp, range_max_m, robot_from_lrf, beams });
        }
        store
    }
}

/// Tells of each hit which way its wall faces.
fn face_walls(beams: &mut [KeptBeam], robot_from_lrf: Pose2) {
    let mut hits: Vec<Point2> = beams.iter().filter_map(|beam| beam.hit(robot_from_lrf, f32::INFINITY)).collect();
    face(&mut hits, robot_from_lrf.position());
    let seen = beams.iter_mut().filter(|beam| beam.range_m >= 0.0);
    for (beam, hit) in seen.zip(hits) {
        beam.facing = hit.facing;
    }
}

/// Each of `values` in units, less the one before.
fn steps(values: impl Iterator<Item = f32>, units: f64) -> Vec<i32> {
    let mut before = 0_i32;
    let step = |value: f32| {
        let now = (f64::from(value) * units).round() as i32;
        now.wrapping_sub(std::mem::replace(&mut before, now))
    };
    values.map(step).collect()
}

/// What [`steps`] was made from.
fn values(steps: &[i32], units: f64) -> impl Iterator<Item = f32> {
    steps.iter().scan(0_i32, move |now, step| {
        *now = now.wrapping_add(*step);
        Some((f64::from(*now) / units) as f32)
    })
}

#[cfg(test)]
mod tests {
    use lrfslam_core::facing::{FACINGS_MAX, Planes};

    use super::*;

    #[test]
    fn kept_scans_come_back_without_their_invalid_beams() {
        let beam = |bearing_rad, echo| Beam { bearing_rad, offset: Duration::ZERO, echo };
        let first = [beam(-0.5, Echo::Hit(2.0)), beam(0.0, Echo::Invalid), beam(0.5, Echo::Miss)];
        let second = [beam(0.25, Echo::Hit(1.0))];
        let mut store = ScanStore::default();
        for beams in [&first[..], &[], &second] {
            let scan = RangeScan { stamp: Instant::from_micros(7), range_max_m: 8.0, beams };
            store.add(&Sweep::at_rest(scan, Pose2::new(0.1, 0.0, 0.0)));
        }
        let mut beams = Vec::new();
        let mut seen = |index| {
            let sweep = store.sweep(index, &mut beams)?;
            assert_eq!((sweep.robot_from_lrf.x, sweep.scan.range_max_m), (0.1, 8.0));
            Some(sweep.scan.beams.iter().map(|beam| (beam.bearing_rad, beam.echo)).collect::<Vec<_>>())
        };
        let near = |a: f32, b: f32| (a - b).abs() < 1e-6;
        let found = seen(0).unwrap();
        assert!(matches!(found[0], (b, Echo::Hit(r)) if near(b, -0.5) && near(r, 2.0)), "{found:?}");
        assert!(matches!(found[1], (b, Echo::Miss) if near(b, 0.5)), "{found:?}");
        assert_eq!((found.len(), seen(1).unwrap().len(), seen(2).unwrap().len()), (2, 0, 1));
        assert!(seen(3).is_none());
    }

    #[test]
    fn saved_scans_are_the_same_to_a_tenth_of_a_millimetre_and_stay_so() {
        let beam = |bearing_rad, echo| Beam { bearing_rad, offset: Duration::ZERO, echo };
        let beams = [beam(-1.234_567, Echo::Hit(7.654_321)), beam(0.0, Echo::Miss), beam(0.7, Echo::Hit(79.123_45))];
        let mut store = ScanStore::default();
        for beams in [&beams[..], &[], &beams[1..]] {
            let scan = RangeScan { stamp: Instant::from_micros(-5), range_max_m: 81.0, beams };
            store.add(&Sweep::at_rest(scan, Pose2::new(0.1, 0.0, 0.2)));
        }
        let bytes = postcard::to_stdvec(&store).unwrap();
        let back: ScanStore = postcard::from_bytes(&bytes).unwrap();
        assert_eq!(back.len(), 3);
        let beams = |store: &ScanStore| store.scans.iter().flat_map(|kept| kept.beams.clone()).collect::<Vec<_>>();
        for (beam, kept) in beams(&back).iter().zip(&beams(&store)) {
            let (range, bearing) = (beam.range_m - kept.range_m, beam.bearing_rad - kept.bearing_rad);
            assert!(range.abs() < 6e-5 && bearing.abs() < 6e-6, "{beam:?} {kept:?}");
            assert_eq!(beam.range_m < 0.0, kept.range_m < 0.0);
        }
        assert_eq!(postcard::to_stdvec(&back).unwrap(), bytes);
    }

    #[test]
    fn hits_know_which_way_their_walls_face_wherever_they_come_from() {
        let wall = |y: f32| (0_u8..20).map(move |step| Point2::new(2.0 + 0.1 * f32::from(step), y));
        let beam =
            |at: Point2| Beam { bearing_rad: at.bearing_rad(), offset: Duration::ZERO, echo: Echo::Hit(at.norm()) };
        let gap = Beam { bearing_rad: 0.0, offset: Duration::ZERO, echo: Echo::Miss };
        let beams: Vec<Beam> = wall(-1.0).map(beam).chain([gap]).chain(wall(1.0).map(beam)).collect();
        let scan = RangeScan { stamp: Instant::from_micros(7), range_max_m: 8.0, beams: &beams };
        let mut store = ScanStore::default();
        for _ in 0..2 {
            store.add(&Sweep::at_rest(scan, Pose2::new(0.1, 0.2, 1.0)));
        }
        store.forget(0);
        store.add(&Sweep::at_rest(scan, Pose2::new(0.1, 0.2, 1.0)));
        let loaded: ScanStore = postcard::from_bytes(&postcard::to_stdvec(&store).unwrap()).unwrap();
        let planes = Planes::new(FACINGS_MAX);
        for (store, index) in [(&store, 0), (&store, 1), (&loaded, 0), (&loaded, 1)] {
            let hits: Vec<Point2> = store.hits(index, f32::INFINITY).collect();
            assert_eq!(hits.len(), 40);
            assert!(hits.iter().all(|hit| hit.facing.is_seen()));
            // Each wall is in one plane, and the one across is in another.
            let of = |hit: &Point2| planes.of(hit.facing, 0.0);
            let (right, left) = hits.split_at(20);
            assert!(right.iter().all(|hit| of(hit) == of(&right[0])) && left.iter().all(|hit| of(hit) == of(&left[0])));
            assert_ne!(of(&right[0]), of(&left[0]));
            // What is too far away is left out, and the rest faces the way it did.
            let near: Vec<Point2> = store.hits(index, 3.0).collect();
            assert!(near.len() < 40 && near.iter().all(|hit| hits.contains(hit)));
        }
    }

    #[test]
    fn places_of_forgotten_scans_are_used_again() {
        let beam = Beam { bearing_rad: 0.1, offset: Duration::ZERO, echo: Echo::Hit(2.0) };
        let mut store = ScanStore::default();
        let add = |store: &mut ScanStore, micros| {
            let scan = RangeScan { stamp: Instant::from_micros(micros), range_max_m: 8.0, beams: &[beam; 4] };
            store.add(&Sweep::at_rest(scan, Pose2::IDENTITY))
        };
        assert_eq!([1, 2, 3].map(|micros| add(&mut store, micros)), [0, 1, 2]);
        let bytes = store.memory_bytes();
        store.forget(1);
        assert_eq!((store.len(), store.kept(), store.memory_bytes()), (3, 2, bytes / 3 * 2));
        assert_eq!((add(&mut store, 4), add(&mut store, 5)), (1, 3));
        let stamps = (0..4).map(|index| store.sweep(index, &mut Vec::new()).unwrap().scan.stamp.micros);
        assert_eq!(stamps.collect::<Vec<_>>(), [1, 4, 3, 5]);
        store.forget(0);
        let scan = RangeScan { stamp: Instant::from_micros(6), range_max_m: 8.0, beams: &[beam; 5] };
        store.add(&Sweep::at_rest(scan, Pose2::IDENTITY));
        assert_eq!((store.beams(0), store.scans[0].beams.capacity()), (5, 5), "no more room than is needed");
    }
}
