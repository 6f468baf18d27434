// The event loss of ERF-GS: the change of log luma between two renderings, in contrast thresholds, against the signed
// event count of every pixel between their times, and its gradients with respect to both renderings.

struct Parameters {
    pixels: u32,
    threads: u32,
    // 0: truncate with a straight-through gradient, 1: dead zone of one threshold, 2: the change itself.
    quantise: u32,
    // 0: absolute, 1: squared.
    norm: u32,
    // Whether a pixel is weighted by 1 / max(|E|, 1).
    confidence: u32,
    linear_light: u32,
    // Grey level (of 255) below which the logarithm is continued as a straight line through zero.
    lin_log: f32,
    // 1 / contrast threshold.
    inverse_threshold: f32,
    scale: f32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> before: array<vec4f>;
@group(0) @binding(2) var<storage, read> after: array<vec4f>;
// Signed event count E of each pixel; beyond 1e30 the pixel is left out.
@group(0) @binding(3) var<storage, read> count: array<f32>;
@group(0) @binding(4) var<storage, read_write> d_before: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> d_after: array<vec4f>;
// Each thread's own sum, added to.
@group(0) @binding(6) var<storage, read_write> loss: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let thread = (group.y * groups.x + group.x) * 64u + lane;
    if (thread >= p.threads) { return; }
    var sum = 0.0;
    for (var pixel = thread; pixel < p.pixels; pixel += p.threads) {
        if (count[pixel] > 1e30) {
            d_before[pixel] = vec4f(0.0);
            d_after[pixel] = vec4f(0.0);
            continue;
        }
        let start = lin_log(before[pixel].rgb);
        let end = lin_log(after[pixel].rgb);
        let events = count[pixel];
        let change = (end.w - start.w) * p.inverse_threshold;
        var error = change - events;
        if (p.quantise == 0u) {
            error = trunc(change) - events;
        } else if (p.quantise == 1u) {
            error = sign(error) * max(abs(error) - 1.0, 0.0);
        }
        let weight = select(1.0, 1.0 / max(abs(events), 1.0), p.confidence != 0u);
        var slope = weight * sign(error);
        if (p.norm == 1u) {
            sum += weight * error * error;
            slope = 2.0 * weight * error;
        } else {
            sum += weight * abs(error);
        }
        slope *= p.scale * p.inverse_threshold;
        d_before[pixel] = vec4f(-slope * start.xyz, 0.0);
        d_after[pixel] = vec4f(slope * end.xyz, 0.0);
    }
    loss[thread] += sum;
}
