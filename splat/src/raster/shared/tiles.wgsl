// Which tiles a splat touches (GPU shape). The host's twin is `bins.rs`.

const TILE = 16u;

// Pixels whose centre lies within low..high, as first and end index within 0..size.
fn pixels_between(low: f32, high: f32, size: u32) -> vec2u {
    let bound = f32(size);
    return vec2u(vec2f(clamp(ceil(low - 0.5), 0.0, bound), clamp(floor(high - 0.5) + 1.0, 0.0, bound)));
}

// Rows of tiles that a splat touches: first and end.
fn tile_rows(splat: Splat) -> vec2u {
    let my = splat.mean_power.y;
    let half_height = splat.shape.w;
    let pixels = pixels_between(my - half_height, my + half_height, view.size.y);
    if !(splat.shape.z > 0.0) || pixels.x >= pixels.y {
        return vec2u(0u);
    }
    return vec2u(pixels.x / TILE, (pixels.y - 1u) / TILE + 1u);
}

// Tiles of one row that a splat touches: first and end column. The ellipse of the splat reaches furthest right at
// `rightmost_y`, or, where the row does not contain that, at the border of the row that is nearer to it.
fn tile_columns(splat: Splat, row: u32) -> vec2u {
    let mean = splat.mean_power.xy;
    let extent = splat.shape.zw;
    var left = -extent.x;
    var right = extent.x;
    if view.switches.y == 0u {
        let rows = pixels_between(mean.y - extent.y, mean.y + extent.y, view.size.y);
        let low = f32(max(row * TILE, rows.x)) + 0.5 - mean.y;
        let high = f32(min((row + 1u) * TILE, rows.y)) - 0.5 - mean.y;
        let rightmost_y = splat.column.z * extent.x;
        let slant = -0.5 * splat.mean_power.w / splat.mean_power.z;
        let reach = max(squared_reach(splat.shape.y), 0.0) * (-0.5 * LOG2_E / splat.mean_power.z);
        if rightmost_y < low || rightmost_y > high {
            let y = clamp(rightmost_y, low, high);
            right = slant * y + sqrt(reach * max(1.0 - (y / extent.y) * (y / extent.y), 0.0));
        }
        if -rightmost_y < low || -rightmost_y > high {
            let y = clamp(-rightmost_y, low, high);
            left = slant * y - sqrt(reach * max(1.0 - (y / extent.y) * (y / extent.y), 0.0));
        }
    }
    let pixels = pixels_between(mean.x + left, mean.x + right, view.size.x);
    if pixels.x >= pixels.y {
        return vec2u(0u);
    }
    return vec2u(pixels.x / TILE, (pixels.y - 1u) / TILE + 1u);
}
