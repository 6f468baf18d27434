// The gradients of a parabola.

fn move_path(row: u32, dt: f32, d_mean: vec3f) {
    d_values[VECTORS * row] += vec4f(dt * d_mean, 0.0);
    d_values[VECTORS * row + 1u] += vec4f(0.5 * dt * dt * d_mean, 0.0);
}

// The gradient of half the squared acceleration, `weight` times.
fn straighten(row: u32, weight: f32) {
    d_values[VECTORS * row + 1u] += vec4f(weight * values[VECTORS * row + 1u].xyz, 0.0);
}
