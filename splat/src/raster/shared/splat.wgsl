// A Gaussian as it appears in the image. log2 of its alpha at distance (dx, dy) of the mean is
// a dx^2 + b dx dy + c dy^2 + log2 of its opacity.

struct Splat {
    // xy: mean, pixels; zw: a, b.
    mean_power: vec4f,
    // x: c; y: log2 of the opacity; zw: half width and half height of what it covers, pixels (0: not visible).
    shape: vec4f,
    // rgb; w: depth along the optical axis, metres.
    colour_depth: vec4f,
    // x: 1 / half width; y: half height of what it covers of the column of pixels through the mean; z: slope of the line
    // through the middles of the columns.
    column: vec4f,
}

const LOG2_E = 1.4426950408889634;
const LOG2_LARGEST_ALPHA = -0.01449956969511509;

// The squared Mahalanobis distance at which alpha is negligible, with a margin for rounding: the blending alone
// decides what is negligible.
fn squared_reach(log_opacity: f32) -> f32 {
    return 2.0 / LOG2_E * (log_opacity - view.thresholds.y) * 1.0001 + 1e-4;
}

// Alpha at distance `d` of the mean. Rounding can lift the power of a needle above 0: that is bounded too.
fn alpha_of(splat: Splat, d: vec2f) -> f32 {
    let power = d.x * (splat.mean_power.z * d.x + splat.mean_power.w * d.y) + splat.shape.x * d.y * d.y;
    return exp2(min(power + splat.shape.y, min(splat.shape.y, LOG2_LARGEST_ALPHA)));
}
