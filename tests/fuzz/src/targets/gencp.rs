//! Any bytes as what a USB3 Vision camera answers to a command. What is taken for its answer is what it says, whole.
//!
//! The first bytes say the command (bit 0: it writes), its id and how many bytes it reads or writes; the rest is what came.

use erfgs_rig::genicam::u3v::gencp::{Answer, Command};

use crate::memory;

/// Bytes before what came.
const HEAD: usize = 5;
/// Most bytes that are written.
const WRITTEN: [u8; 64] = [0x5a; 64];

/// Checks one input.
pub fn gencp(input: &[u8]) {
    let Some((&[kind, low, high, few, many], came)) = input.split_first_chunk::<HEAD>() else { return };
    let (id, count) = (u16::from_le_bytes([low, high]), u16::from_le_bytes([few, many]));
    let command = match kind & 1 {
        0 => Command::Read(7, count),
        _ => Command::Write(7, &WRITTEN[..usize::from(few) % WRITTEN.len()]),
    };
    let peak = memory::peak(|| match command.answer(id, came) {
        Answer::Done(data) => {
            let expected = if matches!(command, Command::Read(..)) { count.into() } else { 0 };
            assert_eq!(data.len(), expected);
            assert!(came.ends_with(&data));
        }
        Answer::Refused(status) => assert!(status.0 != 0 && !status.to_string().is_empty()),
        Answer::Pending(wait) => assert!(wait.as_millis() <= u16::MAX.into()),
        Answer::Other => assert!(came[10..12] != id.to_le_bytes()),
        Answer::Malformed(reason) => assert!(!reason.is_empty()),
    });
    let limit = (4 << 10) + 2 * input.len();
    assert!(peak <= limit, "{peak} bytes of memory for an answer of {} bytes", came.len());
}
