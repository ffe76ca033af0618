//! The server of the live page, and the link to it.

use std::io::IsTerminal as _;
use std::net::SocketAddr;
use std::sync::Arc;

use lrfslam_host::monitor::Monitor;
use lrfslam_monitor::{Robot, Server, ServerConfig};
use qrcode::QrCode;
use qrcode::render::unicode::Dense1x2;

use super::Failure;
use super::laser::say;
use super::shared::TellArgs;

pub(super) use lrfslam_monitor::parse_address;

/// The token, if the user has one for all runs.
const TOKEN: &str = "LRFSLAM_TOKEN";

/// Serves the page of a run, and says where it is.
pub(super) fn serve(address: SocketAddr, (name, monitor): (&str, Monitor), tell: TellArgs) -> Result<(), Failure> {
    serve_all(address, vec![Robot::here(name, monitor)], tell).map(drop)
}

/// The same for several robots.
pub(super) fn serve_all(address: SocketAddr, robots: Vec<Robot>, tell: TellArgs) -> Result<Server, Failure> {
    let token = std::env::var(TOKEN).ok().filter(|token| !token.is_empty());
    let config = ServerConfig { address, token, tell: Arc::new(move |text| tell.say(text)) };
    let server = Server::start(config, robots).map_err(|error| {
        Failure::Start(anyhow::Error::new(error).context(format!("{address}: the live page cannot be served")))
    })?;
    let url = server.url();
    tell.say(&format!("live page: {url}"));
    if !server.address().ip().is_loopback() && !tell.is_quiet() && std::io::stderr().is_terminal() {
        say(&code(&url));
    }
    Ok(server)
}

/// The link for a phone's camera; nothing if it is too long.
fn code(url: &str) -> String {
    let code = QrCode::new(url).map(|code| code.render::<Dense1x2>().quiet_zone(true).build());
    code.map_or_else(|_| String::new(), |code| format!("\n{code}"))
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_link_fits_a_terminal() {
        let code = super::code("http://192.168.123.234:7340/#0123456789abcdef0123456789abcdef");
        let widest = code.lines().map(|line| line.chars().count()).max().unwrap();
        assert!((25..80).contains(&widest), "{code}");
    }
}
