//! Sentences on what a reader leaves out.

use std::collections::BTreeSet;

/// So many names are said, and so many characters of each; a file may hold any number.
const NAMES: usize = 10;
const CHARACTERS: usize = 40;

/// Names what a reader does not know; `None` where there is nothing.
pub(super) fn unknown(keys: &BTreeSet<String>) -> Option<String> {
    let shown: Vec<String> = keys.iter().take(NAMES).map(|key| key.escape_debug().take(CHARACTERS).collect()).collect();
    let more = keys.len().saturating_sub(NAMES);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!shown.is_empty()).then(|| format!("not known here and left out: {}{more}", shown.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_said_within_limits() {
        let keys = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        assert_eq!(unknown(&keys(&[])), None);
        assert_eq!(unknown(&keys(&["b", "a\n"])).unwrap(), "not known here and left out: a\\n, b");
        let many: BTreeSet<String> = (0..10_000).map(|n| format!("{n}{}", "x".repeat(1000))).collect();
        let note = unknown(&many).unwrap();
        assert!(note.ends_with("and 9990 more") && note.len() < 600, "{note}");
    }
}
