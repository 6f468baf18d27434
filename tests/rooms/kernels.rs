//! The loops of all compute kernels, which run without wgpu's own counter in each.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// The WGSL files under a folder.
fn kernels(under: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(under).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            kernels(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "wgsl") {
            found.push(path);
        }
    }
}

/// What stands between the brackets that open at `text`'s begin, and what follows.
fn within(text: &str, open: char, close: char) -> (&str, &str) {
    let mut depth = 0;
    for (at, character) in text.char_indices() {
        depth += i32::from(character == open) - i32::from(character == close);
        if depth == 0 {
            return (&text[1..at], &text[at + 1..]);
        }
    }
    panic!("no {close} in {text}");
}

/// Whether `text` assigns to `name`.
fn assigns(text: &str, name: &str) -> bool {
    text.match_indices(name).any(|(at, _)| {
        let word = |character: Option<char>| character.is_some_and(|c| c.is_alphanumeric() || "_.".contains(c));
        let (before, after) = (text[..at].chars().next_back(), &text[at + name.len()..]);
        let then = after.trim_start();
        !word(before)
            && !word(after.chars().next())
            && (["++", "--", "+=", "-=", "*=", "/="].iter().any(|sign| then.starts_with(sign))
                || then.starts_with('=') && !then.starts_with("=="))
    })
}

#[test]
fn every_loop_of_a_kernel_counts_towards_a_bound() {
    // Steps that are not written out; the host gives none of 0: threads that are dispatched are at least one.
    const GIVEN: [&str; 4] = ["p.threads", "step.threads", "groups.x * THREADS", "groups.x * 256u"];
    let mut files = Vec::new();
    for room in ["splat", "train"] {
        kernels(&erfgs_recordings::root().join(room).join("src"), &mut files);
    }
    assert!(files.len() > 50, "{files:?}");
    let mut loops = 0;
    for file in &files {
        let text = fs::read_to_string(file).expect("a kernel");
        let code: String =
            text.lines().map(|line| line.split("//").next().unwrap_or_default().to_owned() + "\n").collect();
        let words =
            |word: &str| code.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|is| *is == word).count();
        assert_eq!([words("while"), words("loop")], [0, 0], "{}: for alone tells what a loop counts", file.display());
        assert_eq!(words("for"), code.matches("for (").count(), "{}: a loop that is not looked at", file.display());
        for (at, _) in code.match_indices("for (") {
            loops += 1;
            let (head, rest) = within(&code[at + 4..], '(', ')');
            let place = format!("{}: for ({head})", file.display());
            let parts: Vec<&str> = head.split(';').map(str::trim).collect();
            let [_, condition, step] = parts[..] else { panic!("{place}") };
            let counter = condition.split_whitespace().next().expect(&place);
            let sign = condition.split_whitespace().nth(1).expect(&place);
            let step = step.strip_prefix(counter).unwrap_or_else(|| panic!("{place}")).trim();
            let named = |by: &str| {
                let constant = |by: &str| by.chars().all(|c| c.is_ascii_uppercase() || "_ *".contains(c));
                GIVEN.contains(&by)
                    || by.strip_suffix('u').is_some_and(|digits| digits.parse::<u32>().is_ok_and(|step| step > 0))
                    || !by.is_empty() && constant(by)
            };
            let up = ["<", "<="].contains(&sign)
                && (step == "++" || step.strip_prefix("+= ").is_some_and(named) || step == format!("= 2u * {counter}"));
            let down = sign == ">" && (step == "--" || step == "/= 2u");
            assert!(up || down, "{place}");
            let (body, _) = within(rest.trim_start(), '{', '}');
            assert!(!assigns(body, counter), "{place}: {counter} is the step's alone");
        }
    }
    assert!(loops > 60, "{loops}");
}
