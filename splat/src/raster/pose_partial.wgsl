// What the Gaussians say of the camera's pose, summed by a few threads: each takes every so many rows.

@group(0) @binding(0) var<uniform> view: View;
// Ten a row: see `project_backward.wgsl`.
@group(0) @binding(1) var<storage, read> d_splats: array<u32>;
// Two a thread: turn and shift.
@group(0) @binding(2) var<storage, read_write> partial: array<vec4f>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let thread = group.x * THREADS + lane;
    var turn = vec3f(0.0);
    var shift = vec3f(0.0);
    for (var row = thread; row < view.outputs.z; row += groups.x * THREADS) {
        let at = 10u * row;
        if d_splats[at + 9u] == NOBODY {
            continue;
        }
        turn += vec3f(bitcast<f32>(d_splats[at]), bitcast<f32>(d_splats[at + 1u]), bitcast<f32>(d_splats[at + 2u]));
        shift += vec3f(bitcast<f32>(d_splats[at + 3u]), bitcast<f32>(d_splats[at + 4u]), bitcast<f32>(d_splats[at + 5u]));
    }
    partial[2u * thread] = vec4f(turn, 0.0);
    partial[2u * thread + 1u] = vec4f(shift, 0.0);
}
