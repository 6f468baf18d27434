// Features of the points: each thread makes four of one level of one point.

struct Frame {
    origin: vec4f,  // lower corner of the box; w is unused
    scale: vec4f,   // 1 / its extent
    rows: vec4u,    // x: points
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> levels: array<Level>;
@group(0) @binding(2) var<storage, read> parameters: array<vec4f>;
@group(0) @binding(3) var<storage, read> lines: array<vec4f>;
@group(0) @binding(4) var<storage, read> core: array<f32>;
@group(0) @binding(5) var<storage, read_write> points: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> features: array<vec4f>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = (group.y * groups.x + group.x) * 256u + thread;
    let row = i / GROUPS;
    if row >= frame.rows.x {
        return;
    }
    let mean = vec3f(core[row * 12u], core[row * 12u + 1u], core[row * 12u + 2u]);
    let point = (mean - frame.origin.xyz) * frame.scale.xyz;
    let part = i % GROUPS;
    if part == 0u {
        points[row] = vec4f(point, 0.0);
    }
    let level = levels[part / F4];
    let feature = part % F4;
    var product = vec4f(1.0);
    for (var plane = 0u; plane < 3u; plane++) {
        let columns = level.cells[column_axis(plane)];
        let x = locate(point[column_axis(plane)], columns);
        let y = locate(point[row_axis(plane)], level.cells[row_axis(plane)]);
        let at = level.planes[plane] + (y.index * columns + x.index) * F4 + feature;
        let low = mix(parameters[at], parameters[at + F4], x.weight);
        let high = mix(parameters[at + columns * F4], parameters[at + (columns + 1u) * F4], x.weight);
        product *= mix(low, high, y.weight);
    }
    for (var axis = 0u; axis < 3u; axis++) {
        let cell = locate(point[axis], level.cells[axis]);
        let at = level.lines[axis] + cell.index * F4 + feature;
        product *= mix(lines[at], lines[at + F4], cell.weight);
    }
    features[i] = product;
}
