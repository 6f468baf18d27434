//! The treuzell request frames on the control endpoints: little-endian `u32 property, u32 length, payload`
//! (OpenEB: `treuzell_command_definition.h`, `tz_control_frame.cpp`).

use super::registers::Registers;

/// The longest frame.
pub const LONGEST: usize = 1024;
/// Set in the property of a reply: the request failed, or (alone) is not known.
pub const FAILED: u32 = 0x8000_0000;

const ENODEV: u32 = 19;
const EINVAL: u32 = 22;

/// What a request can touch.
pub(super) struct Board<'a> {
    pub registers: &'a mut Registers,
    pub serial: u32,
    pub release: u32,
    pub build_unix_s: u64,
    /// Whether several registers can be written with one request.
    pub burst_writes: bool,
}

/// Answers one frame.
pub(super) fn answer(board: &mut Board<'_>, frame: &[u8]) -> Vec<u8> {
    let word = |index: usize| {
        frame
            .get(index * 4..index * 4 + 4)
            .and_then(|bytes| bytes.first_chunk())
            .map(|&bytes| u32::from_le_bytes(bytes))
    };
    let (Some(property), Some(length)) = (word(0), word(1)) else {
        return reply(FAILED, &[]);
    };
    if frame.len() != 8 + length as usize || frame.len() > LONGEST || !frame.len().is_multiple_of(4) {
        return reply(property | FAILED, &words(&[0, 0, EINVAL]));
    }
    let payload: Vec<u32> = (2..frame.len() / 4).filter_map(word).collect();
    // All requests about a device begin with its number, and there is the one sensor.
    let device = payload.first().copied();
    let about_device = property & 0x1_0000 != 0 && property & 0xffff != 0;
    if about_device && device != Some(0) {
        return reply(property | FAILED, &words(&[device.unwrap_or(0), 0, ENODEV]));
    }
    match (property, &payload[..]) {
        (0x71, []) => reply(property, &words(&[0])),
        (0x72, []) => reply(property, &u64::from(board.serial).to_le_bytes()),
        (0x79, []) => reply(property, &words(&[board.release])),
        (0x7a, []) => reply(property, &board.build_unix_s.to_le_bytes()),
        (0x1_0000, []) => reply(property, &words(&[1])),
        (0x1_0001, [_]) => reply(property, &strings(&["CCam5 Imx636 Event-Based Camera"])),
        (0x1_0003, [_]) => reply(property, &strings(&["psee,ccam5_imx636", "psee,ccam5_gen42"])),
        (0x1_0010 | 0x4001_0010 | 0x1_0200 | 0x4001_0200 | 0x1_0201 | 0x4001_0201, [_, ..]) => frame.to_vec(),
        (0x1_0102, &[_, address, count]) => {
            if !address.is_multiple_of(4) || !(1..=252).contains(&count) {
                return reply(property | FAILED, &words(&[0, address, EINVAL]));
            }
            let values: Vec<u32> =
                (0..count).map(|index| board.registers.read(address.wrapping_add(index * 4))).collect();
            reply(property, &words(&[&[0, address], &values[..]].concat()))
        }
        (0x4001_0102, [_, address, values @ ..]) => {
            if !address.is_multiple_of(4) || values.is_empty() || (values.len() > 1 && !board.burst_writes) {
                return reply(property | FAILED, &words(&[0, *address, EINVAL]));
            }
            for (index, &value) in values.iter().enumerate() {
                board.registers.write(address.wrapping_add(index as u32 * 4), value);
            }
            frame.to_vec()
        }
        _ => reply(FAILED, &[]),
    }
}

fn reply(property: u32, payload: &[u8]) -> Vec<u8> {
    [&property.to_le_bytes()[..], &(payload.len() as u32).to_le_bytes(), payload].concat()
}

fn words(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// The number of the device, then strings that each end with a zero.
fn strings(texts: &[&str]) -> Vec<u8> {
    let mut bytes = words(&[0]);
    for text in texts {
        bytes.extend(text.as_bytes());
        bytes.push(0);
    }
    bytes
}
