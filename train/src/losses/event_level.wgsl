// The event loss of one rendering: its log luma, in contrast thresholds, against what each pixel's level and its signed event count
// since the beginning say. The level, which the count began at, is not known: it follows what the renderings say of it.
// An error counts as much as it is seen: in the dark, where a logarithm is steep, less. FIRST and FLATTEST are those of `level.rs`.

struct Parameters {
    pixels: u32,
    threads: u32,
    linear_light: u32,
    // Grey level (of 255) below which the logarithm is continued as a straight line through zero.
    lin_log: f32,
    // 1 / contrast threshold.
    inverse_threshold: f32,
    scale: f32,
    // The most that a level is moved by, and half the width of what is no error, contrast thresholds.
    rate: f32,
    dead: f32,
    // What an error costs is divided by how steep the logarithm is there, beside this.
    slope: f32,
    unused_0: u32,
    unused_1: u32,
    unused_2: u32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> image: array<vec4f>;
// Signed event count of each pixel since the beginning; beyond 1e30 the pixel is left out.
@group(0) @binding(2) var<storage, read> count: array<f32>;
// The level of each pixel, contrast thresholds, and in how many renderings it was seen.
@group(0) @binding(3) var<storage, read_write> level: array<vec2f>;
@group(0) @binding(4) var<storage, read_write> d_image: array<vec4f>;
// Each thread's own sum, added to.
@group(0) @binding(5) var<storage, read_write> loss: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let thread = (group.y * groups.x + group.x) * 64u + lane;
    if (thread >= p.threads) { return; }
    var sum = 0.0;
    for (var pixel = thread; pixel < p.pixels; pixel += p.threads) {
        d_image[pixel] = vec4f(0.0);
        if (count[pixel] > 1e30) { continue; }
        let seen = lin_log(image[pixel].rgb);
        let known = level[pixel];
        let found = seen.w * p.inverse_threshold - count[pixel];
        let away = found - known.x;
        // The first renderings make a mean, the later ones a median.
        let step = select(clamp(away, -p.rate, p.rate), away / (known.y + 1.0), known.y < FIRST);
        level[pixel] = vec2f(known.x + step, known.y + 1.0);
        if (known.y < FIRST) { continue; }
        let error = sign(away) * max(abs(away) - p.dead, 0.0);
        let cost = p.slope / max(seen.x + seen.y + seen.z, FLATTEST * p.slope);
        sum += cost * abs(error);
        d_image[pixel] = vec4f(cost * sign(error) * p.scale * p.inverse_threshold * seen.xyz, 0.0);
    }
    loss[thread] += sum;
}
