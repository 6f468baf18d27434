//! What shells and `man` are told of the program, and what it says of its build.

use std::{collections::BTreeSet, fs, process::Command};

use crate::command_line::Folder;

fn git(arguments: &[&str]) -> String {
    let output = Command::new("git").current_dir(erfgs_recordings::root()).args(arguments).output().unwrap();
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

#[test]
fn the_version_names_the_commit_and_the_features() {
    let folder = Folder::new();
    for words in ["--version", "-V"] {
        let version = folder.succeed(words);
        let commit = &git(&["rev-parse", "HEAD"])[..12];
        let hdf5 = if cfg!(feature = "hdf5") { ", hdf5" } else { "" };
        assert_eq!(version, format!("erfgs {} ({commit}; exr, rosbag2{hdf5})\n", env!("CARGO_PKG_VERSION")));
    }
}

/// What bash offers where somebody has typed `words` and asks for the last of them.
fn offered(folder: &Folder, words: &[&str]) -> BTreeSet<String> {
    let script = r#"source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _erfgs erfgs "${@: -1}" "${@: -2:1}"; printf '%s\n' "${COMPREPLY[@]}""#;
    let output = Command::new("bash").args(["-c", script, "bash"]).arg(folder.path("erfgs.bash")).args(words).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

#[test]
fn bash_completes_commands_options_and_values_and_other_shells_have_a_script() {
    let folder = Folder::new();
    fs::write(folder.path("erfgs.bash"), folder.succeed("completions bash")).unwrap();
    let all = |words: &[&str]| offered(&folder, words).into_iter().collect::<Vec<_>>();
    assert_eq!(all(&["erfgs", "tra"]), ["train"]);
    assert_eq!(all(&["erfgs", "dataset", "im"]), ["import"]);
    assert_eq!(all(&["erfgs", "train", "ds", "--iter"]), ["--iterations"]);
    assert_eq!(all(&["erfgs", "completions", "z"]), ["zsh"]);
    let commands = offered(&folder, &["erfgs", ""]);
    assert!(["record", "calibrate", "man"].iter().all(|name| commands.contains(*name)), "{commands:?}");
    for (shell, part) in
        [("zsh", "#compdef erfgs"), ("fish", "complete -c erfgs"), ("elvish", "erfgs"), ("powershell", "erfgs")]
    {
        let script = folder.succeed(&format!("completions {shell}"));
        assert!(script.contains(part) && script.contains("calibrate"), "{shell}");
    }
    assert!(folder.fail(2, "completions tcsh").contains("bash"));
}

#[test]
fn each_command_has_a_manual_page_that_man_reads_without_a_warning() {
    let folder = Folder::new();
    folder.succeed("man pages/man1");
    let names: BTreeSet<String> = fs::read_dir(folder.path("pages/man1"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    for name in ["erfgs.1", "erfgs-train.1", "erfgs-dataset-import.1", "erfgs-man.1"] {
        assert!(names.contains(name), "{name} of {names:?}");
    }
    for name in &names {
        let page = folder.path(&format!("pages/man1/{name}"));
        let read = Command::new("groff")
            .args(["-man", "-Tutf8", "-ww", "-b", "-P-cbou"])
            .arg(&page)
            .output()
            .expect("groff runs");
        let (text, wrong) = (String::from_utf8_lossy(&read.stdout), String::from_utf8_lossy(&read.stderr));
        assert!(read.status.success() && wrong.is_empty(), "{name}: {wrong}");
        let title = name.trim_end_matches(".1");
        assert!(text.contains(&format!("{title}(1)")) && text.contains("SYNOPSIS"), "{name}: {text}");
    }
    let train = fs::read_to_string(folder.path("pages/man1/erfgs-train.1")).unwrap();
    assert!(train.contains("iterations") && train.contains("Examples"));
    fs::write(folder.path("file"), "").unwrap();
    assert!(folder.fail(1, "man file").contains("cannot make the folder file"));
}
