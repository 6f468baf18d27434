// A Gaussian as it appears in the image.

struct Splat {
    // xy: mean, pixels; zw: conic a, b (the inverse covariance is [a b; b c], per square pixel).
    mean_conic: vec4f,
    // x: conic c; y: opacity; zw: half width and half height of what it covers, pixels (0: not visible).
    shape: vec4f,
    // rgb; w: depth along the optical axis, metres.
    colour_depth: vec4f,
}

// The squared Mahalanobis distance at which alpha falls below 1/255, with a margin for rounding: the blending alone
// decides what is negligible.
fn squared_reach(opacity: f32) -> f32 {
    return 2.0 * log(255.0 * opacity) * 1.0001 + 1e-4;
}
