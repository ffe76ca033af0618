//! The B1 status report.
//!
//! Source: manual, offsets as in `lrfslam_lrf::sick_lms::reply::StatusReport`.

use lrfslam_core::time::Instant;
use lrfslam_lrf::sick_lms::OperatingMode;
use lrfslam_lrf::sick_lms::reply::STATUS_REPORT;
use lrfslam_lrf::sick_lms::request::BAUD_CODES;

use super::VirtualSick;

impl VirtualSick {
    /// Payload without the status byte.
    pub(super) fn status_report(&self, now: Instant) -> Vec<u8> {
        let mut report = vec![0; STATUS_REPORT];
        let mut put = |at: usize, bytes: &[u8]| report[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, &[0xB1]);
        put(1, self.model.software);
        put(8, &[mode_code(self.mode)]);
        // Clean windows, and a mirror at its speed.
        (0..8).for_each(|channel| put(19 + 2 * channel, &600_u16.to_le_bytes()));
        (0..4).for_each(|channel| put(35 + 2 * channel, &600_u16.to_le_bytes()));
        (0..8).for_each(|channel| put(43 + 2 * channel, &620_u16.to_le_bytes()));
        (0..4).for_each(|channel| put(59 + 2 * channel, &620_u16.to_le_bytes()));
        put(67, &1333_u16.to_le_bytes());
        put(102, &[self.config.measuring_mode()]);
        put(107, &self.variant.angle_deg.to_le_bytes());
        put(109, &self.variant.resolution_cdeg.to_le_bytes());
        let rate = self.line.baud(now).unwrap_or(9600);
        let divisor = BAUD_CODES.iter().find(|(known, _, _)| *known == rate).map_or(0x67, |(_, _, divisor)| *divisor);
        put(116, &[divisor, 0x80]);
        put(119, &[u8::from(self.permanent_baud.is_some())]);
        put(122, &[self.config.unit().map_or(0, |unit| unit.code())]);
        put(124, b"V01.00 ");
        report
    }
}

fn mode_code(mode: OperatingMode) -> u8 {
    match mode {
        OperatingMode::OnRequest | OperatingMode::Baud(_) | OperatingMode::Other(_) => OperatingMode::OnRequest.code(),
        mode => mode.code(),
    }
}
