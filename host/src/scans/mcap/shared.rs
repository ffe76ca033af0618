//! A file into which a laser's thread and a map's write.

use std::fmt;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::writer::{ChannelPlan, McapFile};
use crate::output::{GrowingFile, Hole};

/// Words that came before anything else did: kept until there is a time.
const WAITING_MAX: usize = 100;

/// A file into which a laser's thread and a map's write. Clones are the same file.
#[derive(Clone)]
pub struct SharedMcap {
    plans: &'static [ChannelPlan],
    state: Arc<Mutex<State>>,
}

#[derive(Default)]
struct State {
    file: Option<McapFile>,
    /// Of the last message.
    time_ns: u64,
    waiting: Vec<Later>,
}

/// A message that gets the time of the first one that has any.
struct Later {
    channel: usize,
    build: Box<dyn Fn(u64) -> Vec<u8> + Send>,
}

impl SharedMcap {
    /// One whose file is still to be [begun](Self::begin).
    pub fn new(plans: &'static [ChannelPlan]) -> Self {
        Self { plans, state: Arc::default() }
    }

    /// The file is there; it gets no larger than `max_bytes`.
    pub fn begin(&self, file: GrowingFile, max_bytes: u64) {
        self.lock().file = Some(McapFile::new(file, self.plans, max_bytes));
    }

    /// The number of the channel with this name.
    pub fn channel(&self, topic: &str) -> Option<usize> {
        self.plans.iter().position(|plan| plan.topic == topic)
    }

    /// Of the last message; 0 before it.
    pub fn time_ns(&self) -> u64 {
        self.lock().time_ns
    }

    /// The file was begun.
    pub fn has_begun(&self) -> bool {
        self.lock().file.is_some()
    }

    /// Adds a message; before the file has begun there is nobody to read it.
    pub fn write(&self, channel: usize, time_ns: u64, data: &[u8]) {
        let mut state = self.lock();
        let State { file, time_ns: last, waiting } = &mut *state;
        let Some(file) = file else { return };
        *last = time_ns;
        for Later { channel, build } in waiting.drain(..) {
            file.write(channel, time_ns, &build(time_ns));
        }
        file.write(channel, time_ns, data);
    }

    /// Adds a message with the time of the last one.
    ///
    /// * `build` — its bytes, from that time
    pub fn write_now(&self, channel: usize, build: impl Fn(u64) -> Vec<u8> + Send + 'static) {
        let mut state = self.lock();
        let State { file, time_ns, waiting } = &mut *state;
        match file {
            Some(file) if *time_ns > 0 => drop(file.write(channel, *time_ns, &build(*time_ns))),
            _ if waiting.len() < WAITING_MAX => waiting.push(Later { channel, build: Box::new(build) }),
            _ => {}
        }
    }

    /// Puts what waits into the file at once.
    pub fn flush(&self) {
        self.lock().file.iter_mut().for_each(McapFile::flush);
    }

    /// Bytes of the file.
    pub fn bytes(&self) -> u64 {
        self.lock().file.as_ref().map_or(0, McapFile::bytes)
    }

    /// What there is to tell of the disk.
    pub fn news(&self) -> Option<String> {
        self.lock().file.as_mut().and_then(|file| file.file().news())
    }

    /// When the disk had no room.
    pub fn holes(&self) -> Vec<Hole> {
        self.lock().file.as_mut().map_or(Vec::new(), |file| file.file().holes())
    }

    /// Closes the file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(&self) -> io::Result<()> {
        self.lock().file.take().map_or(Ok(()), |mut file| file.finish())
    }

    /// A thread that panicked in it has left whole chunks.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for SharedMcap {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("SharedMcap").finish_non_exhaustive()
    }
}

/// They are the same file.
impl PartialEq for SharedMcap {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.state, &other.state)
    }
}

impl Eq for SharedMcap {}
