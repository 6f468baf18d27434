//! Smoothing by 1 2 1, again and again: each pass adds half a squared cell to the variance.

use erfgs_scene::image::ImageRgb8;

/// One pass along rows of `count` values that are `stride` apart, for all rows that begin in `starts`; what lies outside counts as the
/// nearest value inside.
fn pass(values: &mut [f32], starts: impl Iterator<Item = usize>, count: usize, stride: usize) {
    for start in starts {
        let mut before = values[start];
        for index in 0..count {
            let at = start + index * stride;
            let now = values[at];
            let after = if index + 1 < count { values[at + stride] } else { now };
            values[at] = 0.25 * before + 0.5 * now + 0.25 * after;
            before = now;
        }
    }
}

/// Smooths a row-major plane.
pub fn smooth_plane(values: &mut [f32], width: usize, height: usize, passes: usize) {
    if width == 0 || height == 0 {
        return;
    }
    for _ in 0..passes {
        pass(values, (0..height).map(|y| y * width), width, 1);
        pass(values, 0..width, height, width);
    }
}

/// Smooths a volume whose last index runs fastest.
pub fn smooth_volume(values: &mut [f32], [x, y, z]: [usize; 3], passes: usize) {
    if x == 0 || y == 0 || z == 0 {
        return;
    }
    for _ in 0..passes {
        pass(values, (0..x * y).map(|row| row * z), z, 1);
        pass(values, (0..x * z).map(|row| row / z * y * z + row % z), y, z);
        pass(values, 0..y * z, x, y * z);
    }
}

/// Smooths each channel of an image.
pub fn smooth_image(image: &ImageRgb8, passes: usize) -> ImageRgb8 {
    let mut smooth = image.clone();
    for channel in 0..3 {
        let mut plane: Vec<f32> = image.data.iter().skip(channel).step_by(3).map(|&value| f32::from(value)).collect();
        smooth_plane(&mut plane, image.width as usize, image.height as usize, passes);
        for (to, value) in smooth.data.iter_mut().skip(channel).step_by(3).zip(plane) {
            *to = value.round() as u8;
        }
    }
    smooth
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_smoothed_keeps_its_sum_and_spreads_by_half_a_cell_squared_with_each_pass() {
        let (x, y, z) = (21, 23, 25);
        let mut values = vec![0.0; x * y * z];
        values[(10 * y + 11) * z + 12] = 1.0;
        smooth_volume(&mut values, [x, y, z], 4);
        let mut moments = [0.0; 4];
        for (index, &value) in values.iter().enumerate() {
            let at = [index / (y * z), index / z % y, index % z].map(|at| at as f64);
            moments[0] += f64::from(value);
            for axis in 0..3 {
                moments[axis + 1] += f64::from(value) * (at[axis] - [10.0, 11.0, 12.0][axis]).powi(2);
            }
        }
        for (moment, expected) in moments.into_iter().zip([1.0, 2.0, 2.0, 2.0]) {
            assert!((moment - expected).abs() < 1e-5, "{moment} is not {expected}");
        }
    }

    #[test]
    fn a_flat_image_stays_flat_to_its_edge() {
        let image = ImageRgb8 { width: 3, height: 2, data: [7, 100, 255].repeat(6) };
        assert_eq!(smooth_image(&image, 5), image);
    }
}
