// The camera and the settings of one render; the Rust side is `uniform.rs`.

struct View {
    // Rows of the world-to-camera rotation; w: the translation, metres.
    world_to_camera: array<vec4f, 3>,
    // xyz: camera centre in the world, w: near plane.
    centre_near: vec4f,
    // fx, fy, cx, cy in pixels.
    pinhole: vec4f,
    // Bounds of x/z (xy) and of y/z (zw) in the Jacobian of the projection.
    slope_bounds: vec4f,
    // rgb: background; w: standard deviations that must lie in front of the camera.
    background: vec4f,
    // Image width, image height (pixels), tile columns, tile rows.
    size: vec4u,
    // Gaussians, rows of the deltas, active SH degree, floats in a row of SH.
    counts: vec4u,
    // Whether the deltas have SH; whether the 3 sigma square bounds a splat; the sum of STATISTICS, STILL_LEARN, IN_PART and POSE;
    // room for intersections.
    switches: vec4u,
    // Whether gradients of the deltas are wanted, and of their SH; ranges to gather; as the bits of a float, what is added to
    // the variances of a splat, square pixels, so that none is thinner than about a pixel.
    outputs: vec4u,
    // What `Thresholds` on the Rust side says: negligible alpha, its logarithm to base 2, least transmittance.
    thresholds: vec4f,
}

// That statistics are kept; that Gaussians without deltas have gradients, too; that a part of the image alone is looked at, though all
// of it was drawn; that the gradient of the camera's pose is wanted.
const STATISTICS = 1u;
const STILL_LEARN = 2u;
const IN_PART = 4u;
const POSE = 8u;
// In place of a Gaussian's index.
const NOBODY = 0xffffffffu;

// A test that holds whatever a compiler assumes about NaN.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}
