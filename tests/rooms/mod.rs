//! The rooms as the documentation lists them, compared with the folders and with what cargo knows of the crates.

mod kernels;
mod pages;

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
    process::Command,
};

use serde_json::Value;

/// A crate's folder below the workspace's, and the crates of the workspace that it depends on.
struct Room {
    folder: String,
    needs: BTreeSet<String>,
}

fn stdout(command: &mut Command) -> String {
    let output = command.current_dir(erfgs_recordings::root()).output().expect("it runs");
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// The crates of the workspace by name; what tests alone depend on is left out.
fn rooms() -> BTreeMap<String, Room> {
    let mut cargo = Command::new(env!("CARGO"));
    let output = stdout(cargo.args(["metadata", "--no-deps", "--locked", "--offline", "--format-version", "1"]));
    let metadata: Value = serde_json::from_str(&output).expect("JSON");
    let text = |value: &Value| value.as_str().expect("a string").to_owned();
    let root = text(&metadata["workspace_root"]);
    let packages = metadata["packages"].as_array().expect("packages");
    let room = |package: &Value| {
        let manifest = text(&package["manifest_path"]);
        let folder = Path::new(&manifest).parent().and_then(|folder| folder.strip_prefix(&root).ok());
        let needs = package["dependencies"].as_array().expect("dependencies").iter();
        let needs = needs.filter(|needed| needed["kind"].is_null() && needed["path"].is_string());
        let folder = folder.expect("below the workspace").display().to_string();
        // The application lies in the workspace's own folder, and its code in `src`.
        let folder = if folder.is_empty() { "src".to_owned() } else { folder };
        (text(&package["name"]), Room { folder, needs: needs.map(|needed| text(&needed["name"])).collect() })
    };
    packages.iter().map(room).collect()
}

/// What stands in backticks in a cell of a table.
fn quoted(cell: &str) -> Vec<String> {
    cell.split('`').skip(1).step_by(2).map(|text| text.trim_end_matches('/').to_owned()).collect()
}

/// The rows of the tables below a heading of a document, as their cells.
fn rows(document: &str, heading: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(erfgs_recordings::root().join(document)).expect(document);
    let section = text.split_once(&format!("\n## {heading}\n")).unwrap_or_else(|| panic!("{document}: no {heading}")).1;
    let section = section.split("\n## ").next().unwrap_or_default();
    let lines = section.lines().filter(|line| line.starts_with('|')).skip(2);
    lines.map(|line| line.trim_matches('|').split('|').map(str::to_owned).collect()).collect()
}

#[test]
fn each_folder_is_in_the_file_map_and_each_crate_is_in_its_folder() {
    let rooms = rooms();
    let mut mapped = BTreeSet::new();
    let mut crates = BTreeSet::new();
    for row in rows("docs/ARCHITECTURE.md", "Rooms") {
        let folders = quoted(&row[0]);
        for name in quoted(&row[1]) {
            assert_eq!(rooms.get(&name).map(|room| &room.folder), folders.first(), "{name}");
            crates.insert(name);
        }
        mapped.extend(folders);
    }
    assert_eq!(crates, rooms.keys().cloned().collect());
    let files = stdout(Command::new("git").arg("ls-files"));
    let folders = files.lines().filter_map(|file| file.split_once('/')).map(|(folder, _)| folder.to_owned());
    let folders: BTreeSet<String> = folders.filter(|folder| !folder.starts_with('.')).collect();
    let unmapped: Vec<&String> = folders.difference(&mapped).collect();
    assert!(unmapped.is_empty(), "not in the file map of docs/ARCHITECTURE.md: {unmapped:?}");
    for path in &mapped {
        assert!(erfgs_recordings::root().join(path).exists(), "there is no {path}");
    }
}

#[test]
fn arrows_go_down_only() {
    let rooms = rooms();
    let order: Vec<String> = rows("CONTRIBUTING.md", "Which room").iter().flat_map(|row| quoted(&row[0])).collect();
    let place = |name: &str| {
        let folder = &rooms[name].folder;
        let here = order.iter().position(|listed| listed == folder);
        here.unwrap_or_else(|| panic!("{folder} is not in the list of rooms in CONTRIBUTING.md"))
    };
    for (name, room) in &rooms {
        for needed in &room.needs {
            assert!(place(needed) < place(name), "{name} depends on {needed}, which comes after it in CONTRIBUTING.md");
        }
    }
}

/// What `docs/ARCHITECTURE.md` says below its table.
#[test]
fn the_lowest_rooms_and_the_stages_know_what_is_said_and_no_more() {
    let rooms = rooms();
    let needs = |name: &str| -> Vec<&str> {
        rooms[name].needs.iter().map(|needed| needed.trim_start_matches("erfgs-")).collect()
    };
    for (name, most) in [
        ("erfgs-base", &[] as &[&str]),
        ("erfgs-page", &[]),
        ("erfgs-events", &["base"]),
        ("erfgs-scene", &["base"]),
        ("erfgs-splat", &["base", "scene"]),
        ("erfgs-session", &["base", "events", "scene"]),
        ("erfgs-rig", &["base", "events", "scene", "session"]),
        ("erfgs-sync", &["base", "events", "page", "scene", "session"]),
    ] {
        let needs = needs(name);
        assert!(needs.iter().all(|needed| most.contains(needed)), "{name}: {needs:?}");
    }
    let stages = ["replay", "calibrate", "train"];
    for stage in stages {
        let needs = needs(&format!("erfgs-{stage}"));
        assert!(!needs.iter().any(|needed| stages.contains(needed) || *needed == "rig"), "{stage}: {needs:?}");
    }
    for (name, room) in &rooms {
        let is_mock = ["erfgs-hardware-mocks", "erfgs-emulated-rig"].contains(&name.as_str());
        let mocks = room.needs.contains("erfgs-hardware-mocks") && !is_mock;
        assert!(!mocks, "{name} depends on emulated hardware outside its tests");
        let stage = room.needs.contains("erfgs-stage")
            && !is_mock
            && !["erfgs-precision", "erfgs-budget", "erfgs-acts"].contains(&name.as_str());
        assert!(!stage, "{name} depends on the stage outside its tests");
    }
}

/// Where a document or a comment names a file by its path from the workspace's folder, it is there.
#[test]
fn files_that_are_named_exist() {
    let root = erfgs_recordings::root();
    let files = stdout(Command::new("git").arg("ls-files"));
    // `src/` begins paths of other programs, too.
    let top: BTreeSet<&str> = files.lines().filter_map(|file| file.split_once('/')).map(|(top, _)| top).collect();
    let named = |word: &str| {
        let plain = word.chars().all(|c| c.is_ascii_alphanumeric() || "_-./".contains(c));
        plain && word.split_once('/').is_some_and(|(folder, _)| folder != "src" && top.contains(folder))
    };
    let mut seen = 0;
    let mut missing = Vec::new();
    for file in files.lines().filter(|file| file.ends_with(".md") || file.ends_with(".rs") || file.ends_with(".wgsl")) {
        let text = fs::read_to_string(root.join(file)).expect(file);
        let lines = text.lines().filter(|line| file.ends_with(".md") || line.trim_start().starts_with("//"));
        for path in lines.flat_map(quoted).filter(|word| named(word)) {
            seen += 1;
            if !root.join(&path).exists() {
                missing.push(format!("{file}: {path}"));
            }
        }
    }
    assert!(seen > 100, "{seen} paths");
    assert!(missing.is_empty(), "there is no such file: {missing:#?}");
}

/// systemd gives the user at the machine what is tagged by 73-seat-late.rules. The interfaces of a device, by which a rule knows cameras of
/// all makers, are read in 50-udev-default.rules.
#[test]
fn rules_of_udev_are_numbered_where_their_tag_is_looked_at() {
    let mut tags = 0;
    for entry in fs::read_dir(erfgs_recordings::root().join("scripts/udev")).expect("the rules") {
        let path = entry.expect("a file").path();
        let name = path.file_name().and_then(|name| name.to_str()).expect("a name");
        let number = name.split_once('-').and_then(|(number, _)| number.parse::<u32>().ok());
        assert!(number.is_some_and(|number| (51..73).contains(&number)), "{name}");
        tags += fs::read_to_string(&path).expect(name).matches("TAG+=\"uaccess\"").count();
    }
    assert!(tags > 5, "{tags} rules");
}
