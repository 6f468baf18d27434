// The gradient of the features goes to the planes, the lines and the coordinates: each thread handles four features of
// one level of one point.
//
// Many points add to one cell in any order, and the sum must not depend on it. So the sums are fixed-point numbers of 64
// bits, in units of 2^-40, each made of two u32: integers add up to the same total in any order. They range to 2^23; a
// single contribution larger than `limit` (2^22 / points, so that no sum can overflow), or one that is not a number, is
// left out and counted.

struct Pull {
    rows: u32,
    first: u32,  // row of the first point
    limit: f32,
    padding: u32,
}

@group(0) @binding(0) var<uniform> pull: Pull;
@group(0) @binding(1) var<storage, read> levels: array<Level>;
@group(0) @binding(2) var<storage, read> parameters: array<vec4f>;
@group(0) @binding(3) var<storage, read> lines: array<vec4f>;
@group(0) @binding(4) var<storage, read> points: array<vec4f>;
@group(0) @binding(5) var<storage, read> d_features: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> low_words: array<atomic<u32>>;
@group(0) @binding(7) var<storage, read_write> high_words: array<atomic<u32>>;
@group(0) @binding(8) var<storage, read_write> d_points: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> left_out: atomic<u32>;

fn add(at: u32, value: f32) {
    // Compared as integers, which puts infinities and NaN above every limit.
    if bitcast<u32>(abs(value)) > bitcast<u32>(pull.limit) {
        atomicAdd(&left_out, 1u);
        return;
    }
    let scaled = abs(value) * 1099511627776.0;
    let above = floor(scaled / 4294967296.0);
    var high = u32(above);
    var low = u32(round(scaled - above * 4294967296.0));
    if value < 0.0 {
        low = ~low + 1u;
        high = ~high + u32(low == 0u);
    }
    let before = atomicAdd(&low_words[at], low);
    high += u32(before > 0xffffffffu - low);
    if high != 0u {
        atomicAdd(&high_words[at], high);
    }
}

fn add_four(at: u32, value: vec4f) {
    for (var i = 0u; i < 4u; i++) {
        add(at + i, value[i]);
    }
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = (group.y * groups.x + group.x) * 256u + thread;
    if i / GROUPS >= pull.rows {
        return;
    }
    let point = points[pull.first + i / GROUPS].xyz;
    let part = i % GROUPS;
    let level = levels[part / F4];
    let feature = part % F4;

    // Factors 0 to 2 are the planes xy, xz, yz; 3 to 5 are the lines over x, y, z.
    var value: array<vec4f, 6>;
    var slope: array<array<vec4f, 2>, 6>;
    for (var plane = 0u; plane < 3u; plane++) {
        let columns = level.cells[column_axis(plane)];
        let x = locate(point[column_axis(plane)], columns);
        let y = locate(point[row_axis(plane)], level.cells[row_axis(plane)]);
        let at = level.planes[plane] + (y.index * columns + x.index) * F4 + feature;
        let rise_low = parameters[at + F4] - parameters[at];
        let rise_high = parameters[at + (columns + 1u) * F4] - parameters[at + columns * F4];
        let low = parameters[at] + x.weight * rise_low;
        let high = parameters[at + columns * F4] + x.weight * rise_high;
        value[plane] = mix(low, high, y.weight);
        slope[plane][0] = mix(rise_low, rise_high, y.weight);
        slope[plane][1] = high - low;
    }
    for (var axis = 0u; axis < 3u; axis++) {
        let cell = locate(point[axis], level.cells[axis]);
        let at = level.lines[axis] + cell.index * F4 + feature;
        value[3u + axis] = mix(lines[at], lines[at + F4], cell.weight);
        slope[3u + axis][0] = lines[at + F4] - lines[at];
    }

    // The gradient of a factor is the product of the five others: those before it times those after it.
    var after: array<vec4f, 6>;
    after[5] = vec4f(1.0);
    for (var factor = 5u; factor > 0u; factor--) {
        after[factor - 1u] = after[factor] * value[factor];
    }
    var before = d_features[i];
    var d_point = vec3f(0.0);
    for (var plane = 0u; plane < 3u; plane++) {
        let columns = level.cells[column_axis(plane)];
        let x = locate(point[column_axis(plane)], columns);
        let y = locate(point[row_axis(plane)], level.cells[row_axis(plane)]);
        let d = before * after[plane];
        before *= value[plane];
        d_point[column_axis(plane)] += dot(d, slope[plane][0]) * f32(columns - 1u);
        d_point[row_axis(plane)] += dot(d, slope[plane][1]) * f32(level.cells[row_axis(plane)] - 1u);
        let at = level.sums[plane] + ((y.index * columns + x.index) * F4 + feature) * 4u;
        add_four(at, d * (1.0 - x.weight) * (1.0 - y.weight));
        add_four(at + F4 * 4u, d * x.weight * (1.0 - y.weight));
        add_four(at + columns * F4 * 4u, d * (1.0 - x.weight) * y.weight);
        add_four(at + (columns + 1u) * F4 * 4u, d * x.weight * y.weight);
    }
    for (var axis = 0u; axis < 3u; axis++) {
        let cell = locate(point[axis], level.cells[axis]);
        let d = before * after[3u + axis];
        before *= value[3u + axis];
        d_point[axis] += dot(d, slope[3u + axis][0]) * f32(level.cells[axis] - 1u);
        let at = level.line_sums[axis] + (cell.index * F4 + feature) * 4u;
        add_four(at, d * (1.0 - cell.weight));
        add_four(at + F4 * 4u, d * cell.weight);
    }
    // A coordinate that was clamped has no gradient.
    let inside = point > vec3f(0.0) & point < vec3f(1.0);
    d_points[i] = vec4f(select(vec3f(0.0), d_point, inside), 0.0);
}
