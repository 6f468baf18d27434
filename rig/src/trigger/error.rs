use erfgs_session::trigger::protocol::{Refusal, VERSION};

/// What can go wrong with a trigger board.
#[derive(Debug, thiserror::Error)]
pub enum TriggerError {
    /// A field of the configuration is out of range.
    #[error("the configuration of trigger board {id:?}: {problem}")]
    Config {
        /// The board's name in the rig.
        id: String,
        /// What is wrong, and what would be right.
        problem: String,
    },
    /// No serial port has a trigger board.
    #[error(
        "no trigger board found; ports tried: {tried}. Plug the board in, flash it (docs/reference/trigger-board.md), or name its \
         port in the configuration"
    )]
    NotFound {
        /// The ports tried, with what became of each.
        tried: String,
    },
    /// Several ports have one, and the configuration names none.
    #[error("several trigger boards, at {ports}; name the port of one in the configuration")]
    Ambiguous {
        /// Where.
        ports: String,
    },
    /// The port cannot be opened.
    #[error(
        "cannot open serial port {port}: {source}. Is it plugged in, and are you in the group that may use it (dialout)?"
    )]
    Open {
        /// The port.
        port: String,
        /// Why.
        source: serialport::Error,
    },
    /// Reading or writing failed: the board was unplugged, as a rule.
    #[error("the serial port {port} of the trigger board fails: {source}. Check its cable")]
    Port {
        /// The port.
        port: String,
        /// Why.
        source: std::io::Error,
    },
    /// What is at the port does not answer as a trigger board does.
    #[error("the device at {port} does not answer {command:?}; flash the board with the firmware in rig/firmware")]
    Silent {
        /// The port.
        port: String,
        /// What was asked.
        command: String,
    },
    /// The board speaks another version of the protocol.
    #[error(
        "the trigger board at {port} speaks version {version} of the protocol, this program version {VERSION}; flash the board"
    )]
    Version {
        /// The port.
        port: String,
        /// Its version.
        version: u32,
    },
    /// The board refused a command.
    #[error("the trigger board at {port} refuses {command:?}: {error}")]
    Refused {
        /// The port.
        port: String,
        /// What was asked.
        command: String,
        /// Why.
        error: Refusal,
    },
    /// The board answered with other values than were set.
    #[error("the trigger board at {port} answers {answer} to {command:?}; flash the board")]
    Answer {
        /// The port.
        port: String,
        /// What was asked.
        command: String,
        /// What it said.
        answer: String,
    },
}
