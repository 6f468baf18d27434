// Sums what the tiles left for each Gaussian, in the order of emission. One thread a Gaussian.

@group(0) @binding(0) var<uniform> view: View;
// First emission index and number of entries of each Gaussian.
@group(0) @binding(1) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(2) var<storage, read> moments: array<vec4f>;
@group(0) @binding(3) var<storage, read> moments_colour: array<vec4f>;
@group(0) @binding(4) var<storage, read> d_blue: array<f32>;
@group(0) @binding(5) var<storage, read_write> d_splats: array<SplatGradient>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = (group.y * groups.x + group.x) * THREADS + thread;
    if index >= view.counts.x {
        return;
    }
    let range = ranges[index];
    var sum = SplatGradient();
    for (var i = range.x; i < range.x + range.y; i++) {
        sum.moments += moments[i];
        sum.moments_colour += moments_colour[i];
        sum.blue_entries.x += d_blue[i];
    }
    sum.blue_entries.y = f32(range.y);
    d_splats[index] = sum;
}
