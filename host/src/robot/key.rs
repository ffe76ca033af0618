//! Files with the key of a robot: 64 hexadecimal digits and the end of the line, for the eyes of their owner alone.

use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::path::Path;

use lrfslam_robot::wire::key::{KEY_BYTES, Key};
use lrfslam_robot::wire::lock::NONCE_BYTES;

/// Longer files are not read: bytes.
const LONGEST: u64 = 1000;

/// Why there is no key.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum KeyFileError {
    /// It cannot be read, or made.
    #[error(transparent)]
    File(#[from] io::Error),
    /// Others of this computer can read it.
    #[error("others can read this key: chmod 600 it, or make another by `lrfslam key`")]
    Open,
    /// It holds something else.
    #[error("this is no key: 64 hexadecimal digits, as `lrfslam key` makes them")]
    NoKey,
    /// The system has no random numbers.
    #[error("no random numbers: {0}")]
    NoEntropy(getrandom::Error),
}

/// The key in the file `path`.
///
/// # Errors
/// If it cannot be read, others can read it, or it holds no key.
pub fn read_key_file(path: &Path) -> Result<Key, KeyFileError> {
    let about = fs::metadata(path)?;
    if is_open_to_others(&about) {
        return Err(KeyFileError::Open);
    }
    if !about.is_file() || about.len() > LONGEST {
        return Err(KeyFileError::NoKey);
    }
    let text = String::from_utf8(fs::read(path)?).map_err(|_| KeyFileError::NoKey)?;
    Key::from_hex(text.trim()).ok_or(KeyFileError::NoKey)
}

/// Makes a new key in the new file `path`, which only its owner can read.
///
/// # Errors
/// If there is one already, or it cannot be written.
pub fn new_key_file(path: &Path) -> Result<(), KeyFileError> {
    let mut bytes = [0; KEY_BYTES];
    getrandom::fill(&mut bytes).map_err(KeyFileError::NoEntropy)?;
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    let mut file = new_for_owner(path)?;
    writeln!(file, "{digits}")?;
    Ok(file.sync_all()?)
}

/// A number that was never there before: what the nonces of a conversation are made of.
///
/// # Errors
/// If the system has no random numbers.
pub fn entropy() -> Result<[u8; NONCE_BYTES], KeyFileError> {
    let mut bytes = [0; NONCE_BYTES];
    getrandom::fill(&mut bytes).map_err(KeyFileError::NoEntropy)?;
    Ok(bytes)
}

#[cfg(unix)]
fn is_open_to_others(about: &fs::Metadata) -> bool {
    use std::os::unix::fs::PermissionsExt as _;
    about.is_file() && about.permissions().mode() & 0o077 != 0
}

#[cfg(not(unix))]
fn is_open_to_others(_: &fs::Metadata) -> bool {
    false
}

fn new_for_owner(path: &Path) -> io::Result<fs::File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(path)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    fn set_mode(path: &Path, mode: u32) {
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    }

    #[test]
    fn a_new_key_is_its_owners_and_another_each_time() {
        let folder = tempfile::tempdir().unwrap();
        let [first, second] = ["a.key", "b.key"].map(|name| folder.path().join(name));
        for path in [&first, &second] {
            new_key_file(path).unwrap();
            assert_eq!(fs::metadata(path).unwrap().permissions().mode() & 0o777, 0o600);
            read_key_file(path).unwrap();
        }
        let text = fs::read_to_string(&first).unwrap();
        assert!(text.len() == 65 && text.ends_with('\n') && text != fs::read_to_string(&second).unwrap(), "{text}");
        let again = new_key_file(&first);
        assert!(matches!(&again, Err(KeyFileError::File(why)) if why.kind() == io::ErrorKind::AlreadyExists));
        assert_eq!(fs::read_to_string(&first).unwrap(), text);
    }

    #[test]
    fn what_is_no_key_or_no_secret_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.key");
        assert!(matches!(read_key_file(&path), Err(KeyFileError::File(_))));
        assert!(matches!(read_key_file(folder.path()), Err(KeyFileError::NoKey)));
        let digits = "5a".repeat(KEY_BYTES);
        let long = digits.repeat(99);
        for text in ["", "robot", &digits[1..], &format!("{digits}00"), &digits.replace('a', "g"), &long] {
            fs::write(&path, text).unwrap();
            set_mode(&path, 0o600);
            assert!(matches!(read_key_file(&path), Err(KeyFileError::NoKey)), "{text}");
        }
        fs::write(&path, [0xff; 64]).unwrap();
        assert!(matches!(read_key_file(&path), Err(KeyFileError::NoKey)));
        fs::write(&path, format!(" {digits}\r\n")).unwrap();
        for (mode, is_secret) in [(0o600, true), (0o400, true), (0o640, false), (0o604, false), (0o620, false)] {
            set_mode(&path, mode);
            assert_eq!(read_key_file(&path).is_ok(), is_secret, "{mode:o}");
        }
    }
}
