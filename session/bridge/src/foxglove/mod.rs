//! A recording as messages of Foxglove in an MCAP file: pictures of frames and of events, lenses and poses, on the session's clock.

mod coded;
mod events;
mod messages;
mod schema;

use std::{collections::BTreeMap, fs::File, io::BufWriter, path::Path};

use erfgs_base::atomic;
use erfgs_scene::rig_file::RigFile;
use erfgs_session::{
    container::{SessionStart, sensor_size},
    source::Description,
};
use erfgs_sync::reading::{Depth, FrameLook, Part, Slice, SliceOptions, Slices, TimedRecording};
use rayon::prelude::*;

pub use self::events::EventPictures;
use self::{coded::Shown, events::EventPictureStream};
use crate::{
    BridgeError, Written,
    log::{Log, Schema},
    rig::Placed,
};

/// The longest slice that is read at once, nanoseconds.
const SLICE_NS: i64 = 100_000_000;
/// What events may lie before the beginning of the recording, nanoseconds: they are in packets that arrived after.
const LEAD_NS: i64 = 1_000_000_000;

/// What is written.
#[derive(Clone, Debug, Default)]
pub struct FoxgloveChoice<'a> {
    /// The streams; `None` for those of all cameras.
    pub streams: Option<Vec<String>>,
    /// What was seen within these session times, nanoseconds; `None` for all.
    pub span_ns: Option<[i64; 2]>,
    /// Where the cameras stand, and their lenses.
    pub rig: Option<&'a RigFile>,
    /// How events become pictures.
    pub events: EventPictures,
    /// The quality (1 to 100) with which frames become JPEG images that the camera did not send as such; `None` for PNG, which keeps
    /// all their bits.
    pub jpeg: Option<u8>,
    /// How many bits of samples of 16 count (AEDAT 4), where that is said.
    pub bits: Option<u8>,
}

/// Writes a recording to `path`, which appears whole or not at all. `progress` is called with the nanoseconds of the recording that are
/// done, and all of them.
///
/// # Errors
/// If the recording cannot be read, nothing in it is dated, the rig file is of others, or the file cannot be written.
pub fn write(
    recording: &mut TimedRecording,
    choice: &FoxgloveChoice<'_>,
    path: &Path,
    mut progress: impl FnMut(u64, u64),
) -> Result<Written, BridgeError> {
    let descriptions = crate::described(recording, choice.streams.as_deref())?;
    let rig = Placed::find(choice.rig, &descriptions.iter().collect::<Vec<_>>())?;
    let mut whole_ns = recording.span_ns();
    whole_ns[0] = whole_ns[0].saturating_sub(LEAD_NS);
    for description in &descriptions {
        // Frames may have been exposed before.
        let exposures = recording.exposures(&description.id)?;
        whole_ns[0] = exposures.values().map(|exposure| exposure.mid_ns).fold(whole_ns[0], i64::min);
    }
    let steps = Steps::new(choice.events.period_ns(), choice.span_ns, whole_ns);
    let look =
        FrameLook { depth: if choice.jpeg.is_some() { Depth::Bits8 } else { Depth::OfCamera }, bits: choice.bits };
    let ids = descriptions.iter().map(|stream| stream.id.clone()).collect();
    let options = SliceOptions { length_ns: steps.slice_ns, streams: Some(ids), span_ns: steps.span_ns, look };
    let mut slices = recording.slices(&options)?;
    let fill = |out: &mut BufWriter<&File>| {
        let log = Log::begin(out, path, "")?;
        let start = recording.recording().summary().start.clone();
        let mut writing = Writing::begin(log, start, &descriptions, (choice, &rig, &steps))?;
        let [from, to] = steps.span_ns.map(i128::from);
        for slice in slices.by_ref() {
            let slice = slice?;
            progress((i128::from(slice.span_ns[1]) - from) as u64, (to - from) as u64);
            writing.slice(slice)?;
        }
        writing.flush()?;
        let topics = writing.log.finish()?.topics;
        if topics.is_empty() {
            return Err(BridgeError::Nothing { path: recording.recording().path().to_owned() });
        }
        Ok(topics)
    };
    let topics = atomic::try_write_with(path, fill, BridgeError::writing(path))?;
    Ok(Written { topics, notes: rig.notes, damage: Slices::take_damage(&mut slices) })
}

/// The slices that are read. Every n-th ends with pictures of events.
struct Steps {
    span_ns: [i64; 2],
    slice_ns: i64,
    period_ns: i64,
}

impl Steps {
    fn new(period_ns: i64, chosen_ns: Option<[i64; 2]>, whole_ns: [i64; 2]) -> Self {
        let parts = 1 + (period_ns - 1) / SLICE_NS;
        let slice_ns = 1 + (period_ns - 1) / parts;
        let period_ns = slice_ns * parts;
        // Pictures of events lie at whole periods of session time, also where the reading begins before.
        let span_ns = chosen_ns.unwrap_or([whole_ns[0].div_euclid(period_ns).saturating_mul(period_ns), whole_ns[1]]);
        Self { span_ns, slice_ns, period_ns }
    }

    /// Whether pictures of events are made at the end of a slice.
    fn ends_period(&self, end_ns: i64) -> bool {
        end_ns == self.span_ns[1] || end_ns.saturating_sub(self.span_ns[0]) % self.period_ns == 0
    }
}

/// What is written of a stream.
struct Stream {
    id: String,
    images: String,
    events: String,
    offset_ns: i64,
    seen: Option<EventPictureStream>,
    pictures: u32,
}

/// The file that is being written.
struct Writing<'a, W: std::io::Write> {
    log: Log<W>,
    start: SessionStart,
    streams: Vec<Stream>,
    choice: &'a FoxgloveChoice<'a>,
    rig: &'a Placed<'a>,
    steps: &'a Steps,
    image: Schema,
    /// Pictures that wait for being coded, as many at once as there are processors.
    waiting: Vec<Waiting>,
    /// Whether lenses and poses were written.
    begun: bool,
}

/// A picture that waits for being coded.
struct Waiting {
    stream: usize,
    t_ns: i64,
    sequence: u32,
    of_events: bool,
    shown: Shown,
}

impl<'a, W: std::io::Write> Writing<'a, W> {
    fn begin(
        log: Log<W>,
        start: SessionStart,
        descriptions: &[Description],
        (choice, rig, steps): (&'a FoxgloveChoice<'a>, &'a Placed<'a>, &'a Steps),
    ) -> Result<Self, BridgeError> {
        let origin_us = steps.span_ns[0].div_euclid(1000);
        let stream = |description: &Description| {
            let id = description.id.clone();
            let size = sensor_size(description).filter(|_| description.encoding.is_events());
            if size.is_none() && description.encoding.is_events() {
                return Err(BridgeError::NoSize { id });
            }
            let seen = size.map(|size| EventPictureStream::new(size, choice.events, origin_us));
            let (images, events) = (format!("/{id}/image"), format!("/{id}/events"));
            Ok(Stream { images, events, offset_ns: rig.offset_ns(&id), id, seen, pictures: 0 })
        };
        let streams = descriptions.iter().map(stream).collect::<Result<_, _>>()?;
        let image = schema::compressed_image();
        Ok(Self { log, start, streams, choice, rig, steps, image, waiting: Vec::new(), begun: false })
    }

    /// Takes what was seen within a slice.
    fn slice(&mut self, slice: Slice) -> Result<(), BridgeError> {
        for (at, part) in slice.parts.into_iter().enumerate() {
            self.gather(at, part, slice.span_ns[1]);
        }
        if self.waiting.len() < 4 * rayon::current_num_threads() { Ok(()) } else { self.flush() }
    }

    /// Writes the pictures that wait, in the order of their times.
    fn flush(&mut self) -> Result<(), BridgeError> {
        let mut waiting = std::mem::take(&mut self.waiting);
        waiting.sort_by_key(|picture| picture.t_ns);
        let quality = self.choice.jpeg;
        let coded: Vec<_> = waiting.par_iter().map(|picture| picture.shown.coded(quality)).collect();
        for (picture, coded) in waiting.iter().zip(coded) {
            // Of pictures of a camera's size this is always something.
            let Some((format, data)) = coded else { continue };
            let log_ns = self.log_ns(picture.t_ns);
            self.begin_once(log_ns)?;
            let stream = &self.streams[picture.stream];
            let topic = if picture.of_events { &stream.events } else { &stream.images };
            let message = messages::compressed_image(log_ns, &stream.id, format, &data);
            self.log.write((topic, &self.image), (log_ns, picture.sequence), &message, BTreeMap::new)?;
        }
        Ok(())
    }

    /// Nanoseconds since 1970.
    fn log_ns(&self, session_ns: i64) -> u64 {
        self.start.log_time(self.start.host_ns.saturating_add(session_ns))
    }

    fn gather(&mut self, at: usize, part: Part, end_ns: i64) {
        let stream = &mut self.streams[at];
        let offset_ns = stream.offset_ns;
        for frame in part.frames {
            let (t_ns, sequence) = (frame.exposure.mid_ns.saturating_add(offset_ns), frame.sequence as u32);
            let shown = frame.jpeg.map_or(Shown::Frame(frame.picture), Shown::Jpeg);
            self.waiting.push(Waiting { stream: at, t_ns, sequence, of_events: false, shown });
        }
        let Some(seen) = &mut stream.seen else { return };
        seen.take(&part.events);
        if self.steps.ends_period(end_ns)
            && let Some(rgb) = seen.picture(end_ns)
        {
            let (shown, sequence) = (Shown::Events(rgb, seen.size()), stream.pictures);
            stream.pictures = stream.pictures.wrapping_add(1);
            let t_ns = end_ns.saturating_add(offset_ns);
            self.waiting.push(Waiting { stream: at, t_ns, sequence, of_events: true, shown });
        }
    }

    /// Writes lenses and poses before the first picture.
    fn begin_once(&mut self, log_ns: u64) -> Result<(), BridgeError> {
        if std::mem::replace(&mut self.begun, true) {
            return Ok(());
        }
        if let Some(message) = messages::frame_transforms(log_ns, self.rig) {
            self.log.write(("/tf", &schema::frame_transforms()), (log_ns, 0), &message, BTreeMap::new)?;
        }
        let calibration = schema::camera_calibration();
        for camera in self.rig.cameras() {
            let topic = format!("/{}/calibration", camera.name);
            let message = messages::camera_calibration(log_ns, camera);
            self.log.write((&topic, &calibration), (log_ns, 0), &message, BTreeMap::new)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_are_short_and_periods_are_whole_numbers_of_them() {
        for (period_ns, chosen) in [(33_333_333, None), (7_000_000_000, None), (1_000, Some([5, 2_000_000_005]))] {
            let steps = Steps::new(period_ns, chosen, [-1_234_567, 20_000_000_000]);
            assert!(steps.slice_ns <= SLICE_NS && steps.period_ns % steps.slice_ns == 0);
            assert!((steps.period_ns - period_ns).abs() < 100);
            if chosen.is_none() {
                assert_eq!(steps.span_ns[0] % steps.period_ns, 0, "pictures lie at whole periods of session time");
                assert!(steps.ends_period(0) && !steps.ends_period(1) && steps.ends_period(20_000_000_000));
            }
        }
    }
}
