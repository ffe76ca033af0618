//! Slamtec RPLIDAR A1, A2, A3 and C1.
//!
//! Requests begin with A5; a request that is answered is answered first by a descriptor (`A5 5A`, length and type of what
//! follows), then by one response or an endless row of them. Angles grow clockwise from straight ahead.
//!
//! Scans are asked for in express mode, whose packets have a check sum. The old scan mode has none, only two check bits a
//! sample. It is used if a sensor has nothing else, and that is told ([`Cause::Unchecked`](crate::driver::Cause::Unchecked)): angles must
//! grow and turns start ahead, but **a damaged distance goes unseen**.
//!
//! Not here: ultra and HQ capsules (A3's fastest modes; the maker documents the first only in its SDK).
//!
//! Sources: maker, *RPLIDAR Interface Protocol and Application Notes* (A1 and A2, 2018 and 2019; A3M1), pages cited at each item; rates
//! by model from drivers.

pub mod decoder;
pub mod driver;
pub mod request;
pub mod response;

pub use decoder::{DecoderEvent, RplidarDecoder};
pub use driver::{RplidarConfig, RplidarDriver};
pub use request::Request;
pub use response::{Capsule, Descriptor, ResponseKind};
