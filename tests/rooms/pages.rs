//! The documentation's pages: each is in the book, and each link arrives.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Component, Path, PathBuf},
    process::Command,
};

/// What the pages of the site are; links must not leave it, since the site has no other files.
const BOOK: &str = "docs/";

/// The lines of a page that are neither code nor a part of an example.
fn prose(text: &str) -> Vec<&str> {
    let mut fenced = false;
    let mut lines = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        } else if !fenced {
            lines.push(line);
        }
    }
    lines
}

/// A heading's anchor as forges and mdBook make it.
fn anchor(heading: &str) -> String {
    let plain = heading.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    plain.map(|c| if c == ' ' { '-' } else { c.to_ascii_lowercase() }).collect()
}

fn anchors(text: &str) -> BTreeSet<String> {
    let mut counts = BTreeMap::<String, usize>::new();
    let headings = prose(text).into_iter().filter_map(|line| {
        let title = line.trim_start_matches('#');
        (title.len() < line.len()).then(|| title.strip_prefix(' ')).flatten()
    });
    let unique = headings.map(|title| {
        let name = anchor(title.trim());
        let count = counts.entry(name.clone()).or_default();
        *count += 1;
        if *count == 1 { name } else { format!("{name}-{}", *count - 1) }
    });
    unique.collect()
}

/// The targets of the links of a page, those of other hosts left out.
fn links(text: &str) -> Vec<String> {
    let mut targets = Vec::new();
    for line in prose(text) {
        // What stands in backticks is code, and every other piece does.
        let plain = line.split('`').step_by(2).collect::<Vec<_>>().join("code");
        for piece in plain.split("](").skip(1) {
            let target = piece.split(')').next().unwrap_or_default();
            if !target.contains("://") && !target.starts_with("mailto:") {
                targets.push(target.to_owned());
            }
        }
    }
    targets
}

/// A path without `.` and `..`, or nothing where it leaves the repository.
fn within(path: &Path) -> Option<PathBuf> {
    let mut found = PathBuf::new();
    for part in path.components() {
        match part {
            Component::Normal(name) => found.push(name),
            Component::ParentDir => found.pop().then_some(())?,
            Component::CurDir => {}
            _ => return None,
        }
    }
    Some(found)
}

/// All pages of the repository, by their paths from its folder.
fn pages() -> BTreeMap<String, String> {
    let root = erfgs_recordings::root();
    let mut git = Command::new("git");
    let output = git.current_dir(&root).args(["ls-files", "*.md"]).output().expect("git runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let files = String::from_utf8(output.stdout).expect("UTF-8");
    files.lines().map(|file| (file.to_owned(), fs::read_to_string(root.join(file)).expect(file))).collect()
}

/// Why a link of a page does not arrive.
fn fault(pages: &BTreeMap<String, String>, page: &str, target: &str) -> Option<String> {
    let (path, place) = target.split_once('#').map_or((target, None), |(path, place)| (path, Some(place)));
    let folder = Path::new(page).parent().unwrap_or(Path::new(""));
    let here = if path.is_empty() { Some(page.into()) } else { within(&folder.join(path)) };
    let Some(here) = here else { return Some("leaves the repository".to_owned()) };
    let name = here.to_string_lossy().replace('\\', "/");
    if !erfgs_recordings::root().join(&here).exists() {
        return Some("no such file".to_owned());
    }
    if page.starts_with(BOOK) && !name.starts_with(BOOK) {
        return Some("leaves docs/, so that the site has no such page; name the file in backticks".to_owned());
    }
    let place = place?;
    let text = pages.get(&name);
    (!text.is_some_and(|text| anchors(text).contains(place))).then(|| "no such heading".to_owned())
}

#[test]
fn each_link_of_a_page_arrives() {
    let pages = pages();
    let links = pages.iter().flat_map(|(page, text)| links(text).into_iter().map(move |target| (page, target)));
    let links: Vec<_> = links.collect();
    let faults = links
        .iter()
        .filter_map(|(page, target)| fault(&pages, page, target).map(|fault| format!("{page}: {target}: {fault}")));
    let faults: Vec<String> = faults.collect();
    assert!(links.len() > 150, "{} links", links.len());
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn each_page_is_in_the_book_once() {
    let pages = pages();
    let mut listed = links(&pages["docs/SUMMARY.md"]);
    listed.sort();
    let book = pages.keys().filter_map(|page| page.strip_prefix(BOOK)).filter(|page| *page != "SUMMARY.md");
    assert_eq!(listed, book.collect::<Vec<_>>(), "docs/SUMMARY.md against the files in docs/");
}

#[test]
fn each_study_is_dated_decided_something_and_is_in_the_notebook() {
    let pages = pages();
    let index = &pages["lab/notebook/README.md"];
    let studies = pages.iter().filter_map(|(page, text)| Some((page.strip_prefix("lab/notebook/")?, text)));
    let studies: Vec<_> = studies.filter(|(page, _)| *page != "README.md").collect();
    assert!(studies.len() > 20, "{}", studies.len());
    for (page, text) in studies {
        let head = text.lines().nth(2).unwrap_or_default();
        assert!(head.starts_with("Date") && head.contains(": 20") && head.contains("**Decided:**"), "{page}: {head}");
        assert!(index.contains(&format!("]({page})")), "lab/notebook/README.md does not list {page}");
    }
    assert!(pages["docs/results.md"].lines().count() <= 150, "docs/results.md is for today's figures alone");
}

#[test]
fn anchors_and_links_are_read_as_forges_read_them() {
    let page = "# A b\n\n## `rig.json`, and more\n\n## A b\n\n```\n# no heading [x](absent)\n```\n`[y](absent)` [z](a.md#b) [w](https://a.b)\n";
    let expected = ["a-b", "a-b-1", "rigjson-and-more"].map(str::to_owned);
    assert_eq!(anchors(page), expected.into());
    assert_eq!(links(page), ["a.md#b"]);
    assert_eq!(within(Path::new("docs/guide/../a.md")), Some("docs/a.md".into()));
    assert_eq!(within(Path::new("docs/../../a.md")), None);
}
