// What the rows, and what holds nodes together, say of the pose of each body and node; and from there of its control points, its gate
// and its reach. One thread each.

@group(0) @binding(0) var<uniform> moment: Moment;
@group(0) @binding(1) var<storage, read> runs: array<vec2u>;       // of each body and node: first chunk, chunks
@group(0) @binding(2) var<storage, read> partial: array<vec4f>;
@group(0) @binding(3) var<storage, read> poses: array<Pose>;
@group(0) @binding(4) var<storage, read> other: array<vec4f>;
// NEIGHBOURS a node: CODES * other + 1 where it is a neighbour of this, + 2 where this is one of it, + LOOSE where the body bends; NO_NODE:
// none.
@group(0) @binding(5) var<storage, read> neighbours: array<u32>;
@group(0) @binding(6) var<storage, read> control: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> d_control: array<vec4f>;
// Gradients of gates (xy) and reaches (w).
@group(0) @binding(8) var<storage, read_write> d_other: array<vec4f>;
// What rows say of each pose, the turn's before it is brought to length 1: what holds nodes together tells nothing of a time.
@group(0) @binding(9) var<storage, read_write> d_poses: array<Pose>;

struct Said {
    shift: vec3f,
    turn: vec4f,
}

// What neighbours say of a node.
fn together(node: u32) -> Said {
    var d = Said(vec3f(0.0), vec4f(0.0));
    let own = poses[moment.bodies + node];
    let first = neighbours[NEIGHBOURS * node];
    let holds = select(1.0, moment.loose, first != NO_NODE && (first & LOOSE) != 0u);
    let rigid = holds * moment.rigid;
    d.shift = 2.0 * holds * moment.away * own.shift;
    for (var k = 0u; k < NEIGHBOURS; k++) {
        let code = neighbours[NEIGHBOURS * node + k];
        if code == NO_NODE {
            break;
        }
        let beside = code / CODES;
        let there = poses[moment.bodies + beside];
        let way = other[moment.bodies + beside].xyz - other[moment.bodies + node].xyz;
        var times = 0.0;
        if (code & 1u) != 0u {
            let error = way + there.shift - own.shift - turned(own.turn, way);
            d.shift -= 2.0 * rigid * error;
            d.turn -= turned_backward(own.turn, way, 2.0 * rigid * error);
            times += 1.0;
        }
        if (code & 2u) != 0u {
            let error = own.shift - way - there.shift + turned(there.turn, way);
            d.shift += 2.0 * rigid * error;
            times += 1.0;
        }
        d.turn -= 2.0 * times * moment.alike * dot(own.turn, there.turn) * there.turn;
    }
    return d;
}

fn sigmoid(x: f32) -> f32 {
    return 1.0 / (1.0 + exp(-clamp(x, -60.0, 60.0)));
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
    var a = vec4f(0.0);
    var d_turn = vec4f(0.0);
    for (var k = 0u; k < runs[entity].y; k++) {
        let chunk = runs[entity].x + k;
        a += partial[2u * chunk];
        d_turn += partial[2u * chunk + 1u];
    }
    var d_shift = a.xyz;
    let of_rows = d_turn;
    if entity >= moment.bodies {
        d_other[entity].w += a.w;
        if moment.rigid + moment.away + moment.alike > 0.0 {
            let said = together(entity - moment.bodies);
            d_shift += said.shift;
            d_turn += said.turn;
        }
    } else if other[entity].z > 0.0 {
        let begin = (moment.seconds - other[entity].x) / moment.softness;
        let end = (other[entity].y - moment.seconds) / moment.softness;
        d_other[entity].x -= a.w * sigmoid(-begin) / moment.softness;
        d_other[entity].y += a.w * sigmoid(-end) / moment.softness;
    }
    // The turn was brought to length 1.
    let basis = basis_of(moment);
    var raw = vec4f(0.0);
    for (var k = 0u; k < 4u; k++) {
        raw += basis.weights[k] * control[2u * ((basis.first + k) * count + entity) + 1u];
    }
    let inverse = inverseSqrt(max(dot(raw, raw), 1e-20));
    let unit = raw * inverse;
    d_turn = inverse * (d_turn - unit * dot(unit, d_turn));
    d_poses[entity] = Pose(a.xyz, 0.0, inverse * (of_rows - unit * dot(unit, of_rows)));
    for (var k = 0u; k < 4u; k++) {
        let at = 2u * ((basis.first + k) * count + entity);
        d_control[at] += vec4f(basis.weights[k] * d_shift, 0.0);
        d_control[at + 1u] += basis.weights[k] * d_turn;
    }
}
