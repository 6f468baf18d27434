use erfgs_base::random;
use erfgs_scene::{Distortion, ImageGrey8, Intrinsics};
use glam::DVec2;

use super::{super::Stick, *};

fn intrinsics() -> Intrinsics {
    Intrinsics { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 160.0, cy: 120.0, distortion: Distortion::None }
}

fn stick() -> Stick {
    Stick::new([0.13, 0.26]).unwrap()
}

/// Three LEDs that move across the image: where they are at a time in seconds. Image gaps are as those of a wand seen
/// broadside.
fn leds(t: f64) -> [DVec2; 3] {
    let first = DVec2::new(100.0 + 140.0 * t, 80.0 + 120.0 * t);
    [0.0, 20.0, 60.0].map(|along| first + DVec2::new(along, 0.3 * along))
}

/// The brightness of a LED's image at a distance from its middle, times the background's.
fn brightness(distance: f64) -> f64 {
    20.0 * (-0.5 * (distance / 1.6).powi(2)).exp()
}

/// Events of LEDs that blink, half of the time on, over a second, with noise events and a pixel that blinks by itself.
fn events(led_hz: &[f64; 3]) -> Vec<(i64, u16, u16, bool)> {
    let mut events = Vec::new();
    for (led, hz) in led_hz.iter().enumerate() {
        for half in 0..(2.0 * hz) as i64 {
            let t = 0.5 * half as f64 / hz + 1e-4;
            let (middle, on) = (leds(t)[led], half % 2 == 0);
            for y in 0..240_u16 {
                for x in (middle.x as u16).saturating_sub(8)..=(middle.x as u16 + 8).min(319) {
                    let from = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - middle;
                    if from.y.abs() > 8.0 {
                        continue;
                    }
                    let count = ((1.0 + brightness(from.length())).ln() / 0.25) as u64;
                    for event in 0..count.min(4) {
                        let key = random::key(1, &[led as u64, half as u64, u64::from(x), u64::from(y), event]);
                        let late_us = 20.0 + 30.0 * random::uniform(key) + 40.0 * event as f64;
                        events.push(((t * 1e6 + late_us) as i64, x, y, on));
                    }
                }
            }
        }
    }
    for index in 0..40_000 {
        let key = |word| random::uniform(random::key(2, &[index, word]));
        events.push(((key(0) * 1e6) as i64, (key(1) * 320.0) as u16, (key(2) * 240.0) as u16, key(3) < 0.5));
    }
    for index in 0..1000 {
        events.push((index * 1000, 300, 20, index % 2 == 0));
    }
    events.sort_unstable();
    events
}

/// In how many windows the wand was found, the standard deviation of lights' places (pixels), and how far behind the lights
/// they lie in the mean, seconds.
fn detect(led_hz: [f64; 3], options: BlinkOptions) -> (usize, f64, f64) {
    let mut detector = BlinkDetector::new(320, 240, options).unwrap();
    let mut lights = Vec::new();
    for (t_us, x, y, on) in events(&led_hz) {
        detector.event(t_us, x, y, on);
        lights.extend(detector.take());
    }
    lights.extend(detector.finish());
    let (mut found, mut squares, mut behind, mut count) = (0, 0.0, 0.0, 0);
    let velocity = leds(1.0)[0] - leds(0.0)[0];
    for lights in &lights {
        let Some(seen) = choose(&stick(), &intrinsics(), &lights.by_frequency) else { continue };
        found += usize::from(seen.iter().all(Option::is_some));
        for (pixel, known) in seen.iter().zip(leds(lights.t as f64 * 1e-6)) {
            if let Some(pixel) = pixel {
                assert!((*pixel - known).length() < 1.5, "{} {pixel} {known}", lights.t);
                squares += (*pixel - known).length_squared();
                behind += (known - *pixel).dot(velocity) / velocity.length_squared();
                count += 2;
            }
        }
    }
    (found, (squares / f64::from(count)).sqrt(), 2.0 * behind / f64::from(count))
}

#[test]
fn blinking_leds_are_found_and_told_apart_by_frequency() {
    let hz = [400.0, 520.0, 680.0];
    let (found, sigma_px, behind_s) = detect(hz, BlinkOptions { led_hz: hz.to_vec(), ..BlinkOptions::default() });
    assert!(found >= 96, "{found} of 100 windows");
    assert!(sigma_px < 0.15, "{sigma_px} px");
    // Events come 0.1 ms after the light; what is found must not be where the light was some periods ago.
    assert!(behind_s.abs() < 5e-4, "{behind_s} s behind");
}

#[test]
fn leds_of_one_frequency_are_told_apart_by_their_gaps() {
    let (found, sigma_px, behind_s) = detect([500.0; 3], BlinkOptions::default());
    assert!(found >= 96, "{found} of 100 windows");
    assert!(sigma_px < 0.15, "{sigma_px} px");
    // Events come 0.1 ms after the light; what is found must not be where the light was some periods ago.
    assert!(behind_s.abs() < 5e-4, "{behind_s} s behind");
}

#[test]
fn frequencies_that_cannot_be_told_apart_are_refused() {
    let with = |led_hz: &[f64]| BlinkOptions { led_hz: led_hz.to_vec(), ..BlinkOptions::default() }.check();
    assert!(with(&[400.0, 500.0, 640.0]).is_ok());
    assert!(with(&[400.0, 450.0, 640.0]).unwrap_err().contains("told apart"));
    assert!(with(&[400.0, 500.0]).unwrap_err().starts_with("2 LED frequencies"));
    assert!(with(&[0.0]).is_err() && with(&[]).is_err());
}

#[test]
fn bright_spots_are_found_to_a_tenth_of_a_pixel() {
    for shift in 0..10 {
        let t = 0.0123 * f64::from(shift);
        let mut image = ImageGrey8 { width: 320, height: 240, data: Vec::new() };
        for y in 0..240 {
            for x in 0..320 {
                let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let light: f64 = leds(t).iter().map(|led| 15.0 * brightness((at - *led).length())).sum();
                let noise = 3.0 * random::normal(random::key(3, &[shift as u64, x as u64, y as u64]));
                image.data.push((30.0 + noise + light).clamp(0.0, 255.0) as u8);
            }
        }
        // A lamp in the background.
        for index in 0..20 {
            image.data[320 * (5 + index / 5) + 10 + index % 5] = 250;
        }
        let lights = bright_lights(&image, &BrightOptions::default());
        let seen = choose(&stick(), &intrinsics(), &[lights]).unwrap();
        for (pixel, known) in seen.iter().flatten().zip(leds(t)) {
            assert!((*pixel - known).length() < 0.1, "{pixel} {known}");
        }
    }
    let dark = ImageGrey8 { width: 4, height: 4, data: vec![7; 16] };
    assert!(bright_lights(&dark, &BrightOptions::default()).is_empty());
}
