//! `landmarks --monitor`: path and landmarks in a real browser while the drive is read, and as they are believed at the end.

use serde_json::json;

use crate::browser::Browser;
use crate::page::{LATER, SOON, Watched};

/// Landmarks whose middle has the colour of landmarks: what lies over some is no fault.
const PAINTED: &str = "(() => { const [view] = lrfslam.views(), [robot] = lrfslam.robots(); const pen = view.canvas.getContext('2d'); \
     const [red, green, blue] = [179, 89, 0]; let painted = 0; \
     for (let k = 0; k < robot.landmarks.length; k += 5) { \
       const [px, py] = view.camera.pixel(robot.landmarks[k], robot.landmarks[k + 1]).map(Math.round); \
       const { data } = pen.getImageData(px, py, 1, 1); \
       painted += data[0] === red && data[1] === green && data[2] === blue; } return painted })()";

#[test]
fn landmarks_are_seen_while_the_drive_is_read_and_as_they_are_at_the_end() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let args = "landmarks ekf --data sim --posts 20 --pace 20 --out watched --monitor=127.0.0.1:0 --monitor-stay";
    let run = Watched::run(folder.path(), &args.split(' ').collect::<Vec<_>>());
    let page = browser.open(&run.url(), [1000, 700]);
    browser.darken(&page, false);
    browser.wait(&page, "lrfslam.robots()[0].landmarks.length >= 5 * 5 && lrfslam.robots()[0].pathLength > 40", SOON);
    assert_eq!(browser.value(&page, "lrfslam.robots()[0].status.ended"), json!(null), "seen on the way");
    let pose = browser.value(&page, "lrfslam.robots()[0].status.pose.length");
    assert_eq!(pose, 3, "where the robot is, is told");
    browser.wait(&page, "lrfslam.robots()[0].status.ended !== null && lrfslam.robots()[0].landmarks.length > 0", LATER);
    browser.wait(&page, "lrfslam.robots()[0].status.way_m > 140 && lrfslam.views()[0].frames > 0", SOON);
    // The page shows what the results have.
    let table = std::fs::read_to_string(folder.path().join("watched/landmarks.csv")).unwrap();
    let places: Vec<[f64; 2]> = table.lines().skip(1).map(place).collect();
    let shown = browser.value(&page, "[...lrfslam.robots()[0].landmarks]");
    let shown: Vec<f64> = shown.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect();
    assert_eq!((shown.len(), places.is_empty()), (5 * places.len(), false));
    for (landmark, [x, y]) in shown.chunks(5).zip(&places) {
        assert!((landmark[0] - x).hypot(landmark[1] - y) < 1e-3, "{landmark:?} for {x}, {y}");
        assert!(landmark[2] > 0.0 && landmark[4] > 0.0, "variances: {landmark:?}");
    }
    let painted = browser.value(&page, &format!("new Promise(requestAnimationFrame).then(() => {PAINTED})"));
    println!("{painted} of {} landmarks are painted", places.len());
    assert!(painted.as_u64().unwrap() as usize * 2 > places.len(), "{painted} of {}", places.len());
    assert_eq!(browser.faults, Vec::<String>::new());
}

fn place(line: &str) -> [f64; 2] {
    let words: Vec<&str> = line.split(',').collect();
    [1, 2].map(|column: usize| words[column].parse().unwrap())
}
