//! The configuration block of telegrams F4, F7 and 77: 34 bytes, 32 on older LMS200.

/// Bytes of the block on new firmware (V02.30, X01.27).
pub const LEN_NEW: usize = 34;

/// Unit of a range on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// 10 mm.
    Centimetre = 0,
    /// 1 mm.
    Millimetre = 1,
    /// 100 mm.
    Decimetre = 2,
}

impl Unit {
    /// From the code 0, 1, 2; `None` for others.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Unit::Centimetre),
            1 => Some(Unit::Millimetre),
            2 => Some(Unit::Decimetre),
            _ => None,
        }
    }

    /// The code on the wire.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// Units in a metre; to divide by, which rounds right where a product with 0.001 would not.
    pub const fn per_metre(self) -> f32 {
        match self {
            Unit::Centimetre => 100.0,
            Unit::Millimetre => 1000.0,
            Unit::Decimetre => 10.0,
        }
    }
}

/// The block, as bytes; what the driver needs has names, the rest stays as it was read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConfigBlock {
    bytes: heapless::Vec<u8, LEN_NEW>,
}

impl ConfigBlock {
    /// A block with `len` bytes (cut to [`LEN_NEW`]): blanking 70 cm, mode 0, mm, everything else 0.
    pub fn new(len: usize) -> Self {
        let mut block = Self { bytes: core::iter::repeat_n(0, len.min(LEN_NEW)).collect() };
        block.set(0, 70);
        block.set(6, Unit::Millimetre.code());
        block
    }

    /// Reads a block; some hosts send a shortened one, so every length up to [`LEN_NEW`] is taken. `None` if longer or empty.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let bytes = heapless::Vec::from_slice(bytes).ok()?;
        (!bytes.is_empty()).then_some(Self { bytes })
    }

    /// The bytes on the wire.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Overwrites the front of this block with `other`: how a sensor takes a shortened one.
    pub fn overlay(&mut self, other: &ConfigBlock) {
        for (mine, new) in self.bytes.iter_mut().zip(&other.bytes) {
            *mine = *new;
        }
    }

    fn get(&self, at: usize) -> u8 {
        self.bytes.get(at).copied().unwrap_or(0)
    }

    fn set(&mut self, at: usize, value: u8) {
        if let Some(byte) = self.bytes.get_mut(at) {
            *byte = value;
        }
    }

    /// Availability bits (offset 4): 1 highest, 2 real-time index in scans, 4 no effect of dazzle.
    pub fn availability(&self) -> u8 {
        self.get(4)
    }

    /// Measuring mode (offset 5): see [`ValueFormat`](super::measurement::ValueFormat).
    pub fn measuring_mode(&self) -> u8 {
        self.get(5)
    }

    /// Sets the measuring mode.
    pub fn set_measuring_mode(&mut self, mode: u8) {
        self.set(5, mode);
    }

    /// Unit of ranges (offset 6); `None` for a code not known.
    pub fn unit(&self) -> Option<Unit> {
        Unit::from_code(self.get(6))
    }

    /// Sets the unit of ranges.
    pub fn set_unit(&mut self, unit: Unit) {
        self.set(6, unit.code());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sizes_are_read_and_keep_their_bytes() {
        for len in [32, LEN_NEW, 7] {
            let bytes: std::vec::Vec<u8> = (0..len as u8).collect();
            let block = ConfigBlock::parse(&bytes).unwrap();
            assert_eq!(block.bytes(), bytes);
            assert_eq!((block.availability(), block.measuring_mode(), block.unit()), (4, 5, None));
        }
        assert_eq!(ConfigBlock::parse(&[0; 35]), None);
        assert_eq!(ConfigBlock::parse(&[]), None);
    }

    #[test]
    fn short_block_overwrites_only_the_front() {
        let mut block = ConfigBlock::new(LEN_NEW);
        block.overlay(&ConfigBlock::parse(&[1, 0, 0, 0, 2, 3, 0]).unwrap());
        assert_eq!((block.bytes()[0], block.availability(), block.measuring_mode()), (1, 2, 3));
        assert_eq!((block.unit(), block.bytes().len()), (Some(Unit::Centimetre), LEN_NEW));
    }
}
