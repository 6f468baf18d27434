//! Event streams: columns of time, position and polarity.

/// One event: at `t_us` microseconds the log intensity of pixel (`x`, `y`) rose (`on`) or fell by one contrast threshold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Event {
    /// Time, microseconds on the stream's clock.
    pub t_us: i64,
    /// Row, 0 at the top.
    pub y: u16,
    /// Column, 0 at the left.
    pub x: u16,
    /// Whether the intensity rose.
    pub on: bool,
}

/// Events of one sensor in columns of equal length, ordered by time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Events {
    /// Sensor width, pixels.
    pub width: u32,
    /// Sensor height, pixels.
    pub height: u32,
    /// Times, microseconds, never decreasing.
    pub t_us: Vec<i64>,
    /// Columns.
    pub x: Vec<u16>,
    /// Rows.
    pub y: Vec<u16>,
    /// Polarities.
    pub on: Vec<bool>,
}

impl Events {
    /// No events yet, of a sensor of `width` x `height` pixels.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, ..Self::default() }
    }

    /// How many events there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.t_us.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.t_us.is_empty()
    }

    /// Appends one event.
    pub fn push(&mut self, event: Event) {
        self.t_us.push(event.t_us);
        self.x.push(event.x);
        self.y.push(event.y);
        self.on.push(event.on);
    }

    /// The event at `index`.
    ///
    /// # Panics
    /// If `index` is not below [`Events::len`].
    #[must_use]
    pub fn get(&self, index: usize) -> Event {
        Event { t_us: self.t_us[index], x: self.x[index], y: self.y[index], on: self.on[index] }
    }

    /// All events in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Event> + '_ {
        (0..self.len()).map(|index| self.get(index))
    }

    /// How many events each pixel had with `from_us <= t < to_us`: rows of OFF counts, then rows of ON counts, `2 * height * width`
    /// numbers. Events outside of the sensor are not counted.
    #[must_use]
    pub fn counts(&self, from_us: i64, to_us: i64) -> Vec<i32> {
        let (width, height) = (self.width as usize, self.height as usize);
        let mut counts = vec![0_i32; 2 * width * height];
        for event in self.between(from_us, to_us).map(|index| self.get(index)) {
            let (x, y) = (usize::from(event.x), usize::from(event.y));
            if x < width && y < height {
                let count = &mut counts[(usize::from(event.on) * height + y) * width + x];
                *count = count.saturating_add(1);
            }
        }
        counts
    }

    /// The range of indices of the events with `from_us <= t < to_us`.
    #[must_use]
    pub fn between(&self, from_us: i64, to_us: i64) -> std::ops::Range<usize> {
        let start = self.t_us.partition_point(|&t| t < from_us);
        let end = self.t_us.partition_point(|&t| t < to_us);
        start..end.max(start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_between_two_instants_are_counted_by_pixel_and_polarity() {
        let mut events = Events::new(3, 2);
        for (t_us, x, y, on) in
            [(0, 0, 0, true), (5, 2, 1, true), (5, 2, 1, true), (6, 1, 0, false), (7, 9, 1, true), (9, 0, 0, false)]
        {
            events.push(Event { t_us, x, y, on });
        }
        assert_eq!(events.counts(5, 9), [0, 1, 0, 0, 0, 0, /* ON */ 0, 0, 0, 0, 0, 2]);
        assert_eq!(events.counts(9, 5), [0; 12]);
    }
}
