//! SCIP 1.1, in which a URG-04LX wakes: no sums, no stamps, one status character.
//!
//! Source: drivers; text of recorded scans. `L` and `S` are known by one source only, and answered as it says.

use lrfslam_core::time::Instant;
use lrfslam_lrf::hokuyo_scip::{Acquire, Encoding};

use super::VirtualHokuyo;

impl VirtualHokuyo {
    pub(super) fn answer_scip1(&mut self, now: Instant, line: &[u8]) {
        match line {
            b"SCIP2.0" => {
                self.reply_scip1(now, line, b'0', "");
                self.scip1 = false;
                self.laser_on = false;
            }
            b"V" => {
                let body = format!(
                    "VEND:Hokuyo Automatic Co.,Ltd.\nPROD:{}\nFIRM:{}\nPROT:SCIP 1.1\nSERI:{}\nSTAT:Sensor works well.\n",
                    self.model.product, self.model.firmware, self.model.serial
                );
                self.reply_scip1(now, line, b'0', &body);
            }
            b"L0" | b"L1" => {
                self.laser_on = line == b"L1";
                self.reply_scip1(now, line, b'0', "");
            }
            [b'S', rate @ ..] if rate.len() >= 6 => match digits(&rate[..6]).filter(|rate| *rate >= 19_200) {
                Some(rate) => {
                    self.reply_scip1(now, line, b'0', "");
                    self.believe(rate);
                }
                None => self.reply_scip1(now, line, b'E', ""),
            },
            [b'G', arguments @ ..] if arguments.len() == 8 => self.get_scip1(now, line, arguments),
            _ => self.reply_scip1(now, line, b'E', ""),
        }
    }

    fn get_scip1(&mut self, now: Instant, line: &[u8], arguments: &[u8]) {
        let field = |from: usize, to: usize| digits(&arguments[from..to]).map(|value| value as u16);
        let (Some(first), Some(last), Some(cluster)) = (field(0, 3), field(3, 6), field(6, 8)) else {
            return self.reply_scip1(now, line, b'E', "");
        };
        let end = self.model.parameters.steps_per_turn * 3 / 4;
        if !self.laser_on || first > last || last > end {
            return self.reply_scip1(now, line, b'E', "");
        }
        let acquire = Acquire { encoding: Encoding::Short, multi_echo: false, first, last, cluster: cluster as u8 };
        let stamped = self.scan_body(self.turn_start(self.turn_at(now) - 1), &acquire);
        // The same lines without stamp and sums.
        let body: String = stamped.lines().skip(1).map(|line| format!("{}\n", &line[..line.len() - 1])).collect();
        self.reply_scip1(now, line, b'0', &body);
    }

    fn reply_scip1(&mut self, now: Instant, echo: &[u8], status: u8, body: &str) {
        let bytes = [echo, b"\n", &[status], b"\n", body.as_bytes(), b"\n"].concat();
        self.line.send(now, bytes);
    }
}

fn digits(text: &[u8]) -> Option<u32> {
    std::str::from_utf8(text).ok()?.parse().ok()
}
