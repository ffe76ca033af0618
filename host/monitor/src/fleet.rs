//! Robots in Zenoh: one that tells of itself there, and those that are found.
//!
//! A robot NAME has these keys; late comers get all of the state, since nothing depends on what was sent before:
//!
//! | key | what |
//! | --- | --- |
//! | `lrfslam/NAME` | a liveliness token: the robot is there |
//! | `lrfslam/NAME/status` | JSON of [`Status`](lrfslam_host::monitor::Status): published every second while somebody subscribes, and answered |
//! | `lrfslam/NAME/changes?INSTANCE-REVISION` | answered with what changed since, as the live page is |
//!
//! Nobody commands a robot by Zenoh, which knows no token. Source: zenoh.io, "Abstractions".

mod place;
mod told;

use std::collections::BTreeSet;
use std::io;
use std::sync::mpsc::channel;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use lrfslam_host::monitor::Monitor;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait as _};

pub use self::place::Place;
use crate::member::{Member, ROOT};
use crate::remote::Remote;

/// Robots that are shown; more are left out.
const ROBOTS_MAX: usize = 32;
/// Longest name of a robot, bytes.
const NAME_BYTES_MAX: usize = 64;
/// Another robot of the same name answers within this.
const NAMESAKE_WITHIN: Duration = Duration::from_millis(500);

/// A place in Zenoh, joined. Clones are the same.
#[derive(Debug, Clone)]
pub struct Fleet {
    session: Session,
}

/// What Zenoh says.
fn fault(error: zenoh::Error) -> io::Error {
    io::Error::other(error.to_string())
}

/// A key of one robot can be made of it.
fn is_name(name: &str) -> bool {
    let is_letter = |c: char| c.is_alphanumeric() || "-_.".contains(c);
    (1..=NAME_BYTES_MAX).contains(&name.len()) && name.chars().all(is_letter)
}

impl Fleet {
    /// Joins at a place. Waits up to ten seconds for who is to be there.
    ///
    /// # Errors
    /// If nobody answers there, or nobody can listen.
    pub fn join(place: &Place) -> io::Result<Self> {
        let config = zenoh::Config::from_json5(&place.config()).map_err(fault)?;
        Ok(Self { session: zenoh::open(config).wait().map_err(fault)? })
    }

    /// Tells of a robot from now on, until the process ends.
    ///
    /// # Errors
    /// If the name is none, or there is a robot of that name already.
    pub fn tell(&self, name: &str, monitor: Monitor) -> io::Result<()> {
        if !is_name(name) {
            let expected = format!("{name}: expected a name of 1 to {NAME_BYTES_MAX} letters, digits, - _ and .");
            return Err(io::Error::other(expected));
        }
        if self.has(name)? {
            return Err(io::Error::other(format!("there is a robot {name} already: choose another name")));
        }
        told::start(&self.session, name, monitor)
    }

    fn has(&self, name: &str) -> io::Result<bool> {
        let (tell, told) = channel();
        let key = format!("{ROOT}/{name}");
        let asked = self.session.liveliness().get(key).timeout(NAMESAKE_WITHIN);
        let take = move |reply: zenoh::query::Reply| {
            let _ = tell.send(reply.result().is_ok());
        };
        asked.callback(take).wait().map_err(fault)?;
        // Ends when the last answer has come.
        Ok(told.into_iter().any(|is_there| is_there))
    }

    /// Calls `found` with every robot that is there, and every one that comes, once for each name.
    ///
    /// # Errors
    /// If Zenoh does not take the subscription.
    pub fn for_each_robot(&self, found: impl Fn(Remote) + Send + Sync + 'static) -> io::Result<()> {
        let (session, known) = (self.session.clone(), Mutex::new(BTreeSet::new()));
        let alive = self.session.liveliness().declare_subscriber(format!("{ROOT}/*")).history(true);
        let alive = alive.callback(move |sample| {
            let name = sample.key_expr().as_str().strip_prefix(ROOT).and_then(|rest| rest.strip_prefix('/'));
            let Some(name) = name.filter(|name| is_name(name) && sample.kind() == SampleKind::Put) else { return };
            let mut known = known.lock().unwrap_or_else(PoisonError::into_inner);
            if known.len() < ROBOTS_MAX && known.insert(name.to_owned()) {
                found(Remote::member(Member::new(session.clone(), name)));
            }
        });
        alive.background().wait().map_err(fault)
    }
}

#[cfg(test)]
mod tests;
