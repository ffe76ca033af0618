//! The one source of live state: what a run is doing now, for everybody who wants to watch it. **No server in here.**
//!
//! Data flow: the run's own thread, when it is [wanted](Feed::is_wanted) → [`Batch`], what is new → a thread that draws, and gives way to others
//! once there is a picture → scene → [`Monitor::changes`], what changed since a revision, in the form of [`wire`] → page, terminal, whoever
//! comes.
//!
//! # What holds
//! - When nobody looks, a run pays one load of an atomic for every scan, and nothing is drawn or kept twice.
//! - A run never waits for a watcher: it hands over at most one batch, and goes on if the last one still lies there.
//! - A watcher asks for what changed since the revision that it has. So a slow one gets fewer states and never an old one, a late one gets all,
//!   and nothing is kept for each.
//! - Watching changes no result: a run is only read.
//!
//! # Frames
//! All is in the map's frame of the run, m and rad.

mod batch;
mod drawer;
mod feed;
mod hub;
mod layers;
mod rates;
mod scene;
mod status;
mod track;
pub mod wire;
pub mod words;

pub use batch::{Batch, Counts, GivenPose, Health, Now, State};
pub use feed::{Cursor, Feed};
pub use hub::{Ask, Monitor, give_way};
pub use status::{About, Status};
