//! Hokuyo's SCIP protocol: 2.0, the 1.1 that a URG-04LX starts in, and the extra lines of 2.2.
//!
//! Everything is text: a command ends with a line feed; a reply is `echo LF status sum LF body LF`, and an empty line
//! ends it, so two line feeds in a row are the one mark from which to find the way again.
//!
//! Modules, in the direction of the data: [`code`] (6 bits per character), [`command`], [`decoder`] (bytes → frames),
//! [`reply`] (frame → checked fields), [`parameters`] (what the sensor is), [`scan`] (fields → beams), [`driver`] (the
//! session); its 24-bit stamps go through [`clock`](crate::clock).
//!
//! Not here: reading the further echoes of multi-echo models (the first is taken), firmware update mode.
//!
//! Source: manual, *Communication Protocol Specification for SCIP2.0 Standard*, C-42-03320B; captures of a URG-04LX and a
//! UTM-30LX.

pub mod code;
pub mod command;
pub mod decoder;
pub mod driver;
pub mod parameters;
pub mod reply;
pub mod scan;

pub use command::{Acquire, Command, Encoding, TimeMode};
pub use decoder::ScipDecoder;
pub use driver::{HokuyoConfig, HokuyoDriver};
pub use parameters::SensorParameters;
pub use reply::{FrameError, Reply, Status};
