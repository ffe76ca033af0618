//! Who may see and who may command: on this computer everybody sees, from elsewhere only who has the token, and only that one commands.
//!
//! The token is asked for in the header `Authorization`: a page of another origin cannot send that without being allowed to, which nobody is.
//! The name that a browser asks for must be this computer's where no token is needed, or another page could reach us by a name of its own.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};

use axum::http::{HeaderMap, header};
use sha2::{Digest as _, Sha256};

/// Port, if none is said.
const PORT: u16 = 7340;
/// Random bytes of a token: nobody guesses 128 bits.
const TOKEN_BYTES: usize = 16;

/// Where `--monitor` without more is served: this computer alone.
pub const LOOPBACK: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), PORT);

/// An address as a user writes it: `IP`, `PORT`, `IP:PORT`; nothing is the loopback.
///
/// # Errors
/// What was expected.
pub fn parse_address(text: &str) -> Result<SocketAddr, String> {
    let with_port = |ip: IpAddr| SocketAddr::new(ip, PORT);
    let whole = text.parse::<SocketAddr>().ok();
    let ip = || text.parse::<IpAddr>().ok().map(with_port);
    let port = || text.parse::<u16>().ok().map(|port| SocketAddr::new(LOOPBACK.ip(), port));
    let nothing = text.is_empty().then_some(LOOPBACK);
    let found = nothing.or(whole).or_else(ip).or_else(port);
    found.ok_or_else(|| "expected an address of this computer, such as 0.0.0.0:7340, or a port".to_owned())
}

/// Who may see the page, and who may command.
#[derive(Debug, Clone)]
pub struct Access {
    token: String,
    digest: [u8; 32],
    needs_token: bool,
}

impl Access {
    /// For a server at `address`, with a token of its own, or `token`.
    ///
    /// # Errors
    /// If the system has no random numbers.
    pub fn new(address: SocketAddr, token: Option<String>) -> std::io::Result<Self> {
        let token = token.map_or_else(random_token, Ok)?;
        let digest = Sha256::digest(token.as_bytes()).into();
        Ok(Self { token, digest, needs_token: !address.ip().is_loopback() })
    }

    /// To be kept secret.
    pub fn token(&self) -> &str {
        &self.token
    }

    /// Who asks may see the robot.
    pub fn may_see(&self, headers: &HeaderMap) -> bool {
        is_of_own_page(headers) && (self.has_token(headers) || !self.needs_token && asks_for_loopback(headers))
    }

    /// Who asks may command it.
    pub fn may_command(&self, headers: &HeaderMap) -> bool {
        is_of_own_page(headers) && self.has_token(headers)
    }

    /// This is the token.
    pub fn is_token(&self, told: &str) -> bool {
        <[u8; 32]>::from(Sha256::digest(told.as_bytes())) == self.digest
    }

    /// Digests are compared: how long that takes says nothing about the token.
    fn has_token(&self, headers: &HeaderMap) -> bool {
        let told = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
        let told = told.and_then(|value| value.strip_prefix("Bearer "));
        told.is_some_and(|token| self.is_token(token))
    }
}

fn random_token() -> std::io::Result<String> {
    let mut bytes = [0; TOKEN_BYTES];
    getrandom::fill(&mut bytes).map_err(|error| std::io::Error::other(format!("no random numbers: {error}")))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// Not of a page of another origin; programs that are no browser say nothing of it.
fn is_of_own_page(headers: &HeaderMap) -> bool {
    let site = headers.get("sec-fetch-site").and_then(|value| value.to_str().ok());
    let is_same_site = site.is_none_or(|site| matches!(site, "same-origin" | "none"));
    let Some(origin) = headers.get(header::ORIGIN) else { return is_same_site };
    let host = text(headers, header::HOST);
    let own = origin.to_str().ok().and_then(|origin| origin.strip_prefix("http://"));
    is_same_site && own.is_some() && own == host
}

fn asks_for_loopback(headers: &HeaderMap) -> bool {
    let Some(host) = text(headers, header::HOST) else { return false };
    let name = host.rsplit_once(':').filter(|(_, port)| port.parse::<u16>().is_ok()).map_or(host, |(name, _)| name);
    let ip = name.trim_matches(['[', ']']).parse::<IpAddr>();
    name == "localhost" || ip.is_ok_and(|ip| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(&str, &str)]) -> HeaderMap {
        let parsed = pairs.iter().map(|(name, value)| (name.parse::<header::HeaderName>(), value.parse()));
        parsed.map(|(name, value)| (name.unwrap(), value.unwrap())).collect()
    }

    #[test]
    fn addresses_are_read() {
        assert_eq!(parse_address("").unwrap(), LOOPBACK);
        assert_eq!(parse_address("8000").unwrap(), "127.0.0.1:8000".parse().unwrap());
        assert_eq!(parse_address("0.0.0.0").unwrap(), "0.0.0.0:7340".parse().unwrap());
        assert_eq!(parse_address("[::1]:9").unwrap(), "[::1]:9".parse().unwrap());
        assert!(parse_address("robot.local").is_err() && parse_address("70000").is_err());
    }

    #[test]
    fn on_the_loopback_everybody_sees_and_who_has_the_token_commands() {
        let access = Access::new(LOOPBACK, Some("secret".to_owned())).unwrap();
        let local = headers(&[("host", "127.0.0.1:7340")]);
        assert!(access.may_see(&local) && !access.may_command(&local));
        let told = headers(&[("host", "localhost:7340"), ("authorization", "Bearer secret")]);
        assert!(access.may_see(&told) && access.may_command(&told));
        let wrong = headers(&[("host", "[::1]:7340"), ("authorization", "Bearer secret2")]);
        assert!(access.may_see(&wrong) && !access.may_command(&wrong));
    }

    #[test]
    fn pages_of_others_see_nothing() {
        let access = Access::new(LOOPBACK, Some("secret".to_owned())).unwrap();
        for foreign in [
            headers(&[("host", "evil.example:7340")]),
            headers(&[("host", "127.0.0.1:7340"), ("origin", "http://evil.example")]),
            headers(&[("host", "127.0.0.1:7340"), ("origin", "null")]),
            headers(&[("host", "127.0.0.1:7340"), ("sec-fetch-site", "cross-site")]),
            headers(&[]),
        ] {
            assert!(!access.may_see(&foreign), "{foreign:?}");
        }
        let own = headers(&[("host", "127.0.0.1:7340"), ("origin", "http://127.0.0.1:7340")]);
        assert!(access.may_see(&own));
    }

    #[test]
    fn elsewhere_the_token_is_needed_to_see() {
        let access = Access::new("192.168.0.7:7340".parse().unwrap(), None).unwrap();
        let with =
            |token: &str| headers(&[("host", "192.168.0.7:7340"), ("authorization", &format!("Bearer {token}"))]);
        assert!(access.may_see(&with(access.token())) && access.token().len() == 32);
        assert!(!access.may_see(&with("")) && !access.may_see(&with(&access.token()[..31])));
        assert!(!access.may_see(&headers(&[("host", "127.0.0.1:7340")])));
    }
}
