// Brings the turns of control points to length 1. One thread each.

@group(0) @binding(0) var<uniform> counts: vec4u;  // x: control points
@group(0) @binding(1) var<storage, read_write> control: array<vec4f>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let at = (group.y * groups.x + group.x) * THREADS + thread;
    if at < counts.x {
        let turn = control[2u * at + 1u];
        control[2u * at + 1u] = turn * inverseSqrt(max(dot(turn, turn), 1e-20));
    }
}
