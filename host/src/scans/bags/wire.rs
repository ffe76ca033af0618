//! Fields of a message as ROS 2 (CDR) and ROS 1 write them.
//!
//! CDR: four bytes of which the second's last bit is 1 for little-endian; then fields, each at a multiple of its size; texts end with 0.
//! ROS 1: little-endian, one field behind the other. Source: OMG DDSI-RTPS 10.2; ROS wiki, msg.

/// How far into a message it was read.
pub(super) struct Wire<'a> {
    bytes: &'a [u8],
    at: usize,
    is_cdr: bool,
    is_big: bool,
}

/// The message ends before the field, or says that it is longer than the message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Short;

impl<'a> Wire<'a> {
    /// A message of ROS 2.
    pub fn cdr(bytes: &'a [u8]) -> Result<Self, Short> {
        let (head, bytes) = bytes.split_first_chunk::<4>().ok_or(Short)?;
        Ok(Self { bytes, at: 0, is_cdr: true, is_big: head[1] & 1 == 0 })
    }

    /// One of ROS 1.
    pub fn ros1(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, is_cdr: false, is_big: false }
    }

    pub fn is_cdr(&self) -> bool {
        self.is_cdr
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], Short> {
        let end = self.at.checked_add(length).ok_or(Short)?;
        let taken = self.bytes.get(self.at..end).ok_or(Short)?;
        self.at = end;
        Ok(taken)
    }

    fn number<const N: usize>(&mut self) -> Result<[u8; N], Short> {
        if self.is_cdr {
            self.at = self.at.next_multiple_of(N);
        }
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        if self.is_big {
            bytes.reverse();
        }
        Ok(bytes)
    }

    pub fn u32(&mut self) -> Result<u32, Short> {
        self.number().map(u32::from_le_bytes)
    }

    pub fn f32(&mut self) -> Result<f32, Short> {
        self.number().map(f32::from_le_bytes)
    }

    pub fn f64(&mut self) -> Result<f64, Short> {
        self.number().map(f64::from_le_bytes)
    }

    /// A text, without the 0 at its end.
    pub fn text(&mut self) -> Result<&'a [u8], Short> {
        let length = self.u32()? as usize;
        let text = self.take(length)?;
        Ok(text.strip_suffix(b"\0").unwrap_or(text))
    }

    /// Bytes that were not read yet.
    pub fn left(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }

    /// Numbers, as many as there are said to be.
    pub fn f32s(&mut self) -> Result<Vec<f32>, Short> {
        let count = self.u32()? as usize;
        if count > self.left() / 4 {
            return Err(Short);
        }
        (0..count).map(|_| self.f32()).collect()
    }
}
