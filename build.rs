//! What `erfgs --version` says: the version, the commit that it was built from, and the features.

use std::{env, fs, path::Path, process::Command};

/// So many digits of a commit tell it from all others.
const DIGITS: usize = 12;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=ERFGS_COMMIT");
    let version = env::var("CARGO_PKG_VERSION").unwrap_or_default();
    let commit =
        from_environment().or_else(of_checkout).or_else(of_package).unwrap_or_else(|| "commit not known".into());
    let mut features = vec!["exr", "rosbag2"];
    if env::var_os("CARGO_FEATURE_HDF5").is_some() {
        features.push("hdf5");
    }
    println!("cargo:rustc-env=ERFGS_VERSION={version} ({commit}; {})", features.join(", "));
}

/// The commit that whoever builds names, who has the files alone.
fn from_environment() -> Option<String> {
    env::var("ERFGS_COMMIT").ok().filter(|commit| is_commit(commit)).map(shortened)
}

/// The commit of the checkout, if this is one; looked at again when another is checked out.
fn of_checkout() -> Option<String> {
    let commit = git(&["rev-parse", "HEAD"]).filter(|commit| is_commit(commit))?;
    let branch = git(&["symbolic-ref", "--quiet", "HEAD"]);
    for file in ["HEAD", "logs/HEAD", "packed-refs"].into_iter().chain(branch.as_deref()) {
        // A file that is not there would have cargo build anew each time.
        if let Some(path) = git(&["rev-parse", "--git-path", file]).filter(|path| Path::new(path).exists()) {
            println!("cargo:rerun-if-changed={path}");
        }
    }
    Some(shortened(commit))
}

/// The commit that cargo notes in a package.
fn of_package() -> Option<String> {
    let noted = fs::read_to_string(".cargo_vcs_info.json").ok()?;
    let commit = noted.split_once("\"sha1\"")?.1.split('"').nth(1)?.to_owned();
    is_commit(&commit).then(|| shortened(commit))
}

/// What git says here; nothing in a folder that is not the checkout's own, as where a package is unpacked within another one.
fn git(arguments: &[&str]) -> Option<String> {
    let run = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
    };
    let top = run(&["rev-parse", "--show-toplevel"])?;
    let here = env::current_dir().ok()?;
    (Path::new(&top).canonicalize().ok()? == here.canonicalize().ok()?).then(|| run(arguments))?
}

fn is_commit(text: &str) -> bool {
    text.len() >= DIGITS && text.chars().all(|digit| digit.is_ascii_hexdigit())
}

fn shortened(mut commit: String) -> String {
    commit.truncate(DIGITS);
    commit
}
