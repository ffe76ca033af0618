//! SICK LMS2xx telegrams: LMS200, 211, 220, 221, 291 on RS-232 or RS-422.
//!
//! A telegram is `02 | address | length | payload | check sum`; the sensor answers each one it takes with a bare `06`, then
//! with its reply; a damaged one with a bare `15`. Sensor telegrams have address 0x80 and a status byte at the end.
//!
//! Modules, in the direction of the data: [`crc`], [`telegram`] (frame around a payload), [`decoder`] (bytes → telegrams),
//! [`request`] (host → sensor), [`reply`] (sensor → host), [`config_block`], [`measurement`] (ranges), [`scan`] (ranges →
//! beams), [`driver`] (the session).
//!
//! Not here: PLS scanners (even parity), field sets and their evaluation.
//!
//! Source: manual, *Telegrams for Configuring and Operating the LMS2xx*, as agreed on by drivers; a capture of an LMS.

pub mod config_block;
pub mod crc;
pub mod decoder;
pub mod driver;
pub mod measurement;
pub mod reply;
pub mod request;
pub mod scan;
pub mod telegram;

pub use config_block::{ConfigBlock, Unit};
pub use decoder::{DecoderEvent, TelegramDecoder};
pub use driver::{SickConfig, SickDriver};
pub use measurement::Measurement;
pub use reply::{DeviceStatus, Reply, ReplyBody};
pub use request::{OperatingMode, Request, Variant};
