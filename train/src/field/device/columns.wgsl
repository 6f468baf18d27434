// Sums of the columns of a matrix, in slabs of its rows: the gradient of a bias. Each thread sums one column of one slab.

struct Columns {
    rows: u32,
    columns: u32,
    slab: u32,    // rows a slab
    slabs: u32,
    offset: u32,
    stride: u32,  // floats from row to row
}

@group(0) @binding(0) var<uniform> columns: Columns;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = (group.y * groups.x + group.x) * 64u + thread;
    if i >= columns.columns * columns.slabs {
        return;
    }
    let slab = i / columns.columns;
    let column = i % columns.columns;
    var sum = 0.0;
    for (var row = slab * columns.slab; row < min(columns.rows, (slab + 1u) * columns.slab); row++) {
        sum += values[columns.offset + row * columns.stride + column];
    }
    sums[i] = sum;
}
