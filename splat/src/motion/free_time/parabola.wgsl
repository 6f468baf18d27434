// A path that bends evenly: velocity (metres an interval) and acceleration, one vector each.

// How far row `row` is from its place `dt` intervals after its instant.
fn moved(row: u32, dt: f32) -> vec3f {
    return dt * (values[VECTORS * row].xyz + 0.5 * dt * values[VECTORS * row + 1u].xyz);
}

// How fast it is then, metres an interval.
fn velocity(row: u32, dt: f32) -> vec3f {
    return values[VECTORS * row].xyz + dt * values[VECTORS * row + 1u].xyz;
}
