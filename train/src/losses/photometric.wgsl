// Mean absolute difference between a rendered exposure and a frame, and its gradient with respect to the exposure.

struct Parameters { pixels: u32, threads: u32, linear_light: u32, scale: f32 }

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> mean: array<vec4f>;
// Frame, 8 bits a channel, red in the lowest byte; alpha 0 leaves the pixel out.
@group(0) @binding(2) var<storage, read> frame: array<u32>;
@group(0) @binding(3) var<storage, read_write> d_mean: array<vec4f>;
// Each thread's own sum, added to.
@group(0) @binding(4) var<storage, read_write> loss: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let thread = (group.y * groups.x + group.x) * 64u + lane;
    if (thread >= p.threads) { return; }
    var sum = 0.0;
    for (var pixel = thread; pixel < p.pixels; pixel += p.threads) {
        let truth = unpack4x8unorm(frame[pixel]);
        var colour = mean[pixel].rgb;
        var slope = vec3f(1.0);
        if (p.linear_light != 0u) {
            slope = vec3f(d_to_display(colour.r), d_to_display(colour.g), d_to_display(colour.b));
            colour = vec3f(to_display(colour.r), to_display(colour.g), to_display(colour.b));
        }
        let error = select(vec3f(0.0), colour - truth.rgb, truth.a > 0.0);
        sum += abs(error.r) + abs(error.g) + abs(error.b);
        d_mean[pixel] = vec4f(p.scale * sign(error) * slope, 0.0);
    }
    loss[thread] += sum;
}
