// The deltas of the rows that bodies carry: place, turn and opacity. Each thread takes PER_THREAD rows.

@group(0) @binding(0) var<uniform> moment: Moment;
@group(0) @binding(1) var<storage, read> core: array<vec4f>;
@group(0) @binding(2) var<storage, read> values: array<vec4f>;
@group(0) @binding(3) var<storage, read> poses: array<Pose>;
@group(0) @binding(4) var<storage, read> other: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> delta_core: array<vec4f>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let begin = ((group.y * groups.x + group.x) * THREADS + thread) * PER_THREAD;
    for (var row = begin; row < min(begin + PER_THREAD, moment.rows); row++) {
        let x = core[3u * row].xyz;
        let c = carried(row, x);
        if c.body == NO_NODE {
            continue;
        }
        let pose = poses[c.body];
        let q = vec4f(core[3u * row + 1u].zw, core[3u * row + 2u].xy);
        let turn = product(product(pose.turn, c.turn), q) - q;
        let s = presence_of(pose.log_presence, core[3u * row + 2u].z);
        delta_core[3u * row] = vec4f(turned(pose.turn, c.place) + pose.shift - x, 0.0);
        delta_core[3u * row + 1u] = vec4f(0.0, 0.0, turn.xy);
        delta_core[3u * row + 2u] = vec4f(turn.zw, s.d_logit, 0.0);
    }
}
