//! What is written: files that are whole or not there, and folders of results that change all at once.

mod aside;
mod beside;
mod file;
mod folder;
mod growing;
mod keep;

pub use aside::Aside;
pub(crate) use aside::Kept;
pub use file::{PendingFile, cannot_write, save_by, save_file, save_json, write_file};
pub use folder::{RECORDING, ResultFolder, shown};
pub use growing::{GrowingFile, HELD_MAX, Hole, NoRoom, SYNC_EVERY};
pub use keep::keep_latest;
