//! Events as rows of 16 bytes, the layout of arrays of other programs.

use super::event::Event;

/// Events in rows: x and y (two bytes each), polarity (two bytes: 1 or 0), two bytes of padding, time (eight bytes), all
/// little-endian. Metavision's `EventCD` lies so in memory, and NumPy reads it as `{"x": "<u2", "y": "<u2", "p": "<i2", "t": "<i8"}`
/// of 16 bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EventRows(Vec<[u64; 2]>);

impl EventRows {
    /// Bytes of a row.
    pub const BYTES: usize = 16;

    /// No rows yet, with room for `events`.
    #[must_use]
    pub fn with_capacity(events: usize) -> Self {
        Self(Vec::with_capacity(events))
    }

    /// How many events there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Appends an event.
    pub fn push(&mut self, Event { t_us, x, y, on }: Event) {
        let place = u64::from(x) | u64::from(y) << 16 | u64::from(on) << 32;
        self.0.push([place.to_le(), t_us.cast_unsigned().to_le()]);
    }

    /// The events one by one.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Event> + '_ {
        self.0.iter().map(|&[place, t_us]| {
            let (place, t_us) = (u64::from_le(place), u64::from_le(t_us).cast_signed());
            Event { t_us, x: place as u16, y: (place >> 16) as u16, on: place >> 32 & 1 == 1 }
        })
    }

    /// Puts the events in the order of their times; those of one time stay in their order.
    pub fn sort(&mut self) {
        let time = |row: &[u64; 2]| u64::from_le(row[1]).cast_signed();
        if !self.0.is_sorted_by_key(time) {
            self.0.sort_by_key(time);
        }
    }

    /// Takes the events before `t_us` out; they are in the order of their times, and so are those that stay.
    #[must_use]
    pub fn take_before(&mut self, t_us: i64) -> Self {
        self.sort();
        let end = self.0.partition_point(|row| u64::from_le(row[1]).cast_signed() < t_us);
        let rest = self.0.split_off(end);
        Self(std::mem::replace(&mut self.0, rest))
    }

    /// The rows as they lie in memory, two words each.
    #[must_use]
    pub fn into_words(self) -> Vec<u64> {
        self.0.into_flattened()
    }
}

impl Extend<Event> for EventRows {
    fn extend<I: IntoIterator<Item = Event>>(&mut self, events: I) {
        let events = events.into_iter();
        self.0.reserve(events.size_hint().0);
        events.for_each(|event| self.push(event));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(t_us: i64, x: u16) -> Event {
        Event { t_us, x, y: 0xfffe, on: x.is_multiple_of(2) }
    }

    #[test]
    fn a_row_lies_in_memory_as_other_programs_have_it() {
        let mut rows = EventRows::default();
        rows.extend([event(-2, 0x1234)]);
        let bytes: Vec<u8> = rows.clone().into_words().into_iter().flat_map(u64::to_ne_bytes).collect();
        let expected = [0x34, 0x12, 0xfe, 0xff, 1, 0, 0, 0, 0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff];
        assert_eq!((bytes.len(), &bytes[..]), (EventRows::BYTES, &expected[..]));
        assert_eq!(rows.iter().collect::<Vec<_>>(), [event(-2, 0x1234)]);
    }

    #[test]
    fn what_is_taken_and_what_stays_are_in_order_and_whole() {
        let mut rows = EventRows::default();
        rows.extend([event(5, 0), event(1, 1), event(5, 2), event(-3, 3), event(9, 4), event(5, 5)]);
        let taken = rows.take_before(5);
        assert_eq!(taken.iter().collect::<Vec<_>>(), [event(-3, 3), event(1, 1)]);
        assert_eq!(rows.iter().collect::<Vec<_>>(), [event(5, 0), event(5, 2), event(5, 5), event(9, 4)]);
        assert_eq!((rows.take_before(i64::MAX).len(), rows.len()), (4, 0));
    }
}
