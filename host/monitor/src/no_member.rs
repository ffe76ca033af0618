//! A robot that was found in Zenoh, of a build without it: there is none.

use axum::body::Bytes;
use axum::http::{Method, StatusCode};

/// There is none.
#[derive(Debug, Clone)]
pub(crate) enum Member {}

impl Member {
    pub fn name(&self) -> &str {
        match *self {}
    }

    pub async fn ask(&self, _: Method, _: &str) -> Option<(StatusCode, Bytes)> {
        match *self {}
    }
}
