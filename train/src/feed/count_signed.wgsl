// The signed event count of each pixel from its ON and OFF events, units of the sensor's threshold, less what nothing caused.

struct Parameters {
    pixels: u32,
    // Whether pixels have steps of their own.
    own_steps: u32,
    // Whether the pixels outside of the region are left out.
    in_region: u32,
    drift: f32,
    // What an ON and an OFF event change.
    on: f32,
    off: f32,
    unused_a: u32,
    unused_b: u32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
// ON and OFF events of each pixel.
@group(0) @binding(1) var<storage, read> sums: array<vec2u>;
@group(0) @binding(2) var<storage, read> steps: array<vec2f>;
// A bit a pixel.
@group(0) @binding(3) var<storage, read> region: array<u32>;
// LEFT_OUT where a pixel is left out.
@group(0) @binding(4) var<storage, read_write> count: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.y * groups.x + group.x) * 64u + lane;
    if (pixel >= p.pixels) { return; }
    if (p.in_region != 0u && (region[pixel / 32u] >> (pixel % 32u) & 1u) == 0u) {
        count[pixel] = LEFT_OUT;
        return;
    }
    var step = vec2f(p.on, p.off);
    // What tells of its own thresholds has what nothing caused in them.
    var drift = p.drift;
    if (p.own_steps != 0u) {
        let own = steps[pixel];
        drift = select(0.0, drift, all(own == step));
        step = own;
    }
    let events = vec2f(sums[pixel]);
    count[pixel] = events.x * step.x - events.y * step.y - drift;
}
