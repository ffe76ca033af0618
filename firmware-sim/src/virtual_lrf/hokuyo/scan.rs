//! Scans: what the scene holds, as text.

use lrfslam_core::time::Instant;
use lrfslam_lrf::hokuyo_scip::parameters::RangeCodes;
use lrfslam_lrf::hokuyo_scip::reply::BLOCK;
use lrfslam_lrf::hokuyo_scip::{Acquire, Command, Encoding, Status, code};

use super::VirtualHokuyo;
use crate::lrf_model::Reading;

/// "Not measurable": also what steps outside the field of view give (capture).
const NOT_MEASURABLE: u32 = 19;

impl VirtualHokuyo {
    /// A turn has passed the last step asked for: its scan goes out if it is wanted and the line is free.
    pub(super) fn finish_turn(&mut self, now: Instant) {
        let Some(start) = self.sight.next_at(self.turn_start(self.next_turn)) else { return };
        self.next_turn += 1;
        self.tell(now, start);
        self.sight.advance();
    }

    fn tell(&mut self, now: Instant, start: Instant) {
        let free = self.line.is_free(now);
        let Some(stream) = &mut self.stream else { return };
        if stream.skip > 0 {
            stream.skip -= 1;
            return;
        }
        if !free {
            return;
        }
        stream.skip = stream.interval;
        stream.remaining = stream.remaining.map(|remaining| remaining - 1);
        let stream = stream.clone();
        if stream.remaining == Some(0) {
            self.stream = None;
            self.laser_on = false;
        }
        let mut echo = stream_echo(&stream.command, stream.remaining.unwrap_or(0));
        if !stream.tag.is_empty() {
            echo.push(b';');
            echo.extend(&stream.tag);
        }
        let body = self.scan_body(start, &stream.acquire);
        self.reply(now, &echo, Status::SCAN, &body);
    }

    /// Time stamp and data of the turn of the mirror that began at `start`.
    pub(super) fn scan_body(&mut self, start: Instant, acquire: &Acquire) -> String {
        let values = self.measure(start, acquire);
        let mut body = self.stamp_line(self.clock_ms(start));
        push_blocks(&mut body, &values, acquire.encoding);
        body
    }

    /// Ranges (and intensities) of the steps asked for, clusters merged; a short last cluster is dropped.
    fn measure(&mut self, start: Instant, acquire: &Acquire) -> Vec<(u32, u32)> {
        let steps: Vec<u32> = (acquire.first..=acquire.last).map(|step| self.measure_step(start, step)).collect();
        let smallest = self.model.parameters.distance_min_mm;
        steps
            .chunks_exact(usize::from(acquire.stride()))
            .map(|cluster| {
                let ranges = cluster.iter().copied().filter(|range| *range >= smallest);
                let range = ranges.min().unwrap_or(cluster[0]);
                (range, if range >= smallest { 4000 - (range / 20).min(3000) } else { 0 })
            })
            .map(|(range, intensity)| match acquire.encoding {
                Encoding::Short => (range.min(4095), intensity),
                _ => (range, intensity),
            })
            .collect()
    }

    fn measure_step(&mut self, start: Instant, step: u16) -> u32 {
        let parameters = &self.model.parameters;
        if step < parameters.step_min || step > parameters.step_max {
            return NOT_MEASURABLE;
        }
        let bearing_rad = f64::from(parameters.bearing_rad(f32::from(step)));
        let is_urg = parameters.range_codes() == RangeCodes::Urg;
        let (nothing, too_near) = if is_urg { (0, 6) } else { (1, 4) };
        let (shortest, longest) = (parameters.distance_min_mm, parameters.distance_max_mm);
        match self.sight.measure(start + self.step_time(step), bearing_rad) {
            Reading::Nothing => nothing,
            // What a URG gives most often in a real room: 0, 7 and 10 (capture).
            Reading::Failed(pick) if is_urg => [0, 0, 0, 0, 0, 0, 7, 10][pick as usize % 8],
            Reading::Failed(pick) => [2, 3, 4, 5][pick as usize % 4],
            Reading::Range(range_m) => match (range_m * 1000.0).round() as u32 {
                near if near < shortest => too_near,
                far if far >= longest => nothing,
                range => range,
            },
        }
    }
}

/// The streaming command with the number of scans left in place of the number asked for.
fn stream_echo(command: &Command, remaining: u8) -> Vec<u8> {
    match *command {
        Command::Stream { acquire, interval, .. } => {
            Command::Stream { acquire, interval, count: remaining }.emit().to_vec()
        }
        other => other.emit().to_vec(),
    }
}

/// Values in lines of 64 characters, each with sum and line feed.
fn push_blocks(body: &mut String, values: &[(u32, u32)], encoding: Encoding) {
    let mut characters = Vec::with_capacity(values.len() * encoding.width());
    let mut put = |value: u32, width: usize| {
        let mut text = [0; 3];
        code::encode(u64::from(value), &mut text[..width]);
        characters.extend(&text[..width]);
    };
    for (range, intensity) in values {
        match encoding {
            Encoding::Short => put(*range, 2),
            Encoding::Long => put(*range, 3),
            Encoding::Intensity => {
                put(*range, 3);
                put(*intensity, 3);
            }
        }
    }
    for line in characters.chunks(BLOCK) {
        body.extend(line.iter().map(|character| char::from(*character)));
        body.push(char::from(code::sum(line)));
        body.push('\n');
    }
}
