// The deltas of the rows at a moment: place and opacity. Each thread takes PER_THREAD rows.

@group(0) @binding(0) var<uniform> moment: Moment;
@group(0) @binding(1) var<storage, read> core: array<vec4f>;
@group(0) @binding(2) var<storage, read> values: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> delta_core: array<vec4f>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let begin = ((group.y * groups.x + group.x) * THREADS + thread) * PER_THREAD;
    for (var row = begin; row < min(begin + PER_THREAD, moment.rows); row++) {
        let s = state_of(moment, core[3u * row + 2u].z, row);
        delta_core[3u * row] = vec4f(select(vec3f(0.0), moved(row, s.dt), s.there), 0.0);
        delta_core[3u * row + 1u] = vec4f(0.0);
        delta_core[3u * row + 2u] = vec4f(0.0, 0.0, s.d_logit, 0.0);
    }
}
