//! Text that others made, for a terminal: a laser, a robot or a file may say anything.

use std::borrow::Cow;

/// `text` with all that is not to be seen escaped: a control character could colour, move or answer for the user.
pub fn printable(text: &str) -> Cow<'_, str> {
    let is_odd = |letter: char| {
        letter.is_control()
            || matches!(letter, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}')
    };
    if !text.contains(is_odd) {
        return Cow::Borrowed(text);
    }
    let escaped = |letter: char| {
        if is_odd(letter) { letter.escape_unicode().to_string() } else { letter.to_string() }
    };
    Cow::Owned(text.chars().map(escaped).collect())
}

/// The same for text of several lines of our own: ends of lines stay.
pub fn printable_lines(text: &str) -> Cow<'_, str> {
    if text.lines().all(|line| matches!(printable(line), Cow::Borrowed(_))) {
        return Cow::Borrowed(text);
    }
    let lines = text.split_inclusive('\n').map(|line| match line.strip_suffix('\n') {
        Some(line) => format!("{}\n", printable(line)),
        None => printable(line).into_owned(),
    });
    Cow::Owned(lines.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moves_the_cursor_is_shown_instead() {
        assert_eq!(printable("URG-04LX, 30°, Büro"), "URG-04LX, 30°, Büro");
        assert_eq!(printable("a\u{1b}[2Jb\r\nc\u{202e}d"), "a\\u{1b}[2Jb\\u{d}\\u{a}c\\u{202e}d");
        assert_eq!(printable_lines("a\nb\u{7}\nc"), "a\nb\\u{7}\nc");
    }
}
