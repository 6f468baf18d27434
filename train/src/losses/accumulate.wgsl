// Adds one rendering of an exposure to the exposure's mean, in display or in linear light.

struct Parameters { pixels: u32, first: u32, linear_light: u32, weight: f32 }

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> image: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> mean: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let pixel = (group.y * groups.x + group.x) * 64u + lane;
    if (pixel >= p.pixels) { return; }
    var light = image[pixel].rgb;
    if (p.linear_light != 0u) { light = vec3f(to_linear(light.r), to_linear(light.g), to_linear(light.b)); }
    let before = select(mean[pixel].rgb, vec3f(0.0), p.first != 0u);
    mean[pixel] = vec4f(before + p.weight * light, 0.0);
}
