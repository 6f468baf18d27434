// The gradient of a splat, before it is taken apart: see `blend_backward_*.wgsl` for the sums.
struct SplatGradient {
    moments: vec4f,
    moments_colour: vec4f,
    // x: dL/d blue; y: number of tiles that the splat touches.
    blue_entries: vec4f,
}
