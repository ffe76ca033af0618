//! Numbers of things, in words.

/// "1 scan", "2 scans"; `thing` is a noun whose plural ends in s.
pub fn count(number: u64, thing: &str) -> String {
    format!("{number} {thing}{}", if number == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_no_plural() {
        assert_eq!([0, 1, 2].map(|number| count(number, "scan")), ["0 scans", "1 scan", "2 scans"]);
    }
}
