//! Treuzell, the control protocol of Prophesee's boards: one request frame, one answer frame.
//!
//! A frame is little-endian: `u32 property, u32 length, payload[length]`. The answer bears the same property; with bit
//! 31 set the command failed, and 0x8000_0000 alone says that it is not implemented. No I/O here.
//!
//! Source: OpenEB 5.1.1, `hal_psee_plugins/src/boards/treuzell/tz_control_frame.cpp`, `tz_libusb_board_command.cpp`
//! and `include/boards/treuzell/treuzell_command_definition.h`.

use thiserror::Error;

/// The largest frame that a board answers with, bytes.
pub const MAX_FRAME: usize = 1024;
/// The most registers that one frame writes: what is left of [`MAX_FRAME`] after header, device and address.
pub const MAX_BURST: usize = (MAX_FRAME - HEADER - 8) / 4;

const HEADER: usize = 8;
const FAILURE: u32 = 0x8000_0000;
const WRITE: u32 = 0x4000_0000;

/// What is asked of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Property {
    /// Serial number: answer u64, u32 on some boards.
    Serial = 0x72,
    /// Version of the firmware: answer u32, 0x30900 is 3.9.0.
    ReleaseVersion = 0x79,
    /// Build date of the firmware: answer u64, seconds since 1970.
    BuildDate = 0x7A,
    /// How many devices the board has: answer u32.
    Devices = 0x1_0000,
    /// Name of a device: `u32 device`; answer the same and a string.
    DeviceName = 0x1_0001,
    /// What a device is compatible with: `u32 device`; answer the same and strings that end with NUL.
    DeviceCompatible = 0x1_0003,
    /// Registers: `u32 device, address, count`; answer `u32 device, address, values`.
    ReadRegisters = 0x1_0102,
    /// Registers: `u32 device, address, values`; answer `u32 device, address`.
    WriteRegisters = 0x1_0102 | WRITE,
}

/// What is wrong with an answer.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FrameError {
    /// Shorter than its header or than what was asked for.
    #[error("the answer has {0} bytes, too few")]
    TooShort(usize),
    /// The header's length is not that of the frame.
    #[error("the answer says it has {declared} bytes of payload and has {has}")]
    Length {
        /// Length in the header.
        declared: u32,
        /// Bytes after the header.
        has: usize,
    },
    /// The board does not know the request.
    #[error("the board does not implement the request")]
    NotImplemented,
    /// The board tried and failed.
    #[error("the board failed to execute the request (error {0})")]
    Failed(u32),
    /// An answer to another request.
    #[error("the answer is to request {0:#x}, not to ours")]
    Property(u32),
    /// The answer is about another device or address.
    #[error("the answer is about device {device} address {address:#06x}, not ours")]
    Address {
        /// Device in the answer.
        device: u32,
        /// Address in the answer.
        address: u32,
    },
    /// A string does not end.
    #[error("a string of the answer does not end")]
    String,
}

/// A request frame of 32-bit words.
#[must_use]
pub fn request(property: Property, words: &[u32]) -> Vec<u8> {
    let length = u32::try_from(words.len() * 4).unwrap_or(u32::MAX);
    let mut frame = Vec::with_capacity(HEADER + words.len() * 4);
    for word in [property as u32, length].iter().chain(words) {
        frame.extend_from_slice(&word.to_le_bytes());
    }
    frame
}

/// The payload of an answer to a request of `property`.
///
/// # Errors
/// If the frame is malformed, is an answer to something else or reports a failure.
pub fn payload(property: Property, frame: &[u8]) -> Result<&[u8], FrameError> {
    let (Some(answered), Some(declared)) = (word(frame, 0), word(frame, 1)) else {
        return Err(FrameError::TooShort(frame.len()));
    };
    let payload = &frame[HEADER..];
    if usize::try_from(declared) != Ok(payload.len()) {
        return Err(FrameError::Length { declared, has: payload.len() });
    }
    match answered {
        FAILURE => Err(FrameError::NotImplemented),
        _ if answered == property as u32 => Ok(payload),
        // The board's error number is the third word, where it says one.
        _ if answered == property as u32 | FAILURE => Err(FrameError::Failed(word(payload, 2).unwrap_or(0))),
        _ => Err(FrameError::Property(answered)),
    }
}

/// Checks that the payload of an answer about registers is about ours, and gives what follows.
///
/// # Errors
/// If it is about another device or address, or too short.
pub fn about(payload: &[u8], device: u32, address: u32) -> Result<&[u8], FrameError> {
    let (Some(answered), Some(at)) = (word(payload, 0), word(payload, 1)) else {
        return Err(FrameError::TooShort(payload.len()));
    };
    if (answered, at) != (device, address) {
        return Err(FrameError::Address { device: answered, address: at });
    }
    Ok(&payload[8..])
}

/// Word `index` of a payload.
#[must_use]
pub fn word(payload: &[u8], index: usize) -> Option<u32> {
    let bytes = payload.get(index.checked_mul(4)?..)?.first_chunk()?;
    Some(u32::from_le_bytes(*bytes))
}

/// A number of eight bytes, or of four where the board sends no more.
///
/// # Errors
/// If there are fewer than four.
pub fn number(payload: &[u8]) -> Result<u64, FrameError> {
    match (payload.first_chunk(), word(payload, 0)) {
        (Some(bytes), _) => Ok(u64::from_le_bytes(*bytes)),
        (None, Some(word)) => Ok(word.into()),
        (None, None) => Err(FrameError::TooShort(payload.len())),
    }
}

/// The strings after the device number of an answer.
///
/// # Errors
/// If the last one does not end with NUL.
pub fn strings(payload: &[u8]) -> Result<Vec<String>, FrameError> {
    let text = payload.get(4..).ok_or(FrameError::TooShort(payload.len()))?;
    let text = text.strip_suffix(&[0]).ok_or(FrameError::String)?;
    Ok(text.split(|&byte| byte == 0).map(|part| String::from_utf8_lossy(part).into_owned()).collect())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn requests_have_these_bytes() {
        assert_eq!(request(Property::Serial, &[]), [0x72, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(
            request(Property::ReadRegisters, &[0, 0xF128, 1]),
            [2, 1, 1, 0, 12, 0, 0, 0, 0, 0, 0, 0, 0x28, 0xF1, 0, 0, 1, 0, 0, 0]
        );
        assert_eq!(
            request(Property::WriteRegisters, &[0, 0x1010, 0x11A1_0066]),
            [2, 1, 1, 0x40, 12, 0, 0, 0, 0, 0, 0, 0, 0x10, 0x10, 0, 0, 0x66, 0, 0xA1, 0x11]
        );
        assert_eq!(MAX_BURST, 252);
    }

    #[test]
    fn failures_are_told_apart() {
        let answer = |property: u32, words: &[u32]| {
            let mut frame = request(Property::Serial, words);
            frame[..4].copy_from_slice(&property.to_le_bytes());
            frame
        };
        let read = Property::ReadRegisters;
        assert_eq!(payload(read, &answer(FAILURE, &[])), Err(FrameError::NotImplemented));
        assert_eq!(payload(read, &answer(0x8001_0102, &[0, 0x14, 5])), Err(FrameError::Failed(5)));
        assert_eq!(payload(read, &answer(0x72, &[1])), Err(FrameError::Property(0x72)));
        assert_eq!(payload(read, &[2, 1, 1]), Err(FrameError::TooShort(3)));
        let mut cut = answer(0x1_0102, &[0, 0x14, 7]);
        cut.pop();
        assert_eq!(payload(read, &cut), Err(FrameError::Length { declared: 12, has: 11 }));
        let other = request(read, &[0, 0x18, 7]);
        assert!(about(payload(read, &other).unwrap(), 0, 0x14).is_err());
    }

    #[test]
    fn strings_end_with_nul() {
        assert_eq!(strings(b"\0\0\0\0psee,ccam5_imx636\0psee,x\0").unwrap(), ["psee,ccam5_imx636", "psee,x"]);
        assert_eq!(strings(b"\0\0\0\0psee"), Err(FrameError::String));
        assert_eq!(strings(b"\0\0\0"), Err(FrameError::TooShort(3)));
        assert_eq!(strings(b"\0\0\0\0"), Err(FrameError::String));
    }

    proptest! {
        #[test]
        fn values_of_a_register_answer_come_back(
            address: u32,
            values in prop::collection::vec(any::<u32>(), 0..MAX_BURST),
        ) {
            let mut words = vec![0, address];
            words.extend(&values);
            let frame = request(Property::ReadRegisters, &words);
            prop_assert!(frame.len() <= MAX_FRAME);
            let rest = about(payload(Property::ReadRegisters, &frame).unwrap(), 0, address).unwrap();
            for (index, value) in values.iter().enumerate() {
                prop_assert_eq!(word(rest, index), Some(*value));
            }
            for cut in 0..frame.len() {
                prop_assert!(payload(Property::ReadRegisters, &frame[..cut]).is_err());
            }
        }

        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            for property in [Property::Serial, Property::ReadRegisters, Property::DeviceCompatible] {
                if let Ok(payload) = payload(property, &bytes) {
                    let _ = (about(payload, 0, 0), number(payload), strings(payload));
                }
            }
        }
    }
}
