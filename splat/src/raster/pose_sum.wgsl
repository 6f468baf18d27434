// Adds what the threads of `pose_partial.wgsl` summed to the row of a camera. Two threads: turn and shift.

struct Row {
    row: u32,
    threads: u32,
    unused0: u32,
    unused1: u32,
}

@group(0) @binding(0) var<uniform> to: Row;
@group(0) @binding(1) var<storage, read> partial: array<vec4f>;
// Two a camera: the gradient of its turn (radians) and that of its shift (metres), and how many renderings were added.
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;

@compute @workgroup_size(2)
fn main(@builtin(local_invocation_index) lane: u32) {
    var sum = vec3f(0.0);
    for (var thread = 0u; thread < to.threads; thread++) {
        sum += partial[2u * thread + lane].xyz;
    }
    sums[2u * to.row + lane] += vec4f(sum, 1.0);
}
