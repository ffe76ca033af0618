//! A participant in a domain of ROS 2, and its topics by the names that ROS 2 gives them.

use std::net::Ipv4Addr;

use rustdds::no_key::{DataWriter, SimpleDataReader};
use rustdds::policy::{Durability, History};
use rustdds::{DomainParticipant, DomainParticipantBuilder, Duration, QosPolicies, QosPolicyBuilder, Topic, TopicKind};

use crate::DOMAIN_MAX;
use crate::raw::{Raw, Whole};

/// The network, or DDS on it, does not do what is asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeError(String);

impl std::fmt::Display for NodeError {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(&self.0)
    }
}

impl std::error::Error for NodeError {}

impl NodeError {
    pub(crate) fn new(what: impl std::fmt::Display) -> Self {
        Self(what.to_string())
    }
}

/// How messages of a topic are kept and sent.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quality {
    /// The last so many.
    pub depth: i32,
    /// Lost ones are sent again.
    pub is_reliable: bool,
    /// Who comes later gets those that are kept.
    pub is_kept: bool,
}

/// A writer waits no longer than this for room: a run does not wait for those who look.
const BLOCKING_MS: u32 = 20;

impl Quality {
    fn policies(self) -> QosPolicies {
        let durability = if self.is_kept { Durability::TransientLocal } else { Durability::Volatile };
        let qos = QosPolicyBuilder::new().durability(durability).history(History::KeepLast { depth: self.depth });
        let blocking = Duration::from_millis(i64::from(BLOCKING_MS));
        if self.is_reliable { qos.reliable(blocking).build() } else { qos.best_effort().build() }
    }
}

/// A participant in a domain of ROS 2. Clones are the same one; it leaves the domain when the last one goes.
#[derive(Clone)]
pub struct Node {
    participant: DomainParticipant,
    domain: u16,
}

impl std::fmt::Debug for Node {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Node").field("domain", &self.domain).finish_non_exhaustive()
    }
}

impl Node {
    /// Joins a domain.
    ///
    /// * `domain` — as ROS_DOMAIN_ID, 0 to [`DOMAIN_MAX`]
    /// * `is_local` — with this computer's participants only
    ///
    /// # Errors
    /// If there is no such domain, or its ports cannot be opened.
    pub fn join(domain: u16, is_local: bool) -> Result<Self, NodeError> {
        if domain > DOMAIN_MAX {
            return Err(NodeError::new(format!("domain {domain}: expected 0 to {DOMAIN_MAX}")));
        }
        let builder = DomainParticipantBuilder::new(domain);
        let builder = if is_local { builder.with_only_networks([Ipv4Addr::LOCALHOST]) } else { builder };
        let participant = builder.build();
        let participant = participant.map_err(|error| NodeError::new(format!("domain {domain}: {error}")))?;
        Ok(Self { participant, domain })
    }

    /// Its domain.
    pub fn domain(&self) -> u16 {
        self.domain
    }

    fn topic(&self, name: &str, kind: &str, qos: &QosPolicies) -> Result<Topic, NodeError> {
        let made = self.participant.create_topic(in_dds(name), kind_in_dds(kind), qos, TopicKind::NoKey);
        made.map_err(|error| NodeError::new(format!("{name}: {error}")))
    }

    /// * `kind` — as in `sensor_msgs/LaserScan`
    pub(crate) fn writer(&self, name: &str, kind: &str, quality: Quality) -> Result<DataWriter<Raw, Whole>, NodeError> {
        let qos = quality.policies();
        let topic = self.topic(name, kind, &qos)?;
        let fault = |error| NodeError::new(format!("{name}: {error}"));
        let publisher = self.participant.create_publisher(&qos).map_err(fault)?;
        publisher.create_datawriter_no_key(&topic, None).map_err(fault)
    }

    pub(crate) fn reader(
        &self,
        name: &str,
        kind: &str,
        quality: Quality,
    ) -> Result<SimpleDataReader<Raw, Whole>, NodeError> {
        let qos = quality.policies();
        let topic = self.topic(name, kind, &qos)?;
        let fault = |error| NodeError::new(format!("{name}: {error}"));
        let subscriber = self.participant.create_subscriber(&qos).map_err(fault)?;
        subscriber.create_simple_datareader_no_key(&topic, None).map_err(fault)
    }
}

/// `/scan` and `scan` → `rt/scan`. Source: ROS 2 design, "Topic and Service name mapping to DDS".
fn in_dds(name: &str) -> String {
    format!("rt/{}", name.trim_start_matches('/'))
}

/// `sensor_msgs/LaserScan` → `sensor_msgs::msg::dds_::LaserScan_`.
fn kind_in_dds(kind: &str) -> String {
    let (package, name) = kind.split_once('/').unwrap_or(("", kind));
    format!("{package}::msg::dds_::{name}_")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_ros_2() {
        assert_eq!((in_dds("/scan"), in_dds("left/scan")), ("rt/scan".to_owned(), "rt/left/scan".to_owned()));
        assert_eq!(kind_in_dds("tf2_msgs/TFMessage"), "tf2_msgs::msg::dds_::TFMessage_");
    }

    #[test]
    fn domain_that_has_no_ports_is_refused() {
        let error = Node::join(233, true).expect_err("no ports").to_string();
        assert_eq!(error, "domain 233: expected 0 to 232");
    }
}
