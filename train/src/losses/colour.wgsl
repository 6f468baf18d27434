// The colour regulariser of ERF-GS: how much the colours of the deformed Gaussians change between two times, as the
// event camera sees them. Colours at the earlier time and the directions that they are seen from count as constants in
// the gradient.

struct Parameters {
    // Centre of the camera in the world, metres.
    centre: vec3f,
    // Multiplies the gradient of the sum of changes.
    scale: f32,
    rows: u32,
    threads: u32,
    // Floats in a row of SH.
    stride: u32,
    // Active SH degree.
    degree: u32,
    // What a change of 1 in one channel adds to the loss.
    share: f32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> core: array<vec4f>;
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read> before_core: array<vec4f>;
@group(0) @binding(4) var<storage, read> before_sh: array<f32>;
@group(0) @binding(5) var<storage, read> after_core: array<vec4f>;
@group(0) @binding(6) var<storage, read> after_sh: array<f32>;
// Gradients, added to.
@group(0) @binding(7) var<storage, read_write> d_sh: array<f32>;
@group(0) @binding(8) var<storage, read_write> d_delta_sh: array<f32>;
// Each thread's own sum, added to.
@group(0) @binding(9) var<storage, read_write> loss: array<f32>;

// The harmonics towards a place; a place at the camera's very centre has no direction, but finite ones all the same.
fn seen_from(place: vec3f) -> array<vec4f, 16> {
    let offset = place - p.centre;
    return harmonics_at(offset * inverseSqrt(max(dot(offset, offset), 1e-30)));
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let thread = (group.y * groups.x + group.x) * 64u + lane;
    if (thread >= p.threads) { return; }
    let coefficients = (p.degree + 1u) * (p.degree + 1u);
    var sum = 0.0;
    for (var row = thread; row < p.rows; row += p.threads) {
        let mean = core[3u * row].xyz;
        var basis_before = seen_from(mean + before_core[3u * row].xyz);
        var basis_after = seen_from(mean + after_core[3u * row].xyz);
        var colour_before = vec3f(0.5);
        var colour_after = vec3f(0.5);
        for (var k = 0u; k < coefficients; k++) {
            let at = row * p.stride + 3u * k;
            let raw = vec3f(sh[at], sh[at + 1u], sh[at + 2u]);
            let delta_before = vec3f(before_sh[at], before_sh[at + 1u], before_sh[at + 2u]);
            let delta_after = vec3f(after_sh[at], after_sh[at + 1u], after_sh[at + 2u]);
            colour_before += basis_before[k].w * (raw + delta_before);
            colour_after += basis_after[k].w * (raw + delta_after);
        }
        let change = max(colour_after, vec3f(0.0)) - max(colour_before, vec3f(0.0));
        sum += abs(change.x) + abs(change.y) + abs(change.z);
        let d_colour = select(vec3f(0.0), p.scale * sign(change), colour_after > vec3f(0.0));
        for (var k = 0u; k < coefficients; k++) {
            let gradient = basis_after[k].w * d_colour;
            for (var channel = 0u; channel < 3u; channel++) {
                let at = row * p.stride + 3u * k + channel;
                d_sh[at] += gradient[channel];
                d_delta_sh[at] += gradient[channel];
            }
        }
    }
    loss[thread] += p.share * sum;
}
