// The poses of all bodies and nodes at a moment. One thread each.

@group(0) @binding(0) var<uniform> moment: Moment;
@group(0) @binding(1) var<storage, read> control: array<vec4f>;
// Of each body when it appears and vanishes, seconds, and whether it does (1) or is always there (0); then of each node its rest (xyz)
// and the logarithm of its reach, metres.
@group(0) @binding(2) var<storage, read> other: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> poses: array<Pose>;

fn log_sigmoid(x: f32) -> f32 {
    return min(x, 0.0) - log(1.0 + exp(-abs(x)));
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let entity = (group.y * groups.x + group.x) * THREADS + thread;
    let count = entities(moment);
    if entity >= count {
        return;
    }
    let basis = basis_of(moment);
    var shift = vec3f(0.0);
    var turn = vec4f(0.0);
    for (var k = 0u; k < 4u; k++) {
        let at = 2u * ((basis.first + k) * count + entity);
        shift += basis.weights[k] * control[at].xyz;
        turn += basis.weights[k] * control[at + 1u];
    }
    var log_presence = 0.0;
    if entity < moment.bodies && other[entity].z > 0.0 {
        let begin = (moment.seconds - other[entity].x) / moment.softness;
        let end = (other[entity].y - moment.seconds) / moment.softness;
        log_presence = log_sigmoid(begin) + log_sigmoid(end);
    }
    poses[entity] = Pose(shift, log_presence, turn * inverseSqrt(max(dot(turn, turn), 1e-20)));
}
