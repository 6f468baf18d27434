//! Files of several cameras as one session, against the truth: event files whose clocks began at different times, pulses that some of
//! them saw, pictures that belong to these pulses, and a video's times.

use std::{fs, path::Path};

use erfgs_base::Progress;
use erfgs_bridge::import::{ImportedSession, Plan, PlanError, draft, import};
use erfgs_events::{CdEvent, Edge, EventEncoding, Evt3Encoder, RawHeader, SensorSize, Sink};
use erfgs_scene::{ImageRgb8, image, video::VideoWriter};
use erfgs_session::container::{Entry, Session};
use erfgs_sync::{SyncOptions, Synchronisation, Tier, synchronise};

const MS: i64 = 1_000_000;
const PULSES: i64 = 48;
const SIZE: SensorSize = SensorSize { width: 64, height: 40 };

/// When a pulse rises and falls, nanoseconds: 30 a second, each of another length.
fn pulse(index: i64) -> [i64; 2] {
    let rise = 120 * MS + index * 33_333_000;
    [rise, rise + (2 + index % 5) * MS]
}

/// An event camera whose clock began at `zero_ns`, as a RAW file.
fn raw(folder: &Path, name: &str, zero_ns: i64, sees_pulses: bool) {
    let header = RawHeader::new(EventEncoding::Evt3, SIZE, "0000", "2026-11-30 12:00:00").unwrap();
    let mut bytes = header.encode();
    let mut encoder = Evt3Encoder::default();
    let t_us = |ns: i64| ((ns - zero_ns) / 1000).unsigned_abs();
    let edges = (0..PULSES).flat_map(|index| pulse(index).into_iter().zip([true, false]));
    let mut edges = edges.filter(|_| sees_pulses).peekable();
    for n in 0..1900 {
        let at_ns = n * MS;
        while let Some((at_ns, rising)) = edges.next_if(|edge| edge.0 <= at_ns) {
            encoder.edge(Edge { t_us: t_us(at_ns), channel: 0, rising }, &mut bytes).unwrap();
        }
        let (x, y) = ((n * 7 % 64) as u16, (n % 40) as u16);
        encoder.event(CdEvent { t_us: t_us(at_ns), x, y, on: n % 3 == 0 }, &mut bytes).unwrap();
    }
    encoder.finish(&mut bytes);
    fs::write(folder.join(name), bytes).unwrap();
}

fn picture(index: i64) -> ImageRgb8 {
    let mut picture = ImageRgb8::new(32, 16);
    picture.data.fill(40 + index as u8);
    picture
}

/// A rig's files: `left` and `right` saw the pulses, `top` counts with `left`; a picture for each pulse, and others at other times.
fn files(folder: &Path) {
    raw(folder, "left.raw", -5_000 * MS, true);
    raw(folder, "right.raw", -70_123 * MS, true);
    raw(folder, "top.raw", -5_000 * MS, false);
    for name in ["jpeg", "png"] {
        fs::create_dir(folder.join(name)).unwrap();
    }
    let mut times = "frame,t_ms\n".to_owned();
    for index in 0..PULSES {
        let picture = picture(index);
        let jpeg = image::jpeg(&picture.data, 32, 16, 90).unwrap();
        fs::write(folder.join(format!("jpeg/{index}.jpg")), jpeg).unwrap();
        if index < 20 {
            picture.write_png(&folder.join(format!("png/f{index}.png"))).unwrap();
            times.push_str(&format!("{index},{}\n", 200 + 40 * index));
        }
    }
    fs::write(folder.join("times.csv"), times).unwrap();
}

const PLAN: &str = r#"
[[events]]
id = "left"
file = "left.raw"

[[events]]
id = "right"
file = "right.raw"
pulses_of = "left"

[[events]]
id = "top"
file = "top.raw"
clock_of = "left"

[[frames]]
id = "strobed"
folder = "jpeg"
pulses_of = "left"

[[frames]]
id = "timed"
folder = "png"
times = "times.csv"
marks = "start"
exposure_us = 8000
"#;

fn imported(folder: &Path, plan: &str) -> Result<ImportedSession, PlanError> {
    let path = folder.join("plan.toml");
    fs::write(&path, plan).unwrap();
    let mut told = 0;
    let mut progress = |step: Progress| told += u64::from(step.done <= step.total);
    let found = import(&Plan::load(&path)?, &folder.join("take.mcap"), &mut progress)?;
    assert!(told > 100, "{told}");
    Ok(found)
}

fn synchronised(folder: &Path) -> Synchronisation {
    synchronise(&mut Session::open(&folder.join("take.mcap")).unwrap(), SyncOptions::default(), |_| {}).unwrap()
}

/// How far the middles of exposures are from the truth at most; each has its length.
fn off(sync: &Synchronisation, id: &str, truth: impl Fn(i64) -> [i64; 2]) -> i64 {
    let exposures = sync.stream(id).unwrap().exposures.as_ref().unwrap();
    let mut most = 0;
    for (index, mid_ns) in (0..).zip(&exposures.mid_ns) {
        let [open, close] = truth(index);
        assert!((exposures.exposure_ns[index as usize] - (close - open)).abs() <= 1000, "{id}, frame {index}");
        most = most.max((mid_ns - (open + close) / 2).abs());
    }
    most
}

/// The session time of the first event, by the clocks of synchronisation.
fn first_event_ns(folder: &Path, sync: &Synchronisation, stream: usize, id: &str) -> i64 {
    struct First(Option<u64>);
    impl Sink for First {
        fn event(&mut self, event: CdEvent) {
            self.0.get_or_insert(event.t_us);
        }
    }
    let mut first = First(None);
    let mut session = Session::open(&folder.join("take.mcap")).unwrap();
    session.decode_events(stream, None, &mut first, |_| {}).unwrap();
    let clock = sync.stream(id).unwrap().epochs.clocks().next().unwrap().clone();
    clock.session_ns(first.0.unwrap().cast_signed())
}

#[test]
fn files_of_several_cameras_are_one_session_on_one_clock() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files(folder);
    let found = imported(folder, PLAN).unwrap();
    let ids: Vec<&str> = found.streams.iter().map(|stream| stream.description.id.as_str()).collect();
    assert_eq!((&ids[..], &found.damage[..]), (&["left", "right", "top", "strobed", "timed"][..], &[][..]));
    assert_eq!(found.streams[3].totals.packets, PULSES.unsigned_abs());

    let sync = synchronised(folder);
    for (stream, id) in ["left", "right", "top"].into_iter().enumerate() {
        // The first event of each is that of time 0, which the session begins with.
        let at_ns = first_event_ns(folder, &sync, stream, id);
        assert!(at_ns.abs() < 3000, "{id}: {at_ns}");
    }
    let strobed = sync.stream("strobed").unwrap();
    assert_eq!((strobed.tier, &strobed.faults[..]), (Tier::Strobe, &[][..]), "{:?}", strobed.notes);
    let most = off(&sync, "strobed", pulse);
    assert!(most < 3000, "{most}");
    let most = off(&sync, "timed", |index| [(200 + 40 * index) * MS, (208 + 40 * index) * MS]);
    assert!(most < 3000, "{most}");

    // Pictures are as they were.
    let mut session = Session::open(&folder.join("take.mcap")).unwrap();
    let mut of_stream = [0_i64; 5];
    for entry in session.messages(None) {
        let Ok(Entry::Packet { stream, packet }) = entry else { continue };
        let index = of_stream[stream];
        of_stream[stream] += 1;
        match stream {
            3 => assert_eq!(packet.payload, fs::read(folder.join(format!("jpeg/{index}.jpg"))).unwrap()),
            4 => assert_eq!(packet.payload, picture(index).data),
            _ => {}
        }
    }
    assert_eq!(of_stream[3..], [PULSES, 20]);
}

#[test]
fn exposures_begin_with_the_edge_that_is_named_and_are_as_long_as_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files(folder);
    for (edge, which) in [("", 0), ("edge = \"falling\"\n", 1)] {
        let plan = PLAN.replace(
            r#"pulses_of = "left"

[[frames]]"#,
            &format!("pulses_of = \"left\"\nexposure_us = 4000\n{edge}\n[[frames]]"),
        );
        imported(folder, &plan).unwrap();
        let sync = synchronised(folder);
        let strobed = sync.stream("strobed").unwrap();
        assert_eq!((strobed.tier, &strobed.faults[..]), (Tier::HardwareTriggered, &[][..]), "{:?}", strobed.notes);
        let most = off(&sync, "strobed", |index| [pulse(index)[which], pulse(index)[which] + 4 * MS]);
        assert!(most < 3000, "{edge}: {most}");
        fs::remove_file(folder.join("take.mcap")).unwrap();
    }
}

#[test]
fn the_draft_of_a_folder_pairs_what_is_as_many_and_is_a_plan() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files(folder);
    fs::write(folder.join("notes.md"), "a wet day").unwrap();
    let draft = draft(folder, &mut |_, _| {}).unwrap();
    assert_eq!((draft.events, draft.frames), (3, 2), "{}", draft.text);
    assert!(draft.left_out.iter().any(|name| name == "notes.md"), "{:?}", draft.left_out);
    let lines: Vec<&str> = draft.text.lines().filter(|line| !line.starts_with('#')).collect();
    assert_eq!(lines.iter().filter(|line| line.starts_with("pulses_of = \"left\"")).count(), 2, "{}", draft.text);
    // What is left open is asked for, stream by stream.
    let error = imported(folder, &draft.text).unwrap_err().to_string();
    assert!(error.contains("[[events]] top") && error.contains("give one of starts_s, clock_of, pulses_of"), "{error}");
    let (above, top) = draft.text.split_once("id = \"top\"").unwrap();
    let text = format!("{above}id = \"top\"{}", top.replacen("# clock_of", "clock_of", 1));
    let error = imported(folder, &text).unwrap_err().to_string();
    assert!(error.contains("[[frames]] png") && error.contains("give one of fps, times, pulses_of"), "{error}");
    let (above, png) = text.split_once("id = \"png\"").unwrap();
    imported(folder, &format!("{above}id = \"png\"{}", png.replace("# fps = 30.0", "fps = 25.0"))).unwrap();
    let sync = synchronised(folder);
    assert!(off(&sync, "jpeg", pulse) < 3000);
}

#[test]
fn what_does_not_belong_together_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    files(folder);
    for (from, to, says) in [
        (
            "pulses_of = \"left\"\n\n[[events]]",
            "pulses_of = \"top\"\n\n[[events]]",
            "'top' is no [[events]] above it; there are: left",
        ),
        (
            "clock_of = \"left\"",
            "clock_of = \"left\"\npulses_of = \"left\"",
            "give one of clock_of, pulses_of, not several",
        ),
        ("clock_of = \"left\"", "pulses_of = \"left\"", "top.raw: it has no edge of its trigger input"),
        (
            "folder = \"jpeg\"",
            "folder = \"png\"",
            "'strobed' has 20 frames, and 'left' saw 48 pulses: say with first_pulse",
        ),
        (
            "folder = \"jpeg\"",
            "folder = \"jpeg\"\nfirst_pulse = 1",
            "48 frames, and 'left' saw 47 pulses from pulse 1 on: frames without",
        ),
        ("folder = \"jpeg\"", "folder = \"jpeg\"\nvideo = \"a.mp4\"", "give one of folder, video, not several"),
        ("folder = \"jpeg\"", "folder = \"nowhere\"", "nowhere"),
        ("folder = \"jpeg\"", "folder = \"jpeg\"\nshutter = 3", "unknown field `shutter`"),
        ("marks = \"start\"\n", "", "say with marks"),
        ("exposure_us = 8000", "exposure_us = 0", "exposure_us is 0"),
        ("exposure_us = 8000", "exposure_us = -1", "exposure_us: "),
        ("times = \"times.csv\"", "fps = 0", "fps: "),
        ("times = \"times.csv\"", "times = \"left.raw\"", "left.raw"),
        ("folder = \"png\"\n", "folder = \"jpeg\"\n", "48 frames, and there are times for 20"),
        ("id = \"timed\"", "id = \"left\"", "left"),
        ("file = \"top.raw\"", "file = \"times.csv\"", "times.csv"),
        ("file = \"left.raw\"", "file = \"left.raw\"\nstarts_s = 1e300", "starts_s: "),
        ("file = \"left.raw\"", "file = \"left.raw\"\nstarts_s = 1.7e9", "'timed' begins 1700000000 s before"),
        (PLAN, "", "neither [[events]] nor [[frames]]"),
    ] {
        assert!(PLAN.contains(from), "{from}");
        let message = imported(folder, &PLAN.replacen(from, to, 1)).map(|_| ()).unwrap_err().to_string();
        assert!(message.contains(says), "{says}: {message}");
        assert!(!folder.join("take.mcap").exists(), "{to}");
    }
    // Which of the pulses the first frame belongs to can be said.
    let some = PLAN.replacen("folder = \"jpeg\"", "folder = \"png\"\nfirst_pulse = 7", 1);
    imported(folder, &some).unwrap();
    assert!(off(&synchronised(folder), "strobed", |index| pulse(index + 7)) < 3000);
    // Nothing is written over.
    assert!(imported(folder, PLAN).map(|_| ()).unwrap_err().to_string().contains("take.mcap"));
}

#[test]
fn a_video_has_the_times_that_the_plan_says_and_as_many_frames() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut video = VideoWriter::create(&folder.join("rgb.mp4"), 32, 16, 25.0).unwrap();
    (0..30).for_each(|index| video.push(&picture(index).data).unwrap());
    video.finish().unwrap();
    let drafted = draft(folder, &mut |_, _| {}).unwrap();
    assert!(drafted.frames == 1 && drafted.text.contains("# 30 frames, shown at 25.000 a second"), "{}", drafted.text);
    let plan = "[[frames]]\nid = \"rgb\"\nvideo = \"rgb.mp4\"\nfps = 250.0\nstarts_s = -1.5\nmarks = \"end\"\nexposure_us = 1000\n";
    let path = folder.join("plan.toml");
    fs::write(&path, plan).unwrap();
    let found = import(&Plan::load(&path).unwrap(), &folder.join("take.mcap"), &mut |_| {}).unwrap();
    assert_eq!(found.streams[0].totals.packets, 30);
    let sync = synchronised(folder);
    // The session begins with the end of the first.
    assert!(off(&sync, "rgb", |index| [4 * MS * index - MS, 4 * MS * index]) <= 1);
    // Fewer times than frames.
    fs::write(folder.join("few.csv"), "t_s\n1\n2\n").unwrap();
    fs::write(&path, "[[frames]]\nid = \"rgb\"\nvideo = \"rgb.mp4\"\ntimes = \"few.csv\"\n").unwrap();
    let error = import(&Plan::load(&path).unwrap(), &folder.join("x.mcap"), &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("rgb.mp4: it has 30 frames, and there are times for 2"), "{error}");
}
