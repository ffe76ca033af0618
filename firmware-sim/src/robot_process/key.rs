//! The robot's key, from a file for the eyes of its owner alone.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use anyhow::{Context as _, Result, anyhow, ensure};
use lrfslam_robot::wire::key::Key;
use lrfslam_robot::wire::lock::NONCE_BYTES;

/// Longer files are not read: bytes.
const LONGEST: u64 = 1000;

/// The key in the file `path`, as `lrfslam key` makes it: 64 hexadecimal digits.
///
/// # Errors
/// If it cannot be read, others can read it, or it holds no key.
pub fn read_key_file(path: &Path) -> Result<Key> {
    let named = || path.display().to_string();
    let about = fs::metadata(path).with_context(named)?;
    let is_secret = !about.is_file() || about.permissions().mode() & 0o077 == 0;
    ensure!(is_secret, "{}: others can read this key: chmod 600 it, or make another by `lrfslam key`", named());
    let text = if about.is_file() && about.len() <= LONGEST { fs::read(path).with_context(named)? } else { Vec::new() };
    let key = String::from_utf8(text).ok().and_then(|text| Key::from_hex(text.trim()));
    key.ok_or_else(|| anyhow!("{}: this is no key: 64 hexadecimal digits, as `lrfslam key` makes them", named()))
}

/// A number that was never there before: what the nonces of a conversation are made of.
pub(super) fn entropy() -> Result<[u8; NONCE_BYTES]> {
    let mut bytes = [0; NONCE_BYTES];
    getrandom::fill(&mut bytes).map_err(|error| anyhow!("no random numbers: {error}"))?;
    Ok(bytes)
}
