//! How many beams a scan has, and over which angle.

use std::collections::BTreeMap;

use super::finding::{Finding, Mark, Stretch};
use crate::plural::count;
use crate::scans::log::LogScan;

/// Fewer scans than one in so many with a number of beams of their own are odd.
const FEW: u64 = 100;
/// Beams farther apart than this are few, degrees. Chosen: matching alone has Intel nearly as well with every third degree as with every second, and
/// slips by metres with every fourth.
const SPARSE_DEG: f32 = 3.5;

/// Counts beams.
#[derive(Debug, Default)]
pub(super) struct BeamCheck {
    /// Scans by their number of beams, and the first of each.
    counts: BTreeMap<usize, (u64, Option<Mark>)>,
    /// Angles from first to last beam, the least and the greatest, rad.
    view_rad: Option<(f32, f32)>,
    scans: u64,
}

impl BeamCheck {
    pub fn see(&mut self, scan: &LogScan) {
        self.scans += 1;
        let entry = self.counts.entry(scan.beams.len()).or_default();
        entry.0 += 1;
        entry.1.get_or_insert(Mark::of(scan));
        let (Some(first), Some(last)) = (scan.beams.first(), scan.beams.last()) else { return };
        let view_rad = (last.bearing_rad - first.bearing_rad).abs();
        let (least, most) = self.view_rad.unwrap_or((view_rad, view_rad));
        self.view_rad = Some((least.min(view_rad), most.max(view_rad)));
    }

    pub fn report(&self, guessed_angles: u64, findings: &mut Vec<Finding>) {
        let usual = self.counts.iter().max_by_key(|(_, (scans, _))| *scans);
        let Some((&beams, &(same, _))) = usual else { return };
        let (least, most) = (self.counts.keys().next(), self.counts.keys().next_back());
        let (Some(&least), Some(&most), Some((_, view_rad))) = (least, most, self.view_rad) else { return };
        let view_deg = view_rad.to_degrees();
        let numbers = if least == most { format!("{beams}") } else { format!("{least} to {most}") };
        let step_deg = view_deg / (beams.max(2) - 1) as f32;
        let found = format!("{numbers} beams a scan over {view_deg:.0}°, {step_deg:.2}° apart");
        findings.push(Finding::note("beams", found));
        if step_deg > SPARSE_DEG {
            let found = format!("beams are {step_deg:.1}° apart");
            let means = "on bare walls they hit the same places ahead of the robot in every scan, as if it stood: ways may be too short by metres, and no scan says so";
            let advice = "map with --odometry if there is any; else take a laser whose beams are 3° apart at most";
            findings.push(Finding::unusual("few-beams", found, means).so(advice));
        }
        let odd = self.scans - same;
        if odd > 0 && odd * FEW < self.scans {
            let others: Vec<_> = self.counts.iter().filter(|(number, _)| **number != beams).collect();
            let at = others.iter().filter_map(|(_, (_, mark))| mark.map(|mark| Stretch::new(mark, mark)));
            let found = format!("{} with another number of beams than the {beams} of the others", count(odd, "scan"));
            let means = "lines that are damaged may look so";
            findings.push(Finding::unusual("odd-beams", found, means).at(at));
        }
        if guessed_angles > 0 {
            let found = format!("nothing says where the {beams} beams point: they are spread over {view_deg:.0}°");
            let means = "with a wrong angle, turns are too large or too small, and walls bend";
            let advice = "set log.field_of_view_deg to the angle over which the laser measures";
            findings.push(Finding::unusual("guessed-angles", found, means).so(advice));
        }
    }
}
