//! Ordering the events of a frame interval.

use erfgs_events::Events;

/// An event of a frame interval, with its time as a small number.
#[derive(Clone, Copy)]
pub(super) struct Raw {
    /// Time: of the form that the caller of [`append`] turns into microseconds.
    pub(super) key: u32,
    pub(super) y: u16,
    pub(super) x: u16,
    pub(super) on: bool,
}

/// Appends the events of all `blocks` to `out`, ordered by key and among equal keys as given. `time` turns a key into
/// microseconds and must not decrease.
pub(super) fn append<'a>(
    blocks: impl Iterator<Item = &'a [Raw]> + Clone,
    time: impl Fn(u32) -> i64,
    out: &mut Events,
    scratch: &mut Vec<u32>,
) {
    let (mut count, mut highest) = (0, 0);
    for block in blocks.clone() {
        count += block.len();
        highest = block.iter().fold(highest, |highest, raw| highest.max(raw.key));
    }
    if count == 0 {
        return;
    }
    let base = out.len();
    if highest as usize > 16 * count + 65_536 {
        // Few events in a long interval: buckets would be nearly all empty.
        let mut all: Vec<Raw> = blocks.flatten().copied().collect();
        all.sort_by_key(|raw| raw.key);
        for raw in all {
            out.push(erfgs_events::Event { t_us: time(raw.key), y: raw.y, x: raw.x, on: raw.on });
        }
        return;
    }
    // A counting sort: how many events each key has, then where the first of them goes, then each to its place.
    scratch.clear();
    scratch.resize(highest as usize + 2, 0);
    for raw in blocks.clone().flatten() {
        scratch[raw.key as usize + 1] += 1;
    }
    out.t_us.reserve(count);
    for key in 0..=highest {
        let t_us = time(key);
        let here = scratch[key as usize + 1];
        out.t_us.extend(std::iter::repeat_n(t_us, here as usize));
        scratch[key as usize + 1] = scratch[key as usize] + here;
    }
    out.x.resize(base + count, 0);
    out.y.resize(base + count, 0);
    out.on.resize(base + count, false);
    let (x, y, on) = (&mut out.x[base..], &mut out.y[base..], &mut out.on[base..]);
    for raw in blocks.flatten() {
        let place = &mut scratch[raw.key as usize];
        let at = *place as usize;
        *place += 1;
        (x[at], y[at], on[at]) = (raw.x, raw.y, raw.on);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_of_sorting_keep_the_order_of_equal_keys() {
        for spread in [1, 100_000] {
            let raws: Vec<Raw> = (0..500u32)
                .map(|i| Raw { key: i * 7919 % 13 * spread, y: (i / 20) as u16, x: (i % 20) as u16, on: i % 2 == 0 })
                .collect();
            let mut out = Events::new(20, 25);
            out.push(erfgs_events::Event { t_us: -5, y: 0, x: 0, on: true });
            append(raws.chunks(70), |key| i64::from(key) + 10, &mut out, &mut Vec::new());
            let mut expected = raws.clone();
            expected.sort_by_key(|raw| (raw.key, raw.y, raw.x));
            assert_eq!(out.len(), 501);
            for (raw, event) in expected.iter().zip(out.iter().skip(1)) {
                assert_eq!((i64::from(raw.key) + 10, raw.y, raw.x, raw.on), (event.t_us, event.y, event.x, event.on));
            }
        }
    }
}
