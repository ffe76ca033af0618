//! How far a log has been read.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::held;
use lrfslam_host::input::text::ByteCount;
use lrfslam_host::runs::scans::Scans;

/// Bytes read of a log, with scans per second and, if its size is known, time left; nothing if stderr is no terminal, and of a laser.
pub(super) struct Progress {
    bar: ProgressBar,
    bytes_read: Option<ByteCount>,
}

impl Progress {
    pub(super) fn new(scans: &Scans, is_quiet: bool) -> Self {
        let (size_bytes, bytes_read) = scans.progress().unzip();
        let size_bytes = size_bytes.filter(|size| *size > 0);
        let is_hidden = is_quiet || held::is_on() || bytes_read.is_none();
        let target = if is_hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(10) };
        let template = match size_bytes {
            None => "{bytes} read  {msg}  {elapsed} gone",
            Some(_) => "{bar:40} {percent:>3} %  {msg}  {elapsed} gone, {eta} left",
        };
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        Self { bar: ProgressBar::with_draw_target(size_bytes, target).with_style(style), bytes_read }
    }

    /// So many scans are done.
    pub(super) fn set(&self, scans: u64) {
        if let Some(bytes_read) = &self.bytes_read {
            let rate = scans as f64 / self.bar.elapsed().as_secs_f64().max(1e-6);
            self.bar.set_message(format!("{rate:.0} scans/s"));
            self.bar.set_position(bytes_read.get());
        }
    }

    pub(super) fn clear(&self) {
        self.bar.finish_and_clear();
    }
}
