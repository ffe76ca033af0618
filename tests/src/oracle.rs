//! Reads scans from undamaged bytes, by other code than the product's: the truth that published scans are held to.

use lrfslam_core::scan::{Echo, RangeScan};

/// One beam, in whole millimetres: what can be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Seen {
    /// A range.
    Millimetres(u32),
    /// Nothing up to the largest range.
    Nothing,
    /// No measurement.
    Unknown,
}

/// A published scan, beam by beam.
pub fn published(scan: &RangeScan<'_>) -> Vec<Seen> {
    let seen = |echo| match echo {
        Echo::Hit(range_m) => Seen::Millimetres((f64::from(range_m) * 1000.0).round() as u32),
        Echo::Miss => Seen::Nothing,
        Echo::Invalid => Seen::Unknown,
    };
    scan.beams.iter().map(|beam| seen(beam.echo)).collect()
}

/// The scan in one write of a SICK in measuring mode 0, if it is one.
pub fn sick(write: &[u8]) -> Option<Vec<Seen>> {
    if write.len() < 9 || write[4] != 0xB0 {
        return None;
    }
    let count = usize::from(write[5]) | usize::from(write[6] & 3) << 8;
    let unit_mm = match write[6] >> 6 {
        0 => 10,
        1 => 1,
        _ => return None,
    };
    let seen = |pair: &[u8]| match (u32::from(pair[0]) | u32::from(pair[1]) << 8) & 0x1FFF {
        0 | 8184.. => Seen::Unknown,
        8183 => Seen::Nothing,
        range => Seen::Millimetres(range * unit_mm),
    };
    Some(write[7..7 + 2 * count].chunks(2).map(seen).collect())
}

/// The scan in one write of a Hokuyo with three characters a value, if it is one; `is_utm` tells the codes.
pub fn hokuyo(write: &[u8], is_utm: bool) -> Option<Vec<Seen>> {
    let text = std::str::from_utf8(write).ok()?;
    let mut lines = text.lines();
    let (echo, status, _stamp) = (lines.next()?, lines.next()?, lines.next()?);
    if !echo.starts_with("MD") || status != "99b" {
        return None;
    }
    let data: String = lines.filter(|line| !line.is_empty()).map(|line| &line[..line.len() - 1]).collect();
    let number = |three: &[u8]| three.iter().fold(0, |value, character| value * 64 + u32::from(character - 48));
    let seen = |range: u32| match (is_utm, range) {
        (true, 1 | 60_000..) => Seen::Nothing,
        (true, 0..23) | (false, 0..20) => Seen::Unknown,
        (false, 5600..) => Seen::Nothing,
        (_, range) => Seen::Millimetres(range),
    };
    Some(data.as_bytes().chunks(3).map(number).map(seen).collect())
}
