//! `--tui`: a run watched in a terminal, as over ssh.
//!
//! [`Monitor`], the same source as that of the live page → [`Picture`](picture::Picture), what is known of the run → [`draw`], through a
//! [`View`](view::View) that keys move, on a [`Canvas`](canvas::Canvas) of braille dots. A thread of its own looks ten times a second; the run does
//! not wait for it.
//!
//! The terminal is given back at the end, after a panic and before any exit: see [`held`].

mod canvas;
mod draw;
mod picture;
mod view;

use std::io::{self, Write, stderr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Once};
use std::thread::JoinHandle;
use std::time::Duration;

use lrfslam_host::monitor::{Ask, Monitor};
use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::cursor::{Hide, Show};
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{
    Clear, ClearType, EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};

use self::picture::Picture;
use self::view::View;
use crate::held;

/// From one look to the next, while no key is pressed.
const LOOK: Duration = Duration::from_millis(100);

/// It is in this build.
pub const IS_BUILT_IN: bool = true;

/// The view of a run, until dropped: then the terminal is as it was.
#[derive(Debug)]
pub struct Screen {
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Screen {
    /// Takes the terminal, and shows what `monitor` tells.
    ///
    /// # Errors
    /// If it is no terminal that can do this.
    pub fn open(monitor: &Monitor) -> io::Result<Self> {
        give_back_after_a_panic();
        let is_over = Arc::new(AtomicBool::new(false));
        let (ends, monitor) = (is_over.clone(), monitor.clone());
        held::hold(leave);
        let begun = enter().and_then(|terminal| {
            let show = move || Watcher::new(monitor).watch(terminal, &ends);
            std::thread::Builder::new().name("terminal".to_owned()).spawn(show)
        });
        let thread = begun.inspect_err(|_| held::release())?;
        Ok(Self { is_over, thread: Some(thread) })
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        // One that has panicked has given the terminal back.
        self.thread.take().into_iter().for_each(|thread| drop(thread.join()));
        held::release();
    }
}

type Display = Terminal<CrosstermBackend<Whole>>;

/// Writes a picture in one piece, and none on a screen that was left meanwhile.
#[derive(Debug, Default)]
struct Whole(Vec<u8>);

impl Write for Whole {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        // Who leaves the screen waits for this lock.
        let mut out = stderr().lock();
        let bytes = std::mem::take(&mut self.0);
        if held::is_on() { out.write_all(&bytes) } else { Ok(()) }
    }
}

fn enter() -> io::Result<Display> {
    enable_raw_mode()?;
    execute!(stderr(), EnterAlternateScreen, Clear(ClearType::All), Hide)?;
    // Not the terminal's own `clear`: that asks it where the cursor is, and not every one answers.
    Terminal::new(CrosstermBackend::new(Whole::default()))
}

/// Of a terminal that is gone nothing can be given back.
fn leave() {
    let _ = execute!(stderr().lock(), LeaveAlternateScreen, Show);
    let _ = disable_raw_mode();
}

fn give_back_after_a_panic() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            held::release();
            before(info);
        }));
    });
}

/// The thread's own: what it has seen, and how it looks at it.
struct Watcher {
    monitor: Monitor,
    picture: Picture,
    view: View,
}

impl Watcher {
    fn new(monitor: Monitor) -> Self {
        Self { monitor, picture: Picture::default(), view: View::default() }
    }

    fn watch(mut self, mut terminal: Display, is_over: &AtomicBool) {
        while !is_over.load(Ordering::Relaxed) && held::is_on() {
            self.monitor.look();
            let (instance, revision) = self.picture.known();
            self.picture.take(&self.monitor.changes(instance, revision));
            self.picture.status = self.monitor.status();
            let drawn = terminal.draw(|frame| draw::draw(frame, &self.picture, &mut self.view));
            // A terminal that is gone ends nothing but this view.
            let Ok(has_event) = drawn.and_then(|_| event::poll(LOOK)) else { return held::release() };
            if has_event {
                let _ = event::read().map(|event| self.take(&event));
            }
        }
    }

    fn take(&mut self, event: &Event) {
        if let Event::Key(key) = event
            && key.kind != KeyEventKind::Release
        {
            self.press(*key);
        }
    }

    fn press(&mut self, key: KeyEvent) {
        if !self.view.is_stopping {
            self.view.notice = "";
        }
        match key.code {
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => self.stop(),
            KeyCode::Char('q') => self.stop(),
            KeyCode::Char('s') => {
                self.monitor.ask(Ask::Save);
                self.view.notice = "the results are saved now";
            }
            KeyCode::Char('p' | ' ') if self.picture.status.can_pause => {
                self.monitor.ask(Ask::Pause(!self.picture.status.is_paused));
            }
            KeyCode::Char('p' | ' ') => self.view.notice = "these scans do not wait",
            KeyCode::Char('+' | '=') => self.view.zoom(1.25),
            KeyCode::Char('-') => self.view.zoom(0.8),
            KeyCode::Char('f') => self.view.follow(),
            KeyCode::Char('0') => self.view.show_all(),
            KeyCode::Left => self.view.pan(-1.0, 0.0),
            KeyCode::Right => self.view.pan(1.0, 0.0),
            KeyCode::Up => self.view.pan(0.0, 1.0),
            KeyCode::Down => self.view.pan(0.0, -1.0),
            _ => {}
        }
    }

    /// As ctrl-C, which is a key like others here: pressed twice, it ends the program at once.
    fn stop(&mut self) {
        if self.view.is_stopping {
            held::release();
            std::process::exit(130);
        }
        (self.view.is_stopping, self.view.notice) = (true, "stopping: results are written; once more ends at once");
        self.monitor.ask(Ask::Stop);
    }
}

#[cfg(test)]
mod tests;
