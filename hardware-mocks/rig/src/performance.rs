//! The stage before the cameras. Before the performance and after it everything stands still.

use std::sync::Arc;

use erfgs_events::{CdEvent, Events};
use erfgs_hardware_mocks::usb::{
    clock::TimeBase,
    scene::{EventScene, FrameScene, Picture},
};
use erfgs_stage::{EventOptions, StageError, StageView, events, film::image};

/// Between two instants of an exposure nothing moves farther than this, pixels.
const EXPOSURE_STEP_PX: f64 = 0.7;

/// Pictures of the stage, each exposed for as long as its camera's shutter is open.
pub struct StageFrames {
    view: StageView<'static>,
    begin_ns: i64,
    length_ns: i64,
    still: [Option<Arc<Picture>>; 2],
}

impl StageFrames {
    /// What a frame camera sees; the performance begins at `begin_ns` of the world's time.
    #[must_use]
    pub fn new(view: StageView<'static>, begin_ns: i64, length_ns: i64) -> Self {
        Self { view, begin_ns, length_ns, still: [None, None] }
    }

    fn picture(&self, shutter: [i64; 2]) -> Arc<Picture> {
        let samples = self.view.exposure_samples(shutter, EXPOSURE_STEP_PX);
        let image = image(&self.view, &self.view.exposure(shutter, samples));
        Arc::new(Picture { width: image.width, height: image.height, rgb: image.data })
    }
}

impl FrameScene for StageFrames {
    fn frame(&mut self, number: u64, exposure_ns: [i64; 2], _width: u32, _height: u32) -> (u64, Arc<Picture>) {
        let shutter = exposure_ns.map(|t_ns| (t_ns - self.begin_ns).clamp(0, self.length_ns));
        if shutter[0] < shutter[1] {
            return (2 + number, self.picture(shutter));
        }
        let after = usize::from(shutter[0] > 0);
        let picture = match &self.still[after] {
            Some(picture) => Arc::clone(picture),
            None => Arc::clone(self.still[after].insert(self.picture(shutter))),
        };
        (after as u64, picture)
    }
}

/// The events of the performance.
pub struct StageEvents {
    played: Played,
    begin_ns: i64,
}

impl StageEvents {
    /// Records the performance ahead, with a sensor whose response is that of real ones: the logarithm of light, in steps of the
    /// `thresholds` of ON and OFF events. `progress` hears the share that is done.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn record(
        view: &StageView<'_>,
        [begin_ns, length_ns]: [i64; 2],
        [threshold_on, threshold_off]: [f64; 2],
        seed: u64,
        stream: u64,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Self, StageError> {
        let options = EventOptions {
            threshold_on,
            threshold_off,
            linear_light: true,
            lin_log_threshold: 2.0,
            ..EventOptions::default()
        };
        let events = events::record(view, [0, length_ns], &options, seed, stream, progress)?;
        Ok(Self { played: Played::new(events), begin_ns })
    }
}

impl EventScene for StageEvents {
    fn begin(&mut self, _clock: &TimeBase, now_ns: i64) {
        self.played.skip(self.begin_ns, now_ns);
    }

    fn until(&mut self, clock: &TimeBase, now_ns: i64, events: &mut Vec<CdEvent>) {
        self.played.until(self.begin_ns, clock, now_ns, events);
    }
}

/// Events that are there already, and which of them comes next.
pub(crate) struct Played {
    events: Events,
    next: usize,
}

impl Played {
    /// All of them are still to come.
    pub(crate) fn new(events: Events) -> Self {
        Self { events, next: 0 }
    }

    /// Passes over those until `now_ns` of the world's time, where they begin at `begin_ns` of it.
    fn skip(&mut self, begin_ns: i64, now_ns: i64) {
        self.next = self.events.t_us.partition_point(|&t_us| at_ns(begin_ns, t_us) <= now_ns);
    }

    /// Appends those until `now_ns`, stamped with the sensor's clock.
    pub(crate) fn until(&mut self, begin_ns: i64, clock: &TimeBase, now_ns: i64, events: &mut Vec<CdEvent>) {
        while self.next < self.events.len() {
            let event = self.events.get(self.next);
            let at_ns = at_ns(begin_ns, event.t_us);
            if at_ns > now_ns {
                return;
            }
            events.push(CdEvent { t_us: clock.ticks_us(at_ns), x: event.x, y: event.y, on: event.on });
            self.next += 1;
        }
    }
}

fn at_ns(begin_ns: i64, t_us: i64) -> i64 {
    begin_ns + 1000 * t_us
}
