//! A robot that another program maps for: what is asked of it is passed on, with its own token, or by Zenoh.

use std::io;
use std::time::Duration;

use axum::body::{Body, Bytes, to_bytes};
use axum::http::{Method, Request, StatusCode, header};
use hyper_util::rt::TokioIo;
use tokio::net::TcpStream;

use crate::member::Member;
use crate::routes::STATUS;

/// A state has at most so many bytes.
pub(crate) const STATE_BYTES_MAX: usize = 64 << 20;
/// A robot answers within this, or is away.
pub(crate) const WITHIN: Duration = Duration::from_secs(10);

/// A run elsewhere: by its page, or in Zenoh.
#[derive(Debug, Clone)]
pub struct Remote(Way);

#[derive(Debug, Clone)]
enum Way {
    Page(Page),
    #[cfg_attr(not(feature = "zenoh"), allow(dead_code, reason = "there is none in this build"))]
    Zenoh(Member),
}

/// The page of a run.
#[derive(Debug, Clone)]
struct Page {
    /// Name or address, and port.
    host: String,
    token: String,
}

impl Remote {
    /// By the link that the other program prints: `http://HOST:PORT/#TOKEN`.
    ///
    /// # Errors
    /// What was expected.
    pub fn parse(link: &str) -> Result<Self, String> {
        let (place, token) = link.split_once('#').unwrap_or((link, ""));
        let host = place.strip_prefix("http://").unwrap_or(place).trim_end_matches('/');
        let has_port =
            host.rsplit_once(':').is_some_and(|(name, port)| !name.is_empty() && port.parse::<u16>().is_ok());
        let is_clean = |text: &str| text.chars().all(|c| c.is_ascii_graphic() && !"/?#@\"".contains(c));
        if !has_port || !is_clean(host) || !is_clean(token) {
            return Err("expected a link as --monitor prints it, such as http://192.168.0.7:7340/#TOKEN".to_owned());
        }
        Ok(Self(Way::Page(Page { host: host.to_owned(), token: token.to_owned() })))
    }

    /// One that was found in Zenoh.
    #[cfg(feature = "zenoh")]
    pub(crate) fn member(member: Member) -> Self {
        Self(Way::Zenoh(member))
    }

    /// Name or address, and port; the name of a robot in Zenoh.
    pub fn host(&self) -> &str {
        match &self.0 {
            Way::Page(page) => &page.host,
            Way::Zenoh(member) => member.name(),
        }
    }

    /// How things stand there: JSON of [`Status`](lrfslam_host::monitor::Status), at most a second old. Waits up to ten seconds for it.
    ///
    /// # Errors
    /// If nobody answers, or the token is wrong.
    pub fn status(&self) -> io::Result<serde_json::Value> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
        match runtime.block_on(self.ask(Method::GET, STATUS)) {
            Some((StatusCode::OK, status)) => serde_json::from_slice(&status).map_err(io::Error::other),
            Some((StatusCode::UNAUTHORIZED, _)) => Err(io::Error::other("the link's token is wrong")),
            Some((status, _)) => Err(io::Error::other(format!("no page of lrfslam: {status}"))),
            None => Err(io::Error::other("nobody answers")),
        }
    }

    /// Passes on what is asked; `None` if nobody answers.
    pub(crate) async fn ask(&self, method: Method, path: &str) -> Option<(StatusCode, Bytes)> {
        match &self.0 {
            Way::Page(page) => tokio::time::timeout(WITHIN, page.fetch(method, path)).await.ok()?.ok(),
            Way::Zenoh(member) => member.ask(method, path).await,
        }
    }
}

impl Page {
    async fn fetch(&self, method: Method, path: &str) -> io::Result<(StatusCode, Bytes)> {
        let stream = TcpStream::connect(&self.host).await?;
        let handshake = hyper::client::conn::http1::handshake(TokioIo::new(stream)).await;
        let (mut sender, connection) = handshake.map_err(io::Error::other)?;
        tokio::spawn(connection);
        let request = Request::builder()
            .method(method)
            .uri(path)
            .header(header::HOST, &self.host)
            .header(header::AUTHORIZATION, format!("Bearer {}", self.token))
            .body(Body::empty())
            .map_err(io::Error::other)?;
        let answer = sender.send_request(request).await.map_err(io::Error::other)?;
        let status = answer.status();
        let body = to_bytes(Body::new(answer.into_body()), STATE_BYTES_MAX).await.map_err(io::Error::other)?;
        Ok((status, body))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_taken_apart() {
        let link = Remote::parse("http://192.168.0.7:7340/#abc").unwrap();
        assert!(matches!(&link.0, Way::Page(page) if page.host == "192.168.0.7:7340" && page.token == "abc"));
        assert_eq!(Remote::parse("[::1]:7340").unwrap().host(), "[::1]:7340");
        for wrong in ["", "http://robot/", "robot:port", "http://a b:1/", "robot:1/#a\r\nb", "ftp://robot:1"] {
            assert!(Remote::parse(wrong).is_err(), "{wrong}");
        }
    }
}
