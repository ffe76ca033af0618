//! Scans as a robot's messages tell them now: each is handed out at once, with what those before it have shown.

use std::sync::Arc;

use lrfslam_core::time::Instant;

use super::LogScan;
use super::bag::raw;
use super::range_limit::RangeLimit;
use super::raw::Bearings;
use crate::input::text::FieldFault;
use crate::scans::bags::scan_of;
use crate::scans::mcap::{Channel, Message};

/// Scans out of messages of a topic, one by one.
#[derive(Debug)]
pub struct ToldScans {
    channel: Arc<Channel>,
    number: u64,
    range_limit: RangeLimit,
}

impl ToldScans {
    /// Of `topic`, whose messages are `sensor_msgs/LaserScan` of ROS 2.
    ///
    /// * `range_max_m` — ranges from here on are misses, m; `None`: as the messages say or show
    pub fn new(topic: &str, range_max_m: Option<f32>) -> Self {
        let channel = Channel {
            topic: topic.to_owned(),
            encoding: "cdr".to_owned(),
            schema: "sensor_msgs/msg/LaserScan".to_owned(),
        };
        Self { channel: Arc::new(channel), number: 0, range_limit: RangeLimit::new(range_max_m) }
    }

    /// The scan in a message, under its own stamp, or under `received` if it has none.
    ///
    /// * `data` — in CDR, with its head of four bytes
    ///
    /// # Errors
    /// What is wrong with it; the next may be right.
    pub fn take(&mut self, received: Instant, data: Vec<u8>) -> Result<LogScan, FieldFault> {
        self.number += 1;
        let (sequence, time_ns) = (0, u64::try_from(received.micros).unwrap_or(0).saturating_mul(1000));
        let message = Message { channel: self.channel.clone(), sequence, time_ns, data, is_suspect: false };
        let scan = raw(scan_of(self.number, &message)?);
        let bearings = scan.bearings.unwrap_or_else(|| Bearings::usual(scan.ranges_m.len()));
        self.range_limit.observe(&scan.ranges_m, bearings.step_rad, scan.range_max_m);
        let range_max_m = self.range_limit.range_max_m();
        Ok(LogScan {
            stamp: scan.stamp.unwrap_or(received),
            range_max_m,
            beams: scan.beams(bearings, range_max_m),
            map_from_robot_odometry: None,
            robot_from_lrf: None,
            line: scan.line,
        })
    }
}
