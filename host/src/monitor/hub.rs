//! Where the run, the drawing thread and the watchers meet.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration as WallDuration, Instant as WallInstant};

use super::batch::Batch;
use super::drawer::Drawer;
use super::feed::Feed;
use super::scene::Scene;
use super::status::About;

/// Who has not asked for so long looks no more.
const LOOKS_FOR: WallDuration = WallDuration::from_secs(3);
/// From one state to the next, at least.
const FRAME: WallDuration = WallDuration::from_millis(50);
/// Lines of what a run says that are kept.
const SAID_MAX: usize = 5;

/// What a watcher may ask of the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ask {
    /// Write the results now, and go on.
    Save,
    /// Take no scan until told otherwise.
    Pause(bool),
    /// End, as by ctrl-C.
    Stop,
}

#[derive(Debug, Default)]
struct Inbox {
    batch: Option<Box<Batch>>,
    /// The run is over, and how it ended.
    ended: Option<String>,
}

/// See the [module](self).
#[derive(Debug)]
pub(super) struct Hub {
    /// Somebody looks, and there is room for a batch.
    pub wanted: AtomicBool,
    pub saves: AtomicBool,
    pub is_paused: AtomicBool,
    /// The scans wait when the run does.
    can_pause: AtomicBool,
    stop: &'static AtomicBool,
    inbox: Mutex<Inbox>,
    news: Condvar,
    scene: Mutex<Scene>,
    /// What the run said last, the newest first.
    said: Mutex<VecDeque<String>>,
    /// That of the scene.
    revision: AtomicU64,
    /// The newest revision that somebody has fetched.
    fetched: AtomicU64,
    began: WallInstant,
    /// When somebody looked last, ms since `began`; 0: never.
    looked: AtomicU64,
    /// No [`Monitor`] is left.
    is_closed: AtomicBool,
}

/// What is guarded stays whole when a thread dies: it is only replaced.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hub {
    /// Takes a batch without ever waiting; `false` if there is no room.
    pub fn take(&self, batch: Batch) -> bool {
        let Ok(mut inbox) = self.inbox.try_lock() else { return false };
        if inbox.batch.is_some() {
            return false;
        }
        self.wanted.store(false, Ordering::Relaxed);
        inbox.batch = Some(Box::new(batch));
        self.news.notify_one();
        true
    }

    pub fn end(&self, words: &str) {
        lock(&self.inbox).ended = Some(words.to_owned());
        self.news.notify_one();
    }

    /// Nobody looks, or those who do have all there is since `when`.
    pub fn is_left_alone(&self, when: WallInstant) -> bool {
        // What came last is drawn within two frames.
        let has_all = self.fetched.load(Ordering::Relaxed) >= self.revision.load(Ordering::Relaxed);
        !self.is_looked_at() || has_all && when.elapsed() > 6 * FRAME
    }

    fn now_ms(&self) -> u64 {
        self.began.elapsed().as_millis() as u64 + 1
    }

    fn is_looked_at(&self) -> bool {
        let looked = self.looked.load(Ordering::Relaxed);
        looked > 0 && self.now_ms() - looked < LOOKS_FOR.as_millis() as u64
    }

    /// The drawing thread.
    fn draw(&self, mut drawer: Drawer) {
        let (mut asked_at, mut was_looked_at) = (WallInstant::now(), false);
        let mut is_first = true;
        while !self.is_closed.load(Ordering::Relaxed) {
            let is_looked_at = self.is_looked_at();
            if is_looked_at && !std::mem::replace(&mut was_looked_at, is_looked_at) {
                drawer.wake();
            }
            was_looked_at = is_looked_at;
            if is_looked_at && !drawer.has_work() && asked_at.elapsed() >= FRAME {
                self.wanted.store(true, Ordering::Relaxed);
            }
            let wait = if is_looked_at { FRAME / 4 } else { LOOKS_FOR };
            let inbox = lock(&self.inbox);
            let waits = |inbox: &mut Inbox| inbox.batch.is_none() && self.is_looked_at() == is_looked_at;
            let (mut inbox, _) =
                self.news.wait_timeout_while(inbox, wait, waits).unwrap_or_else(PoisonError::into_inner);
            let (batch, ended) = (inbox.batch.take(), inbox.ended.clone());
            drop(inbox);
            if let Some(batch) = batch {
                // More is fetched without a pause.
                let is_whole = !batch.has_more;
                drawer.take(*batch);
                asked_at = if is_whole { WallInstant::now() } else { asked_at };
            }
            drawer.status.ended = ended;
            drawer.status.is_paused = self.is_paused.load(Ordering::Relaxed);
            drawer.status.can_pause = self.can_pause.load(Ordering::Relaxed);
            drawer.status.news = lock(&self.said).iter().cloned().collect();
            if is_looked_at {
                let mut has_map = false;
                drawer.draw(|change| {
                    let mut scene = lock(&self.scene);
                    change(&mut scene);
                    has_map = !scene.tiles.is_empty();
                    self.revision.store(scene.revision(), Ordering::Relaxed);
                });
                // The first picture comes at once, on a busy computer too.
                if has_map && std::mem::take(&mut is_first) {
                    give_way();
                }
            }
        }
    }
}

/// The watchers' end; clones are the same. When the last one goes, so does the drawing thread.
#[derive(Debug, Clone)]
pub struct Monitor {
    hub: Arc<Hub>,
    _life: Arc<Life>,
}

#[derive(Debug)]
struct Life(Arc<Hub>);

impl Drop for Life {
    fn drop(&mut self) {
        self.0.is_closed.store(true, Ordering::Relaxed);
        self.0.wanted.store(false, Ordering::Relaxed);
        self.0.news.notify_one();
    }
}

impl Monitor {
    /// A monitor of a run, and the run's end of it.
    ///
    /// * `stop` — is set when a watcher asks for the end
    ///
    /// # Errors
    /// If there is no thread to be had.
    pub fn start(about: About, stop: &'static AtomicBool) -> std::io::Result<(Self, Feed)> {
        let hub = Arc::new(Hub {
            wanted: AtomicBool::new(false),
            saves: AtomicBool::new(false),
            is_paused: AtomicBool::new(false),
            can_pause: AtomicBool::new(false),
            said: Mutex::default(),
            stop,
            inbox: Mutex::default(),
            news: Condvar::new(),
            scene: Mutex::new(Scene::new(about.map.cell_size_m)),
            revision: AtomicU64::new(0),
            fetched: AtomicU64::new(0),
            began: WallInstant::now(),
            looked: AtomicU64::new(0),
            is_closed: AtomicBool::new(false),
        });
        let (drawn, drawer) = (hub.clone(), Drawer::new(about));
        std::thread::Builder::new().name("monitor".to_owned()).spawn(move || drawn.draw(drawer))?;
        Ok((Self { hub: hub.clone(), _life: Arc::new(Life(hub.clone())) }, Feed::new(hub)))
    }

    /// Somebody looks now; whoever does not say so again within three seconds looks no more.
    pub fn look(&self) {
        let before = self.hub.is_looked_at();
        self.hub.looked.store(self.hub.now_ms(), Ordering::Relaxed);
        if !before {
            self.hub.news.notify_one();
        }
    }

    /// Number of the newest state, which grows.
    pub fn revision(&self) -> u64 {
        self.hub.revision.load(Ordering::Relaxed)
    }

    /// Which monitor this is: revisions of another one say nothing here.
    pub fn instance(&self) -> u64 {
        lock(&self.hub.scene).instance()
    }

    /// What has changed since `revision` of `instance`, see [`wire`](super::wire); everything if that is another one, or 0.
    pub fn changes(&self, instance: u64, revision: u64) -> Vec<u8> {
        let scene = lock(&self.hub.scene);
        let changes = super::wire::encode(&scene, if instance == scene.instance() { revision } else { 0 });
        self.hub.fetched.fetch_max(scene.revision(), Ordering::Relaxed);
        changes
    }

    /// How things stand, in words and numbers.
    pub fn status(&self) -> super::Status {
        lock(&self.hub.scene).status.clone()
    }

    /// The run may be paused: its scans wait.
    pub fn set_can_pause(&self, can_pause: bool) {
        self.hub.can_pause.store(can_pause, Ordering::Relaxed);
    }

    /// Something that the run says on its way.
    pub fn tell(&self, text: &str) {
        let mut said = lock(&self.hub.said);
        said.truncate(SAID_MAX - 1);
        said.push_front(text.to_owned());
    }

    /// Asks something of the run.
    pub fn ask(&self, ask: Ask) {
        match ask {
            Ask::Save => self.hub.saves.store(true, Ordering::Relaxed),
            Ask::Pause(is_paused) => self.hub.is_paused.store(is_paused, Ordering::Relaxed),
            Ask::Stop => self.hub.stop.store(true, Ordering::Relaxed),
        }
    }
}

/// Against a thread of SLAM this one gets a tenth of a core, where there is no other; less, and a page on a busy computer stands still.
const NICENESS: i32 = 10;

/// Lets other threads go first from now on. Where that cannot be had it works all the same.
pub fn give_way() {
    #[cfg(target_os = "linux")]
    // Of one thread, on Linux.
    let _ = rustix::process::setpriority_process(None, NICENESS);
}
