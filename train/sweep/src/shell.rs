//! Words for a shell, and lines for Slurm: the one place where text of a plan becomes text of a script.

use super::SweepError;

/// A word that a shell takes for what it is, whatever it holds.
#[must_use]
pub fn quoted(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./+=:%".contains(c);
    let is_plain = !text.is_empty() && text.chars().all(plain);
    if is_plain { text.to_owned() } else { format!("'{}'", text.replace('\'', r"'\''")) }
}

/// A command line of these words.
#[must_use]
pub fn line(words: &[String]) -> String {
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

/// What can stand in one line of a script: Slurm reads its options from comments, which no quotes can hold together.
///
/// # Errors
/// [`SweepError::Line`] if it has a line break or another control character.
pub(super) fn one_line<'a>(what: &'static str, text: &'a str) -> Result<&'a str, SweepError> {
    match text.contains(char::is_control) {
        true => Err(SweepError::Line { what, text: text.to_owned() }),
        false => Ok(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_gives_every_word_back() {
        for word in ["", "a", "a b", "it's", "$(rm -r x)", "`x`", "a\nrm -r x", "\\", "\"", "-n", "é*?", "'", "''\\'"]
        {
            let script = format!("printf '%s|' {}", quoted(word));
            let output = std::process::Command::new("sh").args(["-c", &script]).output().unwrap();
            assert_eq!(String::from_utf8_lossy(&output.stdout), format!("{word}|"));
        }
    }

    #[test]
    fn a_line_is_one() {
        assert!(one_line("x", "a b").is_ok());
        for text in ["a\nb", "a\rb", "a\0", "\u{1b}[2J"] {
            assert!(matches!(one_line("x", text), Err(SweepError::Line { .. })), "{text:?}");
        }
    }
}
