//! Pictures of the events of one stream, at a steady rate.

use erfgs_events::{CdEvent, EventRows, SensorSize, Sink};
use erfgs_session::EventPicture;

/// How events become pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EventPictures {
    /// Pictures a second; above 0.
    pub rate_hz: f64,
    /// Each picture shows the events of so many nanoseconds before its time; where it is not given, of the time from picture to picture.
    pub span_ns: Option<i64>,
}

impl Default for EventPictures {
    fn default() -> Self {
        Self { rate_hz: 30.0, span_ns: None }
    }
}

impl EventPictures {
    /// From picture to picture, nanoseconds.
    pub fn period_ns(&self) -> i64 {
        ((1e9 / self.rate_hz) as i64).clamp(1000, 1_000_000_000_000)
    }

    /// What a picture shows, microseconds.
    fn span_us(&self) -> u64 {
        let span_ns = self.span_ns.unwrap_or(self.period_ns()).max(1000);
        u64::try_from(span_ns).unwrap_or(0).div_ceil(1000)
    }
}

/// The events of a stream so far, of which pictures are made.
pub struct EventPictureStream {
    picture: EventPicture,
    options: EventPictures,
    /// What times are counted from, microseconds.
    origin_us: i64,
    /// Whether the last picture showed an event; `None` before the first.
    showed: Option<bool>,
}

impl EventPictureStream {
    /// `origin_us` is before all events.
    pub fn new(size: SensorSize, options: EventPictures, origin_us: i64) -> Self {
        Self { picture: EventPicture::new(size), options, origin_us, showed: None }
    }

    /// Session microseconds as a picture takes them: 0 is no time there.
    fn counted_us(&self, t_us: i64) -> u64 {
        u64::try_from(t_us.saturating_sub(self.origin_us)).unwrap_or(0) + 1
    }

    /// Takes events in the order of their times.
    pub fn take(&mut self, events: &EventRows) {
        for event in events.iter() {
            let t_us = self.counted_us(event.t_us);
            self.picture.event(CdEvent { t_us, x: event.x, y: event.y, on: event.on });
        }
    }

    /// The picture of the events before a session time, as rows of red, green and blue. `None` where it would be black like the one
    /// before, or the first.
    pub fn picture(&mut self, now_ns: i64) -> Option<Vec<u8>> {
        let now_us = self.counted_us(now_ns.saturating_add(999).div_euclid(1000));
        let span_us = self.options.span_us();
        let shows = self.picture.newest_us().is_some_and(|newest_us| newest_us.saturating_add(span_us) >= now_us);
        let wanted = shows || self.showed == Some(true);
        if wanted {
            self.showed = Some(shows);
        }
        wanted.then(|| self.picture.render(now_us, span_us, 1))
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        self.picture.size()
    }
}

#[cfg(test)]
mod tests {
    use erfgs_events::Event;

    use super::*;

    #[test]
    fn a_picture_shows_the_events_of_its_span_and_black_ones_come_once() {
        let options = EventPictures { rate_hz: 100.0, span_ns: None };
        assert_eq!(options.period_ns(), 10_000_000);
        let mut seen = EventPictureStream::new(SensorSize { width: 4, height: 1 }, options, -1000);
        assert_eq!(seen.picture(0), None, "nothing was seen");
        let mut rows = EventRows::default();
        // The first may come at the very origin, and is a fall.
        for (t_us, x, on) in [(-1000, 0, false), (5000, 1, true), (9999, 2, true)] {
            rows.push(Event { t_us, x, y: 0, on });
        }
        seen.take(&rows);
        let lit = |picture: Option<Vec<u8>>| {
            let picture = picture.unwrap();
            let pixels = picture.chunks(3).map(|pixel| pixel != [16, 19, 26]);
            pixels.collect::<Vec<_>>()
        };
        assert_eq!(lit(seen.picture(9_000_000)), [true, true, true, false], "the span begins at -1 ms");
        assert_eq!(lit(seen.picture(10_000_000)), [false, true, true, false]);
        assert_eq!(lit(seen.picture(19_000_000)), [false, false, true, false]);
        assert_eq!(lit(seen.picture(20_000_000)), [false; 4]);
        assert_eq!(seen.picture(30_000_000), None);
    }
}
