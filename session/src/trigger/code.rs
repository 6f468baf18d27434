//! The code on the pulse train (`rig/firmware/PROTOCOL.md`): the index of every pulse from the edges alone, as an event
//! camera sees them at its trigger input.

/// Width of a pulse with symbol 0, nanoseconds.
pub const BASE_NS: i64 = 80_000;
/// How much wider a pulse is for each step of the symbol, nanoseconds.
pub const STEP_NS: i64 = 40_000;
/// The symbol that begins a group.
pub const MARK: u8 = 16;
/// Pulses in a group.
pub const GROUP: u64 = 8;
/// Indices that can be told apart; the train repeats after so many pulses.
pub const PERIOD: u64 = GROUP << 24;
/// How far from its symbol's width a pulse may be, nanoseconds.
const TOLERANCE_NS: i64 = 16_000;

/// The symbol of a pulse.
#[must_use]
pub fn symbol(index: u64) -> u8 {
    let group = (index / GROUP) & 0xff_ffff;
    let digit = |position: u64| ((group >> (4 * (6 - position))) & 15) as u8;
    match index % GROUP {
        0 => MARK,
        7 => ((1..=6).map(|position| (2 * position - 1) * u64::from(digit(position))).sum::<u64>() % 16) as u8,
        position => digit(position),
    }
}

/// The width of the event cameras' pulse that stands for a symbol, nanoseconds.
#[must_use]
pub fn width_ns(symbol: u8) -> i64 {
    BASE_NS + STEP_NS * i64::from(symbol)
}

/// The symbol that a width stands for; `None` if it stands for none.
#[must_use]
pub fn read_width(width_ns: i64) -> Option<u8> {
    let steps = (width_ns - BASE_NS + STEP_NS / 2).div_euclid(STEP_NS);
    let symbol = u8::try_from(steps).ok().filter(|&symbol| symbol <= MARK)?;
    ((width_ns - self::width_ns(symbol)).abs() <= TOLERANCE_NS).then_some(symbol)
}

/// A pulse as a trigger input saw it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensedPulse {
    /// The rising edge, in any unit that the caller likes.
    pub rise: i64,
    /// From the rising to the falling edge, nanoseconds; `None` if the falling edge was lost.
    pub width_ns: Option<i64>,
}

/// What the train told.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Decoded {
    /// For each pulse seen, its index modulo [`PERIOD`]; `None` where the edges do not tell.
    pub indices: Vec<Option<u64>>,
    /// Pulses that stand for no symbol (no falling edge, or an odd width). The last pulse without a falling edge is none of
    /// them: the stream ended while it was high.
    pub unreadable: usize,
    /// Places between two pulses of known index that are not one after the other (pulses were lost, or doubled, or the
    /// train was started again), counted.
    pub breaks: usize,
}

/// Reads the indices of pulses in the order in which they came.
///
/// A whole group, evenly spaced and with a right check digit, gives its eight pulses their indices. They are carried on to neighbours that
/// follow at the same interval and have the symbol that they should; a lost or doubled pulse ends that. Where what is
/// carried from the left and from the right differs, the pulse stays without an index: nothing is guessed.
#[must_use]
pub fn decode(pulses: &[SensedPulse]) -> Decoded {
    let symbols: Vec<Option<u8>> = pulses.iter().map(|pulse| pulse.width_ns.and_then(read_width)).collect();
    let mut whole = vec![None; pulses.len()];
    for (start, group) in symbols.windows(GROUP as usize).enumerate() {
        if let Some(group) = whole_group(group).filter(|_| evenly_spaced(&pulses[start..start + GROUP as usize])) {
            for (offset, index) in whole[start..start + GROUP as usize].iter_mut().enumerate() {
                *index = Some(group * GROUP + offset as u64);
            }
        }
    }
    let forwards = carry(pulses, &symbols, &whole, 0..pulses.len(), 1);
    let backwards = carry(pulses, &symbols, &whole, (0..pulses.len()).rev(), PERIOD - 1);
    let indices: Vec<_> = std::iter::zip(forwards, backwards)
        .map(|pair| match pair {
            (Some(left), Some(right)) => (left == right).then_some(left),
            (left, right) => left.or(right),
        })
        .collect();
    let cut_off = usize::from(pulses.last().is_some_and(|last| last.width_ns.is_none()));
    let unreadable = symbols.iter().filter(|symbol| symbol.is_none()).count() - cut_off;
    Decoded { unreadable, breaks: breaks(&indices), indices }
}

/// Neighbours among the pulses of known index that do not follow one another.
fn breaks(indices: &[Option<u64>]) -> usize {
    let known: Vec<u64> = indices.iter().copied().flatten().collect();
    known.windows(2).filter(|pair| pair[1] != (pair[0] + 1) % PERIOD).count()
}

/// Whether no interval is half as long again as another: a group with a hole in it is none, though a check digit fit.
fn evenly_spaced(pulses: &[SensedPulse]) -> bool {
    let intervals = pulses.windows(2).map(|pair| pair[1].rise.abs_diff(pair[0].rise));
    intervals.clone().min().zip(intervals.max()).is_some_and(|(least, most)| most - least <= least / 2)
}

/// The number of a group, if these eight symbols are one.
fn whole_group(symbols: &[Option<u8>]) -> Option<u64> {
    if symbols[0] != Some(MARK) {
        return None;
    }
    let mut group = 0;
    for symbol in &symbols[1..7] {
        group = group << 4 | u64::from(symbol.filter(|&symbol| symbol < MARK)?);
    }
    (symbols[7] == Some(symbol(group * GROUP + 7))).then_some(group)
}

/// Carries the indices of whole groups on to neighbours in the given order, adding `step` for each.
fn carry(
    pulses: &[SensedPulse],
    symbols: &[Option<u8>],
    whole: &[Option<u64>],
    order: impl Iterator<Item = usize>,
    step: u64,
) -> Vec<Option<u64>> {
    let mut indices = whole.to_vec();
    // The pulse before in this order with its index, and the last interval.
    let (mut before, mut interval): (Option<(usize, u64)>, Option<i64>) = (None, None);
    for at in order {
        let now = before.map(|(before, _)| pulses[at].rise.abs_diff(pulses[before].rise) as i64);
        if indices[at].is_none() {
            indices[at] = before.map(|(_, index)| (index + step) % PERIOD).filter(|&index| {
                let steady = std::iter::zip(now, interval).all(|(now, last)| (now - last).abs() <= last / 4);
                steady && symbols[at].is_none_or(|symbol_read| symbol_read == symbol(index))
            });
        }
        interval = indices[at].and(now);
        before = indices[at].map(|index| (at, index));
    }
    indices
}

#[cfg(test)]
mod tests;
