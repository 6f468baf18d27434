// From the gradients of the deltas to those of the rows, and what each row says of its body and its nodes: five shares of two vectors
// a row, the first of the body (shift and log presence, turn), the others of the nodes (shift and log reach, turn). The gradient of the
// sum of parameter and delta has been added to that of the stored parameter already: what is added here is the rest.

@group(0) @binding(0) var<uniform> moment: Moment;
@group(0) @binding(1) var<storage, read> core: array<vec4f>;
@group(0) @binding(2) var<storage, read> values: array<vec4f>;
@group(0) @binding(3) var<storage, read> poses: array<Pose>;
@group(0) @binding(4) var<storage, read> other: array<vec4f>;
@group(0) @binding(5) var<storage, read> d_delta_core: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> d_core: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> shares: array<vec4f>;

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
        let d_mean = d_delta_core[3u * row].xyz;
        let d_turn = vec4f(d_delta_core[3u * row + 1u].zw, d_delta_core[3u * row + 2u].xy);
        let d_logit = d_delta_core[3u * row + 2u].z;

        let s = presence_of(pose.log_presence, core[3u * row + 2u].z);
        let d_log_presence = moment.path * d_logit * (1.0 + s.odds * s.presence / s.left);
        let d_inner = product(d_turn, conjugate(q));
        let d_q = product(conjugate(product(pose.turn, c.turn)), d_turn);
        let at = 10u * row;
        shares[at] = vec4f(d_mean, d_log_presence);
        shares[at + 1u] = turned_backward(pose.turn, c.place, d_mean) + product(d_inner, conjugate(c.turn));

        let d_place = turned(conjugate(pose.turn), d_mean);
        let d_unit = product(conjugate(pose.turn), d_inner);
        let d_sum = (d_unit - c.turn * dot(c.turn, d_unit)) * inverseSqrt(max(dot(c.sum, c.sum), 1e-20));
        var d_x = d_place;
        if c.nodes.x != NO_NODE {
            d_x = vec3f(0.0);
            let first = poses[moment.bodies + c.nodes.x].turn;
            var d_weights = vec4f(0.0);
            for (var k = 0u; k < 4u; k++) {
                if c.nodes[k] == NO_NODE {
                    continue;
                }
                let node = other[moment.bodies + c.nodes[k]];
                let of_node = poses[moment.bodies + c.nodes[k]];
                let off = x - node.xyz;
                let sign = select(1.0, -1.0, dot(of_node.turn, first) < 0.0);
                let weight = c.weights[k];
                let there = turned(of_node.turn, off) + node.xyz + of_node.shift;
                d_weights[k] = dot(there, d_place) + sign * dot(of_node.turn, d_sum);
                d_x += weight * turned(conjugate(of_node.turn), d_place);
                shares[at + 2u + 2u * k] = vec4f(weight * d_place, 0.0);
                shares[at + 3u + 2u * k] = weight * (sign * d_sum + turned_backward(of_node.turn, off, d_place));
            }
            let mean = dot(c.weights, d_weights);
            for (var k = 0u; k < 4u; k++) {
                if c.nodes[k] == NO_NODE {
                    continue;
                }
                let node = other[moment.bodies + c.nodes[k]];
                let off = x - node.xyz;
                let scale = exp(-2.0 * node.w) * c.weights[k] * (d_weights[k] - mean);
                d_x -= scale * off;
                shares[at + 2u + 2u * k].w = scale * dot(off, off);
            }
        }
        d_core[3u * row] += vec4f(d_x - d_mean, 0.0);
        d_core[3u * row + 1u] += vec4f(0.0, 0.0, d_q.xy - d_turn.xy);
        d_core[3u * row + 2u] += vec4f(d_q.zw - d_turn.zw, d_logit * (1.0 - s.left) / s.left, 0.0);
    }
}
