//! The commands that make one session of what several hosts recorded.

use std::{net::IpAddr, path::Path};

use super::host::HostTake;

/// A command a line: those that fetch the sessions of the others, and the one that merges. `own` is this host's session.
#[must_use]
pub fn merge_commands(own: &Path, takes: &[HostTake]) -> Vec<String> {
    let folder = own.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut commands = Vec::new();
    let mut sessions = vec![word(own)];
    for take in takes {
        if is_here(&take.address) {
            sessions.push(word(&take.path));
            continue;
        }
        let from = format!("{}:{}", take.address, take.path.display());
        commands.push(format!("scp {} {}", word(Path::new(&from)), word(folder)));
        sessions.push(word(&folder.join(take.path.file_name().unwrap_or_default())));
    }
    let stem = own.file_stem().unwrap_or_default().to_string_lossy();
    let out = own.with_file_name(format!("{stem}-merged.mcap"));
    commands.push(format!("erfgs merge {} --out {}", sessions.join(" "), word(&out)));
    commands
}

/// Whether a host is this one, whose files need not be fetched.
fn is_here(host: &str) -> bool {
    host == "localhost" || host.trim_matches(['[', ']']).parse::<IpAddr>().is_ok_and(|at| at.is_loopback())
}

/// A path as one word of a shell.
fn word(path: &Path) -> String {
    let path = path.display().to_string();
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+:@%,=[]".contains(c);
    if !path.is_empty() && path.chars().all(plain) { path } else { format!("'{}'", path.replace('\'', r"'\''")) }
}
