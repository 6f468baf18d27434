//! What the cameras of a session saw of the wand, for the report.

use std::collections::HashMap;

use erfgs_events::{CdEvent, Sink};
use erfgs_scene::rig_file::RigFile;
use erfgs_session::{
    clock::EpochCursor,
    container::{ContainerError, Entry, Session},
    source::{LATE_NS, Packet},
};
use erfgs_sync::{StreamSync, Synchronisation};

use crate::{
    evidence::{Evidence, Picture},
    report::{EventHistogram, telling},
    wand::WandError,
};

/// A picture of each camera at the instant of the wand that tells most.
///
/// # Errors
/// If the session cannot be read.
pub fn pictures(
    session: &mut Session,
    sync: &Synchronisation,
    rig: &RigFile,
    evidence: &Evidence,
) -> Result<Vec<Picture>, WandError> {
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
            let exposures = clock.map(StreamSync::frames).unwrap_or_default();
            frames.insert(stream, (camera, placement, t_ns, exposures, None::<(i64, Packet)>));
        } else if let Some(sync) = clock {
            let picture = EventHistogram::new(description.width, description.height);
            let mut sink = Around { clock: sync.epochs.follow(), t_ns, picture };
            // Packets arrive later than what they hold, and clocks may be a little off.
            let arrival = [-LATE_NS, LATE_NS].map(|late| start.host_ns.saturating_add(t_ns).saturating_add(late));
            session.decode_events(stream, Some(arrival), &mut sink, |_| {})?;
            pictures.push(Picture::new(camera, Some(placement), &sink.picture.picture()));
        }
    }
    for entry in session.messages(None) {
        let (stream, packet) = match entry {
            Ok(Entry::Packet { stream, packet }) => (stream, packet),
            Err(error @ ContainerError::Read { .. }) => return Err(error.into()),
            _ => continue,
        };
        let Some((_, _, t_ns, exposures, nearest)) = frames.get_mut(&stream) else { continue };
        let mid = exposures
            .get(&packet.sequence)
            .map(|exposure| exposure.mid_ns)
            .unwrap_or_else(|| start.session_ns(packet.host_ns));
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

/// Gathers the events around an instant.
struct Around<'a> {
    clock: EpochCursor<'a>,
    t_ns: i64,
    picture: EventHistogram,
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
