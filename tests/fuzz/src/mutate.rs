//! Inputs that are changed at random, the same each time.

use erfgs_base::random;

/// Bytes at which numbers and lengths turn.
const BYTES: [u8; 10] = [0, 1, 2, 7, 8, 0x0f, 0x7f, 0x80, 0xfe, 0xff];
/// No input grows beyond this.
const MOST_BYTES: usize = 1 << 14;

/// One of `seeds`, changed in one to four places: bits turned, bytes and numbers replaced, pieces taken out, put in, repeated
/// or cut off, another seed's end put in place of its own. `key` says which and how ([`random::key`]); empty without seeds.
#[must_use]
pub fn mutation(seeds: &[Vec<u8>], key: u64) -> Vec<u8> {
    let mut draw = Draw(key);
    let Some(seed) = draw.one_of(seeds) else { return Vec::new() };
    let mut bytes = seed.clone();
    for _ in 0..=draw.below(4) {
        change(&mut bytes, seeds, &mut draw);
        bytes.truncate(MOST_BYTES);
    }
    bytes
}

fn change(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], draw: &mut Draw) {
    let at = draw.below(bytes.len() + 1);
    let some = at..bytes.len().min(at + 1 + draw.below(16));
    match draw.below(10) {
        0 | 1 => bytes[some].iter_mut().take(1).for_each(|byte| *byte ^= 1 << draw.below(8)),
        2 => bytes[some].iter_mut().take(1).for_each(|byte| *byte = *draw.one_of(&BYTES).unwrap_or(&0)),
        3 => bytes[some].iter_mut().for_each(|byte| *byte = draw.below(256) as u8),
        4 => number(&mut bytes[at..], draw),
        5 => bytes.truncate(at),
        6 => drop(bytes.drain(some)),
        7 => {
            let byte = *draw.one_of(&BYTES).unwrap_or(&0);
            bytes.splice(at..at, (0..some.len()).map(|_| byte));
        }
        8 => {
            let again = bytes[some.clone()].repeat(1 + draw.below(8));
            bytes.splice(at..at, again);
        }
        _ => {
            let Some(other) = draw.one_of(seeds) else { return };
            bytes.truncate(at);
            bytes.extend_from_slice(&other[draw.below(other.len() + 1)..]);
        }
    }
}

/// Replaces a little-endian number of 2, 4 or 8 bytes by one that is near it, or at the end of a range.
fn number(bytes: &mut [u8], draw: &mut Draw) {
    let size = 2 << draw.below(3);
    let Some(place) = bytes.get_mut(..size) else { return };
    let mut wide = [0; 8];
    wide[..size].copy_from_slice(place);
    let found = u64::from_le_bytes(wide);
    let changed = match draw.below(4) {
        0 => found.wrapping_add(1 + draw.below(16) as u64),
        1 => found.wrapping_sub(1 + draw.below(16) as u64),
        2 => 1 << draw.below(8 * size),
        _ => u64::MAX >> draw.below(8 * size),
    };
    place.copy_from_slice(&changed.to_le_bytes()[..size]);
}

/// Numbers of one key, one after the other.
struct Draw(u64);

impl Draw {
    fn below(&mut self, count: usize) -> usize {
        self.0 = random::extend(self.0, 0);
        random::below(self.0, count as u64) as usize
    }

    fn one_of<'a, T>(&mut self, values: &'a [T]) -> Option<&'a T> {
        values.get(self.below(values.len()))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn mutations_are_the_same_each_time_and_mostly_differ() {
        let seeds = [b"a seed of some bytes".to_vec(), vec![0; 100], Vec::new()];
        let all = || (0..1000).map(|n| mutation(&seeds, random::key(n, &[]))).collect::<Vec<_>>();
        assert_eq!(all(), all());
        let different: BTreeSet<_> = all().into_iter().collect();
        assert!(different.len() > 500, "{}", different.len());
        let lengths: BTreeSet<_> = different.iter().map(Vec::len).collect();
        assert!(lengths.contains(&100) && *lengths.last().unwrap() > 100 && lengths.len() > 50, "{lengths:?}");
        assert!(mutation(&[], 1).is_empty());
    }
}
