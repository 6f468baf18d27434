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
        if is_here(&take.address) && take.path.exists() {
            sessions.push(word(&take.path));
            continue;
        }
        // The near end of a tunnel does not tell what lies behind it.
        let host = if is_here(&take.address) { "HOST" } else { &take.address };
        // The shell of the other host lists the files of a session in several.
        let path = if take.files() > 1 { take.path.with_extension("*mcap") } else { take.path.clone() };
        let from = format!("{host}:{}", path.display());
        commands.push(format!("scp {} {}", word(Path::new(&from)), word(folder)));
        sessions.push(word(&own.with_file_name(take.path.file_name().unwrap_or_default())));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hosts::HostEnd;

    fn take(address: &str, path: &str) -> HostTake {
        let end = HostEnd::Unknown { why: String::new(), seconds: 1.0, bytes: 1 };
        HostTake { host: format!("{address}:8100"), address: address.into(), path: path.into(), end }
    }

    #[test]
    fn sessions_of_other_hosts_are_fetched_first() {
        let takes = [take("right", "/data/t-right.mcap"), take("[fe80::2]", "/da ta/it's.mcap")];
        let commands = merge_commands(Path::new("takes/t.mcap"), &takes);
        let merge = r"erfgs merge takes/t.mcap takes/t-right.mcap 'takes/it'\''s.mcap' --out takes/t-merged.mcap";
        assert_eq!(
            commands,
            ["scp right:/data/t-right.mcap takes", r"scp '[fe80::2]:/da ta/it'\''s.mcap' takes", merge]
        );
    }

    #[test]
    fn all_files_of_a_session_in_several_are_fetched() {
        let summary = crate::Summary {
            path: "/data/t-right.mcap".into(),
            seconds: 1.0,
            bytes: 1,
            files: 3,
            reason: String::new(),
            failure: None,
            streams: Vec::new(),
        };
        let take = HostTake { end: HostEnd::Stopped(Box::new(summary)), ..take("right", "/data/t-right.mcap") };
        let commands = merge_commands(Path::new("t.mcap"), &[take]);
        assert_eq!(commands[0], "scp 'right:/data/t-right.*mcap' .");
        assert_eq!(commands[1], "erfgs merge t.mcap t-right.mcap --out t-merged.mcap");
    }

    #[test]
    fn what_lies_here_is_merged_where_it_lies_and_what_lies_behind_a_tunnel_is_fetched() {
        let here = tempfile::NamedTempFile::new().unwrap();
        let path = here.path().to_str().unwrap();
        let commands =
            merge_commands(Path::new("t.mcap"), &[take("127.0.0.1", path), take("localhost", "/no/where.mcap")]);
        let merge = format!("erfgs merge t.mcap {path} where.mcap --out t-merged.mcap");
        assert_eq!(commands, ["scp HOST:/no/where.mcap .".to_owned(), merge]);
    }
}
