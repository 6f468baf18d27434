//! The events of a stream on the session's clock, and the pictures of a camera that takes both.

use std::collections::BTreeSet;

use super::{ImportError, Timing, Viewpoint};
use erfgs_base::progress::Progress;
use erfgs_events::{ApsFrame, CdEvent, Edge, Event, Events, HotPixel, PixelActivity, Sink};
use erfgs_scene::{ImageRgb8, image::FEW_BITS, srgb};
use erfgs_session::{
    clock::{Epoch, EpochCursor},
    container::Session,
    source::LATE_NS,
};

/// What an event camera recorded within the window.
pub(super) struct Gathered {
    /// Times in microseconds of session time.
    events: Events,
    /// Exposures in nanoseconds of session time, and what they gave.
    pub pictures: Vec<([i64; 2], ImageRgb8)>,
    /// Where the camera was there and its time is known, session nanoseconds.
    stretches: Vec<[i64; 2]>,
    /// What could not be read of the file.
    pub damage: Vec<String>,
    /// Pixels whose events are left out.
    pub hot_pixels: Vec<HotPixel>,
}

/// Of a break that is no longer than this it is taken that nothing happened in it, nanoseconds.
const BREAK_NS: i64 = 20_000_000;

/// How events of a stream are taken.
#[derive(Clone, Copy)]
pub(super) struct Taking {
    /// So many pixels each way become one.
    pub merged: u32,
    /// Whether those of hot pixels are, too.
    pub hot_pixels: bool,
}

/// Decodes a stream. Pictures are taken where `pictures`, and `bits` of their
/// samples of 16 count, all where absent. `None` where no part
/// of it is dated.
pub(super) fn gather(
    session: &mut Session,
    stream: usize,
    view: &Viewpoint,
    window: [i64; 2],
    taking: Taking,
    (pictures, bits): (bool, Option<u8>),
    progress: &mut dyn FnMut(Progress),
) -> Result<Option<Gathered>, ImportError> {
    let Timing { epochs, offset_ns, .. } = &view.timing;
    let begun: Vec<u64> = epochs.as_slice().iter().skip(1).map(|epoch| epoch.first_sequence).collect();
    if epochs.are_undated() {
        return Ok(None);
    }
    let start_ns = session.summary().start.host_ns;
    let totals = &session.summary().streams[stream].totals;
    let total = totals.bytes;
    let dated = |epoch: Option<&Epoch>| epoch.is_some_and(|epoch| epoch.clock.is_some());
    let (first, last) = (dated(epochs.as_slice().first()), dated(epochs.as_slice().last()));
    let there = [totals.first_host_ns.filter(|_| first), totals.last_host_ns.filter(|_| last)]
        .map(|host_ns| Some(host_ns?.saturating_sub(start_ns)));
    let [from, to] = window;
    // Long enough before, that a decoder has begun, and after, that the last events have arrived.
    let arrival = [from.saturating_sub(LATE_NS), to.saturating_add(LATE_NS)].map(|t_ns| t_ns.saturating_add(start_ns));
    let merged = taking.merged;
    let [width, height] = [view.intrinsics.width / merged, view.intrinsics.height / merged];
    let mut sink = Window {
        activity: (!taking.hot_pixels)
            .then(|| PixelActivity::new(view.intrinsics.width as usize, view.intrinsics.height as usize)),
        cursor: epochs.follow(),
        offset_ns: *offset_ns,
        window,
        merged: merged as u16,
        last_us: i64::MIN,
        found: Gathered {
            events: Events::new(width, height),
            pictures: Vec::new(),
            stretches: Vec::new(),
            damage: Vec::new(),
            hot_pixels: Vec::new(),
        },
        pictures,
        bits,
        largest: 0,
        begun,
        is_broken: false,
    };
    let whole = from == i64::MIN && to == i64::MAX;
    let decoded = session.decode_events(stream, (!whole).then_some(arrival), &mut sink, |done| {
        progress(Progress { what: "bytes of events", done, total: if whole { total } else { 0 } });
    })?;
    check_depth(view, bits, sink.largest)?;
    let mut found = sink.found;
    found.hot_pixels = sink.activity.map_or_else(Vec::new, |activity| activity.hot_pixels());
    found.events = merge(found.events, &found.hot_pixels, merged as u16);
    found.damage = decoded.map(|decoded| decoded.damage).unwrap_or_default();
    // Where nothing moves there is nothing to send.
    if let (Some(stretch), Some(first)) = (found.stretches.first_mut(), there[0]) {
        stretch[0] = stretch[0].min(first);
    }
    if let (Some(stretch), Some(last)) = (found.stretches.last_mut(), there[1]) {
        stretch[1] = stretch[1].max(last);
    }
    Ok(Some(found))
}

/// Events of a sensor's pixels as those of larger ones, without those of some.
fn merge(events: Events, without: &[HotPixel], merged: u16) -> Events {
    if merged == 1 && without.is_empty() {
        return events;
    }
    let left_out: BTreeSet<(u16, u16)> = without.iter().map(|pixel| (pixel.x, pixel.y)).collect();
    let mut all = Events::new(events.width, events.height);
    for Event { t_us, x, y, on } in events.iter().filter(|event| !left_out.contains(&(event.x, event.y))) {
        all.push(Event { t_us, x: x / merged, y: y / merged, on });
    }
    all
}

/// Refuses frames of which nothing tells how many bits count, or that have more than is said.
fn check_depth(view: &Viewpoint, bits: Option<u8>, largest: u16) -> Result<(), ImportError> {
    let name = &view.camera;
    match bits {
        None if (1..FEW_BITS).contains(&largest) => Err(ImportError::Options(format!(
            "camera {name}: its frames have samples of 16 bits, and the largest is {largest}: either fewer bits count, or all frames are \
             nearly black; say how many with --bits (10 as jAER writes a DAVIS's, 16 if all count)"
        ))),
        Some(bits) if u32::from(largest) >> bits.min(16) != 0 => Err(ImportError::Options(format!(
            "camera {name}: a sample of its frames is {largest}, which is more than {bits} bits hold; give --bits as many as count"
        ))),
        _ => Ok(()),
    }
}

/// Takes what lies within the window; events of the sensor's own pixels.
struct Window<'a> {
    /// Where hot pixels are looked for.
    activity: Option<PixelActivity>,
    cursor: EpochCursor<'a>,
    offset_ns: i64,
    window: [i64; 2],
    merged: u16,
    last_us: i64,
    found: Gathered,
    pictures: bool,
    /// How many bits of samples of 16 count, where it is said.
    bits: Option<u8>,
    /// The largest of these samples.
    largest: u16,
    /// The packets with which other epochs than the first begin.
    begun: Vec<u64>,
    /// Whether something is not known since the last time that was told.
    is_broken: bool,
}

impl Window<'_> {
    fn session_ns(&mut self, t_us: u64) -> Option<i64> {
        let Some(t_ns) = self.cursor.session_ns(t_us) else {
            self.is_broken = true;
            return None;
        };
        let t_ns = t_ns.saturating_add(self.offset_ns);
        match self.found.stretches.last_mut() {
            Some(last) if !self.is_broken || t_ns.saturating_sub(last[1]) <= BREAK_NS => last[1] = last[1].max(t_ns),
            _ => self.found.stretches.push([t_ns; 2]),
        }
        self.is_broken = false;
        Some(t_ns)
    }
}

impl Sink for Window<'_> {
    fn packet(&mut self, sequence: u64) {
        let last = self.begun.partition_point(|&begun| begun <= sequence);
        self.is_broken |= last > 0;
        self.begun.drain(..last);
        self.cursor.packet(sequence);
    }

    fn discontinuity(&mut self, _t_us: u64) {
        self.cursor.discontinuity();
        self.is_broken = true;
    }

    fn edge(&mut self, edge: Edge) {
        self.session_ns(edge.t_us);
    }

    fn event(&mut self, event: CdEvent) {
        let Some(t_ns) = self.session_ns(event.t_us) else { return };
        let events = &mut self.found.events;
        let (x, y) = (event.x / self.merged, event.y / self.merged);
        if t_ns < self.window[0]
            || t_ns > self.window[1]
            || u32::from(x) >= events.width
            || u32::from(y) >= events.height
        {
            return;
        }
        // Rounding where two lines of a clock meet, and what two epochs' clocks are off, must not turn events round.
        let t_us = t_ns.div_euclid(1000).max(self.last_us);
        self.last_us = t_us;
        events.push(Event { t_us, x: event.x, y: event.y, on: event.on });
        self.activity.iter_mut().for_each(|activity| activity.take(event.t_us, event.x, event.y));
    }

    fn frame(&mut self, frame: ApsFrame) {
        let [Some(start), Some(end)] =
            [frame.exposure_start_us, frame.exposure_end_us].map(|t_us| self.session_ns(t_us))
        else {
            return;
        };
        let exposure = [start, end];
        let within = exposure[0] >= self.window[0] && exposure[1] <= self.window[1] && exposure[0] <= exposure[1];
        if self.pictures && within {
            let mut frame = frame;
            if frame.bits == 16 {
                self.largest = frame.pixels.iter().copied().max().unwrap_or(0).max(self.largest);
                frame.bits = self.bits.unwrap_or(16);
            }
            self.found.pictures.extend(picture(&frame).map(|picture| (exposure, picture)));
        }
    }
}

/// The picture of linear light, encoded for display.
fn picture(frame: &ApsFrame) -> Option<ImageRgb8> {
    let [width, height] = [frame.width, frame.height].map(u32::from);
    let channels = usize::from(frame.channels);
    let most = ((1u32 << frame.bits.clamp(1, 16)) - 1) as f32;
    let pixels = frame.pixels.chunks_exact(channels.max(1));
    let level = |sample: u16| (255.0 * srgb::encode(f32::from(sample) / most)).round() as u8;
    let data: Vec<u8> = match channels {
        1 => pixels.flat_map(|pixel| [level(pixel[0]); 3]).collect(),
        3 | 4 => pixels.flat_map(|pixel| [level(pixel[2]), level(pixel[1]), level(pixel[0])]).collect(),
        _ => return None,
    };
    (data.len() == 3 * width as usize * height as usize).then_some(ImageRgb8 { width, height, data })
}

impl Gathered {
    /// When it begins, session nanoseconds.
    pub fn first_ns(&self) -> Option<i64> {
        let event = self.events.t_us.first().map(|t_us| t_us * 1000);
        let picture = self.pictures.first().map(|([start, _], _)| *start);
        event.into_iter().chain(picture).min()
    }

    /// When it ends, session nanoseconds.
    pub fn last_ns(&self) -> Option<i64> {
        self.events.t_us.last().map(|t_us| t_us * 1000)
    }

    /// The events from `zero_ns` of session time on, for as long as `span_ns`, counted from there, and which part of it they
    /// cover: without a break, and as long as there is one.
    pub fn finish(&mut self, zero_ns: i64, span_ns: i64) -> (Events, [i64; 2]) {
        let within = |[from, to]: &[i64; 2]| [from, to].map(|t_ns| t_ns.saturating_sub(zero_ns).clamp(0, span_ns));
        let covers = self.stretches.iter().map(within).max_by_key(|[from, to]| to - from).unwrap_or([0, 0]);
        let zero_us = zero_ns.div_euclid(1000);
        let [from, to] = covers.map(|t_ns| zero_us.saturating_add(t_ns / 1000));
        let range = self.events.between(from, to.saturating_add(1));
        let all = std::mem::take(&mut self.events);
        let events = Events {
            width: all.width,
            height: all.height,
            t_us: all.t_us[range.clone()].iter().map(|t_us| t_us - zero_us).collect(),
            x: all.x[range.clone()].to_vec(),
            y: all.y[range.clone()].to_vec(),
            on: all.on[range].to_vec(),
        };
        (events, covers)
    }
}

#[cfg(test)]
mod tests {
    use erfgs_events::{Aedat4Compression, Aedat4Encoder, EventFileHints, SensorSize};
    use erfgs_scene::{Distortion, Intrinsics, Pose};
    use erfgs_session::{
        clock::{Clock, ClockFit, Evidence, Residuals},
        container::{EventFileRecording, import_events},
    };

    use super::*;
    use crate::import::session::Timing;

    /// A session of frames of samples of 16 bits, of which the largest is `white`.
    fn session(folder: &std::path::Path, white: u16) -> Session {
        let size = SensorSize { width: 16, height: 8 };
        let mut encoder = Aedat4Encoder::new(size, "DAVIS346_1", Aedat4Compression::None);
        for n in 0..3_u64 {
            let [exposure_start_us, exposure_end_us] = [1000, 2000].map(|t_us| t_us + n * 40_000);
            let pixels = (0..128).map(|at| if at % 16 < 8 { 0 } else { white }).collect();
            let (width, height, channels, bits) = (16, 8, 1, 16);
            encoder.frame(ApsFrame { exposure_start_us, exposure_end_us, width, height, channels, pixels, bits });
        }
        let file = folder.join(format!("{white}.aedat4"));
        std::fs::write(&file, encoder.finish()).unwrap();
        session_of(&file, EventFileHints::default())
    }

    fn session_of(file: &std::path::Path, hints: EventFileHints) -> Session {
        let recording = EventFileRecording::open(file, &hints).unwrap();
        let out = file.with_extension("mcap");
        import_events(&recording, &out, |_| {}).unwrap();
        Session::open(&out).unwrap()
    }

    fn viewpoint() -> Viewpoint {
        let fit = ClockFit {
            evidence: Evidence::TriggerEdges,
            origin_ticks: 0,
            origin_ns: 0,
            ns_per_tick: 1000.0,
            window_ticks: [0, 1_000_000],
            residuals: Residuals::of(vec![0.0]),
            samples: 2,
            outliers: 0,
        };
        let distortion = Distortion::None;
        Viewpoint {
            stream: "ev".into(),
            camera: "ev".into(),
            intrinsics: Intrinsics { width: 16, height: 8, fx: 20.0, fy: 20.0, cx: 8.0, cy: 4.0, distortion },
            pose: Pose::IDENTITY,
            pose_sigma: None,
            clock_sigma_s: None,
            timing: Timing { epochs: Clock::line(fit, 1000.0).into(), ..Timing::default() },
            thresholds: [0.2; 2],
        }
    }

    #[test]
    fn events_of_hot_pixels_are_left_out_unless_they_are_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        // A column that goes to and fro, and a pixel that sends 200 events a second.
        let column = |n: u64| (0..8).map(move |y| (2000 * n, (n % 15).min(15 - n % 15), y));
        let mut rows: Vec<(u64, u64, u64)> = (0..500).flat_map(column).collect();
        rows.extend((0..200).map(|n| (5000 * n + 7, 13, 2)));
        rows.sort_unstable();
        let lines: String = rows.iter().map(|(t, x, y)| format!("{t},{x},{y},1\n")).collect();
        let file = folder.path().join("events.csv");
        std::fs::write(&file, format!("t,x,y,on\n{lines}")).unwrap();
        let size = Some(SensorSize { width: 16, height: 8 });
        let mut session = session_of(&file, EventFileHints { size, ..EventFileHints::default() });
        let stream = session.summary().streams[0].description.id.clone();
        let view = Viewpoint { stream, ..viewpoint() };
        for (merged, hot_pixels) in [(1, false), (1, true), (2, false), (2, true)] {
            let taking = Taking { merged, hot_pixels };
            let window = [i64::MIN, i64::MAX];
            let found = gather(&mut session, 0, &view, window, taking, (false, None), &mut |_| {}).unwrap().unwrap();
            let places: Vec<[u16; 2]> = found.hot_pixels.iter().map(|pixel| [pixel.x, pixel.y]).collect();
            assert_eq!(places, if hot_pixels { vec![] } else { vec![[13, 2]] });
            let taken = rows.iter().filter(|(_, x, y)| hot_pixels || [*x, *y] != [13, 2]);
            let merged = u64::from(merged);
            let expected: Vec<(u64, u64)> = taken.map(|(_, x, y)| (x / merged, y / merged)).collect();
            let events = found.events.iter().map(|event| (event.x.into(), event.y.into()));
            assert_eq!(events.collect::<Vec<_>>(), expected);
            assert_eq!(u64::from(found.events.width) * merged, 16);
        }
    }

    #[test]
    fn few_bits_of_a_sessions_frames_are_asked_for_and_taken_as_said() {
        let folder = tempfile::tempdir().unwrap();
        for depth in [8, 10, 12, 14, 16_u8] {
            let white = ((1_u32 << depth) - 1) as u16;
            let mut session = session(folder.path(), white);
            let mut gather = |bits| {
                let window = [i64::MIN, i64::MAX];
                let taking = Taking { merged: 1, hot_pixels: false };
                let found = gather(&mut session, 0, &viewpoint(), window, taking, (true, bits), &mut |_| {})?;
                let found = found.expect("dated");
                assert_eq!(found.pictures.len(), 3);
                Ok::<_, ImportError>(found.pictures[0].1.data.iter().copied().max().unwrap())
            };
            let unsaid = gather(None).map_err(|error| error.to_string());
            match unsaid {
                Err(error) => {
                    assert!(depth <= 12 && error.contains(&format!("the largest is {white}")), "{depth}: {error}");
                    assert!(error.contains("camera ev") && error.contains("--bits"), "{error}");
                }
                Ok(level) => assert!(depth > 12 && (level == 255) == (depth == 16), "{depth}: {level}"),
            }
            assert_eq!(gather(Some(depth)).unwrap(), 255, "{depth}");
            if depth > 8 {
                let error = gather(Some(depth - 1)).unwrap_err().to_string();
                assert!(error.contains(&format!("more than {} bits hold", depth - 1)), "{error}");
            }
        }
    }
}
