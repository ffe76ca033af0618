//! Debian's chromium, driven over its DevTools protocol: JSON through two pipes, so that no port and no other crate is needed.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

/// A browser without a window, until dropped.
pub struct Browser {
    child: Child,
    to: File,
    from: BufReader<File>,
    calls: u64,
    /// What went wrong in pages.
    pub faults: Vec<String>,
    _folder: tempfile::TempDir,
}

/// A page of it.
pub struct Page(String);

fn program() -> Option<PathBuf> {
    let folders: Vec<PathBuf> = std::env::split_paths(&std::env::var_os("PATH")?).collect();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|file| file.is_file())
}

impl Browser {
    /// `None` where there is none, which is said. It reaches no network but this computer.
    pub fn start() -> Option<Self> {
        let Some(program) = program() else {
            println!("skipped: the live page was seen by no browser (apt-get install chromium)");
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        let flags = "--headless --no-sandbox --disable-gpu --hide-scrollbars --no-first-run --remote-debugging-pipe \
             --host-resolver-rules='MAP * ~NOTFOUND, EXCLUDE 127.0.0.1' --user-data-dir=profile";
        let script = format!("mkfifo in out && exec '{}' {flags} about:blank 3<in 4>out", program.display());
        let mut command = Command::new("sh");
        command.args(["-c", &script]).current_dir(folder.path());
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        while !folder.path().join("out").exists() {
            std::thread::sleep(Duration::from_millis(5));
        }
        let to = File::options().write(true).open(folder.path().join("in")).unwrap();
        let from = BufReader::new(File::open(folder.path().join("out")).unwrap());
        Some(Self { child, to, from, calls: 0, faults: Vec::new(), _folder: folder })
    }

    fn call(&mut self, page: Option<&Page>, method: &str, params: Value) -> Value {
        self.calls += 1;
        let mut call = json!({ "id": self.calls, "method": method, "params": params });
        if let Some(Page(session)) = page {
            call["sessionId"] = json!(session);
        }
        self.to.write_all(format!("{call}\0").as_bytes()).expect("the browser listens");
        loop {
            let mut answer = Vec::new();
            self.from.read_until(0, &mut answer).expect("the browser answers");
            answer.pop();
            let mut answer: Value = serde_json::from_slice(&answer).expect("JSON");
            if answer["method"] == "Runtime.exceptionThrown" {
                self.faults.push(answer["params"]["exceptionDetails"].to_string());
            }
            if answer["id"] == self.calls {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].take();
            }
        }
    }

    /// A page in a window of its own, `size` pixels large: one behind another is not painted.
    pub fn open(&mut self, url: &str, [width, height]: [u32; 2]) -> Page {
        let target = self.call(None, "Target.createTarget", json!({ "url": "about:blank", "newWindow": true }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = self.call(None, "Target.attachToTarget", attach);
        let page = Page(session["sessionId"].as_str().expect("a session").to_owned());
        self.call(Some(&page), "Runtime.enable", json!({}));
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call(Some(&page), "Emulation.setDeviceMetricsOverride", size);
        self.call(Some(&page), "Page.navigate", json!({ "url": url }));
        page
    }

    /// Value of an expression, awaited.
    pub fn value(&mut self, page: &Page, expression: &str) -> Value {
        let asked = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        self.call(Some(page), "Runtime.evaluate", asked)["result"]["value"].take()
    }

    /// Waits until an expression holds; returns how long that took.
    pub fn wait(&mut self, page: &Page, expression: &str, at_most: Duration) -> Duration {
        let begun = Instant::now();
        // What is not there yet is not so.
        let asked = format!("(() => {{ try {{ return Boolean({expression}) }} catch {{ return false }} }})()");
        while self.value(page, &asked) != json!(true) {
            assert!(begun.elapsed() < at_most, "{expression}: not within {at_most:?}; {:?}", self.faults);
            std::thread::sleep(Duration::from_millis(20));
        }
        begun.elapsed()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.call(None, "Browser.close", json!({}));
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
