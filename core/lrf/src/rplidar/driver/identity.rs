//! What an RPLIDAR says of itself.

use super::RANGE_MAX_M;
use crate::driver::Identity;

/// Model, versions and serial number of an information response.
///
/// Source: Interface Protocol, "Device Info Response": model, firmware minor and major, hardware, 16 bytes of serial number.
pub(super) fn describe(bytes: &[u8]) -> Identity {
    use core::fmt::Write as _;
    let mut identity = Identity {
        angle_min_rad: -core::f32::consts::PI,
        angle_max_rad: core::f32::consts::PI,
        range_max_m: RANGE_MAX_M,
        ..Identity::default()
    };
    if let [model, minor, major, hardware, serial @ ..] = bytes {
        // The longest of these texts fits its field: 32 characters.
        let _ = write!(identity.model, "RPLIDAR model 0x{model:02X}, hardware {hardware}");
        let _ = write!(identity.firmware, "{major}.{minor:02}");
        let _ = serial.iter().try_for_each(|byte| write!(identity.serial, "{byte:02X}"));
    }
    identity
}
