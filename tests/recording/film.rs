//! A dataset that is shown to a rig as a film comes back from the recording: the same pictures, exposed at the same instants, and the
//! same events.

use std::path::Path;

use erfgs_dataset::{Camera, Dataset};
use erfgs_emulated_rig::{Act, Film, record};
use erfgs_scene::{ImageRgb8, image::jpeg};
use erfgs_stage::{EventOptions, FilmOptions, RigOptions, StageOptions, film};

use crate::recording::files::json;

/// How far off a microsecond of the session is from one of the film: the board's clock and those of the cameras are fitted.
const LATE_US: i64 = 150;

fn camera<'a>(dataset: &'a Dataset, name: &str) -> &'a Camera {
    dataset.camera(name).unwrap_or_else(|| panic!("camera {name} was imported"))
}

#[test]
fn what_a_film_shows_is_what_the_recording_of_it_holds() {
    let kept = tempfile::tempdir().expect("a folder");
    let folder = kept.path();
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, ..StageOptions::default() },
        rig: RigOptions { width: 80, height: 60, rgb: 2, event: 1, test: 1, ..RigOptions::default() },
        events: EventOptions { threshold_on: 0.3, threshold_off: 0.25, ..EventOptions::default() },
        duration_ns: 400_000_000,
        test_fps: 30.0,
        truth_points: 0,
        ..FilmOptions::default()
    };
    film(&folder.join("shown"), &options, &|_| {}).expect("a dataset");
    let shown = Dataset::load(&folder.join("shown")).expect("a dataset");
    let plan = Film::plan(shown.clone()).expect("a plan");
    record(&plan, Act::Film, &folder.join("take.mcap"), &|_, _| {}).expect("a take");
    plan.rig_file("film").write(&folder.join("rig.json")).expect("a rig");
    let [from_s, seconds] = plan.film.as_ref().expect("a film").window_s();
    let tests: Vec<&str> = shown.cameras(erfgs_dataset::Split::Test).map(|camera| camera.name.as_str()).collect();
    let event = shown.manifest.cameras.iter().find(|camera| camera.events.is_some()).expect("an event camera");
    let words = format!(
        "dataset import session take.mcap --rig rig.json --from {from_s} --seconds {seconds} --threshold 0.3,0.25 --response display --scale-of \
         {}=0.1 --test {} --out back --json",
        event.name,
        tests.join(",")
    );
    json(folder, &words.split(' ').collect::<Vec<_>>());
    let back = Dataset::load(&folder.join("back")).expect("a dataset");
    let zero_ns = frames_come_back(&shown, &back);
    events_come_back(&shown, &back, &event.name, zero_ns);
    assert_eq!(back.manifest.cameras.len(), shown.manifest.cameras.len());
    refused(folder, &shown);
}

/// The time in the imported dataset of the film's time 0.
fn frames_come_back(shown: &Dataset, back: &Dataset) -> i64 {
    let first = |dataset: &Dataset, name: &str| camera(dataset, name).frames[0].exposure_ns[0];
    let some = shown.cameras(erfgs_dataset::Split::Train).find(|camera| !camera.frames.is_empty()).expect("one");
    let zero_ns = first(back, &some.name) - first(shown, &some.name);
    for original in shown.manifest.cameras.iter().filter(|camera| !camera.frames.is_empty()) {
        let copy = camera(back, &original.name);
        assert_eq!(copy.frames.len(), original.frames.len(), "{}", original.name);
        assert_eq!(copy.split, original.split);
        for (frame, played) in std::iter::zip(&copy.frames, &original.frames) {
            let middle = |[start, end]: [i64; 2]| i64::midpoint(start, end);
            let late_us = (middle(frame.exposure_ns) - zero_ns - middle(played.exposure_ns)) / 1000;
            assert!(late_us.abs() < LATE_US, "{}: {late_us} us late", original.name);
            let length = |[start, end]: [i64; 2]| end - start;
            let longer_us = (length(frame.exposure_ns) - length(played.exposure_ns)) / 1000;
            assert!(longer_us.abs() <= 200, "{}: exposed for {longer_us} us more", original.name);
            let images = [back.read_image(copy, frame), shown.read_image(original, played)].map(Result::unwrap);
            let sent = as_sent(&images[1]);
            assert_eq!(sent.len(), images[0].data.len());
            let most = images[0].data.iter().zip(&sent).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(most <= Some(1), "{} {}: {most:?} levels off", original.name, frame.file.display());
        }
    }
    zero_ns
}

/// A picture after the MJPEG of an emulated camera.
fn as_sent(picture: &ImageRgb8) -> Vec<u8> {
    let bytes = jpeg(&picture.data, picture.width, picture.height, 85).expect("a JPEG");
    image::load_from_memory(&bytes).expect("a picture").into_rgb8().into_raw()
}

fn events_come_back(shown: &Dataset, back: &Dataset, name: &str, zero_ns: i64) {
    let [original, copy] = [shown, back].map(|dataset| camera(dataset, name));
    let [played, recorded] = [(shown, original), (back, copy)]
        .map(|(dataset, camera)| dataset.read_events(camera).unwrap().expect("events"));
    // A pixel of the film is 10 x 10 of an EVK4, which has 128 x 72 of such squares.
    assert_eq!((recorded.width, recorded.height), (128, 72));
    assert!(played.len() > 1000, "{}", played.len());
    let response = |camera: &Camera| {
        camera.events.as_ref().map(|events| (events.lin_log_threshold.to_bits(), events.linear_light))
    };
    assert_eq!(response(original), response(copy));
    let sum = |counted: &erfgs_events::Events, theta: [f64; 2]| {
        let mut sums = vec![0.0; 128 * 72];
        for event in counted.iter() {
            sums[usize::from(event.y) * 128 + usize::from(event.x)] += if event.on { theta[0] } else { -theta[1] };
        }
        sums
    };
    let theta =
        |camera: &Camera| camera.events.as_ref().map(|events| [events.threshold_on, events.threshold_off]).unwrap();
    let (before, after) = (sum(&played, theta(original)), sum(&recorded, theta(copy)));
    let off = std::iter::zip(&before, &after).filter(|(a, b)| (**a - **b).abs() > 1e-6).count();
    // The last events of the film lie at its very end.
    assert!(off < 20, "{off} pixels of {} came back with another change of light", before.len());
    // Each event is a hundred of them.
    for (share, &played_us) in played.t_us.iter().enumerate().step_by(100) {
        let late_us = recorded.t_us[(100 * share).min(recorded.len() - 1)] - zero_ns / 1000 - played_us;
        assert!(late_us.abs() < LATE_US, "event {share}: {late_us} us late");
    }
}

/// A film that no rig can be shown is refused with what to do.
fn refused(folder: &Path, shown: &Dataset) {
    let mut both = shown.clone();
    let with_events = both.manifest.cameras.iter().find(|camera| camera.events.is_some()).expect("one").events.clone();
    both.manifest.cameras.iter_mut().find(|camera| !camera.frames.is_empty()).expect("one").events = with_events;
    assert!(Film::plan(both).unwrap_err().to_string().contains("frames and events"));
    let mut uneven = shown.clone();
    let named = uneven.manifest.cameras.iter_mut().find(|camera| camera.frames.len() > 2).expect("one");
    named.frames[1].exposure_ns = named.frames[1].exposure_ns.map(|t_ns| t_ns + 3_000_000);
    let message = Film::plan(uneven).unwrap_err().to_string();
    assert!(message.contains("3000 us off the steps"), "{message}");
    let plan = Film::plan(Dataset { root: folder.join("gone"), ..shown.clone() }).expect("a plan");
    let message = record(&plan, Act::Film, &folder.join("gone.mcap"), &|_, _| {}).unwrap_err().to_string();
    assert!(message.contains("gone"), "{message}");
}
