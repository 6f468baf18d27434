//! Events as pictures.

use erfgs_events::Events;
use erfgs_scene::ImageRgb8;

/// ON minus OFF events of each pixel with `from_us <= t < to_us`, row-major.
#[must_use]
pub fn signed_counts(events: &Events, from_us: i64, to_us: i64) -> Vec<i32> {
    let mut counts = vec![0; events.width as usize * events.height as usize];
    for index in events.between(from_us, to_us) {
        let event = events.get(index);
        if u32::from(event.x) < events.width
            && let Some(count) = counts.get_mut(usize::from(event.y) * events.width as usize + usize::from(event.x))
        {
            *count += if event.on { 1 } else { -1 };
        }
    }
    counts
}

/// Signed values of each pixel (event counts, or a rendered change of log intensity in thresholds) as a picture: white for
/// none, red for ON, blue for OFF, full colour at `full` and above. Values that are not numbers are grey; pixels without a
/// value are white.
#[must_use]
pub fn picture(values: impl IntoIterator<Item = f32>, width: u32, height: u32, full: f32) -> ImageRgb8 {
    const ON: [f32; 3] = [200.0, 20.0, 30.0];
    const OFF: [f32; 3] = [20.0, 50.0, 200.0];
    let mut image = ImageRgb8::new(width, height);
    image.data.fill(255);
    for (pixel, value) in image.data.chunks_exact_mut(3).zip(values) {
        let amount = (value.abs() / full.max(f32::MIN_POSITIVE)).min(1.0);
        let colour = if value > 0.0 { ON } else { OFF };
        for (channel, end) in pixel.iter_mut().zip(colour) {
            *channel = if value.is_nan() { 128 } else { (255.0 + (end - 255.0) * amount).round() as u8 };
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;
    use erfgs_events::Event;

    #[test]
    fn counts_are_signed_and_the_window_is_half_open() {
        let mut events = Events::new(3, 2);
        for (t_us, x, y, on) in [(0, 0, 0, true), (5, 1, 1, false), (5, 1, 1, false), (6, 1, 1, true), (9, 2, 0, true)]
        {
            events.push(Event { t_us, x, y, on });
        }
        assert_eq!(signed_counts(&events, 0, 9), [1, 0, 0, 0, -1, 0]);
        assert_eq!(signed_counts(&events, 6, 10), [0, 0, 1, 0, 1, 0]);
        assert_eq!(signed_counts(&events, 9, 0), [0; 6]);
    }

    #[test]
    fn on_is_red_off_is_blue_nothing_is_white() {
        let image = picture([0.0, 2.0, -1.0, f32::NAN, 99.0], 3, 2, 2.0);
        assert_eq!(image.pixel(0, 0), [255, 255, 255]);
        assert_eq!(image.pixel(1, 0), [200, 20, 30]);
        assert_eq!(image.pixel(2, 0), [138, 153, 228]);
        assert_eq!(image.pixel(0, 1), [128, 128, 128]);
        assert_eq!(image.pixel(1, 1), image.pixel(1, 0));
        assert_eq!(image.pixel(2, 1), [255, 255, 255]);
    }
}
