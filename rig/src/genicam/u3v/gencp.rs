//! The control protocol of USB3 Vision (GenCP), without input or output: commands as packets, and acknowledgements taken apart. All
//! numbers are little-endian.

use std::time::Duration;

use crate::genicam::Status;

const PREFIX: &[u8; 4] = b"U3VC";
/// Bytes before the data of a command and of an acknowledgement.
pub const HEADER_BYTES: usize = 12;
/// Bytes of a command to write that are no data: the header and an address.
pub const WRITE_BYTES: usize = HEADER_BYTES + 8;
const ACKNOWLEDGE: u16 = 0x4000;
const READ: u16 = 0x0800;
const WRITE: u16 = 0x0802;
const PENDING: u16 = 0x0805;

/// Addresses of registers that every camera has (ABRM, and from their own addresses on SBRM and SIRM).
pub mod register {
    /// Maker, model, serial number and the name that its user gave it: texts of [`TEXT_BYTES`].
    pub const TEXTS: [u64; 4] = [0x004, 0x044, 0x144, 0x184];
    /// Length of a text.
    pub const TEXT_BYTES: usize = 64;
    /// Version of GenCP; read to see whether the camera answers.
    pub const VERSION: u64 = 0x000;
    /// Whether there are names of users (bit 0).
    pub const CAPABILITY: u64 = 0x1c4;
    /// Most milliseconds that an answer takes.
    pub const RESPONSE_MS: u64 = 0x1cc;
    /// Where the manifest of descriptions lies.
    pub const MANIFEST: u64 = 0x1d0;
    /// Where the SBRM lies.
    pub const SBRM: u64 = 0x1d8;
    /// In the SBRM: bit 0 says that there is a SIRM.
    pub const SBRM_CAPABILITY: u64 = 0x04;
    /// In the SBRM: bytes of the largest command, and of the largest acknowledgement.
    pub const LARGEST: [u64; 2] = [0x14, 0x18];
    /// In the SBRM: where the SIRM lies.
    pub const SIRM: u64 = 0x20;
    /// In the SIRM: the alignment, its power of 2 in the upper byte.
    pub const INFO: u64 = 0x00;
    /// In the SIRM: bit 0 lets the camera stream.
    pub const CONTROL: u64 = 0x04;
    /// In the SIRM: bytes of a payload.
    pub const PAYLOAD: u64 = 0x08;
    /// In the SIRM: bytes of a leader, and of a trailer.
    pub const ENDS: [u64; 2] = [0x10, 0x14];
    /// In the SIRM, set by the host: bytes of a leader, of a transfer of the payload, the count of these, bytes of two more transfers,
    /// and of a trailer.
    pub const SIZES: [u64; 6] = [0x18, 0x1c, 0x20, 0x24, 0x28, 0x2c];
}

/// A command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command<'a> {
    /// Reads so many bytes from an address on.
    Read(u64, u16),
    /// Writes from an address on.
    Write(u64, &'a [u8]),
}

/// What a packet that came back is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The command is done; what was read.
    Done(Vec<u8>),
    /// The camera says no.
    Refused(Status),
    /// It is under way: the answer takes so long at most.
    Pending(Duration),
    /// It belongs to a command before.
    Other,
    /// It is no answer to this command: why.
    Malformed(String),
}

impl Command<'_> {
    /// The packet. `id` is not 0.
    #[must_use]
    pub fn packet(self, id: u16) -> Vec<u8> {
        let (command, data) = match self {
            Self::Read(address, count) => (READ, [&address.to_le_bytes()[..], &[0, 0], &count.to_le_bytes()].concat()),
            Self::Write(address, data) => (WRITE, [&address.to_le_bytes(), data].concat()),
        };
        let mut packet = PREFIX.to_vec();
        for half in [ACKNOWLEDGE, command, data.len() as u16, id] {
            packet.extend(half.to_le_bytes());
        }
        packet.extend(data);
        packet
    }

    /// Takes apart what came back.
    #[must_use]
    pub fn answer(self, id: u16, bytes: &[u8]) -> Answer {
        let Some((header, data)) = bytes.split_first_chunk::<HEADER_BYTES>() else {
            return Answer::Malformed(format!("{} bytes came, less than a header has", bytes.len()));
        };
        let half = |at: usize| u16::from_le_bytes([header[at], header[at + 1]]);
        let [status, kind, length, of] = [4, 6, 8, 10].map(half);
        if !header.starts_with(PREFIX) {
            return Answer::Malformed("it does not begin with U3VC".into());
        }
        if of != id {
            return Answer::Other;
        }
        if usize::from(length) != data.len() {
            return Answer::Malformed(format!("it says {length} bytes and has {}", data.len()));
        }
        let code = match self {
            Self::Read(..) => READ,
            Self::Write(..) => WRITE,
        };
        match (kind, data) {
            (PENDING, [_, _, low, high]) => {
                Answer::Pending(Duration::from_millis(u16::from_le_bytes([*low, *high]).into()))
            }
            (kind, _) if kind != code | 1 => Answer::Malformed(format!("it is of kind {kind:#06x}")),
            _ if status != 0 => Answer::Refused(Status(status)),
            _ => self.done(data),
        }
    }

    fn done(self, data: &[u8]) -> Answer {
        match self {
            Self::Read(_, count) if data.len() != usize::from(count) => {
                Answer::Malformed(format!("it has {} bytes where {count} were to be read", data.len()))
            }
            Self::Read(..) => Answer::Done(data.to_vec()),
            // Not every camera says how much it wrote.
            Self::Write(_, written) => match data {
                [_, _, low, high] if usize::from(u16::from_le_bytes([*low, *high])) != written.len() => {
                    let count = u16::from_le_bytes([*low, *high]);
                    Answer::Malformed(format!("{count} bytes of {} were written", written.len()))
                }
                _ => Answer::Done(Vec::new()),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn acknowledgement(status: u16, kind: u16, id: u16, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"U3VC".to_vec();
        for half in [status, kind, data.len() as u16, id] {
            bytes.extend(half.to_le_bytes());
        }
        bytes.extend(data);
        bytes
    }

    #[test]
    fn commands_are_the_bytes_of_the_protocol() {
        let read = [b"U3VC".to_vec(), vec![0, 0x40, 0, 8, 12, 0, 0x34, 0x12, 0xd8, 1, 0, 0, 0, 0, 0, 0, 0, 0, 8, 0]];
        assert_eq!(Command::Read(0x1d8, 8).packet(0x1234), read.concat());
        let write = [b"U3VC".to_vec(), vec![0, 0x40, 2, 8, 12, 0, 7, 0, 4, 0, 2, 0, 0, 0, 0, 0, 1, 0, 0, 0]];
        assert_eq!(Command::Write(0x2_0004, &[1, 0, 0, 0]).packet(7), write.concat());
    }

    #[test]
    fn answers_are_told_from_each_other() {
        let read = Command::Read(0, 2);
        let of = |bytes: &[u8]| read.answer(5, bytes);
        assert_eq!(of(&acknowledgement(0, 0x801, 5, &[1, 2])), Answer::Done(vec![1, 2]));
        assert_eq!(of(&acknowledgement(0, 0x801, 4, &[1, 2])), Answer::Other);
        assert_eq!(of(&acknowledgement(0x8003, 0x801, 5, &[])), Answer::Refused(Status(0x8003)));
        let pending = acknowledgement(0, 0x805, 5, &[0, 0, 0x2c, 1]);
        assert_eq!(of(&pending), Answer::Pending(Duration::from_millis(300)));
        for (wrong, says) in [
            (acknowledgement(0, 0x801, 5, &[1]), "1 bytes where 2"),
            (acknowledgement(0, 0x803, 5, &[1, 2]), "kind 0x0803"),
            (acknowledgement(0, 0x801, 5, &[1, 2])[..13].to_vec(), "says 2 bytes and has 1"),
            (b"U3VE\0\0\0\0\0\0\0\0".to_vec(), "does not begin with U3VC"),
            (Vec::new(), "less than a header"),
        ] {
            let Answer::Malformed(reason) = of(&wrong) else { panic!("{wrong:?}") };
            assert!(reason.contains(says), "{reason}");
        }
        let write = Command::Write(0, &[1, 2, 3, 4]);
        assert_eq!(write.answer(5, &acknowledgement(0, 0x803, 5, &[])), Answer::Done(Vec::new()));
        assert_eq!(write.answer(5, &acknowledgement(0, 0x803, 5, &[0, 0, 4, 0])), Answer::Done(Vec::new()));
        assert!(matches!(write.answer(5, &acknowledgement(0, 0x803, 5, &[0, 0, 3, 0])), Answer::Malformed(_)));
    }

    proptest! {
        #[test]
        fn any_bytes_are_an_answer_or_none(
            id: u16, count in 0_u16..40, bytes in prop::collection::vec(any::<u8>(), 0..60), prefix: bool
        ) {
            let bytes = if prefix { [&b"U3VC"[..], &bytes].concat() } else { bytes };
            for command in [Command::Read(7, count), Command::Write(7, &[0; 4])] {
                if let Answer::Done(read) = command.answer(id, &bytes) {
                    prop_assert!(bytes.ends_with(&read) && read.len() <= count.into());
                }
            }
        }
    }
}
