//! Tables of numbers in text files: one row a line, `#` comments, plain or gzip.

use std::path::Path;

use crate::input::text::{FieldFault, LineFault, Lines, Words};

/// Why a table cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// The file cannot be opened, or reading fails on the way.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// Name of the file, as given.
        file: String,
        /// Why.
        source: LineFault,
    },
    /// A field is missing or not what it should be.
    #[error("{file}: line {line}: {source}")]
    Field {
        /// Name of the file, as given.
        file: String,
        /// From 1.
        line: u64,
        /// Which field, what was expected, what stands there.
        source: FieldFault,
    },
    /// No row at all.
    #[error("{file}: no line of numbers in it, expected lines of `{columns}`")]
    Empty {
        /// Name of the file, as given.
        file: String,
        /// What a line should be.
        columns: &'static str,
    },
}

/// Reads every row of the table at `path` with `row`; `columns` names them for messages.
///
/// # Errors
/// The first line that is wrong, a file that cannot be read, or a table without rows.
pub fn read_table<T>(
    path: &Path,
    columns: &'static str,
    row: impl Fn(&mut Words<'_>) -> Result<T, FieldFault>,
) -> Result<Vec<T>, TableError> {
    let file = path.display().to_string();
    let read = |source| TableError::Read { file: file.clone(), source };
    let (mut lines, _) = Lines::open(path).map_err(read)?;
    let mut rows = Vec::new();
    while let Some(line) = lines.next_line().map_err(read)? {
        if line.text.is_empty() || line.text.starts_with('#') {
            continue;
        }
        let parsed = row(&mut Words::new(&line.text));
        rows.push(parsed.map_err(|source| TableError::Field { file: file.clone(), line: line.number, source })?);
    }
    if rows.is_empty() { Err(TableError::Empty { file, columns }) } else { Ok(rows) }
}
