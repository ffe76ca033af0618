//! Plain words for how things stand.

use serde::Serialize;

use super::batch::State;
use super::status::Status;
use crate::plural::count;

/// How good it is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Mood {
    /// As it should be.
    #[default]
    Good,
    /// Something is a guess.
    Doubt,
    /// The pose is not to be believed.
    Bad,
}

/// After so long without a scan it is said, s.
const SILENT_S: f32 = 2.0;
/// Below this probability a place is doubted.
const CERTAIN: f32 = 0.5;
/// So late, scans are mapped slower than they come, ms.
const LATE_MS: f32 = 2000.0;

/// Words for a status, what matters most first, and how good it is.
pub(super) fn words(status: &Status, state: State, silent_s: f32) -> (Vec<String>, Mood) {
    let mut said = Vec::new();
    let mut say = |mood: Mood, text: String| said.push((mood, text));
    match (&status.ended, status.is_paused) {
        (Some(ended), _) => say(Mood::Good, ended.clone()),
        (None, true) => say(Mood::Good, "paused".to_owned()),
        (None, false) if state == State::Fitting => {}
        (None, false) if silent_s > SILENT_S => say(Mood::Bad, format!("no scan for {silent_s:.0} s")),
        _ if status.scans == 0 => say(Mood::Good, "waiting for the first scan".to_owned()),
        _ => {}
    }
    match state {
        State::Lost => say(Mood::Bad, "lost: the scan fits nowhere in the map".to_owned()),
        State::Blind => say(Mood::Bad, "the laser sees nothing: is it covered?".to_owned()),
        State::Frozen => say(Mood::Doubt, "the laser repeats itself: is it frozen?".to_owned()),
        State::Fitting => say(Mood::Good, "path and landmarks are fitted together".to_owned()),
        State::Searching => say(Mood::Doubt, "looking where in the map the robot is: drive a few metres".to_owned()),
        State::Tracking if status.undetermined.is_some() => {
            say(Mood::Doubt, "corridor: position along it is a guess".to_owned());
        }
        State::Tracking => {}
    }
    if status.is_apart {
        say(Mood::Doubt, "was lost, and draws a new piece of map until it recognises a place".to_owned());
    }
    if let Some(certainty) = status.certainty.filter(|certainty| *certainty < CERTAIN) {
        say(Mood::Doubt, format!("the place is a guess: {:.0} % sure", 100.0 * certainty));
    }
    if let Some(late) = status.rates.map(|rates| rates.late_ms).filter(|late| (LATE_MS..60_000.0).contains(late)) {
        say(Mood::Doubt, format!("too slow: scans are mapped {:.1} s after they were taken", late / 1e3));
    }
    let loops =
        if status.closures > 0 { format!(", {} closed", count(status.closures, "loop")) } else { String::new() };
    if said.is_empty() {
        said.push((Mood::Good, format!("on the map{loops}")));
    }
    said.sort_by_key(|(mood, _)| std::cmp::Reverse(*mood));
    let mood = said.first().map_or(Mood::Good, |(mood, _)| *mood);
    (said.into_iter().map(|(_, text)| text).collect(), mood)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_matters_most_comes_first() {
        let corridor = Status { scans: 3, undetermined: Some([1.0, 0.0]), ..Status::default() };
        let (said, mood) = words(&corridor, State::Tracking, 0.0);
        assert_eq!((said, mood), (vec!["corridor: position along it is a guess".to_owned()], Mood::Doubt));
        let (said, mood) = words(&Status { scans: 3, is_paused: true, ..Status::default() }, State::Lost, 9.0);
        assert_eq!(mood, Mood::Bad);
        assert_eq!(said, ["lost: the scan fits nowhere in the map", "paused"]);
        assert_eq!(words(&Status::default(), State::Tracking, 0.0).0, ["waiting for the first scan"]);
        let fine = Status { scans: 3, closures: 2, ..Status::default() };
        assert_eq!(words(&fine, State::Tracking, 0.0).0, ["on the map, 2 loops closed"]);
    }
}
