//! Where scans come from: logs, lasers over a link, recordings of these; and where they are kept.

pub mod driver;
pub mod family;
pub mod link;
pub mod live;
pub mod log;
pub mod recording;
pub mod store;
