//! A robot that tells of itself in Zenoh: a thread that answers, and publishes while somebody subscribes.
//!
//! As of the live page: when nobody looks nothing is drawn, a run waits for nobody, and nothing is kept for each who asks.

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use lrfslam_host::monitor::{Monitor, give_way};
use zenoh::bytes::Encoding;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::query::Query;
use zenoh::{Session, Wait as _};

use super::fault;
use crate::member::ROOT;
use crate::routes::{POLL, WAIT};

/// Questions that wait for an answer; more are not heard.
const ASKED_MAX: usize = 64;
/// From one status that is published to the next.
const STATUS_EVERY: Duration = Duration::from_secs(1);

/// What somebody asks for.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Changes,
    Status,
}

/// A question, and since when it waits.
struct Asked {
    query: Query,
    kind: Kind,
    since: Instant,
    /// Instance and revision that are known.
    known: (u64, u64),
}

struct Told {
    name: String,
    monitor: Monitor,
    status: Publisher<'static>,
    asked: Receiver<Asked>,
    waiting: Vec<Asked>,
    published: Instant,
    _alive: LivelinessToken,
}

/// Tells of a robot until the process ends.
pub(super) fn start(session: &Session, name: &str, monitor: Monitor) -> io::Result<()> {
    let (ask, asked) = sync_channel(ASKED_MAX);
    answer(session, &format!("{ROOT}/{name}/changes"), Kind::Changes, ask.clone())?;
    answer(session, &format!("{ROOT}/{name}/status"), Kind::Status, ask)?;
    let status = session.declare_publisher(format!("{ROOT}/{name}/status"));
    // Who takes nothing gets nothing: the next one is newer.
    let status = status.encoding(Encoding::APPLICATION_JSON).congestion_control(CongestionControl::Drop);
    let status = status.wait().map_err(fault)?;
    let alive = session.liveliness().declare_token(format!("{ROOT}/{name}")).wait().map_err(fault)?;
    let (name, published) = (name.to_owned(), Instant::now());
    let told = Told { name, monitor, status, asked, waiting: Vec::new(), published, _alive: alive };
    std::thread::Builder::new().name("zenoh".to_owned()).spawn(move || told.run())?;
    Ok(())
}

/// Questions for a key go to the thread; those for which there is no room get no answer.
fn answer(session: &Session, key: &str, kind: Kind, ask: SyncSender<Asked>) -> io::Result<()> {
    let take = move |query: Query| {
        let Some(known) = known(query.parameters().as_str()) else {
            let _ = query.reply_err("expected INSTANCE-REVISION").wait();
            return;
        };
        let _ = ask.try_send(Asked { query, kind, since: Instant::now(), known });
    };
    session.declare_queryable(key).callback(take).background().wait().map_err(fault)
}

/// Instance and revision; of who says nothing, 0: all is new.
pub(super) fn known(parameters: &str) -> Option<(u64, u64)> {
    let text = if parameters.is_empty() { "0-0" } else { parameters };
    let (instance, revision) = text.split_once('-')?;
    Some((instance.parse().ok()?, revision.parse().ok()?))
}

impl Told {
    fn run(mut self) {
        give_way();
        loop {
            match self.asked.recv_timeout(POLL) {
                Ok(asked) if self.waiting.len() < ASKED_MAX => self.waiting.push(asked),
                Ok(_) | Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            let is_followed = self.status.matching_status().wait().is_ok_and(|status| status.matching());
            if is_followed || !self.waiting.is_empty() {
                self.monitor.look();
            }
            let Self { waiting, monitor, name, .. } = &mut self;
            waiting.retain(|asked| !asked.answer(monitor, name));
            if is_followed && self.published.elapsed() >= STATUS_EVERY {
                self.published = Instant::now();
                let _ = self.status.put(status(&self.monitor)).wait();
            }
        }
    }
}

impl Asked {
    /// Answers if there is something new, or it has waited long enough; true if so.
    fn answer(&self, monitor: &Monitor, name: &str) -> bool {
        let has_waited = self.since.elapsed() >= WAIT;
        let (instance, revision) = self.known;
        match self.kind {
            Kind::Changes if has_waited || self.known != (monitor.instance(), monitor.revision()) => {
                let key = format!("{ROOT}/{name}/changes");
                let _ = self.query.reply(key, monitor.changes(instance, revision)).wait();
                true
            }
            // What nobody has looked at is old.
            Kind::Status if self.since.elapsed() >= STATUS_DRAWN => {
                let reply = self.query.reply(format!("{ROOT}/{name}/status"), status(monitor));
                let _ = reply.encoding(Encoding::APPLICATION_JSON).wait();
                true
            }
            Kind::Changes | Kind::Status => false,
        }
    }
}

/// A state is drawn within this after somebody has begun to look.
const STATUS_DRAWN: Duration = Duration::from_millis(300);

fn status(monitor: &Monitor) -> Vec<u8> {
    serde_json::to_vec(&monitor.status()).unwrap_or_default()
}
