//! A robot that was found in Zenoh: what is asked of it is passed on.

use axum::body::Bytes;
use axum::http::{Method, StatusCode};
use tokio::sync::mpsc::channel;
use zenoh::{Session, Wait as _};

use crate::remote::{STATE_BYTES_MAX, WITHIN};
use crate::routes::STATUS;

/// What all keys begin with.
pub(crate) const ROOT: &str = "lrfslam";

/// See the [module](self).
#[derive(Debug, Clone)]
pub(crate) struct Member {
    session: Session,
    name: String,
}

impl Member {
    pub fn new(session: Session, name: &str) -> Self {
        Self { session, name: name.to_owned() }
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// As a page elsewhere answers the same; `None` if the robot is away, or what it says is no state.
    pub async fn ask(&self, method: Method, path: &str) -> Option<(StatusCode, Bytes)> {
        let Some(key) = key(&self.name, path).filter(|_| method == Method::GET) else {
            return Some((StatusCode::FORBIDDEN, Bytes::new()));
        };
        // One robot has one answer: what comes beside it is left out.
        let (tell, mut told) = channel(1);
        let asked = self.session.get(key).timeout(WITHIN).callback(move |reply| drop(tell.try_send(reply)));
        asked.wait().ok()?;
        let reply = told.recv().await?;
        let payload = reply.result().ok()?.payload();
        (payload.len() <= STATE_BYTES_MAX).then(|| (StatusCode::OK, Bytes::from(payload.to_bytes().into_owned())))
    }
}

/// What has in Zenoh the part of a page.
fn key(name: &str, path: &str) -> Option<String> {
    let since = path.strip_prefix("/robots/0/changes?");
    let changes = since.map(|since| format!("{ROOT}/{name}/changes?{since}"));
    changes.or_else(|| (path == STATUS).then(|| format!("{ROOT}/{name}/status")))
}
