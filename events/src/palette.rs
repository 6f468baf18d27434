//! The colours that events are drawn in, everywhere: red, green and blue, display values.

/// A pixel without events.
pub const STILL: [u8; 3] = [16, 19, 26];
/// A pixel that grew brighter.
pub const ON: [u8; 3] = [255, 214, 138];
/// A pixel that grew darker.
pub const OFF: [u8; 3] = [66, 150, 255];

/// A pixel of events of one polarity over `base`: its own colour at a `weight` of 0 (and below), that of the events at 1 (and
/// above).
#[must_use]
pub fn blend(base: [u8; 3], on: bool, weight: f32) -> [u8; 3] {
    let events = if on { ON } else { OFF };
    let weight = weight.clamp(0.0, 1.0);
    std::array::from_fn(|c| {
        let [base, events] = [base[c], events[c]].map(f32::from);
        (base + weight * (events - base)) as u8
    })
}
