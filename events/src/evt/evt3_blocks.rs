//! Blocks of 64 EVT3 words sorted by type into bit masks, so that the decoder visits events and not words.

/// Words in a block.
pub(super) const WORDS: usize = 64;
/// Bytes in a block.
pub(super) const BYTES: usize = 2 * WORDS;

/// Which words of a block are of which type; bit i stands for word i.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Masks {
    /// Row addresses (type 0).
    pub row: u64,
    /// Single events (type 2).
    pub event: u64,
    /// Low bits of the time (type 6).
    pub low: u64,
    /// All else, except time words equal to the one before the block (type 8), which say nothing new.
    pub other: u64,
}

impl Masks {
    /// Sorts a block. `repeated` is the time word that says nothing new.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    #[expect(
        unsafe_code,
        reason = "a function with a target feature is called from one without, which the language cannot check"
    )]
    pub fn of(block: &[u8; BYTES], repeated: u16) -> Self {
        // SAFETY: SSE2, which is all that the function asks for, belongs to every x86-64 processor.
        unsafe { Self::by_sixteen(block, repeated) }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "sse2")]
    #[inline]
    fn by_sixteen(block: &[u8; BYTES], repeated: u16) -> Self {
        use std::arch::x86_64::{
            _mm_cmpeq_epi8, _mm_cmpeq_epi16, _mm_movemask_epi8, _mm_packs_epi16, _mm_packus_epi16, _mm_set_epi64x,
            _mm_set1_epi8, _mm_set1_epi16, _mm_srli_epi16,
        };
        let (mut row, mut event, mut low, mut nothing) = (0, 0, 0, 0);
        let repeated = _mm_set1_epi16(repeated as i16);
        for (at, sixteen) in block.as_chunks::<8>().0.as_chunks::<4>().0.iter().enumerate() {
            let [a_low, a_high, b_low, b_high] = sixteen.map(i64::from_le_bytes);
            let (a, b) = (_mm_set_epi64x(a_high, a_low), _mm_set_epi64x(b_high, b_low));
            let types = _mm_packus_epi16(_mm_srli_epi16::<12>(a), _mm_srli_epi16::<12>(b));
            let repeats = _mm_packs_epi16(_mm_cmpeq_epi16(a, repeated), _mm_cmpeq_epi16(b, repeated));
            let shift = 16 * at;
            row |= u64::from(_mm_movemask_epi8(_mm_cmpeq_epi8(types, _mm_set1_epi8(0))) as u16) << shift;
            event |= u64::from(_mm_movemask_epi8(_mm_cmpeq_epi8(types, _mm_set1_epi8(2))) as u16) << shift;
            low |= u64::from(_mm_movemask_epi8(_mm_cmpeq_epi8(types, _mm_set1_epi8(6))) as u16) << shift;
            nothing |= u64::from(_mm_movemask_epi8(repeats) as u16) << shift;
        }
        Self { row, event, low, other: !(row | event | low | nothing) }
    }

    /// Sorts a block. `repeated` is the time word that says nothing new.
    #[cfg(not(target_arch = "x86_64"))]
    #[inline(always)]
    pub fn of(block: &[u8; BYTES], repeated: u16) -> Self {
        Self::one_by_one(block, repeated)
    }

    /// As [`Masks::of`], word by word.
    #[cfg(any(test, not(target_arch = "x86_64")))]
    fn one_by_one(block: &[u8; BYTES], repeated: u16) -> Self {
        let (mut row, mut event, mut low, mut nothing) = (0, 0, 0, 0);
        for (at, &word) in block.as_chunks::<2>().0.iter().enumerate() {
            let word = u16::from_le_bytes(word);
            let mask = |is: bool| u64::from(is) << at;
            row |= mask(word >> 12 == 0);
            event |= mask(word >> 12 == 2);
            low |= mask(word >> 12 == 6);
            nothing |= mask(word == repeated);
        }
        Self { row, event, low, other: !(row | event | low | nothing) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn both_ways_of_sorting_agree(words in proptest::collection::vec(any::<u16>(), WORDS), repeated in 0_u16..4096) {
            let mut block = [0; BYTES];
            for (bytes, word) in block.as_chunks_mut::<2>().0.iter_mut().zip(&words) {
                *bytes = word.to_le_bytes();
            }
            let repeated = 0x8000 | repeated;
            block[6..8].copy_from_slice(&repeated.to_le_bytes());
            let masks = Masks::of(&block, repeated);
            prop_assert_eq!(masks, Masks::one_by_one(&block, repeated));
            prop_assert_eq!((masks.row | masks.event | masks.low | masks.other) >> 3 & 1, 0);
        }
    }
}
