//! Sources without a device: a turning wheel as events or as frames, for trying the recorder, the page and the disk.

use std::{
    f64::consts::TAU,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use bytes::Bytes;
use erfgs_events::EventEncoding;
use erfgs_scene::{image::jpeg, pixel::PixelFormat};
use erfgs_session::source::{
    Counters, Description, Encoding, FrameStamp, Outlet, Packet, Source, SourceError, StampClock, StampPoint,
};
use serde::{Deserialize, Serialize};

use erfgs_rig::host_time::host_ns;

/// Turns of the wheel a second.
const TURNS_HZ: f64 = 0.5;
/// Spokes of the wheel.
const SPOKES: u32 = 5;
/// Frames are drawn once, for one fifth of a turn, after which the wheel looks the same.
const DRAWN: u32 = 24;

/// What a pattern delivers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PatternKind {
    /// EVT 3.0 events of the edges of the spokes.
    #[default]
    Events,
    /// MJPEG frames.
    Frames,
}

/// A table `[[pattern]]` of `RIG.toml`: a built-in source that needs no device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PatternConfig {
    /// `"events"` or `"frames"`.
    pub delivers: PatternKind,
    /// Columns, 64 to 2048.
    pub width: u32,
    /// Rows, 64 to 2048.
    pub height: u32,
    /// Packets of events, or frames, a second: 1 to 1000.
    pub rate_hz: f64,
    /// For events: how many a packet holds, at most; 1 to 1,000,000.
    pub events_per_packet: u32,
}

impl Default for PatternConfig {
    fn default() -> Self {
        Self { delivers: PatternKind::Events, width: 640, height: 480, rate_hz: 30.0, events_per_packet: 20_000 }
    }
}

impl PatternConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// A sentence about the value that is out of range.
    pub fn validate(&self) -> Result<(), String> {
        let size = 64..=2048;
        if !size.contains(&self.width) || !size.contains(&self.height) {
            return Err(format!("width and height are {} and {}; both can be 64 to 2048", self.width, self.height));
        }
        if !(1.0..=1000.0).contains(&self.rate_hz) {
            return Err(format!("rate_hz is {}; it can be 1 to 1000", self.rate_hz));
        }
        if !(1..=1_000_000).contains(&self.events_per_packet) {
            return Err(format!("events_per_packet is {}; it can be 1 to 1000000", self.events_per_packet));
        }
        Ok(())
    }
}

/// A built-in source. Its model says that no camera is behind it.
pub struct Pattern {
    description: Description,
    config: PatternConfig,
    quit: Arc<AtomicBool>,
    counters: Arc<Mutex<Counters>>,
    thread: Option<JoinHandle<()>>,
}

impl Pattern {
    /// A pattern as the stream `id`.
    ///
    /// # Errors
    /// If the configuration is out of range.
    pub fn open(id: &str, config: PatternConfig) -> Result<Self, String> {
        config.validate()?;
        let encoding = match config.delivers {
            PatternKind::Events => Encoding::Events(EventEncoding::Evt3),
            PatternKind::Frames => Encoding::Frames(PixelFormat::Mjpeg),
        };
        let mut settings = serde_json::Map::new();
        settings.insert("rate_hz".into(), config.rate_hz.into());
        let description = Description {
            id: id.to_owned(),
            model: "built-in test pattern (no camera)".into(),
            serial: String::new(),
            encoding,
            width: config.width,
            height: config.height,
            start_order: 0,
            settings,
        };
        let (quit, counters) = Default::default();
        Ok(Self { description, config, quit, counters, thread: None })
    }
}

impl Source for Pattern {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        if self.thread.is_some() {
            return Ok(());
        }
        self.quit.store(false, Relaxed);
        let (config, quit, counters) = (self.config.clone(), Arc::clone(&self.quit), Arc::clone(&self.counters));
        let thread = thread::Builder::new().name(format!("pattern-{}", self.description.id));
        self.thread = Some(thread.spawn(move || deliver(&config, &quit, &counters, outlet.as_ref()))?);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.quit.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            thread.join().map_err(|_| "the thread of the pattern panicked: this is a bug of erfgs")?;
        }
        Ok(())
    }

    fn counters(&self) -> Counters {
        *self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Pattern {
    fn drop(&mut self) {
        let _ = self.stop();
    }
}

fn deliver(config: &PatternConfig, quit: &AtomicBool, counters: &Mutex<Counters>, outlet: &dyn Outlet) {
    let frames: Vec<Bytes> = match config.delivers {
        PatternKind::Events => Vec::new(),
        PatternKind::Frames => (0..DRAWN).filter_map(|index| frame(config, index)).collect(),
    };
    let (begun, begun_ns) = (Instant::now(), host_ns());
    for sequence in 0_u64.. {
        let due_s = (sequence + 1) as f64 / config.rate_hz;
        let due = begun + Duration::from_secs_f64(due_s);
        while Instant::now() < due && !quit.load(Relaxed) {
            thread::park_timeout(due.saturating_duration_since(Instant::now()));
        }
        if quit.load(Relaxed) {
            return;
        }
        let (payload, stamp) = match config.delivers {
            PatternKind::Events => (events(config, [due_s - 1.0 / config.rate_hz, due_s]), None),
            PatternKind::Frames => {
                let phase = (due_s * TURNS_HZ * f64::from(SPOKES)).fract();
                let Some(frame) = frames.get((phase * f64::from(DRAWN)) as usize) else { return };
                let stamp = FrameStamp {
                    kernel_ns: begun_ns + (due_s * 1e9) as i64,
                    clock: StampClock::Monotonic,
                    point: StampPoint::EndOfFrame,
                    sequence: sequence as u32,
                };
                (frame.clone(), Some(stamp))
            }
        };
        let bytes = payload.len() as u64;
        let (host_ns, discontinuity, damaged) = (host_ns(), false, false);
        let taken = outlet.send(Packet { sequence, host_ns, discontinuity, damaged, stamp, payload });
        counters.lock().unwrap_or_else(PoisonError::into_inner).deliver(bytes, damaged, taken);
    }
}

/// The words of EVT 3.0 for the edges of the spokes between two times, seconds.
fn events(config: &PatternConfig, span_s: [f64; 2]) -> Bytes {
    let centre = [f64::from(config.width) / 2.0, f64::from(config.height) / 2.0];
    let radius = 0.46 * f64::from(config.width.min(config.height));
    // Steps in time, so that an edge moves by about a pixel at the rim between two.
    let turned = (span_s[1] - span_s[0]) * TURNS_HZ * TAU * radius;
    let steps = (turned.ceil() as u32).clamp(1, 1000);
    let per_edge = (config.events_per_packet / (steps * 2 * SPOKES)).clamp(1, radius as u32);
    let mut words = Vec::with_capacity(4 + 2 * config.events_per_packet as usize);
    for step in 0..steps {
        let time_s = span_s[0] + (span_s[1] - span_s[0]) * f64::from(step) / f64::from(steps);
        let time_us = (time_s * 1e6) as u64;
        words.push(0x8000 | (time_us >> 12 & 0xfff) as u16);
        words.push(0x6000 | (time_us & 0xfff) as u16);
        for edge in 0..2 * SPOKES {
            let angle = TAU * (time_s * TURNS_HZ + f64::from(edge) / f64::from(2 * SPOKES));
            let on = u16::from(edge % 2 == 0);
            for index in 0..per_edge {
                let at = radius * (0.15 + 0.85 * (f64::from(index) + 0.5) / f64::from(per_edge));
                let [x, y] = [centre[0] + at * angle.cos(), centre[1] + at * angle.sin()];
                words.push(y as u16 & 0x7ff);
                words.push(0x2000 | on << 11 | x as u16 & 0x7ff);
            }
        }
    }
    words.into_iter().flat_map(u16::to_le_bytes).collect()
}

/// A frame of the wheel, JPEG.
fn frame(config: &PatternConfig, index: u32) -> Option<Bytes> {
    let (width, height) = (config.width, config.height);
    let turned = f64::from(index) / f64::from(DRAWN) / f64::from(SPOKES);
    let radius = 0.46 * f64::from(width.min(height));
    let mut rgb = Vec::with_capacity((3 * width * height) as usize);
    for row in 0..height {
        for column in 0..width {
            let [x, y] = [f64::from(column) - f64::from(width) / 2.0, f64::from(row) - f64::from(height) / 2.0];
            let inside = (0.15 * radius..radius).contains(&x.hypot(y));
            let spoke = ((y.atan2(x) / TAU - turned).rem_euclid(1.0) * f64::from(SPOKES)).fract() < 0.5;
            let shade = 60 + (column * 60 / width) as u8 + (row * 60 / height) as u8;
            rgb.extend(if inside && spoke {
                [235, 235, 225]
            } else if inside {
                [40, 44, 60]
            } else {
                [shade; 3]
            });
        }
    }
    jpeg(&rgb, width, height, 85).map(Bytes::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_lie_on_the_sensor_and_their_times_follow_each_other() {
        let config = PatternConfig::default();
        let bytes = events(&config, [1.0, 1.0 + 1.0 / 30.0]);
        let (mut time, mut high, mut count) = (0, 0, 0);
        for word in bytes.as_chunks::<2>().0.iter().map(|pair| u16::from_le_bytes(*pair)) {
            match word >> 12 {
                0x8 => high = u32::from(word & 0xfff) << 12,
                0x6 => {
                    let now = high | u32::from(word & 0xfff);
                    assert!(now >= time && (1_000_000..1_033_400).contains(&now), "{now}");
                    time = now;
                }
                0x0 => assert!(word < 480),
                0x2 => {
                    assert!(word & 0x7ff < 640);
                    count += 1;
                }
                other => panic!("unexpected word type {other}"),
            }
        }
        assert!((5_000..=20_000).contains(&count), "{count}");
    }

    #[test]
    fn frames_are_jpeg_images_of_the_size_asked_for() {
        let config = PatternConfig { delivers: PatternKind::Frames, width: 128, height: 96, ..Default::default() };
        let image = image::load_from_memory(&frame(&config, 0).unwrap()).unwrap();
        assert_eq!((image.width(), image.height()), (128, 96));
    }

    #[test]
    fn settings_out_of_range_are_refused_with_the_range() {
        let with = |change: fn(&mut PatternConfig)| {
            let mut config = PatternConfig::default();
            change(&mut config);
            Pattern::open("p", config).map(drop).unwrap_err()
        };
        assert!(with(|config| config.width = 5000).contains("64 to 2048"));
        assert!(with(|config| config.rate_hz = f64::NAN).contains("1 to 1000"));
        assert!(with(|config| config.events_per_packet = 0).contains("1000000"));
    }
}
