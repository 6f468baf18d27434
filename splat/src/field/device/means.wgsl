// Sums the gradients of a point's coordinates over its groups of features, and adds that of its mean.

struct Means {
    scale: vec4f,  // 1 / extent of the box
    rows: u32,
    first: u32,
}

@group(0) @binding(0) var<uniform> means: Means;
@group(0) @binding(1) var<storage, read> d_points: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> d_core: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = (group.y * groups.x + group.x) * 256u + thread;
    if row >= means.rows {
        return;
    }
    var sum = vec3f(0.0);
    for (var part = 0u; part < GROUPS; part++) {
        sum += d_points[row * GROUPS + part].xyz;
    }
    for (var axis = 0u; axis < 3u; axis++) {
        d_core[(means.first + row) * 12u + axis] += sum[axis] * means.scale[axis];
    }
}
