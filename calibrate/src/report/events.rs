//! What an event camera saw in a short time, as a picture.
//!
//! `erfgs_session::EventPicture` is another thing: it remembers the last event of each pixel, and shows the newest strongest. Here
//! all events of the time count, in the order of the time or not, and a pixel whose light came and went shows that it did.

use erfgs_events::palette;
use erfgs_scene::ImageRgb8;

/// How much of its full colour one event gives a pixel.
const ONE: f32 = 0.35;

/// Events that are gathered.
#[derive(Clone, Debug)]
pub struct EventHistogram {
    width: u32,
    height: u32,
    /// Events of each pixel: off and on.
    counts: Vec<[u16; 2]>,
}

impl EventHistogram {
    /// No events yet, on a sensor of `width` x `height` pixels.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, counts: vec![[0; 2]; width as usize * height as usize] }
    }

    /// Adds an event; one outside the sensor is nowhere.
    pub fn add(&mut self, x: u16, y: u16, on: bool) {
        if u32::from(x) < self.width {
            let at = usize::from(y) * self.width as usize + usize::from(x);
            if let Some(counts) = self.counts.get_mut(at) {
                let count = &mut counts[usize::from(on)];
                *count = count.saturating_add(1);
            }
        }
    }

    /// The picture: the more events, the brighter.
    #[must_use]
    pub fn picture(&self) -> ImageRgb8 {
        let colour =
            |[off, on]: &[u16; 2]| palette::blend(palette::STILL, on >= off, ONE * (f32::from(*off) + f32::from(*on)));
        let data = self.counts.iter().flat_map(colour).collect();
        ImageRgb8 { width: self.width, height: self.height, data }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_take_the_colour_of_most_of_their_events() {
        let mut events = EventHistogram::new(4, 3);
        for (x, y, on) in [(1, 1, true), (1, 1, true), (1, 1, false), (2, 0, false), (4, 0, true), (0, 3, true)] {
            events.add(x, y, on);
        }
        let picture = events.picture();
        assert_eq!((picture.pixel(1, 1), picture.pixel(0, 0)), (palette::ON, palette::STILL));
        assert!(picture.pixel(2, 0)[2] > 80 && picture.pixel(2, 0)[0] < 60);
        assert_eq!(picture.data.chunks(3).filter(|pixel| **pixel != palette::STILL).count(), 2);
    }
}
