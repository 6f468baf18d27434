// Mean absolute difference between a rendered exposure, as its camera shows colours, and a frame; its gradients with
// respect to the exposure and to the camera's gain and offset.

struct Parameters {
    pixels: u32,
    threads: u32,
    linear_light: u32,
    scale: f32,
    view: u32,
    // 0: all pixels are compared, 1: those within, 2: those that are not.
    part: u32,
    unused_a: u32,
    unused_b: u32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> mean: array<vec4f>;
// Red, green and blue, a byte each, pixel by pixel.
@group(0) @binding(2) var<storage, read> frame: array<u32>;
// A bit a pixel.
@group(0) @binding(3) var<storage, read> within: array<u32>;
// Two a camera: gain and offset in display values.
@group(0) @binding(4) var<storage, read> colours: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> d_mean: array<vec4f>;
// Each thread's own sum, added to.
@group(0) @binding(6) var<storage, read_write> loss: array<f32>;
// Each thread's own gradient of the camera's gain and offset, unscaled, set anew.
@group(0) @binding(7) var<storage, read_write> d_colour: array<vec4f>;

fn stored(pixel: u32) -> vec3f {
    let byte = 3u * pixel;
    let shift = 8u * (byte & 3u);
    var bytes = frame[byte / 4u] >> shift;
    // The rest of the colour is in the next word.
    if (shift > 8u) { bytes |= frame[byte / 4u + 1u] << (32u - shift); }
    return unpack4x8unorm(bytes).rgb;
}

fn compared(pixel: u32) -> bool {
    if (p.part == 0u) { return true; }
    return (within[pixel / 32u] >> (pixel % 32u) & 1u) == (p.part & 1u);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let thread = (group.y * groups.x + group.x) * 64u + lane;
    if (thread >= p.threads) { return; }
    let gain = colours[2u * p.view].rgb;
    let offset = colours[2u * p.view + 1u].rgb;
    var sum = 0.0;
    var d_gain = vec3f(0.0);
    var d_offset = vec3f(0.0);
    for (var pixel = thread; pixel < p.pixels; pixel += p.threads) {
        let truth = stored(pixel);
        var colour = mean[pixel].rgb;
        var slope = gain;
        if (p.linear_light != 0u) {
            slope *= vec3f(d_to_display(colour.r), d_to_display(colour.g), d_to_display(colour.b));
            colour = vec3f(to_display(colour.r), to_display(colour.g), to_display(colour.b));
        }
        let error = select(vec3f(0.0), gain * colour + offset - truth, compared(pixel));
        let away = sign(error);
        sum += abs(error.r) + abs(error.g) + abs(error.b);
        d_mean[pixel] = vec4f(p.scale * away * slope, 0.0);
        d_gain += away * colour;
        d_offset += away;
    }
    loss[thread] += sum;
    d_colour[2u * thread] = vec4f(d_gain, 0.0);
    d_colour[2u * thread + 1u] = vec4f(d_offset, 0.0);
}
