// The gradient of squared third differences of control points. One thread a knot of a body or node.

struct Smooth {
    bodies: u32,
    nodes: u32,
    knots: u32,
    padding: u32,
    weights: vec4f,  // of bodies: shift, turn; of nodes: shift, turn
}

@group(0) @binding(0) var<uniform> smooth_by: Smooth;
@group(0) @binding(1) var<storage, read> control: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> d_control: array<vec4f>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let at = (group.y * groups.x + group.x) * THREADS + thread;
    let count = smooth_by.bodies + smooth_by.nodes;
    if at >= count * smooth_by.knots {
        return;
    }
    let knot = i32(at / count);
    let entity = at % count;
    let weights = select(smooth_by.weights.zw, smooth_by.weights.xy, entity < smooth_by.bodies);
    let signs = vec4f(-1.0, 3.0, -3.0, 1.0);
    var shift = vec4f(0.0);
    var turn = vec4f(0.0);
    // The differences that this control point is in: it is number k of that from `knot - k` on.
    for (var k = 0; k < 4; k++) {
        let first = knot - k;
        if first < 0 || first + 4 > i32(smooth_by.knots) {
            continue;
        }
        var third_shift = vec4f(0.0);
        var third_turn = vec4f(0.0);
        for (var j = 0; j < 4; j++) {
            let other = 2u * (u32(first + j) * count + entity);
            third_shift += signs[j] * control[other];
            third_turn += signs[j] * control[other + 1u];
        }
        shift += signs[k] * third_shift;
        turn += signs[k] * third_turn;
    }
    d_control[2u * at] += 2.0 * weights.x * vec4f(shift.xyz, 0.0);
    d_control[2u * at + 1u] += 2.0 * weights.y * turn;
}
