//! Viewers that are no browsers: one that takes what comes as fast as a page does, and one that asks and does not read.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use lrfslam_host::monitor::wire::decode;

/// A page asks once a frame.
const FRAME: Duration = Duration::from_millis(16);

/// One that reads, until the program ends.
pub struct Viewer {
    thread: std::thread::JoinHandle<()>,
    /// States and bytes that came.
    pub states: Arc<AtomicU64>,
    pub bytes: Arc<AtomicU64>,
}

impl Viewer {
    pub fn new(host: &str) -> Self {
        let (host, states, bytes) = (host.to_owned(), Arc::<AtomicU64>::default(), Arc::<AtomicU64>::default());
        let counts = (states.clone(), bytes.clone());
        let thread = std::thread::spawn(move || {
            // Ends when the program does.
            let _ = view(&host, &counts);
        });
        Self { thread, states, bytes }
    }

    /// Waits for its end; returns states and bytes.
    pub fn end(self) -> (u64, u64) {
        self.thread.join().unwrap();
        (self.states.load(Ordering::Relaxed), self.bytes.load(Ordering::Relaxed))
    }
}

fn view(host: &str, (states, bytes): &(Arc<AtomicU64>, Arc<AtomicU64>)) -> std::io::Result<()> {
    let mut reader = BufReader::new(TcpStream::connect(host)?);
    let (mut instance, mut revision) = (0, 0);
    loop {
        let request = format!("GET /robots/0/changes?{instance}-{revision} HTTP/1.1\r\nHost: {host}\r\n\r\n");
        reader.get_mut().write_all(request.as_bytes())?;
        let mut length = 0;
        loop {
            let mut line = String::new();
            if reader.read_line(&mut line)? == 0 {
                return Ok(());
            }
            if line == "\r\n" {
                break;
            }
            if let Some(value) = line.to_ascii_lowercase().strip_prefix("content-length:") {
                length = value.trim().parse().unwrap();
            }
        }
        let mut message = vec![0; length];
        reader.read_exact(&mut message)?;
        (instance, revision) = decode(&message).map(|message| (message.0, message.1)).expect("a message");
        states.fetch_add(1, Ordering::Relaxed);
        bytes.fetch_add(length as u64, Ordering::Relaxed);
        std::thread::sleep(FRAME);
    }
}

/// Asks for the whole state again and again, and reads nothing, until dropped.
pub fn sulker(host: &str) -> TcpStream {
    let mut stream = TcpStream::connect(host).unwrap();
    stream.set_write_timeout(Some(Duration::from_millis(100))).unwrap();
    let request = format!("GET /robots/0/changes?0-0 HTTP/1.1\r\nHost: {host}\r\n\r\n").repeat(100);
    // The line is full at some time: so be it.
    while stream.write_all(request.as_bytes()).is_ok() {}
    stream
}
