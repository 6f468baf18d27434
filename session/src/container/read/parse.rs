//! Records of MCAP, taken apart by the `mcap` crate once it is certain that they are as long as they claim.

use mcap::records::{Record, op};

/// What a record consists of, as far as lengths go.
#[derive(Clone, Copy, Debug)]
enum Part {
    /// So many bytes.
    Fixed(usize),
    /// A length in 32 bits, and so many bytes: a string, or bytes.
    Bytes,
    /// A length in 64 bits, and so many bytes.
    LongBytes,
    /// A length in 32 bits, and so many bytes of strings, two by two.
    Strings,
    /// A length in 32 bits, and so many bytes of pairs of numbers.
    Numbers,
}

fn parts(opcode: u8) -> &'static [Part] {
    use Part::{Bytes, Fixed, LongBytes, Numbers, Strings};
    match opcode {
        op::HEADER => &[Bytes, Bytes],
        op::SCHEMA => &[Fixed(2), Bytes, Bytes, Bytes],
        op::CHANNEL => &[Fixed(4), Bytes, Bytes, Strings],
        op::CHUNK => &[Fixed(28), Bytes, LongBytes],
        op::MESSAGE_INDEX => &[Fixed(2), Numbers],
        op::CHUNK_INDEX => &[Fixed(32), Numbers, Fixed(8), Bytes, Fixed(16)],
        op::ATTACHMENT => &[Fixed(16), Bytes, Bytes, LongBytes, Fixed(4)],
        op::ATTACHMENT_INDEX => &[Fixed(40), Bytes, Bytes],
        op::STATISTICS => &[Fixed(42), Numbers],
        op::METADATA => &[Bytes, Strings],
        op::METADATA_INDEX => &[Fixed(16), Bytes],
        _ => &[],
    }
}

/// Takes `count` bytes off the beginning.
fn take<'a>(body: &mut &'a [u8], count: usize) -> Option<&'a [u8]> {
    let (bytes, rest) = body.split_at_checked(count)?;
    *body = rest;
    Some(bytes)
}

fn take_bytes<'a>(body: &mut &'a [u8]) -> Option<&'a [u8]> {
    let length = u32::from_le_bytes(*take(body, 4)?.first_chunk()?);
    take(body, length as usize)
}

fn take_part(body: &mut &[u8], part: Part) -> Option<()> {
    match part {
        Part::Fixed(count) => take(body, count).map(drop),
        Part::Bytes | Part::Numbers => take_bytes(body).map(drop),
        Part::LongBytes => {
            let length = u64::from_le_bytes(*take(body, 8)?.first_chunk()?);
            take(body, usize::try_from(length).ok()?).map(drop)
        }
        Part::Strings => {
            let mut strings = take_bytes(body)?;
            while !strings.is_empty() {
                take_bytes(&mut strings)?;
                take_bytes(&mut strings)?;
            }
            Some(())
        }
    }
}

/// Takes a record apart.
///
/// # Errors
/// What is wrong: a damaged length is found here, before the `mcap` crate makes room for as much as it claims.
pub(in crate::container) fn parse_record(opcode: u8, body: &[u8]) -> Result<Record<'_>, String> {
    let mut rest = body;
    for &part in parts(opcode) {
        take_part(&mut rest, part).ok_or("a length in the record is longer than the record")?;
    }
    mcap::parse_record(opcode, body).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn string(text: &str) -> Vec<u8> {
        [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
    }

    fn with_length(parts: &[Vec<u8>]) -> Vec<u8> {
        let bytes = parts.concat();
        [&(bytes.len() as u32).to_le_bytes()[..], &bytes].concat()
    }

    /// A record of each kind that has lengths.
    fn records() -> [(u8, Vec<u8>); 11] {
        let strings = with_length(&[string("key"), string("value")]);
        let numbers = with_length(&[vec![0; 10]]);
        let pairs = with_length(&[vec![0; 32]]);
        let attachment = [vec![0; 16], string("a"), string("b"), 3_u64.to_le_bytes().to_vec(), vec![7; 3], vec![0; 4]];
        [
            (op::HEADER, [string("p"), string("l")].concat()),
            (op::SCHEMA, [vec![1, 0], string("n"), string("e"), string("d")].concat()),
            (op::CHANNEL, [vec![1, 0, 1, 0], string("t"), string("e"), strings.clone()].concat()),
            (op::MESSAGE_INDEX, [vec![1, 0], pairs].concat()),
            (op::CHUNK_INDEX, [vec![0; 32], numbers.clone(), vec![0; 8], string(""), vec![0; 16]].concat()),
            (op::ATTACHMENT, attachment.concat()),
            (op::ATTACHMENT_INDEX, [vec![0; 40], string("a"), string("b")].concat()),
            (op::STATISTICS, [vec![0; 42], numbers].concat()),
            (op::METADATA, [string("name"), strings].concat()),
            (op::METADATA_INDEX, [vec![0; 16], string("name")].concat()),
            (op::CHUNK, [vec![0; 28], string("zstd"), 3_u64.to_le_bytes().to_vec(), vec![7; 3]].concat()),
        ]
    }

    #[test]
    fn records_that_the_crate_reads_are_read() {
        for (opcode, body) in records() {
            parse_record(opcode, &body).unwrap_or_else(|error| panic!("{opcode}: {error}"));
        }
    }

    #[test]
    fn a_length_is_not_believed_before_the_bytes_are_there() {
        for (opcode, body) in records() {
            for at in 0..body.len().saturating_sub(3) {
                let mut damaged = body.clone();
                // As text that took the place of a length once did: 1.7 GB.
                damaged[at..at + 4].copy_from_slice(b"epoc");
                let _ = parse_record(opcode, &damaged);
            }
        }
        let (opcode, mut metadata) = records()[8].clone();
        metadata[8..12].copy_from_slice(b"epoc");
        assert!(parse_record(opcode, &metadata).unwrap_err().contains("longer than the record"));
    }
}
