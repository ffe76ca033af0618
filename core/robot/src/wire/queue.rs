//! Reliable messages that the other side does not have yet, in order, in memory lent by the caller.

/// Bytes before each message: its length.
const PREFIX: usize = 2;

/// No room for the message now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the queue of the robot link is full")]
pub struct QueueFullError;

/// See the [module](self).
#[derive(Debug)]
pub(super) struct SendQueue<'m> {
    memory: &'m mut [u8],
    /// Bytes in use, from the front.
    used: usize,
    /// Sequence number of the message at the front.
    base: u32,
    count: u32,
    /// The message to send next: sequence number and place.
    next: u32,
    at: usize,
}

impl<'m> SendQueue<'m> {
    pub(super) fn new(memory: &'m mut [u8]) -> Self {
        Self { memory, used: 0, base: 0, count: 0, next: 0, at: 0 }
    }

    /// Oldest sequence number that can still be sent.
    pub(super) fn base(&self) -> u32 {
        self.base
    }

    /// Sequence number that the next new message will have.
    pub(super) fn end(&self) -> u32 {
        self.base.wrapping_add(self.count)
    }

    /// Sequence number of the message to send next.
    pub(super) fn next(&self) -> u32 {
        self.next
    }

    /// Bytes for messages and what stands before them.
    pub(super) fn capacity(&self) -> usize {
        self.memory.len()
    }

    /// Bytes that a new message may have.
    pub(super) fn room(&self) -> usize {
        (self.memory.len() - self.used).saturating_sub(PREFIX)
    }

    /// Adds the message that `write` puts into the room it is given; it returns the length.
    pub(super) fn push(&mut self, write: impl FnOnce(&mut [u8]) -> Option<usize>) -> Result<u32, QueueFullError> {
        let room = self.memory.get_mut(self.used..).and_then(|free| free.split_first_chunk_mut::<PREFIX>());
        let (prefix, free) = room.ok_or(QueueFullError)?;
        let length = write(free).ok_or(QueueFullError)?;
        *prefix = u16::try_from(length).map_err(|_| QueueFullError)?.to_le_bytes();
        self.used += PREFIX + length;
        self.count += 1;
        Ok(self.end().wrapping_sub(1))
    }

    /// The message to send next.
    pub(super) fn front(&self) -> Option<&[u8]> {
        message_at(self.memory.get(..self.used)?, self.at)
    }

    /// It was sent.
    pub(super) fn advance(&mut self) {
        if let Some(length) = self.front().map(<[u8]>::len) {
            self.at += PREFIX + length;
            self.next = self.next.wrapping_add(1);
        }
    }

    /// All that is still here is to be sent again.
    pub(super) fn rewind(&mut self) {
        self.next = self.base;
        self.at = 0;
    }

    /// The receiver has everything before `next`; true if that frees something.
    pub(super) fn acknowledge(&mut self, next: u32) -> bool {
        let done = next.wrapping_sub(self.base);
        if done == 0 || done > self.count {
            return false;
        }
        let mut freed = 0;
        for _ in 0..done {
            let length = self.memory.get(..self.used).and_then(|used| message_at(used, freed)).map_or(0, <[u8]>::len);
            freed += PREFIX + length;
        }
        if let Some(used) = self.memory.get_mut(..self.used) {
            let freed = freed.min(used.len());
            used.copy_within(freed.., 0);
            self.used -= freed;
        }
        let unsent = self.next.wrapping_sub(next);
        self.base = next;
        self.count -= done;
        if unsent > self.count {
            self.rewind(); // more was acknowledged than was sent since the last rewind
        } else {
            self.at -= freed;
        }
        true
    }
}

fn message_at(used: &[u8], at: usize) -> Option<&[u8]> {
    let (prefix, rest) = used.get(at..)?.split_first_chunk::<PREFIX>()?;
    rest.get(..usize::from(u16::from_le_bytes(*prefix)))
}
