// The gradient of one rendering of an exposure from the gradient of the exposure's mean, where light was averaged.

struct Parameters { pixels: u32, weight: f32, unused_a: u32, unused_b: u32 }

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> image: array<vec4f>;
@group(0) @binding(2) var<storage, read> d_mean: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> d_image: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.y * groups.x + group.x) * 64u + lane;
    if (pixel >= p.pixels) { return; }
    let x = image[pixel].rgb;
    let slope = vec3f(d_to_linear(x.r), d_to_linear(x.g), d_to_linear(x.b));
    d_image[pixel] = vec4f(p.weight * slope * d_mean[pixel].rgb, 0.0);
}
