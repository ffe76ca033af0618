//! Where scans come from: logs, lasers over a link, recordings of these; and where they are kept.
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

pub mod bags;
pub mod driver;
pub mod family;
pub mod link;
pub mod live;
pub mod log;
pub mod mcap;
pub mod recording;
pub mod store;
pub(crate) mod unpack;
