// What the kernels of bodies share. A body is a spline of poses; so is a node, whose shift is from its rest in the frame of its body.
// Control points lie knot after knot, and of each knot body after body, then node after node: (shift, 0), (turn: w, x, y, z).

struct Moment {
    rows: u32,
    bodies: u32,
    nodes: u32,
    knots: u32,
    stretch: f32,     // where the time is on the splines, stretches between knots
    seconds: f32,     // since the recording began
    softness: f32,    // of appearing and vanishing, seconds
    path: f32,        // how much of the gradient reaches when a body is there
    rigid: f32,       // weights of what holds nodes together, of so many nodes
    away: f32,
    alike: f32,
    loose: f32,       // what these are multiplied by, but the last, for bodies that bend
}

struct Pose {
    shift: vec3f,
    log_presence: f32,  // of a body
    turn: vec4f,
}

// A node that is not there.
const NO_NODE = 0xffffffffu;

fn entities(moment: Moment) -> u32 {
    return moment.bodies + moment.nodes;
}

struct Basis {
    first: u32,
    weights: vec4f,
}

fn basis_of(moment: Moment) -> Basis {
    let last = moment.knots - 4u;
    let s = clamp(moment.stretch, 0.0, f32(last + 1u));
    let first = min(u32(floor(s)), last);
    let u = s - f32(first);
    let v = 1.0 - u;
    return Basis(first, vec4f(
        v * v * v,
        u * u * (3.0 * u - 6.0) + 4.0,
        u * (u * (3.0 - 3.0 * u) + 3.0) + 1.0,
        u * u * u,
    ) / 6.0);
}

fn conjugate(q: vec4f) -> vec4f {
    return vec4f(q.x, -q.yzw);
}

fn product(a: vec4f, b: vec4f) -> vec4f {
    return vec4f(a.x * b.x - dot(a.yzw, b.yzw), a.x * b.yzw + b.x * a.yzw + cross(a.yzw, b.yzw));
}

// `v` turned by `q`, of length 1.
fn turned(q: vec4f, v: vec3f) -> vec3f {
    let c = cross(q.yzw, v);
    return v + 2.0 * (q.x * c + cross(q.yzw, c));
}

// The gradient of `q` from that of `turned(q, v)`.
fn turned_backward(q: vec4f, v: vec3f, d: vec3f) -> vec4f {
    let u = q.yzw;
    return 2.0 * vec4f(
        dot(cross(u, v), d),
        q.x * cross(v, d) + dot(u, v) * d + dot(u, d) * v - 2.0 * dot(v, d) * u,
    );
}
