//! Chunks that Prophesee's filter ECF ("Event Compression Format", number 0x8ECF) compressed. (The format's facts are those
//! of the published codec, hdf5_ecf; there is no other description.)
//!
//! A chunk begins with 32 bits: number of events times 4, plus 2 if rows, columns and polarities are packed together, plus 1
//! if columns and polarities are. What follows, all little-endian:
//!
//! - times: the first one in 64 bits, then runs. A byte whose high 4 bits are below 15 moves time on by them, and its low 4
//!   bits say how many events have that time; 15 says that the number follows in 16 bits. Bytes whose high 4 bits are 15 hold
//!   4 bits each of a longer step, the lowest first; it is taken before the byte that follows them.
//! - packed together: 24 bits an event (row in 12, column in 11, polarity), four events in three words of 32 bits;
//! - or rows in runs (16 bits: row times 32 plus how many; 31 says that the number follows in 16 bits), and then
//!   - packed: 12 bits an event (column in 11, polarity), four events in three words of 16 bits;
//!   - or columns (16 bits: column times 32 plus a mask of which of the next five columns follow, the nearest in bit 4), and
//!     polarities in runs (a byte: polarity in bit 7, how many; 127 says that the number follows in 16 bits).

use crate::CdEvent;

/// HDF5's number of the filter.
pub const FILTER: i32 = 0x8ECF;

/// The codec itself allows no more events in a chunk.
const MAX_EVENTS: usize = 65_535;

/// Unpacks the events of a chunk. Times before zero, which the format allows, become zero.
///
/// # Errors
/// What is wrong.
pub fn unpack(chunk: &[u8]) -> Result<Vec<CdEvent>, String> {
    let mut input = Input { rest: chunk };
    let head = input.u32()? as usize;
    let count = head >> 2;
    if count > MAX_EVENTS {
        return Err(format!("an ECF chunk claims {count} events; it has {MAX_EVENTS} at most"));
    }
    let times = times(&mut input, count)?;
    let mut places = Places { x: Vec::new(), y: Vec::new(), on: Vec::new() };
    if head & 2 != 0 {
        packed_24(&mut input, count, &mut places)?;
    } else {
        rows(&mut input, count, &mut places.y)?;
        if head & 1 != 0 {
            packed_12(&mut input, count, &mut places)?;
        } else {
            columns(&mut input, count, &mut places.x)?;
            polarities(&mut input, count, &mut places.on)?;
        }
    }
    let Places { x, y, on } = places;
    let events = times.into_iter().zip(x).zip(y.into_iter().zip(on));
    Ok(events.map(|((t_us, x), (y, on))| CdEvent { t_us, x, y, on }).collect())
}

struct Places {
    x: Vec<u16>,
    y: Vec<u16>,
    on: Vec<bool>,
}

/// What is left of a chunk.
struct Input<'a> {
    rest: &'a [u8],
}

impl Input<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (bytes, rest) = self.rest.split_first_chunk().ok_or("an ECF chunk is cut short")?;
        self.rest = rest;
        Ok(*bytes)
    }

    fn u8(&mut self) -> Result<u8, String> {
        self.take().map(|[byte]| byte)
    }

    fn u16(&mut self) -> Result<u16, String> {
        self.take().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Result<u32, String> {
        self.take().map(u32::from_le_bytes)
    }
}

/// Appends a run, which must not go past `count`.
fn run<T: Copy>(out: &mut Vec<T>, value: T, length: usize, count: usize) -> Result<(), String> {
    if length > count - out.len() {
        return Err("an ECF chunk has a run that is longer than the chunk".to_owned());
    }
    out.extend(std::iter::repeat_n(value, length));
    Ok(())
}

fn times(input: &mut Input<'_>, count: usize) -> Result<Vec<u64>, String> {
    let mut t_us = i64::from_le_bytes(input.take()?);
    let mut times = Vec::new();
    while times.len() < count {
        let mut byte = input.u8()?;
        if byte >> 4 == 15 {
            let (mut step, mut shift) = (0_u64, 0);
            while byte >> 4 == 15 {
                step |= u64::from(byte & 15).checked_shl(shift).unwrap_or(0);
                shift += 4;
                byte = input.u8()?;
            }
            t_us = t_us.saturating_add_unsigned(step);
        }
        t_us = t_us.saturating_add(i64::from(byte >> 4));
        let length = match byte & 15 {
            15 => input.u16()?.into(),
            short => usize::from(short),
        };
        run(&mut times, u64::try_from(t_us).unwrap_or(0), length, count)?;
    }
    Ok(times)
}

fn rows(input: &mut Input<'_>, count: usize, y: &mut Vec<u16>) -> Result<(), String> {
    while y.len() < count {
        let word = input.u16()?;
        let length = match word & 31 {
            31 => input.u16()?,
            short => short,
        };
        run(y, word >> 5, length.into(), count)?;
    }
    Ok(())
}

fn columns(input: &mut Input<'_>, count: usize, x: &mut Vec<u16>) -> Result<(), String> {
    while x.len() < count {
        let word = input.u16()?;
        x.push(word >> 5);
        let next = (0..5).filter(|column| word >> (4 - column) & 1 == 1);
        x.extend(next.map(|column| (word >> 5) + column + 1));
    }
    // The encoder looks past the last event: what it saw there is none.
    x.truncate(count);
    Ok(())
}

fn polarities(input: &mut Input<'_>, count: usize, on: &mut Vec<bool>) -> Result<(), String> {
    while on.len() < count {
        let byte = input.u8()?;
        let length = match byte & 127 {
            127 => input.u16()?,
            short => short.into(),
        };
        run(on, byte >> 7 == 1, length.into(), count)?;
    }
    Ok(())
}

fn packed_12(input: &mut Input<'_>, count: usize, places: &mut Places) -> Result<(), String> {
    for _ in 0..count.div_ceil(4) {
        let [a, b, c] = [input.u16()?, input.u16()?, input.u16()?];
        for value in [a >> 4, a & 0xF | b >> 8 << 4, b & 0xFF | c >> 12 << 8, c & 0xFFF] {
            places.x.push(value >> 1);
            places.on.push(value & 1 == 1);
        }
    }
    Ok(())
}

fn packed_24(input: &mut Input<'_>, count: usize, places: &mut Places) -> Result<(), String> {
    for _ in 0..count.div_ceil(4) {
        let [a, b, c] = [input.u32()?, input.u32()?, input.u32()?];
        for value in [a >> 8, a & 0xFF | b >> 16 << 8, b & 0xFFFF | c >> 24 << 16, c & 0xFF_FFFF] {
            places.y.push((value >> 12 & 0x7FF) as u16);
            places.x.push((value >> 1 & 0x7FF) as u16);
            places.on.push(value & 1 == 1);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(t_us: u64, x: u16, y: u16, on: bool) -> CdEvent {
        CdEvent { t_us, x, y, on }
    }

    /// The beginning of a chunk with five events: two at 1000 µs, one at 1003, two at 1003 + 0x123 + 1.
    fn begin(flags: u32) -> Vec<u8> {
        let mut chunk = (5_u32 << 2 | flags).to_le_bytes().to_vec();
        chunk.extend(1000_u64.to_le_bytes());
        chunk.extend([0x02, 0x31, 0xF3, 0xF2, 0xF1, 0x12]);
        chunk
    }

    fn expected() -> [CdEvent; 5] {
        let late = 1003 + 0x123 + 1;
        [
            event(1000, 10, 7, true),
            event(1000, 12, 7, true),
            event(1003, 1279, 7, true),
            event(late, 3, 719, false),
            event(late, 4, 719, false),
        ]
    }

    #[test]
    fn runs_and_masks_are_unpacked() {
        let mut chunk = begin(0);
        // Rows: 7 three times, 719 twice with the number behind.
        [7 << 5 | 3, 719 << 5 | 31, 2].iter().for_each(|word: &u16| chunk.extend(word.to_le_bytes()));
        // Columns: 10 and 10 + 2; 1279; 3, 3 + 1, and one that the encoder saw past the end.
        let columns: [u16; 3] = [10 << 5 | 0b01000, 1279 << 5, 3 << 5 | 0b11000];
        columns.iter().for_each(|word| chunk.extend(word.to_le_bytes()));
        // Polarities: three ON, two OFF with the number behind.
        chunk.extend([0x83, 0x7F, 2, 0]);
        assert_eq!(unpack(&chunk).unwrap(), expected());
        for length in 0..chunk.len() {
            assert!(unpack(&chunk[..length]).is_err(), "{length}");
        }
    }

    #[test]
    fn packed_events_are_unpacked() {
        let events = expected();
        let mut both = begin(1);
        [7_u16 << 5 | 3, 719 << 5 | 2].iter().for_each(|word| both.extend(word.to_le_bytes()));
        let mut all = begin(2);
        for four in [&events[..4], &[events[4]; 4]] {
            let v: Vec<u16> = four.iter().map(|event| event.x << 1 | u16::from(event.on)).collect();
            let words = [v[0] << 4 | v[1] & 0xF, v[1] >> 4 << 8 | v[2] & 0xFF, v[2] >> 8 << 12 | v[3]];
            words.iter().for_each(|word| both.extend(word.to_le_bytes()));
            let v: Vec<u32> = four
                .iter()
                .map(|event| u32::from(event.y) << 12 | u32::from(event.x) << 1 | u32::from(event.on))
                .collect();
            let words = [v[0] << 8 | v[1] & 0xFF, v[1] >> 8 << 16 | v[2] & 0xFFFF, v[2] >> 16 << 24 | v[3]];
            words.iter().for_each(|word| all.extend(word.to_le_bytes()));
        }
        assert_eq!(unpack(&both).unwrap(), events);
        assert_eq!(unpack(&all).unwrap(), events);
    }

    #[test]
    fn what_a_chunk_claims_is_not_believed() {
        assert!(unpack(&[0xFF; 40]).unwrap_err().contains("at most"));
        let mut chunk = begin(0);
        chunk.truncate(12);
        chunk.extend([0x0F, 0xFF, 0xFF]);
        assert!(unpack(&chunk).unwrap_err().contains("longer than the chunk"));
        assert_eq!(unpack(&[[0; 4], [0; 4], [0; 4]].concat()).unwrap(), []);
    }
}
