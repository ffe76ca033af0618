//! Where in Zenoh: a router or another program to connect to, or an address to listen at.

use super::ROBOTS_MAX;
use crate::remote::STATE_BYTES_MAX;

/// Zenoh's usual port.
const PORT: u16 = 7447;

/// Where Zenoh is joined, over TCP.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// `HOST:PORT`.
    address: String,
    pub(super) listens: bool,
}

impl Place {
    /// As a user writes it: `HOST[:PORT]` of a router, or of a program that listens; or `listen:IP[:PORT]`.
    ///
    /// # Errors
    /// What was expected.
    pub fn parse(text: &str) -> Result<Self, String> {
        let expected = || "expected HOST[:PORT] of a Zenoh router, or listen:IP[:PORT]".to_owned();
        let (listens, place) = text.strip_prefix("listen:").map_or((false, text), |place| (true, place));
        // An address of IPv6 stands in brackets.
        let has_port = place.rsplit_once(':').is_some_and(|(_, end)| !end.contains(']'));
        let address = if has_port { place.to_owned() } else { format!("{place}:{PORT}") };
        let (host, port) = address.rsplit_once(':').ok_or_else(expected)?;
        let is_host = host.chars().all(|c| c.is_ascii_alphanumeric() || "-._[]:".contains(c));
        let is_plain = !host.contains(':') || host.starts_with('[') && host.ends_with(']');
        if host.is_empty() || !is_host || !is_plain || port.parse::<u16>().is_err() {
            return Err(expected());
        }
        Ok(Self { address, listens })
    }

    /// Host or address, and port.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Zenoh's configuration: TCP alone, nobody is looked for, and no more than this is taken of whom it meets. A client finds its router
    /// again when that was away.
    pub(super) fn config(&self) -> String {
        let endpoint = format!("[\"tcp/{}\"]", self.address);
        let (mode, connect, listen) =
            if self.listens { ("peer", "[]", &*endpoint) } else { ("client", &*endpoint, "[]") };
        let largest = STATE_BYTES_MAX + (64 << 10);
        format!(
            "{{ mode: \"{mode}\", connect: {{ endpoints: {connect}, timeout_ms: 10000, exit_on_failure: true }}, \
             listen: {{ endpoints: {listen}, exit_on_failure: true }}, \
             scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }}, \
             transport: {{ unicast: {{ max_sessions: {} }}, link: {{ rx: {{ max_message_size: {largest} }} }} }} }}",
            2 * ROBOTS_MAX
        )
    }
}
