//! Names that come from a file, as names of files.
//!
//! Whoever wrote a recording chose the names in it. As a path, `/etc/cron.d/x` or `../../x` would lie outside of the folder that
//! is written, and two topics such as `/a/b` and `/a-b` could become one file.

use std::collections::BTreeSet;

/// The longest name of a file, in bytes, with room for an extension: file systems stop at 255.
const LONGEST: usize = 200;

/// `name` as the name of a file or folder: letters, digits, `-`, `_` and `.` stay, anything else becomes `_`; it is never
/// empty, hidden, a step upwards or longer than a file system allows.
#[must_use]
pub fn file_name(name: &str) -> String {
    let usable = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
    let mut name: String = name.chars().map(usable).collect();
    if name.is_empty() || name.starts_with('.') {
        name.insert(0, '_');
    }
    let end = (0..=name.len().min(LONGEST)).rev().find(|&end| name.is_char_boundary(end)).unwrap_or(0);
    name.truncate(end);
    name
}

/// The names of files in one folder, each given once, also where the file system does not tell capitals from small letters.
#[derive(Clone, Debug, Default)]
pub struct FileNames {
    given: BTreeSet<String>,
}

impl FileNames {
    /// [`file_name`] of `name`; with `_2`, `_3` and so on after it if that was given before.
    pub fn give(&mut self, name: &str) -> String {
        let plain = file_name(name);
        let numbered = (2u64..).map(|number| format!("{plain}_{number}"));
        let free = std::iter::once(plain.clone()).chain(numbered).find(|name| self.given.insert(name.to_lowercase()));
        free.unwrap_or(plain)
    }
}

/// Short names of paths, such as topics and files: what their parts have in common at the beginning and at the end is left out, and
/// what remains is joined by `_`. Names may still be alike where paths are.
#[must_use]
pub fn apart(paths: &[&str]) -> Vec<String> {
    let parts: Vec<Vec<&str>> =
        paths.iter().map(|path| path.split('/').filter(|part| !part.is_empty() && *part != ".").collect()).collect();
    let shortest = parts.iter().map(Vec::len).min().unwrap_or(0);
    let alike = |at: &dyn Fn(&[&str]) -> usize| {
        let first = parts.first().map(|parts| parts[at(parts)]);
        parts.iter().all(|parts| Some(parts[at(parts)]) == first)
    };
    let before = (0..shortest).take_while(|&index| alike(&|_| index)).count();
    let behind = (0..shortest - before).take_while(|&index| alike(&|parts| parts.len() - 1 - index)).count();
    let own = |parts: &Vec<&str>| match &parts[before..parts.len() - behind] {
        // One of the paths is the beginning of the others.
        [] => parts.join("_"),
        own => own.join("_"),
    };
    parts.iter().map(own).collect()
}

/// `text` without what a terminal takes for a command: control characters but line breaks and tabs are written out, as `\u{1b}`, and
/// so is what turns the direction of the text around it.
#[must_use]
pub fn printable(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        let turns = matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        if turns || c.is_control() && !matches!(c, '\n' | '\t') {
            shown.extend(c.escape_unicode());
        } else {
            shown.push(c);
        }
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_of_a_file_stays_in_its_folder() {
        let long = "ä".repeat(300);
        let evil = ["", ".", "..", "/abs/EVIL", "../../EVIL", "a/../..", "C:\\x", "a\0b", "\u{1b}[2J", "\n", &long];
        for name in evil {
            let name = file_name(name);
            let path = std::path::Path::new("out").join(&name);
            assert_eq!(path.parent(), Some(std::path::Path::new("out")), "{name:?}");
            assert!(name.len() <= LONGEST && !name.starts_with('.') && !name.contains(char::is_control), "{name:?}");
            assert_eq!(path.file_name().and_then(|own| own.to_str()), Some(name.as_str()));
        }
        assert_eq!(file_name("cam-1.x"), "cam-1.x");
        assert_eq!(file_name("../a b"), "_.._a_b");
    }

    #[test]
    fn paths_are_called_by_what_tells_them_apart() {
        for (paths, names) in [
            (&["/stereo/left/image_raw", "/stereo/right/image_raw"][..], &["left", "right"][..]),
            (&["/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw"], &["infra1", "infra2"]),
            (
                &["cam0/images/1", "cam1/images/1", "cam1/images/2"],
                &["cam0_images_1", "cam1_images_1", "cam1_images_2"],
            ),
            (&["/rig/a", "/rig/a/b", "/rig/a/c/d"], &["rig_a", "b", "c_d"]),
            (&["/x", "/x"], &["x", "x"]),
            (&["one"], &["one"]),
            (&[], &[]),
            (&["", "a"], &["", "a"]),
        ] {
            assert_eq!(apart(paths), names, "{paths:?}");
        }
    }

    #[test]
    fn two_names_never_become_one_file() {
        let mut names = FileNames::default();
        let given = ["/a/b", "/a b", "_a_b", "_A_B", "_a_b_2"].map(|name| names.give(name));
        assert_eq!(given, ["_a_b", "_a_b_2", "_a_b_3", "_A_B_4", "_a_b_2_2"]);
    }

    #[test]
    fn a_terminal_gets_no_commands_from_a_name() {
        assert_eq!(printable("a\u{1b}[31mb\r\u{7}\n\tc é"), "a\\u{1b}[31mb\\u{d}\\u{7}\n\tc é");
    }
}
