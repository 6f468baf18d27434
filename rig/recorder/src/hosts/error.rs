//! What keeps another host from recording, with what to do about it.

use std::{io, path::PathBuf};

use crate::RecordError;

/// Why a link is refused. It never quotes the link's token.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// It is no link of a live page.
    #[error(
        "'{link}' is no link of a live page: {why}. Copy it as `erfgs record --live` printed it on the other host, with the token"
    )]
    Wrong {
        /// The link, up to what is secret.
        link: String,
        /// What is wrong with it.
        why: &'static str,
    },
    /// It was copied as it stands, from a recorder that listens at all its addresses.
    #[error("'{link}' has an unspecified address: replace the zeros by the host's name or address")]
    Unspecified {
        /// The link, up to what is secret.
        link: String,
    },
}

/// Why another host does not record.
#[derive(Debug, thiserror::Error)]
pub enum HostError {
    /// No connection.
    #[error(
        "host {host} cannot be reached: {source}. Start `erfgs record RIG.toml --out takes/ --wait --live ADDRESS` there, and check \
         that its address and port are reachable from here"
    )]
    Unreachable {
        /// The host.
        host: String,
        /// What the system says.
        source: io::Error,
    },
    /// It does not answer in time, or breaks off.
    #[error("host {host} does not answer: {what}. Check whether it runs, and the network")]
    Silent {
        /// The host.
        host: String,
        /// What came instead of an answer.
        what: String,
    },
    /// The token is another one.
    #[error(
        "host {host} refuses the token of its link: a recorder makes a new one at each start. Copy the link that it printed last"
    )]
    Token {
        /// The host.
        host: String,
    },
    /// Something else answers.
    #[error("the program at {host} is not a recorder of this version of erfgs: {what}")]
    Foreign {
        /// The host.
        host: String,
        /// How that shows.
        what: String,
    },
    /// It plays a recording.
    #[error("host {host} plays a recording, and has no cameras: give the link of `erfgs record`")]
    Replay {
        /// The host.
        host: String,
    },
    /// It records already.
    #[error("host {host} is already recording into '{}': stop it on its live page first", path.display())]
    Busy {
        /// The host.
        host: String,
        /// The session there.
        path: PathBuf,
    },
    /// Its disk has no room.
    #[error(
        "the disk of host {host} has too little room beyond its reserve: {room} in '{}'. Free some space there, or record to another \
         disk",
        folder.display()
    )]
    Disk {
        /// The host.
        host: String,
        /// What room there is.
        room: String,
        /// The folder of recordings there.
        folder: PathBuf,
    },
    /// It says no.
    #[error("host {host} refuses: {why}")]
    Refused {
        /// The host.
        host: String,
        /// What it says.
        why: String,
    },
    /// It took the order, and nothing follows.
    #[error("host {host} did not confirm within {seconds} s that it records: look at its terminal")]
    NotBegun {
        /// The host.
        host: String,
        /// How long it was waited for.
        seconds: u64,
    },
    /// It is named twice.
    #[error("host {host} is given twice: leave one of the links out")]
    Twice {
        /// The host.
        host: String,
    },
    /// Several of them do not.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; and "))]
    Several(Vec<HostError>),
    /// This host's system.
    #[error("cannot start to watch other hosts: {0}")]
    System(#[from] io::Error),
}

impl HostError {
    /// What kept hosts from something, if anything did.
    pub(super) fn any_of<T>(answers: Vec<Result<T, Self>>) -> Result<(), Self> {
        let mut errors: Vec<Self> = answers.into_iter().filter_map(Result::err).collect();
        match errors.len() {
            0 => Ok(()),
            1 => Err(errors.swap_remove(0)),
            _ => Err(Self::Several(errors)),
        }
    }
}

/// Why a recording of several hosts does not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// Another host does not record.
    #[error("nothing is recorded: {error}{}", stopped_again(stopped))]
    Host {
        /// Why.
        error: HostError,
        /// What other hosts had begun until then: it was stopped again.
        stopped: Vec<PathBuf>,
    },
    /// This host does not.
    #[error(transparent)]
    Own(#[from] RecordError),
}

fn stopped_again(stopped: &[PathBuf]) -> String {
    let paths: Vec<String> = stopped.iter().map(|path| format!("'{}'", path.display())).collect();
    match paths.len() {
        0 => String::new(),
        _ => format!(". What other hosts had begun was stopped again, and can be deleted there: {}", paths.join(", ")),
    }
}
