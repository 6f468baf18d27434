//! The lines of the trigger board (`rig/firmware/PROTOCOL.md`): commands to bytes, bytes to messages, no input or output.

mod lines;

use std::fmt;

pub use lines::Reader;

/// The protocol's version that this module speaks.
pub const VERSION: u32 = 1;
/// The name by which a board knows itself.
pub const NAME: &str = "erfgs-trigger";
/// Speed of the serial line, baud.
pub const BAUD: u32 = 500_000;
/// Ticks a second.
pub const TICK_HZ: u32 = 16_000_000;
/// The longest line with its ending, bytes.
pub const LINE_MAX: usize = 96;
/// The shortest and longest period, ticks.
pub const PERIOD_TICKS: std::ops::RangeInclusive<u32> = 16_000..=0x1000_0000;
/// The shortest exposure, ticks.
pub const EXPOSURE_MIN_TICKS: u32 = 320;
/// What must remain of a period after the exposure, ticks.
pub const EXPOSURE_GUARD_TICKS: u32 = 800;

/// CRC-16/XMODEM: polynomial 0x1021, initial value 0.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0, |crc, &byte| {
        (0..8)
            .fold(crc ^ (u16::from(byte) << 8), |crc, _| if crc & 0x8000 == 0 { crc << 1 } else { (crc << 1) ^ 0x1021 })
    })
}

/// What a board says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The board's name: [`NAME`].
    pub name: String,
    /// Version of its protocol: [`VERSION`].
    pub version: u32,
    /// Version of its firmware.
    pub firmware: u32,
    /// Ticks a second: [`TICK_HZ`].
    pub tick_hz: u32,
    /// Frame outputs.
    pub outputs: u32,
}

/// A pulse that has begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pulse {
    /// Counts the pulses from `start` on, from 0.
    pub index: u32,
    /// The rising edge on every output, ticks since the board's reset.
    pub tick: u64,
    /// Width of the frame triggers, ticks.
    pub width: u32,
}

/// The board's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// Whether pulses are given.
    pub running: bool,
    /// From one rising edge to the next, ticks.
    pub period: u32,
    /// Width of the frame triggers, ticks.
    pub exposure: u32,
    /// Frame outputs in use; bit 0 is output 1.
    pub outputs: u32,
    /// Pulses since `start`.
    pub count: u32,
    /// Ticks since the reset.
    pub tick: u64,
    /// Lines of pulses that the board dropped because the serial line was full.
    pub lost_lines: u32,
    /// Edges that came later than they were due.
    pub late_edges: u32,
    /// Lines that reached the board damaged.
    pub bad_lines: u32,
}

/// Why the board refused a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The line had no checksum or a wrong one.
    #[error("the line reached the board damaged")]
    Damaged,
    /// The board's firmware does not know the command.
    #[error("the board does not know the command; flash the firmware that belongs to this version")]
    Unknown,
    /// An argument is missing or is none.
    #[error("the board does not understand the arguments")]
    Arguments,
    /// A number is out of range, or period and exposure do not fit each other.
    #[error("out of range: a period is 1 ms to 16.7 s, an exposure 20 µs to the period less 50 µs")]
    Range,
    /// Not while pulses are given.
    #[error("the board gives pulses already; stop it first")]
    Running,
    /// The line was too long.
    #[error("the line is too long for the board")]
    TooLong,
    /// An error that this version does not know.
    #[error("error {0}, which this version does not know")]
    Other(u32),
}

/// An answer to a command that was done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// Who the board is.
    Identify(Identity),
    /// The period, ticks.
    Period(u32),
    /// The exposure, ticks.
    Exposure(u32),
    /// The outputs in use.
    Outputs(u32),
    /// The tick of the first rising edge.
    Start(u64),
    /// Pulses since `start`.
    Stop(u32),
    /// Pulses since `start`.
    Count(u32),
    /// Half periods of the LEDs.
    Leds([u16; 3]),
    /// The host's token, and the tick at which the command arrived.
    Clock {
        /// As sent: host time in nanoseconds, by our use.
        token: u64,
        /// The tick at which the command's line feed was received.
        tick: u64,
    },
    /// The board's state.
    Status(Status),
}

impl Reply {
    /// The word of the command that it answers.
    #[must_use]
    pub fn command(&self) -> &'static str {
        match self {
            Self::Identify(_) => "identify",
            Self::Period(_) => "period",
            Self::Exposure(_) => "exposure",
            Self::Outputs(_) => "outputs",
            Self::Start(_) => "start",
            Self::Stop(_) => "stop",
            Self::Count(_) => "count",
            Self::Leds(_) => "leds",
            Self::Clock { .. } => "clock",
            Self::Status(_) => "status",
        }
    }
}

/// A line from the board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Message {
    /// The board has booted: ticks start from 0 and nothing runs.
    Boot {
        /// Who it is.
        identity: Identity,
        /// The processor's reset flags.
        cause: u32,
    },
    /// A pulse has begun.
    Pulse(Pulse),
    /// A command was done.
    Done(Reply),
    /// A command was refused.
    Refused {
        /// Its name, or `?`.
        command: String,
        /// Why.
        error: Refusal,
    },
}

/// Why a line is not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// There is no checksum at its end, or it does not fit.
    #[error("the checksum is missing or wrong")]
    Checksum,
    /// The checksum fits and the fields do not.
    #[error("the checksum is right, but the fields are not those of the protocol")]
    Fields,
}

/// A command to the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Who are you?
    Identify,
    /// Time from one rising edge to the next, ticks.
    Period(u32),
    /// Width of the frame triggers, ticks.
    Exposure(u32),
    /// Frame outputs in use; bit 0 is output 1.
    Outputs(u32),
    /// Give pulses from index 0 on.
    Start,
    /// Give no more pulses.
    Stop,
    /// How many pulses?
    Count,
    /// Half periods of the LEDs, units of 1600 ticks; 0 dark, 0xffff lit.
    Leds([u16; 3]),
    /// What is your tick? The token is given back.
    Clock(u64),
    /// How are you?
    Status,
}

impl Command {
    /// The command's word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Identify => "identify",
            Self::Period(_) => "period",
            Self::Exposure(_) => "exposure",
            Self::Outputs(_) => "outputs",
            Self::Start => "start",
            Self::Stop => "stop",
            Self::Count => "count",
            Self::Leds(_) => "leds",
            Self::Clock(_) => "clock",
            Self::Status => "status",
        }
    }

    /// The command as a line, with checksum and line feed.
    #[must_use]
    pub fn encode(self) -> Vec<u8> {
        line(&self.to_string())
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        match self {
            Self::Period(n) | Self::Exposure(n) | Self::Outputs(n) => write!(f, " {n:x}"),
            Self::Leds([a, b, c]) => write!(f, " {a:x} {b:x} {c:x}"),
            Self::Clock(token) => write!(f, " {token:x}"),
            Self::Identify | Self::Start | Self::Stop | Self::Count | Self::Status => Ok(()),
        }
    }
}

/// A body with its checksum and line feed.
#[must_use]
pub fn line(body: &str) -> Vec<u8> {
    format!("{body}*{:04x}\n", checksum(body.as_bytes())).into_bytes()
}

/// Reads one line without its ending.
///
/// # Errors
/// If it is damaged, or none of the board's.
pub fn parse(line: &[u8]) -> Result<Message, LineError> {
    let body = verified(line).ok_or(LineError::Checksum)?;
    let body = std::str::from_utf8(body).map_err(|_| LineError::Fields)?;
    message(body).ok_or(LineError::Fields)
}

/// The body of a line whose checksum is right.
fn verified(line: &[u8]) -> Option<&[u8]> {
    let (body, tail) = line.split_at_checked(line.len().checked_sub(5)?)?;
    let digits = tail.strip_prefix(b"*")?;
    let expected = checksum(body);
    (hexadecimal(std::str::from_utf8(digits).ok()?)? == u64::from(expected)).then_some(body)
}

/// A number as the protocol writes it; leading zeros are let pass.
fn hexadecimal(field: &str) -> Option<u64> {
    let digits = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
    if field.is_empty() || !field.bytes().all(digits) { None } else { u64::from_str_radix(field, 16).ok() }
}

/// The fields of a body, taken one after another.
struct Fields<'a>(std::str::Split<'a, char>);

impl<'a> Fields<'a> {
    fn word(&mut self) -> Option<&'a str> {
        self.0.next().filter(|word| !word.is_empty())
    }

    fn number<T: TryFrom<u64>>(&mut self) -> Option<T> {
        T::try_from(hexadecimal(self.word()?)?).ok()
    }

    fn identity(&mut self) -> Option<Identity> {
        Some(Identity {
            name: self.word()?.to_owned(),
            version: self.number()?,
            firmware: self.number()?,
            tick_hz: self.number()?,
            outputs: self.number()?,
        })
    }

    fn status(&mut self) -> Option<Status> {
        Some(Status {
            running: match self.number::<u8>()? {
                0 => false,
                1 => true,
                _ => return None,
            },
            period: self.number()?,
            exposure: self.number()?,
            outputs: self.number()?,
            count: self.number()?,
            tick: self.number()?,
            lost_lines: self.number()?,
            late_edges: self.number()?,
            bad_lines: self.number()?,
        })
    }

    fn reply(&mut self, command: &str) -> Option<Reply> {
        Some(match command {
            "identify" => Reply::Identify(self.identity()?),
            "period" => Reply::Period(self.number()?),
            "exposure" => Reply::Exposure(self.number()?),
            "outputs" => Reply::Outputs(self.number()?),
            "start" => Reply::Start(self.number()?),
            "stop" => Reply::Stop(self.number()?),
            "count" => Reply::Count(self.number()?),
            "leds" => Reply::Leds([self.number()?, self.number()?, self.number()?]),
            "clock" => Reply::Clock { token: self.number()?, tick: self.number()? },
            "status" => Reply::Status(self.status()?),
            _ => return None,
        })
    }
}

fn message(body: &str) -> Option<Message> {
    let mut fields = Fields(body.split(' '));
    let kind = fields.word()?;
    let message = if let Some(command) = kind.strip_prefix('+') {
        Message::Done(fields.reply(command)?)
    } else if let Some(command) = kind.strip_prefix('-') {
        let error = match fields.number()? {
            1 => Refusal::Damaged,
            2 => Refusal::Unknown,
            3 => Refusal::Arguments,
            4 => Refusal::Range,
            5 => Refusal::Running,
            6 => Refusal::TooLong,
            other => Refusal::Other(other),
        };
        Message::Refused { command: command.to_owned(), error }
    } else {
        match kind {
            "b" => Message::Boot { identity: fields.identity()?, cause: fields.number()? },
            "p" => Message::Pulse(Pulse { index: fields.number()?, tick: fields.number()?, width: fields.number()? }),
            _ => return None,
        }
    };
    fields.0.next().is_none().then_some(message)
}

#[cfg(test)]
mod tests;
