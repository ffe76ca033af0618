//! Text that others wrote, read with the place of every fault: lines and words, tables; and shown.
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

pub mod printable;
pub mod table;
pub mod text;
