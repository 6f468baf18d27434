//! A playback that is steered from the live page.

use erfgs_recorder::live::{Playback, PlaybackOrder, PlaybackStatus};
use erfgs_replay::{Controls, Player, Speed};

/// Slowest and fastest that the page may ask for.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.001..=1000.0;

/// See the module.
pub struct Steering {
    controls: Controls,
    length_ns: i64,
    epoch_ns: i64,
    repeat: bool,
    /// The streams with frames: name, place in the recording, nanoseconds from frame to frame.
    cameras: Vec<(String, usize, i64)>,
}

impl Steering {
    /// Steers what `player` plays.
    pub fn new(player: &Player, repeat: bool) -> Self {
        let summary = player.summary();
        let length_ns = summary.span_ns().map_or(0, |[_, last]| summary.start.session_ns(last)).max(1);
        let camera = |(stream, recorded): (usize, &erfgs_session::container::Stream)| {
            let period_ns = 1e9 / recorded.totals.rate_hz().filter(|&rate| rate > 0.01).unwrap_or(30.0);
            let is_camera = recorded.description.encoding.is_frames();
            is_camera.then(|| (recorded.description.id.clone(), stream, period_ns as i64))
        };
        Self {
            controls: player.controls(),
            length_ns,
            epoch_ns: summary.start.epoch_ns,
            repeat,
            cameras: summary.streams.iter().enumerate().filter_map(camera).collect(),
        }
    }

    fn camera(&self, name: &str) -> Result<&(String, usize, i64), String> {
        let found = self.cameras.iter().find(|(id, ..)| name.is_empty() || id == name);
        found.ok_or_else(|| match name {
            "" => "the recording has no camera with frames".into(),
            name => format!("the recording has no camera '{name}' with frames"),
        })
    }
}

impl Playback for Steering {
    fn status(&self) -> PlaybackStatus {
        PlaybackStatus {
            position_ns: self.controls.position_ns().unwrap_or(0).clamp(0, self.length_ns),
            length_ns: self.length_ns,
            epoch_ns: self.epoch_ns,
            paused: self.controls.paused(),
            finished: self.controls.finished(),
            repeat: self.repeat,
            speed: match self.controls.speed() {
                Speed::Times(times) => Some(times),
                Speed::Max => None,
            },
            cameras: self.cameras.iter().map(|(id, ..)| id.clone()).collect(),
        }
    }

    fn order(&self, order: &PlaybackOrder) -> Result<(), String> {
        let controls = &self.controls;
        match order {
            PlaybackOrder::Pause => controls.pause(true),
            PlaybackOrder::Play => {
                let over = controls.finished();
                controls.pause(false);
                if over {
                    controls.seek(0);
                }
            }
            PlaybackOrder::Seek(to_ns) => controls.seek((*to_ns).clamp(0, self.length_ns)),
            PlaybackOrder::Step(span_ns) => controls.step(*span_ns),
            PlaybackOrder::Frame(name) => controls.step_packet(self.camera(name)?.1),
            PlaybackOrder::FrameBack(name) => controls.step(-self.camera(name)?.2),
            PlaybackOrder::Speed(times) if SPEEDS.contains(times) => controls.set_speed(Speed::Times(*times)),
            PlaybackOrder::Speed(times) => return Err(format!("a speed of {times}: it can be 0.001 to 1000")),
        }
        Ok(())
    }
}
