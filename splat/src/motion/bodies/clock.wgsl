// Adds what bodies and nodes say of the time of a rendering to the row of a camera: later is where a pose goes to.

struct Row {
    row: u32,
    interval: f32,  // stretches an RGB interval
    renderings: f32,  // to be counted here
    unused: u32,
}

@group(0) @binding(0) var<uniform> moment: Moment;
@group(0) @binding(1) var<uniform> to: Row;
@group(0) @binding(2) var<storage, read> control: array<vec4f>;
@group(0) @binding(3) var<storage, read> d_poses: array<Pose>;
// For each camera the gradient of its time (intervals), and how many renderings were added.
@group(0) @binding(4) var<storage, read_write> sums: array<vec2f>;

@compute @workgroup_size(1)
fn main() {
    let count = entities(moment);
    let basis = basis_of(moment);
    let u = clamp(moment.stretch - f32(basis.first), 0.0, 1.0);
    let v = 1.0 - u;
    let slope = 0.5 * vec4f(-v * v, u * (3.0 * u - 4.0), u * (2.0 - 3.0 * u) + 1.0, u * u);
    var sum = 0.0;
    for (var entity = 0u; entity < count; entity++) {
        for (var k = 0u; k < 4u; k++) {
            let at = 2u * ((basis.first + k) * count + entity);
            sum += slope[k] * (dot(d_poses[entity].shift, control[at].xyz) + dot(d_poses[entity].turn, control[at + 1u]));
        }
    }
    sums[to.row] += vec2f(sum * to.interval, to.renderings);
}
