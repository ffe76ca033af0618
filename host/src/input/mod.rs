//! Text that others wrote, read with the place of every fault: lines and words, tables.

pub mod table;
pub mod text;
