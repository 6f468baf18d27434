// A path that bends evenly: velocity (metres an interval) and acceleration, one vector each.

const VECTORS = 2u;

// How far row `row` is from its place `dt` intervals after its instant.
fn moved(row: u32, dt: f32) -> vec3f {
    return dt * (values[2u * row].xyz + 0.5 * dt * values[2u * row + 1u].xyz);
}

// How fast it is then, metres an interval.
fn velocity(row: u32, dt: f32) -> vec3f {
    return values[2u * row].xyz + dt * values[2u * row + 1u].xyz;
}
