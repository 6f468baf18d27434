//! The event sensor against the intensity that it watches.

use erfgs_base::random;
use erfgs_events::Events;
use erfgs_stage::{EventOptions, Flicker, RigCamera, RigOptions, Role, Stage, StageOptions, StageView, events::record};

const SPAN: [i64; 2] = [100_000_000, 220_000_000];

fn stage() -> Stage {
    Stage::new(StageOptions { shadows: true, samples_per_axis: 2, ..StageOptions::default() })
}

fn camera() -> RigCamera {
    let rig = RigOptions { width: 48, height: 36, rgb: 0, event: 1, test: 0, ..RigOptions::default() };
    let camera = rig.cameras(1).unwrap().remove(0);
    assert_eq!(camera.role, Role::Event);
    camera
}

fn quiet(_: f64) {}

fn filmed(view: &StageView<'_>, options: &EventOptions) -> Events {
    record(view, SPAN, options, 1, 0, &quiet).unwrap()
}

fn levels(view: &StageView<'_>, options: &EventOptions, t_us: i64) -> Vec<f64> {
    view.exposure([t_us * 1000; 2], 1).into_iter().map(|pixel| options.response(pixel.map(f64::from))).collect()
}

/// What each pixel's signed events add up to, up to and including `t_us`.
fn sums(events: &Events, options: &EventOptions, t_us: i64) -> Vec<f64> {
    let mut sums = vec![0.0; (events.width * events.height) as usize];
    for event in events.iter().take_while(|event| event.t_us <= t_us) {
        let pixel = usize::from(event.y) * events.width as usize + usize::from(event.x);
        sums[pixel] += if event.on { options.threshold_on } else { -options.threshold_off };
    }
    sums
}

#[test]
fn signed_events_follow_the_log_intensity_within_one_threshold() {
    let (steady, camera) = (stage(), camera());
    let flicker = Some(Flicker { hz: 100.0, depth: 0.8 });
    let flickering = Stage::new(StageOptions { flicker, ..steady.options.clone() });
    for (stage, linear_light, threshold_on, threshold_off) in [
        (&steady, false, 0.2, 0.2),
        (&steady, false, 0.05, 0.11),
        (&steady, true, 0.3, 0.25),
        (&flickering, true, 0.2, 0.2),
    ] {
        let view = StageView::new(stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
        let options = EventOptions { linear_light, threshold_on, threshold_off, ..EventOptions::ideal() };
        let events = filmed(&view, &options);
        assert!(events.len() > 500, "only {} events", events.len());
        let start = levels(&view, &options, SPAN[0] / 1000);
        let (mut worst, mut looks, mut beyond) = (0.0_f64, 0, 0);
        for look in 0..150 {
            let share = random::uniform(random::key(5, &[look]));
            let t_us = SPAN[0] / 1000 + (share * 120_000.0) as i64;
            let (now, sums) = (levels(&view, &options, t_us), sums(&events, &options, t_us));
            for ((now, start), sum) in now.iter().zip(&start).zip(&sums) {
                let left = now - start - sum;
                let over = (left - threshold_on).max(-left - threshold_off);
                worst = worst.max(over);
                beyond += u32::from(over > 1e-5);
                looks += 1;
            }
        }
        // Between two looks at a pixel a peak may rise past a threshold by the tolerance of the halving and fall back.
        assert!(worst < 0.5 * threshold_on.min(threshold_off), "off by {worst} beyond the threshold");
        assert!(f64::from(beyond) < 2e-4 * f64::from(looks), "{beyond} of {looks} looks are beyond the threshold");
    }
}

#[test]
fn an_event_carries_the_first_microsecond_past_its_crossing() {
    let (stage, camera) = (stage(), camera());
    let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
    let options = EventOptions::ideal();
    let events = filmed(&view, &options);
    let start = levels(&view, &options, SPAN[0] / 1000);
    for pick in 0..60 {
        let event = events.get(random::below(random::key(9, &[pick]), events.len() as u64) as usize);
        let pixel = usize::from(event.y) * events.width as usize + usize::from(event.x);
        let sum = sums(&events, &options, event.t_us)[pixel];
        let sign = if event.on { 1.0 } else { -1.0 };
        let past = |t_us: i64| sign * (levels(&view, &options, t_us)[pixel] - start[pixel] - sum);
        assert!(past(event.t_us) > -1e-5, "{event:?} came early: {}", past(event.t_us));
        assert!(past(event.t_us - 1) < 1e-5, "{event:?} came late: {}", past(event.t_us - 1));
    }
}

#[test]
fn events_are_ordered_inside_the_sensor_and_the_span() {
    let (stage, camera) = (stage(), camera());
    let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
    let events = filmed(&view, &EventOptions { shot_hz: 20.0, leak_hz: 5.0, ..EventOptions::default() });
    assert!(events.t_us.is_sorted());
    for event in events.iter() {
        assert!(u32::from(event.x) < events.width && u32::from(event.y) < events.height);
        assert!(event.t_us * 1000 >= SPAN[0] && event.t_us * 1000 <= SPAN[1]);
    }
}

#[test]
fn a_pixel_is_blind_for_the_refractory_period() {
    let (stage, camera) = (stage(), camera());
    let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
    let events = filmed(&view, &EventOptions { refractory_us: 700, shot_hz: 50.0, ..EventOptions::default() });
    let mut last = vec![i64::MIN / 2; (events.width * events.height) as usize];
    for event in events.iter() {
        let pixel = usize::from(event.y) * events.width as usize + usize::from(event.x);
        assert!(event.t_us - last[pixel] >= 700, "{} us apart", event.t_us - last[pixel]);
        last[pixel] = event.t_us;
    }
    assert!(events.len() < filmed(&view, &EventOptions::default()).len() + 20_000);
}

#[test]
fn leak_shot_noise_and_hot_pixels_have_their_nominal_rates() {
    let (stage, camera) = (stage(), camera());
    let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
    // Pixels at the left edge, which nothing reaches during the take.
    let still: Vec<usize> = {
        let masks: Vec<Vec<bool>> = (0..=60).map(|k| view.mask(SPAN[0] + k * 2_000_000)).collect();
        (0..view.pixels()).filter(|&pixel| masks.iter().all(|mask| !mask[pixel])).collect()
    };
    assert!(still.len() > 500);
    let seconds = (SPAN[1] - SPAN[0]) as f64 * 1e-9;
    let count = |options: &EventOptions| {
        let events = filmed(&view, options);
        let mut counts = [0_u32; 2];
        for event in events.iter() {
            let pixel = usize::from(event.y) * events.width as usize + usize::from(event.x);
            counts[usize::from(event.on)] += u32::from(still.binary_search(&pixel).is_ok());
        }
        counts.map(f64::from)
    };
    let exposure = still.len() as f64 * seconds;
    let near = |count: f64, rate: f64| {
        (count - rate * exposure).abs() < 5.0 * (rate * exposure).sqrt() + 0.03 * rate * exposure
    };
    let [off, on] = count(&EventOptions { shot_hz: 40.0, ..EventOptions::ideal() });
    assert!(near(off, 20.0) && near(on, 20.0), "{off} OFF and {on} ON in {exposure} s");
    let [off, on] = count(&EventOptions { leak_hz: 30.0, ..EventOptions::ideal() });
    // The mean of v2e's log-normal spread of a tenth of a decade is 1.027 times its median.
    assert!(off == 0.0 && near(on, 30.0 * 1.027), "{off} OFF and {on} ON in {exposure} s");
    let [off, on] = count(&EventOptions { hot_share: 0.1, hot_hz: 300.0, ..EventOptions::ideal() });
    assert!(
        off == 0.0 && on > 0.5 * 30.0 * exposure && on < 1.5 * 30.0 * exposure,
        "{off} OFF and {on} ON in {exposure} s"
    );
    assert_eq!(count(&EventOptions::ideal()), [0.0, 0.0], "an ideal pixel in constant light is silent");
}

#[test]
fn impossible_sensors_are_typed_errors() {
    let (stage, camera) = (stage(), camera());
    let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera).unwrap();
    let good = EventOptions::default();
    for bad in [
        EventOptions { threshold_on: 0.0, ..good.clone() },
        EventOptions { threshold_off: f64::NAN, ..good.clone() },
        EventOptions { threshold_sigma: -1.0, ..good.clone() },
        EventOptions { refractory_us: -1, ..good.clone() },
        EventOptions { shot_hz: f64::INFINITY, ..good.clone() },
        EventOptions { hot_share: 2.0, ..good.clone() },
        EventOptions { lin_log_threshold: 0.0, ..good.clone() },
    ] {
        assert!(record(&view, SPAN, &bad, 1, 0, &quiet).is_err(), "{bad:?}");
    }
    for span in [[0, 0], [1000, 0], [i64::MIN, i64::MAX], [0, 999]] {
        assert!(record(&view, span, &good, 1, 0, &quiet).is_err(), "{span:?}");
    }
}
