//! Requests: `A5 command`, and for those with a payload its length, itself, and the XOR of all bytes before.
//!
//! Source: Interface Protocol, "Request Packets' Format" and the table of requests.

/// A request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// 25: stop scanning, laser off. Not answered; the next request must wait a millisecond.
    Stop,
    /// 40: reboot. Not answered.
    Reset,
    /// 20: scan, 5 bytes a sample.
    Scan,
    /// 82: scan in packets with a check sum, in the sensor's usual express mode.
    ExpressScan,
    /// 50: model, versions, serial number.
    GetInfo,
    /// 52: health.
    GetHealth,
    /// F0: motor power, 0 (off) to 1023; A2 and A3. Not answered.
    MotorPower(u16),
}

/// A request as bytes.
pub type RequestBytes = heapless::Vec<u8, 12>;

impl Request {
    /// The bytes on the wire.
    pub fn emit(&self) -> RequestBytes {
        match self {
            Request::Stop => plain(0x25),
            Request::Reset => plain(0x40),
            Request::Scan => plain(0x20),
            Request::ExpressScan => with_payload(0x82, &[0; 5]),
            Request::GetInfo => plain(0x50),
            Request::GetHealth => plain(0x52),
            Request::MotorPower(power) => with_payload(0xF0, &power.to_le_bytes()),
        }
    }

    /// Reads a whole request; `None` for one not known, or a wrong sum.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [0xA5, 0x25] => Some(Request::Stop),
            [0xA5, 0x40] => Some(Request::Reset),
            [0xA5, 0x20] => Some(Request::Scan),
            [0xA5, 0x50] => Some(Request::GetInfo),
            [0xA5, 0x52] => Some(Request::GetHealth),
            [0xA5, 0x82, 5, 0, 0, 0, 0, 0, _] if is_right(bytes) => Some(Request::ExpressScan),
            [0xA5, 0xF0, 2, low, high, _] if is_right(bytes) => {
                Some(Request::MotorPower(u16::from_le_bytes([*low, *high])))
            }
            _ => None,
        }
    }
}

fn plain(command: u8) -> RequestBytes {
    RequestBytes::from_slice(&[0xA5, command]).unwrap_or_default()
}

fn with_payload(command: u8, payload: &[u8]) -> RequestBytes {
    // The longest has 9 bytes: it fits.
    let head = [0xA5, command, payload.len() as u8];
    let mut bytes: RequestBytes = head.iter().chain(payload).copied().collect();
    let _ = bytes.push(xor(&bytes));
    bytes
}

fn is_right(bytes: &[u8]) -> bool {
    xor(bytes) == 0
}

/// All bytes, exclusive-or.
pub(super) fn xor(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_of_the_manual_are_emitted_and_parsed() {
        for (request, bytes) in [
            (Request::Stop, &[0xA5, 0x25][..]),
            (Request::Scan, &[0xA5, 0x20]),
            (Request::ExpressScan, &[0xA5, 0x82, 0x05, 0, 0, 0, 0, 0, 0x22]),
            (Request::GetHealth, &[0xA5, 0x52]),
            (Request::MotorPower(660), &[0xA5, 0xF0, 0x02, 0x94, 0x02, 0xC1]),
        ] {
            assert_eq!(&request.emit()[..], bytes);
            assert_eq!(Request::parse(bytes), Some(request));
        }
        assert_eq!(Request::parse(&[0xA5, 0x82, 0x05, 0, 0, 0, 0, 0, 0x23]), None);
    }
}
