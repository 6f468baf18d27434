// Adds slabs, in order, to gradients.

struct Reduce {
    length: u32,
    slabs: u32,
    to: u32,
    padding: u32,
}

@group(0) @binding(0) var<uniform> reduce: Reduce;
@group(0) @binding(1) var<storage, read> slabs: array<f32>;
@group(0) @binding(2) var<storage, read_write> gradients: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = (group.y * groups.x + group.x) * 256u + thread;
    if i >= reduce.length {
        return;
    }
    var sum = 0.0;
    for (var slab = 0u; slab < reduce.slabs; slab++) {
        sum += slabs[slab * reduce.length + i];
    }
    gradients[reduce.to + i] += sum;
}
