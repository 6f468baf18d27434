//! A take of the stage, rendered ahead of time, or one that was recorded: it plays again and again, at true times modulo its
//! length, so that all devices that play it are in step.

use std::sync::Arc;

use erfgs_events::{CdEvent, Events};

use super::{EventScene, FrameScene, Picture};
use crate::usb::clock::TimeBase;
use erfgs_stage::{EventOptions, StageError, StageView, events::record, film::image};

/// The events of a take, which starts again when it has ended.
#[derive(Clone, Debug)]
pub struct TakeEvents {
    take: Arc<Events>,
    length_us: u64,
    lap: u64,
    next: usize,
}

impl TakeEvents {
    /// Records `length_us` of the stage with an event sensor at `view`'s camera. `stream` tells sensors apart.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn record(
        view: &StageView<'_>,
        length_us: u64,
        options: &EventOptions,
        stream: u64,
    ) -> Result<Self, StageError> {
        let end = i64::try_from(length_us.saturating_mul(1000)).unwrap_or(i64::MAX);
        let take = record(view, [0, end], options, 1, stream, &|_| {})?;
        Ok(Self::new(Arc::new(take), length_us))
    }

    /// Plays events that are there already, at true times modulo `length_us`.
    #[must_use]
    pub fn new(take: Arc<Events>, length_us: u64) -> Self {
        Self { take, length_us: length_us.max(1), lap: 0, next: 0 }
    }
}

impl EventScene for TakeEvents {
    fn begin(&mut self, _clock: &TimeBase, now_ns: i64) {
        let now_us = u64::try_from(now_ns / 1000).unwrap_or(0);
        self.lap = now_us / self.length_us;
        let within = (now_us % self.length_us) as i64;
        self.next = self.take.t_us.partition_point(|&t| t <= within);
    }

    fn until(&mut self, clock: &TimeBase, now_ns: i64, events: &mut Vec<CdEvent>) {
        let now_us = now_ns / 1000;
        loop {
            let lap_start = (self.lap * self.length_us) as i64;
            if self.next >= self.take.len() {
                if now_us < lap_start + self.length_us as i64 || self.take.is_empty() {
                    return;
                }
                self.lap += 1;
                self.next = 0;
                continue;
            }
            let event = self.take.get(self.next);
            let at_us = lap_start + event.t_us;
            if at_us > now_us {
                return;
            }
            events.push(CdEvent { t_us: clock.ticks_us(at_us * 1000), x: event.x, y: event.y, on: event.on });
            self.next += 1;
        }
    }
}

/// Frames of a take, which starts again when it has ended. A frame shows the picture nearest to the middle
/// of its exposure.
#[derive(Clone, Debug)]
pub struct TakeFrames {
    pictures: Vec<Arc<Picture>>,
    period_ns: i64,
}

impl TakeFrames {
    /// Renders `count` pictures, `period_ns` apart, each exposed for `exposure_ns`. Cameras show them at this size.
    #[must_use]
    pub fn film(view: &StageView<'_>, count: usize, period_ns: i64, exposure_ns: i64) -> Self {
        let pictures = (0..count.max(1) as i64)
            .map(|number| {
                let middle = number * period_ns;
                let linear = view.exposure([middle - exposure_ns / 2, middle + exposure_ns / 2], 4);
                let image = image(view, &linear);
                Arc::new(Picture { width: image.width, height: image.height, rgb: image.data })
            })
            .collect();
        Self::new(pictures, period_ns)
    }

    /// Plays pictures that are there already, `period_ns` apart; black if there are none.
    #[must_use]
    pub fn new(mut pictures: Vec<Arc<Picture>>, period_ns: i64) -> Self {
        if pictures.is_empty() {
            pictures.push(Arc::new(Picture { width: 1, height: 1, rgb: vec![0; 3] }));
        }
        Self { pictures, period_ns: period_ns.max(1) }
    }
}

impl FrameScene for TakeFrames {
    fn frame(&mut self, _number: u64, exposure_ns: [i64; 2], width: u32, height: u32) -> (u64, Arc<Picture>) {
        let middle = exposure_ns[0] / 2 + exposure_ns[1] / 2;
        let index = ((middle + self.period_ns / 2).div_euclid(self.period_ns)).rem_euclid(self.pictures.len() as i64);
        let picture = &self.pictures[index as usize];
        if (picture.width, picture.height) == (width, height) {
            return (index as u64, Arc::clone(picture));
        }
        (index as u64, Arc::new(resize(picture, width, height)))
    }

    fn known(&mut self, width: u32, height: u32) -> Vec<(u64, Arc<Picture>)> {
        (0..self.pictures.len() as i64).map(|index| self.frame(0, [index * self.period_ns; 2], width, height)).collect()
    }
}

/// The nearest pixels of a picture.
fn resize(picture: &Picture, width: u32, height: u32) -> Picture {
    let mut rgb = Vec::with_capacity((width * height * 3) as usize);
    for y in 0..height {
        let row = y * picture.height / height.max(1);
        for x in 0..width {
            let column = x * picture.width / width.max(1);
            let at = ((row * picture.width + column) * 3) as usize;
            rgb.extend_from_slice(&picture.rgb[at..at + 3]);
        }
    }
    Picture { width, height, rgb }
}
