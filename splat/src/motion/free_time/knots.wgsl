// A path through knots: where the row is, from its place, at SIDE times before its instant and SIDE after it, SPACING intervals apart;
// at its instant it is at its place. Between them a cubic with the tangents of Catmull and Rom; those of the outermost knots are of the
// parabola through three, and beyond them the path goes straight on.

const LAST = i32(SIDE);

// Which four knots decide, from `first` on (-LAST is the earliest), and with what weights.
struct Share {
    first: i32,
    weights: vec4f,
}

// In the outermost stretch on the side of `u` or beyond it: weights of the knots at 0, 1 and 2 from its outer end.
fn outermost(u: f32, weights: vec3f) -> Share {
    if u < 0.0 {
        return Share(-LAST, vec4f(weights, 0.0));
    }
    return Share(LAST - 3, vec4f(0.0, weights.zyx));
}

fn share_of(dt: f32) -> Share {
    let u = dt / SPACING;
    let reach = f32(LAST);
    if abs(u) >= reach - 1.0 {
        // Within the last stretch or beyond it, w from its outer end: the knots at 0, 1 and 2.
        let w = reach - abs(u);
        let c = max(w, 0.0);
        let h00 = 1.0 + c * c * (2.0 * c - 3.0);
        let h10 = select(w, c * (1.0 - c) * (1.0 - c), w > 0.0);
        let h11 = c * c * (c - 1.0);
        return outermost(u, vec3f(h00 - 1.5 * h10 - 0.5 * h11, (1.0 - h00) + 2.0 * h10, 0.5 * (h11 - h10)));
    }
    let before = floor(u);
    let t = u - before;
    return Share(i32(before) - 1, 0.5 * vec4f(
        t * (t * (2.0 - t) - 1.0),
        t * t * (3.0 * t - 5.0) + 2.0,
        t * (t * (4.0 - 3.0 * t) + 1.0),
        t * t * (t - 1.0),
    ));
}

// The same of how fast it is: the derivatives by dt / SPACING.
fn slope_of(dt: f32) -> Share {
    let u = dt / SPACING;
    let reach = f32(LAST);
    if abs(u) >= reach - 1.0 {
        let w = reach - abs(u);
        let c = max(w, 0.0);
        let h00 = 6.0 * c * (c - 1.0);
        let h10 = 1.0 + c * (3.0 * c - 4.0);
        let h11 = c * (3.0 * c - 2.0);
        let by_w = vec3f(h00 - 1.5 * h10 - 0.5 * h11, 2.0 * h10 - h00, 0.5 * (h11 - h10));
        return outermost(u, select(-by_w, by_w, u < 0.0));
    }
    let before = floor(u);
    let t = u - before;
    return Share(i32(before) - 1, 0.5 * vec4f(
        t * (4.0 - 3.0 * t) - 1.0,
        t * (9.0 * t - 10.0),
        t * (8.0 - 9.0 * t) + 1.0,
        t * (3.0 * t - 2.0),
    ));
}

// Where knot `knot` of row `row` lies in `values`; there is none for knot 0.
fn slot(row: u32, knot: i32) -> u32 {
    return VECTORS * row + u32(select(knot + LAST, knot + LAST - 1, knot > 0));
}

// How far row `row` is from its place `dt` intervals after its instant.
fn moved(row: u32, dt: f32) -> vec3f {
    return through(row, share_of(dt));
}

// How fast it is then, metres an interval.
fn velocity(row: u32, dt: f32) -> vec3f {
    return through(row, slope_of(dt)) / SPACING;
}

fn through(row: u32, share: Share) -> vec3f {
    var sum = vec3f(0.0);
    for (var k = 0; k < 4; k++) {
        let knot = share.first + k;
        if knot != 0 {
            sum += share.weights[k] * values[slot(row, knot)].xyz;
        }
    }
    return sum;
}
