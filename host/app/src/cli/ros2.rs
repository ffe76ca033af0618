//! `--ros2`, and `--lrf ros2:TOPIC`: a run among nodes of ROS 2.

use anyhow::{Context as _, ensure};
use clap::Args;

use super::Failure;
use super::ros2_node::Published;

/// What others in ROS 2 are told.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct Ros2Args {
    /// Publish /scan, /map, /tf, /odom and /pose in ROS 2; no ROS is needed on this computer.
    ///
    /// The domain is that of ROS_DOMAIN_ID, else 0. With ROS_LOCALHOST_ONLY=1, or ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, this computer alone
    /// is told.
    #[arg(long)]
    ros2: bool,
}

impl Ros2Args {
    /// Announces what is to be published, if that is wanted.
    ///
    /// * `has_scan` — the scans are not from ROS 2 themselves
    pub(super) fn announce(self, has_scan: bool) -> Result<Option<Published>, Failure> {
        if !self.ros2 {
            return Ok(None);
        }
        Published::announce(Domain::of_environment().map_err(Failure::Start)?, has_scan).map(Some)
    }
}

/// Whom a node meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(not(feature = "ros2"), allow(dead_code, reason = "there is no node in this build"))]
pub(super) struct Domain {
    pub(super) number: u16,
    /// On this computer only.
    pub(super) is_local: bool,
}

impl Domain {
    /// As all programs of ROS 2 choose it.
    pub(super) fn of_environment() -> anyhow::Result<Self> {
        let variable = |name: &str| std::env::var(name).unwrap_or_default();
        Self::of(
            &variable("ROS_DOMAIN_ID"),
            &variable("ROS_LOCALHOST_ONLY"),
            &variable("ROS_AUTOMATIC_DISCOVERY_RANGE"),
        )
    }

    fn of(number: &str, localhost_only: &str, range: &str) -> anyhow::Result<Self> {
        let number = if number.is_empty() { "0" } else { number };
        let expected = || format!("ROS_DOMAIN_ID={number}: expected a number from 0 to 232");
        Ok(Self {
            number: number.parse().with_context(expected)?,
            is_local: localhost_only == "1" || range.eq_ignore_ascii_case("LOCALHOST"),
        })
    }
}

/// The topic behind `ros2:`.
pub(super) fn topic(text: &str) -> anyhow::Result<&'static str> {
    let words = text.strip_prefix('/').unwrap_or(text).split('/');
    let is_word = |word: &str| {
        word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') && word.starts_with(|c: char| !c.is_ascii_digit())
    };
    ensure!(words.clone().all(is_word), "expected ros2: and a topic, such as ros2:/scan");
    // There is one for as long as the program runs.
    Ok(text.to_owned().leak())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn domain_is_that_of_the_environment() {
        let domain = |number: u16, is_local: bool| Domain { number, is_local };
        assert_eq!(Domain::of("", "", "").unwrap(), domain(0, false));
        assert_eq!(Domain::of("42", "0", "SUBNET").unwrap(), domain(42, false));
        assert_eq!(Domain::of("7", "1", "").unwrap(), domain(7, true));
        assert_eq!(Domain::of("7", "", "localhost").unwrap(), domain(7, true));
        assert!(Domain::of("many", "", "").is_err() && Domain::of("-1", "", "").is_err());
    }

    #[test]
    fn topics_are_those_that_ros_2_can_have() {
        for right in ["/scan", "scan", "/left/scan_2", "/_hidden"] {
            assert_eq!(topic(right).unwrap(), right);
        }
        for wrong in ["", "/", "//scan", "/scan/", "/2scan", "/sc an", "/scän"] {
            assert!(topic(wrong).is_err(), "{wrong:?}");
        }
    }
}
