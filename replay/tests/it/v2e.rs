//! The parity mode against events that v2e itself made from a recording (where the shared recordings are at hand).

use erfgs_events::{Event, Events, npz};
use erfgs_recordings::shared;
use erfgs_replay::{Luma, Simulator, SimulatorConfig};

fn simulate(luma: &npz::LumaSequence, config: &SimulatorConfig) -> Events {
    let (width, height) = (luma.width, luma.height);
    let mut simulator = Simulator::new(width, height, config, 0).unwrap();
    let mut events = Events::new(width, height);
    for (index, frame) in luma.data.chunks_exact((width * height) as usize).enumerate() {
        let t_ns = (index as f64 * 1e9 / 30.0).round() as i64;
        simulator.step(Luma::U8(frame), t_ns, &mut events).unwrap();
    }
    events
}

fn sorted(events: &Events) -> Vec<Event> {
    let mut events: Vec<Event> = events.iter().collect();
    events.sort_unstable();
    events
}

#[test]
fn without_noise_every_event_is_v2es() {
    let Some(folder) = shared("reference/v2e") else { return };
    let luma = npz::read_luma(&folder.join("cam5_luma_frames.npz")).unwrap();
    for (file, cutoff_hz) in [("cam5_noiseless.npz", 0.0), ("cam5_lowpass30.npz", 30.0)] {
        let expected = npz::read_events(&folder.join(file), Some([luma.width, luma.height])).unwrap();
        let events = simulate(&luma, &SimulatorConfig { cutoff_hz, ..SimulatorConfig::default() });
        let (ours, theirs) = (sorted(&events), sorted(&expected));
        let first = ours.iter().zip(&theirs).position(|(a, b)| a != b);
        let at = first.map(|at| (at, ours[at], theirs[at]));
        assert_eq!((ours.len(), at), (theirs.len(), None), "{file}");
        assert!(events.iter().map(|e| (e.t_us, e.y, e.x)).is_sorted(), "already in order");
    }
}

#[test]
fn with_noise_the_counts_are_v2es_within_sampling_error() {
    let Some(folder) = shared("reference/v2e") else { return };
    let luma = npz::read_luma(&folder.join("cam5_luma_frames.npz")).unwrap();
    let summary = std::fs::read(folder.join("cam5_summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    for preset in ["clean", "noisy"] {
        let expected = &summary[preset];
        let config = SimulatorConfig { seed: 1, ..SimulatorConfig::preset(preset).unwrap() };
        let events = simulate(&luma, &config);
        // Counts over 230,000 pixels: a seed changes them by a few tenths of a percent, an interval's by about one.
        let near = |ours: f64, theirs: &serde_json::Value, tolerance: f64, what: &str| {
            let theirs = theirs.as_f64().unwrap();
            assert!((ours / theirs - 1.0).abs() < tolerance, "{preset} {what}: {ours} against {theirs}");
        };
        let on = events.on.iter().filter(|&&on| on).count();
        near(events.len() as f64, &expected["events"], 0.003, "events");
        near(on as f64, &expected["on"], 0.005, "on");
        near((events.len() - on) as f64, &expected["off"], 0.005, "off");
        let mut hit = vec![false; (luma.width * luma.height) as usize];
        events.iter().for_each(|e| hit[usize::from(e.y) * luma.width as usize + usize::from(e.x)] = true);
        near(hit.iter().filter(|&&hit| hit).count() as f64, &expected["pixels_with_events"], 0.003, "pixels");
        for (interval, theirs) in expected["events_per_interval"].as_array().unwrap().iter().enumerate() {
            // An event at a frame's time belongs to the interval before it.
            let edge = |index: usize| (index as f64 * 1e6 / 30.0).round() as i64 + 1;
            let from = if interval == 0 { 0 } else { edge(interval) };
            let ours = events.between(from, edge(interval + 1)).len();
            near(ours as f64, theirs, 0.03, "events of an interval");
        }
    }
}
