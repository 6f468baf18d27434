// Sums of shares over runs of the index, each a few hundred long, in the order of the index.

@group(0) @binding(0) var<uniform> counts: vec4u;  // x: chunks
@group(0) @binding(1) var<storage, read> chunks: array<vec2u>;  // first item, items
@group(0) @binding(2) var<storage, read> index: array<u32>;     // which share of all
@group(0) @binding(3) var<storage, read> shares: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> partial: array<vec4f>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let chunk = (group.y * groups.x + group.x) * THREADS + thread;
    if chunk >= counts.x {
        return;
    }
    var a = vec4f(0.0);
    var b = vec4f(0.0);
    for (var k = 0u; k < chunks[chunk].y; k++) {
        let share = index[chunks[chunk].x + k];
        a += shares[2u * share];
        b += shares[2u * share + 1u];
    }
    partial[2u * chunk] = a;
    partial[2u * chunk + 1u] = b;
}
