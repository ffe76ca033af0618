//! Text that others wrote, read with the place of every fault: lines and words, tables; and shown.

pub mod printable;
pub mod table;
pub mod text;
