// The gradients of a path through knots.

fn move_path(row: u32, dt: f32, d_mean: vec3f) {
    let share = share_of(dt);
    for (var k = 0; k < 4; k++) {
        let knot = share.first + k;
        if knot != 0 {
            d_values[slot(row, knot)] += vec4f(share.weights[k] * d_mean, 0.0);
        }
    }
}

fn place(row: u32, knot: i32) -> vec3f {
    if knot == 0 {
        return vec3f(0.0);
    }
    return values[slot(row, knot)].xyz;
}

// The gradient of half the mean squared acceleration at the knots, `weight` times.
fn straighten(row: u32, weight: f32) {
    if weight == 0.0 {
        return;
    }
    let each = weight / (f32(2 * LAST - 1) * pow(SPACING, 4.0));
    for (var knot = 1 - LAST; knot < LAST; knot++) {
        let bend = each * (place(row, knot - 1) - 2.0 * place(row, knot) + place(row, knot + 1));
        for (var k = -1; k <= 1; k++) {
            let at = knot + k;
            if at != 0 {
                d_values[slot(row, at)] += vec4f(select(-2.0, 1.0, k != 0) * bend, 0.0);
            }
        }
    }
}
