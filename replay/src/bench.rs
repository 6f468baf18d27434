//! The speed of the simulator and of decoding.

use std::time::Instant;

use erfgs_base::cpu;
use erfgs_events::{CdEvent, Columns, Decoder, EventBatch, EventFile, Events, Sink};
use serde::Serialize;

use crate::simulator::{Luma, Simulator, SimulatorConfig, SimulatorError};

/// How fast the simulator was.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Pixels processed: width times height times frames.
    pub pixels: u64,
    /// Events made.
    pub events: u64,
    /// Threads used.
    pub threads: usize,
    /// Wall time of the fastest run, seconds.
    pub seconds: f64,
    /// Million pixels a second on each thread.
    pub mpix_per_s_per_core: f64,
    /// Million events a second.
    pub mevents_per_s: f64,
}

/// How fast an event file was decoded, in its fastest run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DecodeFigures {
    /// Name of the format.
    pub format: &'static str,
    /// Bytes decoded.
    pub bytes: u64,
    /// Events in them.
    pub events: u64,
    /// Processor time, seconds, so that other work on the machine counts little; by the clock where the system does not tell.
    pub seconds: f64,
    /// By the clock, seconds.
    pub wall_seconds: f64,
    /// Million events a second.
    #[serde(rename = "Mev_per_s")]
    pub mev_per_s: f64,
    /// Mebibytes a second.
    pub mib_per_s: f64,
}

/// Takes events alone.
struct EventsAlone(Columns);

impl Sink for EventsAlone {
    fn event(&mut self, event: CdEvent) {
        self.0.event(event);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        self.0.events(batch);
    }
}

/// Decodes the `body` of a file (what follows its header) into columns `runs` times, on one core, in pieces of 64 KiB as
/// drivers give them.
#[must_use]
pub fn decode(file: &EventFile, body: &[u8], runs: u32) -> DecodeFigures {
    let mut events = EventsAlone(Columns::default());
    let mut count = 0;
    let (mut seconds, mut wall_seconds) = (f64::INFINITY, f64::INFINITY);
    // The first run makes room and does not count.
    for run in 0..=runs.max(1) {
        let mut decoder = file.decoder();
        let (from, cpu_from) = (Instant::now(), cpu::thread_seconds());
        count = 0;
        for piece in body.chunks(1 << 16) {
            events.0.clear_events();
            decoder.decode(piece, &mut events);
            count += events.0.len() as u64;
        }
        events.0.clear_events();
        decoder.finish(&mut events);
        count += events.0.len() as u64;
        let (wall, cpu) = (from.elapsed().as_secs_f64(), cpu::thread_seconds());
        if run > 0 {
            wall_seconds = wall_seconds.min(wall);
            seconds = seconds.min(cpu.zip(cpu_from).map_or(wall, |(to, from)| to - from));
        }
    }
    DecodeFigures {
        format: file.format.name(),
        bytes: body.len() as u64,
        events: count,
        seconds,
        wall_seconds,
        mev_per_s: count as f64 / seconds * 1e-6,
        mib_per_s: body.len() as f64 / seconds / f64::from(1 << 20),
    }
}

/// Simulates `luma` (frames of `width` x `height` grey levels) at `fps` frames a second `runs` times on `threads` threads.
/// Making the sensor (its thresholds are drawn then) counts as part of a run.
///
/// # Errors
/// If the simulator refuses the frames or its configuration.
pub fn simulate(
    luma: &[u8],
    width: u32,
    height: u32,
    fps: f64,
    config: &SimulatorConfig,
    threads: usize,
    runs: u32,
) -> Result<Figures, SimulatorError> {
    // Where no pool of that size can be had, the work runs on the one that there is, and the figures say so.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().ok();
    let run = || {
        let start = Instant::now();
        let mut events = Events::new(width, height);
        let mut simulator = Simulator::new(width, height, config, 0)?;
        for (index, frame) in luma.chunks_exact(width as usize * height as usize).enumerate() {
            simulator.step(Luma::U8(frame), (index as f64 * 1e9 / fps).round() as i64, &mut events)?;
        }
        Ok((start.elapsed().as_secs_f64(), events.len()))
    };
    let all = || {
        let mut best: Option<(f64, usize)> = None;
        for _ in 0..runs.max(1) {
            let result = run()?;
            if best.is_none_or(|best| result.0 < best.0) {
                best = Some(result);
            }
        }
        Ok((best.unwrap_or_default(), rayon::current_num_threads()))
    };
    let ((seconds, events), threads) = pool.map_or_else(all, |pool| pool.install(all))?;
    let rate = |count: f64| if seconds > 0.0 { count / seconds * 1e-6 } else { 0.0 };
    Ok(Figures {
        pixels: luma.len() as u64,
        events: events as u64,
        threads,
        seconds,
        mpix_per_s_per_core: rate(luma.len() as f64) / threads as f64,
        mevents_per_s: rate(events as f64),
    })
}

/// Frames of a textured background before which a textured disc moves, for measuring without a recording. About one pixel
/// in twenty makes an event in a frame, as in a recorded throw.
#[must_use]
pub fn moving_disc(width: u32, height: u32, frames: u32) -> Vec<u8> {
    let (w, h) = (f64::from(width), f64::from(height));
    let texture = |x: f64, y: f64| (x * 0.7).sin() + (y * 0.9).cos() + (x * 0.13 + y * 0.21).sin();
    let radius = 0.15 * w.min(h);
    let mut luma = Vec::with_capacity(width as usize * height as usize * frames as usize);
    for frame in 0..frames {
        let phase = f64::from(frame) / 45.0;
        let centre = [w * (0.2 + 0.6 * phase.fract()), h * (0.5 - 0.3 * (std::f64::consts::PI * phase).sin())];
        for y in 0..height {
            for x in 0..width {
                let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
                let (dx, dy) = (x - centre[0], y - centre[1]);
                let inside = dx * dx + dy * dy < radius * radius;
                let level = if inside { 160.0 + 30.0 * texture(dx, dy) } else { 100.0 + 20.0 * texture(x, y) };
                luma.push(level as u8);
            }
        }
    }
    luma
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_count_what_was_done() {
        let luma = moving_disc(64, 48, 5);
        let figures = simulate(&luma, 64, 48, 30.0, &SimulatorConfig::default(), 2, 2).unwrap();
        assert_eq!((figures.pixels, figures.threads), (64 * 48 * 5, 2));
        assert!(figures.events > 100 && figures.seconds > 0.0 && figures.mpix_per_s_per_core > 0.0);
    }
}
