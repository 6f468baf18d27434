// What the rows say of the time of a rendering, from the gradients of their deltas, summed by a few threads: each takes every so many
// rows. Later is where a row goes to, and nearer to its end.

@group(0) @binding(0) var<uniform> moment: Moment;
@group(0) @binding(1) var<storage, read> core: array<vec4f>;
@group(0) @binding(2) var<storage, read> values: array<vec4f>;
@group(0) @binding(3) var<storage, read> d_delta_core: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> partial: array<f32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let thread = group.x * THREADS + lane;
    var sum = 0.0;
    for (var row = thread; row < moment.rows; row += groups.x * THREADS) {
        let s = state_of(moment, core[3u * row + 2u].z, row);
        if !s.there {
            continue;
        }
        let d_mean = d_delta_core[3u * row].xyz;
        let d_log_presence = d_delta_core[3u * row + 2u].z * (1.0 + s.odds * s.presence / s.left);
        sum += dot(d_mean, velocity(row, s.dt)) - d_log_presence * s.u / s.life;
    }
    partial[thread] = sum;
}
