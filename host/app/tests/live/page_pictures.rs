//! The pictures of the guide.
//!
//! `LRFSLAM_PICTURES=$PWD/docs/watch cargo test --release -p lrfslam --all-features --test live pictures_of -- --ignored --nocapture`

use std::path::PathBuf;
use std::time::Duration;

use crate::browser::{Browser, Page};
use crate::page::{LATER, Watched};

fn save(browser: &mut Browser, page: &Page, folder: &std::path::Path, name: &str) {
    std::fs::write(folder.join(name), browser.picture(page)).unwrap();
}

/// As it is in light and dark.
fn both(browser: &mut Browser, page: &Page, folder: &std::path::Path, name: &str) {
    for (is_dark, light) in [(false, "light"), (true, "dark")] {
        browser.darken(page, is_dark);
        std::thread::sleep(Duration::from_millis(200));
        save(browser, page, folder, &format!("{name}-{light}.png"));
    }
}

#[test]
#[ignore = "heavy: run by .ci/run"]
fn pictures_of_the_guide() {
    let Some(pictures) = std::env::var_os("LRFSLAM_PICTURES").map(PathBuf::from) else {
        println!("skipped: no pictures were taken (set LRFSLAM_PICTURES to a folder for them)");
        return;
    };
    let Some(mut browser) = Browser::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let run = Watched::start(folder.path(), "0", 700, &["--monitor-stay"]);
    let desktop = browser.open(&run.url(), [1280, 800]);
    let phone = browser.open(&run.url(), [390, 760]);
    browser.sharpen(&phone, [390, 760]);
    browser.wait(&desktop, "lrfslam.robots()[0].status.scans > 430", LATER);
    both(&mut browser, &desktop, &pictures, "desktop");
    both(&mut browser, &phone, &pictures, "phone");
    browser.press(&phone, "g");
    browser.wait(&phone, "lrfslam.robots()[0].status.scans > 600", LATER);
    save(&mut browser, &phone, &pictures, "phone-graphs.png");
    robots(&mut browser, &pictures, &run);
    #[cfg(feature = "demo")]
    cloud(&mut browser, &pictures);
    assert_eq!(browser.faults, Vec::<String>::new());
}

/// Two robots side by side.
fn robots(browser: &mut Browser, pictures: &std::path::Path, first: &Watched) {
    let folder = tempfile::tempdir().unwrap();
    let second = Watched::start(folder.path(), "0", 250, &["--monitor-stay"]);
    let both = Watched::run(folder.path(), &["watch", "--at", "0", &first.url(), &second.url()]);
    let page = browser.open(&both.url(), [1280, 800]);
    browser.wait(&page, "lrfslam.robots()[1].status.scans > 200", LATER);
    save(browser, &page, pictures, "robots.png");
}

/// The 3D map of the demo.
#[cfg(feature = "demo")]
fn cloud(browser: &mut Browser, pictures: &std::path::Path) {
    let folder = tempfile::tempdir().unwrap();
    let demo = Watched::run(folder.path(), &["demo", "--out", "demo", "--monitor=0"]);
    let page = browser.open(&demo.url(), [1280, 800]);
    browser.wait(&page, "lrfslam.robots()[0].cloud.length > 180000", LATER);
    browser.press(&page, "c");
    browser.wait(&page, "lrfslam.views()[0].is3d", crate::page::SOON);
    std::thread::sleep(Duration::from_millis(500));
    save(browser, &page, pictures, "cloud.png");
}
