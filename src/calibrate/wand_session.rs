//! The wand's LEDs in a recorded session: events and frames of all cameras, on the session's clock.

use std::{collections::HashMap, path::Path};

use anyhow::Context;
use erfgs_calibrate::{
    evidence::{Evidence, Picture},
    report::{EventPicture, telling},
    wand::{
        Sighting, Stick, WandCamera,
        detect::{BlinkDetector, BlinkOptions, BrightOptions, Lights, bright_lights, choose},
    },
};
use erfgs_events::{CdEvent, Sink};
use erfgs_scene::rig_file::RigFile;
use erfgs_session::{
    clock::{Dated, EpochCursor},
    container::{ContainerError, Entry, Session},
    source::{Description, Packet},
};
use erfgs_sync::{StreamSync, Synchronisation};

use crate::{errors::Usage, sync, terminal::Terminal};

/// A session, and its clocks.
pub struct Recording {
    session: Session,
    sync: Synchronisation,
}

impl Recording {
    /// Opens a session.
    pub fn open(path: &Path, terminal: &Terminal) -> anyhow::Result<Self> {
        let mut session = Session::open(path)?;
        let sync = sync::of_session(&mut session, terminal)?;
        Ok(Self { session, sync })
    }
}

/// Looks for the wand in all cameras of a session that `rig` has intrinsics for.
pub fn look(
    recording: &mut Recording,
    rig: Option<&RigFile>,
    stick: &Stick,
    options: &BlinkOptions,
    terminal: &Terminal,
) -> anyhow::Result<Vec<WandCamera>> {
    let Recording { session, sync } = recording;
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
            blinking(session, index, &description, clock, options, |bytes, total| {
                progress.update(bytes, total, "bytes");
            })?
        } else {
            bright(session, index, &description, clock, |frames, total| progress.update(frames, total, "frames"))?
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

/// A picture of each camera at the instant of the wand that tells most.
pub fn pictures(recording: &mut Recording, rig: &RigFile, evidence: &Evidence) -> anyhow::Result<Vec<Picture>> {
    let Recording { session, sync } = recording;
    let start = session.summary().start.clone();
    let streams = session.summary().streams.clone();
    let (mut pictures, mut frames) = (Vec::new(), HashMap::new());
    for (camera, placement) in telling(rig, evidence) {
        let known = &rig.cameras[camera];
        let Some(stream) = streams.iter().position(|stream| stream.description.id == known.name) else { continue };
        let Some(t_ns) = evidence.moments.get(placement).and_then(|moment| moment.t_ns) else { continue };
        // By the camera's own clock.
        let t_ns = t_ns - (1e9 * known.time_offset_s).round() as i64;
        let (description, clock) = (&streams[stream].description, sync.stream(&known.name));
        if description.encoding.is_frames() {
            let mids = clock.map(StreamSync::exposure_mids).unwrap_or_default();
            frames.insert(stream, (camera, placement, t_ns, mids, None::<(i64, Packet)>));
        } else if let Some(sync) = clock {
            let picture = EventPicture::new(description.width, description.height);
            let mut sink = Around { clock: sync.epochs.follow(), t_ns, picture };
            let from = start.host_ns.saturating_add(t_ns).saturating_sub(EARLIER_NS);
            session.decode_events(stream, Some([from, i64::MAX]), &mut sink, |_| {})?;
            pictures.push(Picture::new(camera, Some(placement), &sink.picture.picture()));
        }
    }
    for entry in session.messages(None) {
        let (stream, packet) = match entry {
            Ok(Entry::Packet { stream, packet }) => (stream, packet),
            Err(error @ ContainerError::Read { .. }) => return Err(error.into()),
            _ => continue,
        };
        let Some((_, _, t_ns, mids, nearest)) = frames.get_mut(&stream) else { continue };
        let mid = mids.get(&packet.sequence).copied().unwrap_or_else(|| start.session_ns(packet.host_ns));
        let away = mid.saturating_sub(*t_ns).saturating_abs();
        if nearest.as_ref().is_none_or(|(least, _)| away < *least) {
            *nearest = Some((away, packet));
        }
    }
    for (stream, (camera, placement, _, _, nearest)) in frames {
        let d = &streams[stream].description;
        let image = nearest.and_then(|(_, packet)| d.frame_format()?.picture(&packet.payload).ok());
        pictures.extend(image.map(|image| Picture::new(camera, Some(placement), &image)));
    }
    pictures.sort_by_key(|picture| picture.camera);
    Ok(pictures)
}

/// Events of this time before and after an instant make a picture of it.
const AROUND_NS: i64 = 5_000_000;
/// Packets arrive later than what they hold.
const EARLIER_NS: i64 = 500_000_000;

/// Gathers the events around an instant.
struct Around<'a> {
    clock: EpochCursor<'a>,
    t_ns: i64,
    picture: EventPicture,
}

impl Sink for Around<'_> {
    fn packet(&mut self, sequence: u64) {
        self.clock.packet(sequence);
    }

    fn discontinuity(&mut self, _t_us: u64) {
        self.clock.discontinuity();
    }

    fn event(&mut self, event: CdEvent) {
        let Some(t_ns) = self.clock.session_ns(event.t_us) else { return };
        if t_ns.saturating_sub(self.t_ns).saturating_abs() <= AROUND_NS {
            self.picture.add(event.x, event.y, event.on);
        }
    }
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
    let epochs = sync.map(|sync| &sync.epochs).filter(|epochs| !epochs.are_undated());
    let epochs = epochs.with_context(|| format!("stream {} has no clock; `erfgs sync` tells why", description.id))?;
    let total = session.summary().streams[stream].totals.bytes;
    let side = |pixels: u32| u16::try_from(pixels).context("the sensor's size makes no sense");
    let detector = BlinkDetector::new(side(description.width)?, side(description.height)?, options.clone());
    // By the session's clock: the device's own may begin again.
    let mut sink = Dated::new(epochs, Blinks(detector.map_err(Usage)?));
    session.decode_events(stream, None, &mut sink, |bytes| progress(bytes, total))?;
    let mut lights = sink.inner.0.finish();
    for lights in &mut lights {
        lights.t *= 1000;
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
        let Some(Ok(image)) = description.frame_format().map(|format| format.picture(&packet.payload)) else {
            continue;
        };
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
