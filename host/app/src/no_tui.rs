//! `--tui` of a build without the terminal view.

use std::io;

use lrfslam_host::monitor::Monitor;

/// It is not in this build.
pub const IS_BUILT_IN: bool = false;

/// The view, which is not in this build.
#[derive(Debug)]
pub struct Screen;

impl Screen {
    /// Nobody comes so far.
    pub fn open(_: &Monitor) -> io::Result<Self> {
        Err(io::ErrorKind::Unsupported.into())
    }
}
