//! The wand's LEDs in a recorded session: events and frames of all cameras, on the session's clock.

mod pictures;

use erfgs_base::progress::Progress;
use erfgs_events::{CdEvent, Sink};
use erfgs_scene::rig_file::{RigCamera, RigFile};
use erfgs_session::{
    clock::Dated,
    container::{ContainerError, Entry, Session, sensor_size},
    source::Description,
};
use erfgs_sync::{StreamSync, Synchronisation};

use super::{
    Sighting, Stick, WandCamera, WandError,
    detect::{BlinkDetector, BlinkOptions, BrightOptions, Lights, bright_lights, choose},
};

pub use pictures::pictures;

/// What was found in a session.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    /// The cameras that were looked at, and where they saw the wand.
    pub cameras: Vec<WandCamera>,
    /// At how many instants each of them saw lights, the wand's or others.
    pub lit: Vec<usize>,
    /// Streams that were left out, as their intrinsics are not known.
    pub without: Vec<String>,
}

/// Looks for the wand in all cameras of a session that `rig` has intrinsics for; their poses are of no account. The session's
/// clocks are those of `sync`. `progress` is called with the stream that is looked at.
///
/// # Errors
/// If fewer than two cameras have intrinsics, an event camera has no clock, the options make no sense, or the session cannot
/// be read.
pub fn look_session(
    session: &mut Session,
    sync: &Synchronisation,
    rig: Option<&RigFile>,
    stick: &Stick,
    options: &BlinkOptions,
    progress: &mut dyn FnMut(&str, Progress),
) -> Result<Found, WandError> {
    let mut found = Found::default();
    let mut known: Vec<(usize, Description, &RigCamera)> = Vec::new();
    for (index, stream) in session.summary().streams.iter().enumerate() {
        let d = &stream.description;
        if !d.encoding.is_events() && !d.encoding.is_frames() {
            continue;
        }
        match rig.and_then(|rig| rig.camera(&d.id)) {
            Some(camera) => known.push((index, d.clone(), camera)),
            None => found.without.push(d.id.clone()),
        }
    }
    if known.len() < 2 {
        return Err(WandError::NoIntrinsics { cameras: found.without });
    }
    for (index, description, camera) in known {
        let clock = sync.stream(&description.id);
        let mut tell = |step: Progress| progress(&description.id, step);
        let lights = if description.encoding.is_events() {
            blinking(session, index, &description, clock, options, &mut tell)?
        } else {
            bright(session, index, &description, clock, &mut tell)?
        };
        found.lit.push(lights.len());
        let intrinsics = camera.intrinsics;
        let sightings = lights.into_iter().filter_map(|lights| {
            let leds = choose(stick, &intrinsics, &lights.by_frequency)?;
            Some(Sighting { t_ns: lights.t, leds })
        });
        found.cameras.push(WandCamera {
            sightings: sightings.collect(),
            name: description.id,
            modality: camera.modality,
            intrinsics,
            sigma_px: None,
        });
    }
    Ok(found)
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
    progress: &mut dyn FnMut(Progress),
) -> Result<Vec<Lights>, WandError> {
    let epochs = sync.map(|sync| &sync.epochs).filter(|epochs| !epochs.are_undated());
    let epochs = epochs.ok_or_else(|| WandError::NoClock { stream: description.id.clone() })?;
    let total = session.summary().streams[stream].totals.bytes;
    let size = sensor_size(description).ok_or_else(|| WandError::SensorSize { stream: description.id.clone() })?;
    let detector = BlinkDetector::new(size.width, size.height, options.clone()).map_err(WandError::Option)?;
    // By the session's clock: the device's own may begin again.
    let mut sink = Dated::new(epochs, Blinks(detector));
    session.decode_events(stream, None, &mut sink, |done| progress(Progress { what: "bytes", done, total }))?;
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
    progress: &mut dyn FnMut(Progress),
) -> Result<Vec<Lights>, WandError> {
    let total = session.summary().streams[stream].totals.packets;
    let start = session.summary().start.clone();
    let exposures = sync.map(StreamSync::frames).unwrap_or_default();
    let (mut found, mut done) = (Vec::new(), 0);
    for entry in session.messages(None) {
        let packet = match entry {
            Ok(Entry::Packet { stream: of, packet }) if of == stream => packet,
            Err(error @ ContainerError::Read { .. }) => return Err(error.into()),
            _ => continue,
        };
        done += 1;
        progress(Progress { what: "frames", done, total });
        let Some(Ok(image)) = description.frame_format().map(|format| format.picture(&packet.payload)) else {
            continue;
        };
        let lights = bright_lights(&image.grey(), &BrightOptions::default());
        if !lights.is_empty() {
            let t = exposures
                .get(&packet.sequence)
                .map(|exposure| exposure.mid_ns)
                .unwrap_or_else(|| start.session_ns(packet.host_ns));
            found.push(Lights { t, by_frequency: vec![lights] });
        }
    }
    Ok(found)
}
