// Adds the gradient of the means to columns 0..3 of the gradient of the core parameters.

@group(0) @binding(0) var<uniform> rows: vec4u;
@group(0) @binding(1) var<storage, read> d_means: array<f32>;
@group(0) @binding(2) var<storage, read_write> d_core: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = (group.y * groups.x + group.x) * 256u + thread;
    if row >= rows.x {
        return;
    }
    for (var axis = 0u; axis < 3u; axis++) {
        d_core[row * 12u + axis] += d_means[row * 3u + axis];
    }
}
