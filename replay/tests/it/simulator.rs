//! What the event simulator does, on frames made here.

use erfgs_events::{Event, Events};
use erfgs_replay::{
    Luma, Mode, Simulator, SimulatorConfig, SimulatorError,
    simulator::{camera_key, lin_log},
};

const MS: i64 = 1_000_000;

fn enhanced() -> SimulatorConfig {
    SimulatorConfig { mode: Mode::Enhanced, ..SimulatorConfig::default() }
}

fn both() -> [SimulatorConfig; 2] {
    [SimulatorConfig::default(), enhanced()]
}

/// Everything on: each source of randomness, low-pass and refractory period.
fn everything(mode: Mode) -> SimulatorConfig {
    let noisy = SimulatorConfig { mode, refractory_s: 0.002, seed: 11, ..SimulatorConfig::preset("noisy").unwrap() };
    match mode {
        Mode::Parity => noisy,
        Mode::Enhanced => SimulatorConfig { event_sigma: 0.02, hot_fraction: 0.01, hot_hz: 200.0, ..noisy },
    }
}

/// Simulates frames of floating grey levels, one every 10 ms.
fn simulate(config: &SimulatorConfig, width: u32, frames: &[Vec<f32>]) -> Result<Events, SimulatorError> {
    let height = frames[0].len() as u32 / width;
    let mut simulator = Simulator::new(width, height, config, camera_key("test"))?;
    let mut events = Events::new(width, height);
    for (index, frame) in frames.iter().enumerate() {
        simulator.step(Luma::F32(frame), index as i64 * 10 * MS, &mut events)?;
    }
    Ok(events)
}

/// A bright bar that moves over a gradient.
fn moving_bar(width: usize, height: usize, frames: usize) -> Vec<Vec<f32>> {
    let pixel = |frame: usize, x: usize, y: usize| {
        let bar = (x + 3 * frame + y / 4) % width < 5;
        (if bar { 240 } else { (x * 3 + y * 2) % 180 }) as f32
    };
    (0..frames).map(|frame| (0..width * height).map(|at| pixel(frame, at % width, at / width)).collect()).collect()
}

fn level_of_log(log: f64) -> f32 {
    log.exp() as f32
}

#[test]
fn one_step_of_contrast_makes_the_same_number_of_events_in_both_modes() {
    // From ln 50, by 3.5 thresholds up, then 2.2 down: the half that was left over counts.
    let logs = [50f64.ln(), 50f64.ln() + 0.7, 50f64.ln() + 0.26];
    let frames: Vec<Vec<f32>> = logs.map(|log| vec![level_of_log(log)]).to_vec();
    for config in both() {
        let events = simulate(&config, 1, &frames).unwrap();
        assert_eq!(events.on, [true, true, true, false], "{config:?}");
        assert!(events.t_us[2] <= 10_000 && events.t_us[3] > 10_000);
    }
}

#[test]
fn in_enhanced_mode_a_pixel_fires_when_its_own_line_crosses() {
    // Pixel 0 rises by 1.0 in 10 ms: crossings of 0.2, 0.4, ... Pixel 1 rises by 0.25: one crossing, at 8 ms.
    let frames = [vec![level_of_log(4.0), level_of_log(4.0)], vec![level_of_log(5.001), level_of_log(4.25)]];
    let events = simulate(&enhanced(), 2, &frames).unwrap();
    let times = |x| events.iter().filter(|e| e.x == x).map(|e| e.t_us).collect::<Vec<_>>();
    assert_eq!(times(0), [1998, 3996, 5994, 7992, 9990]);
    assert_eq!(times(1), [8000]);
    // v2e's common time grid lets pixel 1 fire with the first event of pixel 0.
    let events = simulate(&SimulatorConfig::default(), 2, &frames).unwrap();
    assert_eq!(events.iter().filter(|e| e.x == 1).map(|e| e.t_us).collect::<Vec<_>>(), [2000]);
}

#[test]
fn the_enhanced_low_pass_is_the_exact_step_response_whatever_the_frame_rate() {
    // White after black; with ten times more frames the output after 20 ms must be the same.
    let config = SimulatorConfig { cutoff_hz: 20.0, threshold_on: 0.01, ..enhanced() };
    let count = |steps: i64| {
        let mut simulator = Simulator::new(1, 1, &config, 0).unwrap();
        let mut events = Events::new(1, 1);
        simulator.step(Luma::U8(&[0]), 0, &mut events).unwrap();
        for step in 1..=steps {
            simulator.step(Luma::U8(&[255]), step * 20 * MS / steps, &mut events).unwrap();
        }
        events.len()
    };
    let expected = f64::from(lin_log(255.0)) * (1.0 - (-0.02 * std::f64::consts::TAU * 20.0f64).exp()) / 0.01;
    for steps in [1, 2, 10, 200] {
        assert!((count(steps) as f64 - expected).abs() < 1.5, "{steps} steps: {} events, {expected}", count(steps));
    }
}

#[test]
fn the_refractory_period_separates_the_events_of_a_pixel() {
    let frames = moving_bar(40, 20, 8);
    for mode in [Mode::Parity, Mode::Enhanced] {
        let free = SimulatorConfig { mode, ..SimulatorConfig::default() };
        let held = SimulatorConfig { refractory_s: 0.003, ..free.clone() };
        let (free, held) = (simulate(&free, 40, &frames).unwrap(), simulate(&held, 40, &frames).unwrap());
        assert!(held.len() > 500 && held.len() < free.len(), "{mode:?}: {} of {}", held.len(), free.len());
        let mut last = vec![i64::MIN / 2; 40 * 20];
        for event in held.iter() {
            let last = &mut last[usize::from(event.y) * 40 + usize::from(event.x)];
            assert!(event.t_us - *last >= 2999, "{mode:?}: {} after {last}", event.t_us);
            *last = event.t_us;
        }
    }
}

#[test]
fn after_the_refractory_period_the_enhanced_pixel_starts_from_its_new_output() {
    // A rise by 1.0 in 10 ms, 0.1 a millisecond: an event after 2 ms, then 3 ms held, then again 2 ms to the next.
    let config = SimulatorConfig { refractory_s: 0.003, ..enhanced() };
    let frames = [vec![level_of_log(4.0)], vec![level_of_log(5.0)], vec![level_of_log(5.0)]];
    let events = simulate(&config, 1, &frames).unwrap();
    assert_eq!(events.t_us, [2000, 7000]);
}

#[test]
fn shot_noise_and_leak_have_the_rates_asked_for() {
    // 20,000 pixels for 2 s. v2e halves, quarters and clamps; at level 0 the rate is 0.945 of the one asked for.
    let frames = vec![vec![0.0; 20_000]; 201];
    for mode in [Mode::Parity, Mode::Enhanced] {
        let shot = SimulatorConfig { mode, shot_hz: 2.0, seed: 5, ..SimulatorConfig::default() };
        let events = simulate(&shot, 200, &frames).unwrap();
        let on = events.on.iter().filter(|&&on| on).count();
        let expected = 40_000.0 * 2.0 * (1.0 - 0.75 * 20.0 / 275.0);
        assert!((events.len() as f64 / expected - 1.0).abs() < 0.02, "{mode:?}: {} of {expected}", events.len());
        assert!((on as f64 / events.len() as f64 - 0.5).abs() < 0.02, "{mode:?}: {on} ON");

        let leak = SimulatorConfig { mode, leak_hz: 4.0, leak_jitter: 0.3, ..SimulatorConfig::default() };
        let events = simulate(&leak, 200, &frames).unwrap();
        // Eight thresholds' worth; the last of them is complete at every other pixel.
        assert!((events.len() as f64 / 150_000.0 - 1.0).abs() < 0.03, "{mode:?}: {} leak events", events.len());
        assert!(events.on.iter().all(|&on| on), "{mode:?}: leak makes ON events");
    }
}

#[test]
fn enhanced_noise_is_spread_over_the_interval() {
    let frames = vec![vec![0.0; 20_000]; 11];
    let config = SimulatorConfig { shot_hz: 50.0, ..enhanced() };
    let events = simulate(&config, 200, &frames).unwrap();
    let mut bins = [0.0; 10];
    events.t_us.iter().for_each(|t| bins[(t % 10_000 / 1000) as usize] += 1.0);
    let mean = events.len() as f64 / 10.0;
    assert!(bins.iter().all(|&bin| (bin - mean).abs() < 5.0 * f64::sqrt(mean)), "{bins:?}");
}

#[test]
fn hot_pixels_are_few_and_fire_often() {
    let frames = vec![vec![100.0; 10_000]; 101];
    let config = SimulatorConfig { hot_fraction: 0.01, hot_hz: 100.0, ..enhanced() };
    let events = simulate(&config, 100, &frames).unwrap();
    let mut counts = vec![0; 10_000];
    events.iter().for_each(|e| counts[usize::from(e.y) * 100 + usize::from(e.x)] += 1);
    let hot = counts.iter().filter(|&&count| count > 0).count();
    assert!((70..=130).contains(&hot), "{hot} hot pixels of about 100");
    assert!((events.len() as f64 / (hot as f64 * 100.0) - 1.0).abs() < 0.06);
}

#[test]
fn redrawn_thresholds_keep_the_mean_number_of_events() {
    let frames: Vec<Vec<f32>> = (0..10).map(|i| vec![level_of_log(3.5 + 0.2 * f64::from(i)); 2000]).collect();
    let plain = simulate(&enhanced(), 50, &frames).unwrap();
    let redrawn = simulate(&SimulatorConfig { event_sigma: 0.04, ..enhanced() }, 50, &frames).unwrap();
    // A renewal process of steps 0.2 +- 0.04 over 1.8: 9 + (0.2^2 - 1) / 2 of them. Without the spread the ninth step ends
    // with the rise.
    let mean = redrawn.len() as f64 / 2000.0;
    assert!((mean - 8.52).abs() < 0.1, "{mean} events a pixel");
    let distinct = |events: &Events| events.t_us.iter().collect::<std::collections::BTreeSet<_>>().len();
    assert!(distinct(&redrawn) > 100 * distinct(&plain) / 10);
}

#[test]
fn the_same_bytes_with_one_two_and_five_threads() {
    let frames = moving_bar(331, 77, 6);
    for mode in [Mode::Parity, Mode::Enhanced] {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| simulate(&everything(mode), 331, &frames).unwrap())
        };
        let one = with(1);
        assert!(one.len() > 5_000, "{mode:?}: {}", one.len());
        assert_eq!(one, with(2), "{mode:?}");
        assert_eq!(one, with(5), "{mode:?}");
    }
}

#[test]
fn cameras_and_seeds_draw_different_noise() {
    let config = SimulatorConfig { shot_hz: 5.0, ..SimulatorConfig::default() };
    let with = |seed, camera| {
        let mut simulator =
            Simulator::new(64, 64, &SimulatorConfig { seed, ..config.clone() }, camera_key(camera)).unwrap();
        let mut events = Events::new(64, 64);
        (0..5).for_each(|i| simulator.step(Luma::U8(&[9; 4096]), i * 33 * MS, &mut events).unwrap());
        events
    };
    assert_eq!(with(1, "a"), with(1, "a"));
    assert_ne!(with(1, "a"), with(1, "b"));
    assert_ne!(with(1, "a"), with(2, "a"));
}

#[test]
fn events_are_ordered_by_time_row_and_column_on_any_clock() {
    let frames = moving_bar(50, 30, 6);
    for start_ns in [0, 123_456_789_012_345, -7_000_001] {
        for mode in [Mode::Parity, Mode::Enhanced] {
            let mut simulator = Simulator::new(50, 30, &everything(mode), 0).unwrap();
            let mut events = Events::new(50, 30);
            for (index, frame) in frames.iter().enumerate() {
                simulator.step(Luma::F32(frame), start_ns + index as i64 * 33_333_333, &mut events).unwrap();
            }
            assert!(events.iter().map(|e| (e.t_us, e.y, e.x)).is_sorted(), "{mode:?} from {start_ns}");
            let end_us = (start_ns + 5 * 33_333_333).div_euclid(1000) + 1;
            assert!(events.iter().all(|e| (start_ns.div_euclid(1000)..=end_us).contains(&e.t_us)), "{mode:?}");
        }
    }
}

#[test]
fn whole_grey_levels_give_the_same_events_as_bytes_and_as_floats() {
    let frames = moving_bar(50, 30, 4);
    for mode in [Mode::Parity, Mode::Enhanced] {
        let mut simulator = Simulator::new(50, 30, &everything(mode), camera_key("test")).unwrap();
        let mut events = Events::new(50, 30);
        for (index, frame) in frames.iter().enumerate() {
            let bytes: Vec<u8> = frame.iter().map(|&x| x as u8).collect();
            simulator.step(Luma::U8(&bytes), index as i64 * 10 * MS, &mut events).unwrap();
        }
        assert_eq!(events, simulate(&everything(mode), 50, &frames).unwrap(), "{mode:?}");
    }
}

#[test]
fn still_scenes_and_single_frames_make_no_events() {
    for config in both() {
        for level in [0.0, 0.5, 255.0, 1e30] {
            assert!(simulate(&config, 4, &vec![vec![level; 16]; 5]).unwrap().is_empty(), "{level}");
        }
        assert!(simulate(&config, 4, &moving_bar(4, 4, 1)).unwrap().is_empty());
    }
}

#[test]
fn a_flip_from_black_to_white_makes_every_event_even_above_a_hundred() {
    for mode in [Mode::Parity, Mode::Enhanced] {
        let config = SimulatorConfig { mode, threshold_on: 0.01, threshold_off: 0.01, ..SimulatorConfig::default() };
        let frames = [vec![0.0; 6], vec![255.0; 6], vec![0.0; 6]];
        let events = simulate(&config, 3, &frames).unwrap();
        let per_pixel = (f64::from(lin_log(255.0)) / 0.01) as usize;
        assert!(events.len().abs_diff(6 * 2 * per_pixel) <= 12, "{mode:?}: {} of {}", events.len(), 12 * per_pixel);
    }
}

#[test]
fn linear_light_sees_the_contrast_of_the_scene() {
    // Encoded 100 and 200 differ by a factor 4.5 in light, not 2.
    let config = SimulatorConfig { linear_light: true, ..enhanced() };
    let frames = [vec![100.0], vec![200.0]];
    assert_eq!(simulate(&enhanced(), 1, &frames).unwrap().len(), 3);
    assert_eq!(simulate(&config, 1, &frames).unwrap().len(), 7);
}

#[test]
fn extreme_bandwidths_leave_the_signal_finite() {
    let frames = moving_bar(20, 10, 4);
    for mode in [Mode::Parity, Mode::Enhanced] {
        let with =
            |cutoff_hz| simulate(&SimulatorConfig { mode, cutoff_hz, ..SimulatorConfig::default() }, 20, &frames);
        let (off, huge, tiny) = (with(0.0).unwrap(), with(1e12).unwrap(), with(1e-9).unwrap());
        // v2e's state is wider with the filter, which decides contrasts of exactly a threshold otherwise.
        assert!(off.len().abs_diff(huge.len()) <= off.len() / 100, "{mode:?}: no filter and an instant one");
        assert!(tiny.is_empty(), "{mode:?}: nothing passes");
    }
}

#[test]
fn bad_input_is_refused_and_changes_nothing() {
    for config in both() {
        let size = |width, height| Simulator::new(width, height, &config, 0).err();
        assert_eq!(size(0, 5), Some(SimulatorError::Size { width: 0, height: 5 }));
        assert_eq!(size(5, 70_000), Some(SimulatorError::Size { width: 5, height: 70_000 }));
        assert_eq!(size(65_535, 65_535), Some(SimulatorError::Size { width: 65_535, height: 65_535 }));

        let mut simulator = Simulator::new(2, 2, &config, 0).unwrap();
        let mut events = Events::new(2, 2);
        simulator.step(Luma::F32(&[10.0; 4]), 5 * MS, &mut events).unwrap();
        let mut refused = |luma: &[f32], t_ns| simulator.step(Luma::F32(luma), t_ns, &mut events).unwrap_err();
        for bad in [f32::NAN, f32::INFINITY, -1.0] {
            let error = refused(&[1.0, 1.0, bad, 1.0], 6 * MS);
            assert!(matches!(error, SimulatorError::BadLuma { frame: 1, x: 0, y: 1, .. }), "{error}");
        }
        assert!(matches!(refused(&[1.0; 3], 6 * MS), SimulatorError::FrameSize { found: 3, expected: 4, .. }));
        for t_ns in [5 * MS, 4 * MS, i64::MIN] {
            assert!(matches!(refused(&[1.0; 4], t_ns), SimulatorError::TimeNotIncreasing { .. }), "{t_ns}");
        }
        assert!(matches!(refused(&[1.0; 4], i64::MAX), SimulatorError::TimeTooFar { .. }));
        let mut other = Events::new(3, 2);
        let error = simulator.step(Luma::F32(&[1.0; 4]), 6 * MS, &mut other).unwrap_err();
        assert!(matches!(error, SimulatorError::OutputSize { .. }));
        // The refused frames left no trace.
        simulator.step(Luma::F32(&[10.0; 4]), 6 * MS, &mut events).unwrap();
        assert!(events.is_empty());
    }
}

#[test]
fn parameters_out_of_range_are_refused_by_name() {
    let refused = |config: SimulatorConfig| config.validate().unwrap_err().to_string();
    let plain = SimulatorConfig::default;
    for threshold in [0.0, -0.2, f64::NAN, f64::INFINITY] {
        assert!(refused(SimulatorConfig { threshold_on: threshold, ..plain() }).contains("threshold_on"));
        assert!(refused(SimulatorConfig { threshold_off: threshold, ..plain() }).contains("threshold_off"));
    }
    assert!(refused(SimulatorConfig { cutoff_hz: -1.0, ..plain() }).contains("cutoff_hz"));
    assert!(refused(SimulatorConfig { refractory_s: f64::NAN, ..plain() }).contains("refractory_s"));
    assert!(refused(SimulatorConfig { hot_fraction: 0.1, ..plain() }).contains("enhanced"));
    assert!(refused(SimulatorConfig { hot_fraction: 1.1, ..enhanced() }).contains("hot_fraction"));
}

#[test]
fn more_events_than_memory_holds_are_an_error() {
    for mode in [Mode::Parity, Mode::Enhanced] {
        let config = SimulatorConfig { mode, leak_hz: 1e4, ..SimulatorConfig::default() };
        let mut simulator = Simulator::new(64, 64, &config, 0).unwrap();
        let mut events = Events::new(64, 64);
        simulator.step(Luma::U8(&[0; 4096]), 0, &mut events).unwrap();
        let error = simulator.step(Luma::U8(&[0; 4096]), 3_000_000 * MS, &mut events).unwrap_err();
        assert!(matches!(error, SimulatorError::TooManyEvents { frame: 1, .. }), "{error}");
        assert!(events.is_empty());
    }
}

#[test]
fn a_long_quiet_interval_still_gives_ordered_events() {
    // An hour between two frames: too long for one bucket a microsecond.
    let mut simulator = Simulator::new(3, 1, &enhanced(), 0).unwrap();
    let mut events = Events::new(3, 1);
    simulator.step(Luma::U8(&[100, 100, 100]), 0, &mut events).unwrap();
    simulator.step(Luma::U8(&[130, 100, 140]), 3_600_000 * MS, &mut events).unwrap();
    let expected = |to: f64| (3.6e9 * 0.2 / (to / 100.0).ln()).round();
    let events: Vec<Event> = events.iter().collect();
    assert_eq!(events.len(), 2);
    assert_eq!((events[0].x, events[1].x), (2, 0));
    assert!(
        (events[0].t_us as f64 - expected(140.0)).abs() < 1e4 && (events[1].t_us as f64 - expected(130.0)).abs() < 1e4
    );
}
