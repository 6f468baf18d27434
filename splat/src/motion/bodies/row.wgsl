// A Gaussian in the frame of its body, and how body and nodes carry it. In its row of `values` the vectors from BODY on hold
// 1 + its body (0: no body carries it) and up to four nodes (1 + node; 0: none).

struct Carried {
    body: u32,          // NO_NODE where no body carries it
    nodes: vec4u,
    weights: vec4f,
    place: vec3f,       // in the frame of the body
    sum: vec4f,         // of the nodes' turns, before it is brought to length 1
    turn: vec4f,        // the same of length 1
}

fn carried(row: u32, x: vec3f) -> Carried {
    var c: Carried;
    let a = values[VECTORS * row + BODY];
    let b = values[VECTORS * row + BODY + 1u];
    c.body = u32(a.x) - 1u;
    c.nodes = vec4u(vec4f(a.yzw, b.x)) - 1u;
    c.place = x;
    c.sum = vec4f(1.0, 0.0, 0.0, 0.0);
    c.turn = c.sum;
    if c.nodes.x == NO_NODE {
        return c;
    }
    var reach = vec4f(-1e30);
    for (var k = 0u; k < 4u; k++) {
        if c.nodes[k] != NO_NODE {
            let node = other[moment.bodies + c.nodes[k]];
            let off = x - node.xyz;
            reach[k] = -0.5 * dot(off, off) * exp(-2.0 * node.w);
        }
    }
    let most = max(max(reach.x, reach.y), max(reach.z, reach.w));
    let shares = exp(max(reach - most, vec4f(-80.0))) * select(vec4f(0.0), vec4f(1.0), c.nodes != vec4u(NO_NODE));
    c.weights = shares / (shares.x + shares.y + shares.z + shares.w);
    c.place = vec3f(0.0);
    c.sum = vec4f(0.0);
    let first = poses[moment.bodies + c.nodes.x].turn;
    for (var k = 0u; k < 4u; k++) {
        if c.nodes[k] != NO_NODE {
            let node = other[moment.bodies + c.nodes[k]];
            let pose = poses[moment.bodies + c.nodes[k]];
            c.place += c.weights[k] * (turned(pose.turn, x - node.xyz) + node.xyz + pose.shift);
            c.sum += c.weights[k] * select(1.0, -1.0, dot(pose.turn, first) < 0.0) * pose.turn;
        }
    }
    c.turn = c.sum * inverseSqrt(max(dot(c.sum, c.sum), 1e-20));
    return c;
}

struct Presence {
    presence: f32,
    odds: f32,      // of the stored opacity: o / (1 - o)
    left: f32,      // (1 - o presence) / (1 - o)
    d_logit: f32,   // change of the logit that makes the opacity o * presence, not less than GONE
}

fn presence_of(log_presence: f32, logit: f32) -> Presence {
    var s: Presence;
    s.presence = exp(max(log_presence, -80.0));
    s.odds = exp(clamp(logit, -30.0, 30.0));
    var absent = 1.0 - s.presence;
    if log_presence > -1e-3 {
        absent = -log_presence * (1.0 + 0.5 * log_presence);
    }
    s.left = 1.0 + s.odds * absent;
    s.d_logit = max(log_presence - log(s.left), GONE);
    return s;
}
