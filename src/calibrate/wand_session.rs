//! The wand's LEDs in a recorded session: events and frames of all cameras, on the session's clock.

use std::path::Path;

use anyhow::Context;
use erfgs_calibrate::{
    rig_file::RigFile,
    wand::{
        Sighting, Stick, WandCamera,
        detect::{BlinkDetector, BlinkOptions, BrightOptions, Lights, bright_lights, choose},
    },
};
use erfgs_rig::sync::{StreamSync, SyncOptions, Synchronisation, synchronise};
use erfgs_session::{
    codec::{CdEvent, Sink},
    container::{ContainerError, Entry, Session},
    pixel,
    source::Description,
};

use crate::{errors::Usage, terminal::Terminal};

/// Looks for the wand in all cameras of a session that `rig` has intrinsics for.
pub fn look(
    path: &Path,
    rig: Option<&RigFile>,
    stick: &Stick,
    options: &BlinkOptions,
    terminal: &Terminal,
) -> anyhow::Result<Vec<WandCamera>> {
    let mut session = Session::open(path)?;
    let sync = synchronisation(&mut session, terminal)?;
    let mut cameras = Vec::new();
    let mut without = Vec::new();
    for index in 0..session.summary().streams.len() {
        let description = session.summary().streams[index].description.clone();
        if !description.encoding.is_events() && !description.encoding.is_frames() {
            continue;
        }
        let Some(known) = rig.and_then(|rig| rig.camera(&description.id)) else {
            without.push(description.id);
            continue;
        };
        let intrinsics = known.intrinsics;
        let clock = sync.stream(&description.id);
        let progress = terminal.progress(&description.id);
        let lights = if description.encoding.is_events() {
            blinking(&mut session, index, &description, clock, options, |bytes, total| {
                progress.update(bytes, total, "bytes");
            })?
        } else {
            bright(&mut session, index, &description, clock, |frames, total| progress.update(frames, total, "frames"))?
        };
        drop(progress);
        let total = lights.len();
        let sightings: Vec<Sighting> = lights
            .into_iter()
            .filter_map(|lights| {
                let leds = choose(stick, &intrinsics, &lights.by_frequency)?;
                Some(Sighting { t_ns: lights.t, leds })
            })
            .collect();
        terminal.note(format!("{}: lights at {total} instants, the wand at {}", description.id, sightings.len()));
        cameras.push(WandCamera {
            name: description.id,
            modality: known.modality,
            intrinsics,
            sigma_px: None,
            sightings,
        });
    }
    if cameras.len() < 2 {
        let what = format!(
            "a wand in a session needs known intrinsics: give a rig file that has them with --rig; there are none for {}",
            without.join(", ")
        );
        return Err(Usage(what).into());
    }
    if !without.is_empty() {
        terminal.note(format!("left out, as the rig file has no intrinsics for them: {}", without.join(", ")));
    }
    Ok(cameras)
}

/// The session's clocks, from the file beside it where `erfgs sync` wrote one.
fn synchronisation(session: &mut Session, terminal: &Terminal) -> anyhow::Result<Synchronisation> {
    let beside = Synchronisation::file_beside(session.path());
    if beside.is_file() {
        return Ok(Synchronisation::load(&beside)?);
    }
    let total: u64 = session.summary().streams.iter().map(|stream| stream.totals.bytes).sum();
    let progress = terminal.progress("clocks");
    Ok(synchronise(session, SyncOptions { flash: false }, |bytes| progress.update(bytes, total, "bytes"))?)
}

/// Hands events to the detector.
struct Blinks(BlinkDetector);

impl Sink for Blinks {
    fn event(&mut self, event: CdEvent) {
        self.0.event(i64::try_from(event.t_us).unwrap_or(i64::MAX), event.x, event.y, event.on);
    }
}

fn blinking(
    session: &mut Session,
    stream: usize,
    description: &Description,
    sync: Option<&StreamSync>,
    options: &BlinkOptions,
    progress: impl Fn(u64, u64),
) -> anyhow::Result<Vec<Lights>> {
    let clock = sync.and_then(|sync| sync.clock.as_ref());
    let clock = clock.with_context(|| format!("stream {} has no clock; `erfgs sync` tells why", description.id))?;
    let total = session.summary().streams[stream].totals.bytes;
    let side = |pixels: u32| u16::try_from(pixels).context("the sensor's size makes no sense");
    let detector = BlinkDetector::new(side(description.width)?, side(description.height)?, options.clone());
    let mut sink = Blinks(detector.map_err(Usage)?);
    session.decode_events(stream, None, &mut sink, |bytes| progress(bytes, total))?;
    let mut lights = sink.0.finish();
    for lights in &mut lights {
        lights.t = clock.session_ns(lights.t);
    }
    Ok(lights)
}

fn bright(
    session: &mut Session,
    stream: usize,
    description: &Description,
    sync: Option<&StreamSync>,
    progress: impl Fn(u64, u64),
) -> anyhow::Result<Vec<Lights>> {
    let total = session.summary().streams[stream].totals.packets;
    let start = session.summary().start.clone();
    let mids = sync.map(StreamSync::exposure_mids).unwrap_or_default();
    let (mut found, mut done) = (Vec::new(), 0);
    for entry in session.messages(None) {
        let packet = match entry {
            Ok(Entry::Packet { stream: of, packet }) if of == stream => packet,
            Err(error @ ContainerError::Read { .. }) => return Err(error.into()),
            _ => continue,
        };
        done += 1;
        progress(done, total);
        let (width, height) = (description.width, description.height);
        let Ok(image) = pixel::decode(description.encoding, width, height, &packet.payload) else { continue };
        let lights = bright_lights(&image.grey(), &BrightOptions::default());
        if !lights.is_empty() {
            let t = mids.get(&packet.sequence).copied().unwrap_or_else(|| start.session_ns(packet.host_ns));
            found.push(Lights { t, by_frequency: vec![lights] });
        }
    }
    Ok(found)
}

#[cfg(test)]
#[path = "wand_session_tests.rs"]
mod tests;
