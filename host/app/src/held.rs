//! What is said while something else has the terminal's screen: kept, and said when the screen is left.

use std::io::{self, Write as _};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Lines that are kept; of more the oldest go, but no results.
const LINES_MAX: usize = 1000;

/// Who has the screen, and what waits for it.
struct Held {
    leave: fn(),
    /// For standard output if true, else a line for standard error.
    said: Vec<(bool, String)>,
}

static HELD: Mutex<Option<Held>> = Mutex::new(None);

fn held() -> MutexGuard<'static, Option<Held>> {
    HELD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The screen is somebody's now; `leave` gives it back.
#[cfg(feature = "tui")]
pub fn hold(leave: fn()) {
    *held() = Some(Held { leave, said: Vec::new() });
}

/// Somebody has the screen.
pub fn is_on() -> bool {
    held().is_some()
}

/// Has the screen left, if somebody has it, and says what was said meanwhile. Goes before every end of the program, a panic's too.
pub fn release() {
    let Some(Held { leave, said }) = held().take() else { return };
    leave();
    for (is_output, text) in said {
        let _ = if is_output { write_output(&text) } else { write_line(&text) };
    }
}

/// A line on standard error; with that closed there is nobody left to tell.
pub fn say(text: &str) {
    match held().as_mut() {
        Some(Held { said, .. }) => {
            let oldest = said.iter().position(|(is_output, _)| !is_output).filter(|_| said.len() >= LINES_MAX);
            oldest.into_iter().for_each(|at| drop(said.remove(at)));
            said.push((false, text.to_owned()));
        }
        None => drop(write_line(text)),
    }
}

/// Text on standard output.
///
/// # Errors
/// If it cannot be written; of what waits nobody is told.
pub fn print(text: &str) -> io::Result<()> {
    if let Some(Held { said, .. }) = held().as_mut() {
        said.push((true, text.to_owned()));
        return Ok(());
    }
    write_output(text)
}

fn write_output(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()
}

fn write_line(text: &str) -> io::Result<()> {
    writeln!(io::stderr(), "{text}")
}
