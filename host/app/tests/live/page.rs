//! `--monitor`: the live page in a real browser, and what those get who should not see it.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::browser::Browser;
use crate::common::{lrfslam, run};

pub const SOON: Duration = Duration::from_secs(20);
pub const LATER: Duration = Duration::from_secs(180);
pub const TOKEN: &str = "0123456789abcdef";

/// A run with a page, until dropped.
pub struct Watched {
    pub child: Child,
    /// `127.0.0.1:PORT`.
    pub host: String,
    pub said: Arc<Mutex<String>>,
}

pub fn floor() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/floor.log.gz")
}

impl Watched {
    /// Maps the first `scans` of the example.
    pub fn start(folder: &Path, address: &str, scans: u32, more: &[&str]) -> Self {
        let (log, scans) = (floor(), scans.to_string());
        let monitor = format!("--monitor={address}");
        let args = ["map", log.to_str().unwrap(), "--out", "watched", "--overwrite", "--scans", &scans, &monitor];
        Self::run(folder, &[&args[..], more].concat())
    }

    /// The program with these arguments, which serves a page.
    pub fn run(folder: &Path, args: &[&str]) -> Self {
        let mut command = lrfslam(folder, args);
        command.env("LRFSLAM_TOKEN", TOKEN).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap());
        let mut first = String::new();
        lines.read_line(&mut first).unwrap();
        let host = first.split("http://").nth(1).and_then(|url| url.split('/').next());
        let host = host.unwrap_or_else(|| panic!("{first}")).to_owned();
        let said = Arc::new(Mutex::new(first));
        let heard = said.clone();
        std::thread::spawn(move || {
            for line in lines.lines().map_while(Result::ok) {
                heard.lock().unwrap().push_str(&(line + "\n"));
            }
        });
        Self { child, host, said }
    }

    /// The link.
    pub fn url(&self) -> String {
        format!("http://{}/#{TOKEN}", self.host)
    }

    /// Sends bytes, and returns the first line of the answer; empty if the connection was closed without one.
    fn sends(&self, bytes: &[u8]) -> String {
        let Ok(mut stream) = TcpStream::connect(&self.host) else { return String::new() };
        stream.set_read_timeout(Some(SOON)).unwrap();
        let _ = stream.write_all(bytes);
        let mut answer = [0; 64];
        let count = stream.read(&mut answer).unwrap_or(0);
        String::from_utf8_lossy(&answer[..count]).lines().next().unwrap_or_default().to_owned()
    }

    /// Code of the answer to a request.
    pub fn status(&self, what: &str, headers: &str) -> String {
        let host = &self.host;
        let answer =
            self.sends(format!("{what} HTTP/1.1\r\nHost: {host}\r\n{headers}Connection: close\r\n\r\n").as_bytes());
        answer.split(' ').nth(1).unwrap_or_default().to_owned()
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub const HAS_MAP: &str = "lrfslam.robots()[0].map.tiles.size > 0 && lrfslam.views()[0].frames > 0";
pub const HAS_ENDED: &str = "lrfslam.robots()[0].status.ended";
/// The map as it is painted, when nothing fades any more.
const PICTURE: &str = "new Promise((done) => setTimeout(() => { const view = lrfslam.views()[0]; view.draw(); \
     setTimeout(() => done(view.canvas.toDataURL()), 500) }, 3000))";

#[test]
fn browsers_follow_a_run_and_who_comes_late_sees_the_same() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut run = Watched::start(folder.path(), "0", 300, &["--monitor-stay"]);
    let begun = Instant::now();
    let first = browser.open(&run.url(), [1000, 700]);
    browser.wait(&first, HAS_MAP, SOON);
    let first_s = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let second = browser.open(&run.url(), [1000, 700]);
    browser.wait(&second, HAS_MAP, SOON);
    let second_s = begun.elapsed().as_secs_f64();
    println!("a map was seen {first_s:.2} s after the page was asked for, by a second viewer after {second_s:.2} s");
    // The better of two: the first one waits for the browser, too.
    assert!(first_s.min(second_s) < 2.0, "{first_s} {second_s}");
    let scans = browser.value(&second, "lrfslam.robots()[0].status.scans").as_u64().unwrap();
    assert!(scans < 300, "the run is over before it was followed");
    for page in [&first, &second] {
        browser.wait(page, HAS_ENDED, LATER);
    }
    let late = browser.open(&run.url(), [1000, 700]);
    browser.wait(&late, HAS_ENDED, SOON);
    let [first_picture, second_picture, late_picture] =
        [&first, &second, &late].map(|page| browser.value(page, PICTURE).as_str().unwrap().to_owned());
    assert!(first_picture.len() > 5_000, "nothing is painted");
    assert!(first_picture == late_picture && second_picture == late_picture, "who comes late sees something else");
    // Keys do what they should, and nothing was fetched from elsewhere.
    for (key, expression) in [("f", "view.follows"), ("m", "view.measures"), ("0", "view.fits"), ("+", "!view.fits")] {
        let press = format!("dispatchEvent(new KeyboardEvent('keydown', {{ key: '{key}' }}))");
        let asked = format!("(() => {{ {press}; const view = lrfslam.views()[0]; return {expression} }})()");
        assert_eq!(browser.value(&late, &asked), true, "{key}");
    }
    let elsewhere = "performance.getEntriesByType('resource').filter((one) => !one.name.startsWith(location.origin)).map((one) => one.name).join()";
    assert_eq!(browser.value(&late, elsewhere), "");
    assert_eq!(browser.faults, Vec::<String>::new());
    // Who has the token ends it.
    browser
        .value(&late, "document.getElementById('stop').click(); document.querySelector('dialog [value=stop]').click()");
    assert_eq!(run.child.wait().unwrap().code(), Some(0));
}

#[test]
fn a_page_goes_on_when_the_program_is_started_anew() {
    let Some(mut browser) = Browser::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let run = Watched::start(folder.path(), "0", 40, &["--monitor-stay"]);
    let page = browser.open(&run.url(), [390, 844]);
    browser.wait(&page, HAS_ENDED, LATER);
    let address = run.host.clone();
    let instance = browser.value(&page, "String(lrfslam.robots()[0].instance)");
    drop(run);
    browser.wait(&page, "lrfslam.robots()[0].link === 'away'", SOON);
    let _again = Watched::start(folder.path(), &address, 60, &["--monitor-stay"]);
    browser.wait(&page, &format!("String(lrfslam.robots()[0].instance) !== {instance}"), SOON);
    browser.wait(&page, "lrfslam.robots()[0].status.ended && lrfslam.robots()[0].status.scans === 60", LATER);
    assert_eq!(browser.faults, Vec::<String>::new());
}

#[test]
fn guests_that_mean_no_good_are_refused_and_disturb_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let log = floor();
    let plain = ["map", log.to_str().unwrap(), "--out", "plain", "--scans", "250"];
    assert_eq!(run(folder.path(), &plain).0, 0);
    let mut run = Watched::start(folder.path(), "0", 250, &["--monitor-stay"]);
    refuses_whom_it_does_not_know(&run);
    refuses_what_is_no_request(&run);
    has_room_for_so_many(&run);
    let report = folder.path().join("watched/run.json");
    let begun = Instant::now();
    while !fs::read_to_string(&report).is_ok_and(|report| report.contains("\"partial\": false")) {
        assert!(begun.elapsed() < LATER, "the run does not end");
        std::thread::sleep(Duration::from_millis(50));
    }
    assert_eq!(run.status("POST /robots/0/stop", &format!("Authorization: Bearer {TOKEN}\r\n")), "204");
    assert_eq!(run.child.wait().unwrap().code(), Some(0));
    let said = run.said.lock().unwrap().clone();
    for once in ["too many connections", "was refused the live page"] {
        assert_eq!(said.matches(once).count(), 1, "{said}");
    }
    for result in ["trajectory.tum", "map.pgm", "map.yaml", "map.lrfslam", "steps.csv"] {
        let [plain, watched] =
            ["plain", "watched"].map(|name| fs::read(folder.path().join(name).join(result)).unwrap());
        // Times in it are of the wall.
        assert!(result == "steps.csv" || plain == watched, "{result} differs when somebody looks");
    }
}

fn refuses_whom_it_does_not_know(run: &Watched) {
    let bearer = |token: &str| format!("Authorization: Bearer {token}\r\n");
    let origin = |origin: &str| format!("Origin: {origin}\r\n");
    // Seen on this computer without a token, but not by another page, and commanded by nobody without.
    assert_eq!(run.status("GET /robots", ""), "200");
    assert_eq!(run.status("GET /robots", &origin("http://evil.example")), "401");
    assert_eq!(run.status("GET /robots", &(origin("http://evil.example") + &bearer(TOKEN))), "401");
    assert_eq!(run.status("GET /robots", "Sec-Fetch-Site: cross-site\r\n"), "401");
    assert!(run.sends(b"GET /robots HTTP/1.1\r\nHost: evil.example\r\n\r\n").contains("401"));
    for wrong in [String::new(), bearer(""), bearer("0123456789abcdee"), bearer(&"x".repeat(4000))] {
        assert_eq!(run.status("POST /robots/0/stop", &wrong), "401", "{wrong}");
    }
    assert_eq!(run.status("POST /robots/0/explode", &bearer(TOKEN)), "404");
    assert_eq!(run.status("POST /robots/9/save", &bearer(TOKEN)), "404");
}

fn refuses_what_is_no_request(run: &Watched) {
    // What is no request, or too large.
    for query in ["", "x", "1-", "-1", "99999999999999999999-1", "%00-%00"] {
        assert!(
            ["200", "400"].contains(&run.status(&format!("GET /robots/0/changes?{query}"), "").as_str()),
            "{query}"
        );
    }
    assert_eq!(run.status("GET /robots/99999999999999999999/changes", ""), "400");
    assert_eq!(run.status("GET /../../etc/passwd", ""), "404");
    for wrong in [&b"\0\xff\x16\x03\x01\r\n\r\n"[..], b"GET\r\n\r\n", b"POST /robots HTTP/9.9\r\n\r\n"] {
        let answer = run.sends(wrong);
        assert!(answer.is_empty() || answer.contains("400"), "{answer}");
    }
    let large = format!("GET / HTTP/1.1\r\nHost: {}\r\nX: {}\r\n\r\n", run.host, "x".repeat(1 << 20));
    let answer = run.sends(large.as_bytes());
    assert!(answer.is_empty() || answer.contains("431"), "{answer}");
}

fn has_room_for_so_many(run: &Watched) {
    // 200 at once, half of whom say half of something, and read nothing: some find no room, and who leaves makes some.
    let crowd: Vec<TcpStream> = (0..200).filter_map(|_| TcpStream::connect(&run.host).ok()).collect();
    for mut guest in crowd.iter().take(100) {
        let _ = guest.write_all(b"GET /robots/0/changes?0-0 HTTP/1.1\r\nHost: 127");
    }
    assert_ne!(run.status("GET /robots", ""), "200", "there are places without end");
    drop(crowd);
    let begun = Instant::now();
    while run.status("GET /robots", "") != "200" {
        assert!(begun.elapsed() < SOON, "nobody is let in any more");
    }
}

#[test]
fn from_elsewhere_nobody_sees_anything_without_the_token() {
    let folder = tempfile::tempdir().unwrap();
    let mut run = Watched::start(folder.path(), "0.0.0.0:0", 60, &["--monitor-stay"]);
    run.host = format!("127.0.0.1:{}", run.host.rsplit_once(':').unwrap().1);
    assert_eq!(run.status("GET /", ""), "200");
    for path in ["GET /robots", "GET /robots/0/changes", "POST /robots/0/stop"] {
        assert_eq!(run.status(path, ""), "401", "{path}");
        assert_eq!(run.status(path, "Authorization: Bearer wrong\r\n"), "401", "{path}");
    }
    let token = format!("Authorization: Bearer {TOKEN}\r\n");
    assert_eq!(run.status("GET /robots", &token), "200");
    // Saved when asked, and ended.
    assert_eq!(run.status("POST /robots/0/save", &token), "204");
    assert_eq!(run.status("POST /robots/0/stop", &token), "204");
    let code = run.child.wait().unwrap().code();
    assert!(matches!(code, Some(0 | 130)), "{code:?}");
}
