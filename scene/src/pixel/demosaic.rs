//! Colour from a Bayer mosaic: gradient-corrected linear interpolation.
//!
//! H. S. Malvar, L. He, R. Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned color images",
//! ICASSP 2004. A missing colour is the mean of its nearest neighbours, corrected by the curvature of the colour that is
//! known at the pixel, with the paper's gains 1/2 (green), 5/8 (red and blue at green) and 3/4 (red at blue and the other
//! way round), whose filters have coefficients of sixteenths. All filters are linear and symmetric and sum to one, so
//! that a scene whose colours change linearly comes back exactly.

use super::BayerOrder;

/// Pixels that the filters reach beyond a pixel.
const REACH: usize = 2;

/// Red, green and blue of every pixel. `mosaic` holds `height` rows of `width` values, at least two of each; beyond its
/// borders it goes on as its mirror image about the outermost pixels, in which the order of the colours is the same.
#[must_use]
pub fn demosaic(order: BayerOrder, width: usize, height: usize, mosaic: &[f32]) -> Vec<f32> {
    if width < 2 || height < 2 || mosaic.len() < width * height {
        return vec![0.0; 3 * width * height];
    }
    let padded = padded(width, height, mosaic);
    let stride = width + 2 * REACH;
    let mut rgb = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        let [nn, n, row, s, ss] = std::array::from_fn(|k| &padded[(y + k) * stride..][..stride]);
        let first = [order.colour(0, y), order.colour(1, y)];
        for x in 0..width {
            let (own, beside) = (first[x % 2], first[(x + 1) % 2]);
            let c = row[x + 2];
            let (vertical, horizontal) = (n[x + 2] + s[x + 2], row[x + 1] + row[x + 3]);
            let (far_vertical, far_horizontal) = (nn[x + 2] + ss[x + 2], row[x] + row[x + 4]);
            let diagonal = n[x + 1] + n[x + 3] + s[x + 1] + s[x + 3];
            let mut pixel = [0.0; 3];
            pixel[own] = c;
            if own == 1 {
                let towards = |near: f32, far: f32, across: f32| {
                    (10.0 * c + 8.0 * near - 2.0 * diagonal - 2.0 * far + across) / 16.0
                };
                pixel[beside] = towards(horizontal, far_horizontal, far_vertical);
                pixel[2 - beside] = towards(vertical, far_vertical, far_horizontal);
            } else {
                let far = far_vertical + far_horizontal;
                pixel[1] = (8.0 * c + 4.0 * (vertical + horizontal) - 2.0 * far) / 16.0;
                pixel[2 - own] = (12.0 * c + 4.0 * diagonal - 3.0 * far) / 16.0;
            }
            rgb.extend(pixel);
        }
    }
    rgb
}

/// The mosaic with what lies beyond its borders.
fn padded(width: usize, height: usize, mosaic: &[f32]) -> Vec<f32> {
    let columns: Vec<usize> = (0..width + 2 * REACH).map(|x| mirrored(x, width)).collect();
    let rows = (0..height + 2 * REACH).map(|y| &mosaic[mirrored(y, height) * width..][..width]);
    rows.flat_map(|row| columns.iter().map(|&x| row[x])).collect()
}

/// The index, among `count`, at which the one `REACH` before `index` is found, mirrored about the first and the last.
/// The period `2 (count - 1)` is even, so that columns and rows keep their colours.
fn mirrored(index: usize, count: usize) -> usize {
    let period = 2 * (count - 1);
    let at = (index + REACH * (period - 1)) % period;
    at.min(period - at)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mosaic(order: BayerOrder, width: usize, height: usize, scene: impl Fn(usize, usize) -> [f32; 3]) -> Vec<f32> {
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        places.map(|(x, y)| scene(x, y)[order.colour(x, y)]).collect()
    }

    #[test]
    fn borders_mirror_about_the_outermost_pixel() {
        let around = |count| (0..count + 4).map(|index| mirrored(index, count)).collect::<Vec<_>>();
        assert_eq!(around(5), [2, 1, 0, 1, 2, 3, 4, 3, 2]);
        assert_eq!(around(3), [2, 1, 0, 1, 2, 1, 0]);
        assert_eq!(around(2), [0, 1, 0, 1, 0, 1]);
    }

    #[test]
    fn linear_ramps_of_three_slopes_come_back_exactly() {
        let scene = |x: usize, y: usize| {
            let (x, y) = (x as f32, y as f32);
            [100.0 + 3.0 * x + 2.0 * y, 500.0 - 5.0 * x + 7.0 * y, 40.0 + x - y]
        };
        let (width, height) = (13, 12);
        for order in BayerOrder::ALL {
            let rgb = demosaic(order, width, height, &mosaic(order, width, height, scene));
            for y in 2..height - 2 {
                for x in 2..width - 2 {
                    assert_eq!(rgb[3 * (y * width + x)..][..3], scene(x, y), "{order:?} at ({x}, {y})");
                }
            }
        }
    }

    #[test]
    fn a_flat_scene_is_flat_up_to_its_corners_at_any_size() {
        let scene = [200.0, 90.0, 30.0];
        for order in BayerOrder::ALL {
            for (width, height) in [(2, 2), (3, 2), (2, 5), (4, 3), (7, 6)] {
                let rgb = demosaic(order, width, height, &mosaic(order, width, height, |_, _| scene));
                assert!(rgb.chunks(3).all(|pixel| pixel == scene), "{order:?} {width}x{height}: {rgb:?}");
            }
        }
    }

    #[test]
    fn a_single_bright_pixel_spreads_with_the_papers_coefficients() {
        // Figure 2 of the paper, in eighths: what a pixel gives to its neighbours.
        let (width, height, bright) = (9, 9, (4, 4));
        let gives = |order, colour: usize, dx: usize, dy: usize| {
            let mut mosaic = vec![0.0; width * height];
            mosaic[bright.1 * width + bright.0] = 8.0;
            demosaic(order, width, height, &mosaic)[3 * ((bright.1 + dy) * width + bright.0 + dx) + colour]
        };
        // At (4, 4) of RGGB is red. Its right neighbour is green in a row of red, its lower one in a column of red.
        let red = |colour, dx, dy| gives(BayerOrder::Rggb, colour, dx, dy);
        assert_eq!([red(0, 0, 0), red(1, 0, 0), red(2, 0, 0)], [8.0, 4.0, 6.0]);
        assert_eq!([red(0, 1, 0), red(0, 0, 1), red(0, 1, 1)], [4.0, 4.0, 2.0]);
        assert_eq!([red(1, 1, 0), red(2, 1, 0), red(2, 0, 1)], [0.0, 0.0, 0.0]);
        assert_eq!([red(1, 2, 0), red(1, 0, 2), red(2, 2, 0), red(2, 0, 2)], [-1.0, -1.0, -1.5, -1.5]);
        // At (4, 4) of GRBG is green in a row of red.
        let green = |colour, dx, dy| gives(BayerOrder::Grbg, colour, dx, dy);
        assert_eq!([green(0, 0, 0), green(1, 0, 0), green(2, 0, 0)], [5.0, 8.0, 5.0]);
        assert_eq!([green(1, 1, 0), green(1, 0, 1)], [2.0, 2.0]);
        assert_eq!([green(0, 1, 1), green(2, 1, 1)], [-1.0, -1.0]);
        assert_eq!([green(0, 2, 0), green(0, 0, 2), green(2, 2, 0), green(2, 0, 2)], [-1.0, 0.5, 0.5, -1.0]);
    }

    #[test]
    fn what_has_no_rows_or_columns_is_black() {
        assert_eq!(demosaic(BayerOrder::Rggb, 1, 2, &[9.0; 2]), [0.0; 6]);
        assert_eq!(demosaic(BayerOrder::Rggb, 2, 2, &[9.0; 3]), [0.0; 12]);
    }
}
