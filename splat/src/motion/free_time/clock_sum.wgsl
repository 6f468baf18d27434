// Adds what the threads of `clock_partial.wgsl` summed to the row of a camera.

struct Row {
    row: u32,
    threads: u32,
    unused0: u32,
    unused1: u32,
}

@group(0) @binding(0) var<uniform> to: Row;
@group(0) @binding(1) var<storage, read> partial: array<f32>;
// For each camera the gradient of its time (intervals), and how many renderings were added.
@group(0) @binding(2) var<storage, read_write> sums: array<vec2f>;

@compute @workgroup_size(1)
fn main() {
    var sum = 0.0;
    for (var thread = 0u; thread < to.threads; thread++) {
        sum += partial[thread];
    }
    sums[to.row] += vec2f(sum, 1.0);
}
