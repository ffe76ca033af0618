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

    /// The page as one with fingers has it: `kind` is `touchStart`, `touchMove` or `touchEnd`, with where the fingers are, pixels.
    pub fn touch(&mut self, page: &Page, kind: &str, fingers: &[[f64; 2]]) {
        let points: Vec<Value> =
            fingers.iter().enumerate().map(|(id, [x, y])| json!({ "x": x, "y": y, "id": id })).collect();
        self.call(Some(page), "Input.dispatchTouchEvent", json!({ "type": kind, "touchPoints": points }));
    }

    /// A click of the mouse.
    pub fn click(&mut self, page: &Page, [x, y]: [f64; 2]) {
        for kind in ["mousePressed", "mouseReleased"] {
            let event = json!({ "type": kind, "x": x, "y": y, "button": "left", "clickCount": 1 });
            self.call(Some(page), "Input.dispatchMouseEvent", event);
        }
    }

    /// A click in the middle of an element.
    pub fn click_on(&mut self, page: &Page, selector: &str) {
        let find = format!("document.querySelector('{selector}').getBoundingClientRect().toJSON()");
        let place = self.value(page, &find);
        let [x, y, width, height] = ["x", "y", "width", "height"].map(|side| place[side].as_f64().expect(selector));
        assert!(width > 0.0 && height > 0.0, "{selector} is not to be seen");
        self.click(page, [x + width / 2.0, y + height / 2.0]);
    }

    /// A key of the keyboard, by its name, such as `f` or `ArrowLeft`.
    pub fn press(&mut self, page: &Page, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.call(Some(page), "Input.dispatchKeyEvent", json!({ "type": kind, "key": key }));
        }
    }

    /// The page as in the dark, or in the light.
    pub fn darken(&mut self, page: &Page, is_dark: bool) {
        let scheme = if is_dark { "dark" } else { "light" };
        let media = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        self.call(Some(page), "Emulation.setEmulatedMedia", media);
    }

    /// The page as on a phone, whose pixels are smaller.
    pub fn sharpen(&mut self, page: &Page, [width, height]: [u32; 2]) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 2, "mobile": true });
        self.call(Some(page), "Emulation.setDeviceMetricsOverride", size);
    }

    /// What is seen, as PNG.
    pub fn picture(&mut self, page: &Page) -> Vec<u8> {
        let shot = self.call(Some(page), "Page.captureScreenshot", json!({ "format": "png" }));
        from_base64(shot["data"].as_str().expect("a picture"))
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

fn from_base64(text: &str) -> Vec<u8> {
    let digit =
        |c: u8| b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/".iter().position(|d| *d == c);
    let digits: Vec<usize> = text.bytes().filter_map(digit).collect();
    let group = |four: &[usize]| {
        let bits = four.iter().enumerate().fold(0, |bits, (k, digit)| bits | digit << (18 - 6 * k));
        [bits >> 16, bits >> 8, bits].map(|byte| byte as u8).into_iter().take(four.len() - 1).collect::<Vec<u8>>()
    };
    digits.chunks(4).flat_map(group).collect()
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.call(None, "Browser.close", json!({}));
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
