// Walks each tile's list back to front and leaves, for every entry, the sums over the tile's pixels that the gradient
// of its splat is made of, at the entry's emission index (CPU shape).

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> entries: array<vec2u>;
@group(0) @binding(3) var<storage, read> lists: array<vec4u>;
@group(0) @binding(4) var<storage, read> image: array<vec4f>;
@group(0) @binding(5) var<storage, read> stops: array<u32>;
@group(0) @binding(6) var<storage, read> d_image: array<vec4f>;
// Nine an entry, in the order of `Sums`.
@group(0) @binding(7) var<storage, read_write> sums: array<f32>;

// Four pixels of a column.
struct Block {
    // Transmittance in front of what has been walked.
    t: vec4f,
    // Colour (and transmittance) behind, weighted by dL/d image.
    behind: vec4f,
    stop: vec4u,
    // dL/d colour.
    r: vec4f,
    g: vec4f,
    b: vec4f,
}

// Sums over pixels. With v = dL/d power and (dx, dy) the distance from the mean: v, v dx, v dy, v dx dx, v dx dy,
// v dy dy; dL/d colour.
struct Sums {
    v: f32,
    v_dx: f32,
    v_dy: f32,
    v_dx_dx: f32,
    v_dx_dy: f32,
    v_dy_dy: f32,
    r: f32,
    g: f32,
    b: f32,
}

fn start(x: u32, y: u32, first: u32, needed: bool) -> Block {
    var block: Block;
    block.stop = vec4u(first);
    block.t = vec4f(1.0);
    if !needed || x >= view.size.x {
        return block;
    }
    for (var i = 0u; i < 4u; i++) {
        if y + i < view.size.y {
            let at = (y + i) * view.size.x + x;
            let d = d_image[at];
            block.t[i] = image[at].w;
            block.r[i] = d.r;
            block.g[i] = d.g;
            block.b[i] = d.b;
            block.behind[i] = dot(d.rgb, view.background.rgb) + d.w;
            block.stop[i] = stops[at];
        }
    }
    return block;
}

fn total(x: vec4f) -> f32 {
    return (x.x + x.y) + (x.z + x.w);
}

// The loss depends on alpha through T (colour - colour behind). The bound of alpha is not differentiated, as in the
// 3DGS code, so that opaque splats keep moving: d alpha / d power is alpha everywhere.
fn unblend(block: ptr<function, Block>, own: ptr<function, Sums>, splat: Splat, column: Column, dy: f32, entry: u32, needed: bool, least: f32) {
    if needed && reaches(column, dy) {
        let rows = dy + ROWS;
        let power = log_alpha(splat, column, rows);
        let counts = (power >= vec4f(least)) & (vec4u(entry) < (*block).stop);
        let alpha = select(vec4f(0.0), exp2(power), counts);
        let t = (*block).t / (1.0 - alpha);
        let colour = splat.colour_depth.r * (*block).r + splat.colour_depth.g * (*block).g + splat.colour_depth.b * (*block).b;
        let contrast = colour - (*block).behind;
        let weight = alpha * t;
        (*block).t = t;
        (*block).behind += alpha * contrast;
        (*own).r += total(weight * (*block).r);
        (*own).g += total(weight * (*block).g);
        (*own).b += total(weight * (*block).b);
        let v = weight * contrast;
        let v_dy = v * rows;
        let v_total = total(v);
        let v_dx_total = v_total * column.dx;
        let v_dy_total = total(v_dy);
        (*own).v += v_total;
        (*own).v_dx += v_dx_total;
        (*own).v_dy += v_dy_total;
        (*own).v_dx_dx += v_dx_total * column.dx;
        (*own).v_dx_dy += v_dy_total * column.dx;
        (*own).v_dy_dy += total(v_dy * rows);
    }
}

fn last_of(block: Block) -> u32 {
    return max(max(block.stop.x, block.stop.y), max(block.stop.z, block.stop.w));
}

@compute @workgroup_size(LANES)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let slot = group.y * groups.x + group.x;
    if slot >= view.size.z * view.size.w {
        return;
    }
    let list = lists[slot];
    let left = TILE * (list.x % view.size.z) + lane;
    let right = left + LANES;
    let y = TILE * (list.x / view.size.z);
    // A bit a block: see `Region::tiles`.
    let needs_l0 = (list.w & 1u) != 0u;
    let needs_l1 = (list.w & 2u) != 0u;
    let needs_l2 = (list.w & 4u) != 0u;
    let needs_l3 = (list.w & 8u) != 0u;
    let needs_r0 = (list.w & 16u) != 0u;
    let needs_r1 = (list.w & 32u) != 0u;
    let needs_r2 = (list.w & 64u) != 0u;
    let needs_r3 = (list.w & 128u) != 0u;
    var l0 = start(left, y, list.y, needs_l0);
    var l1 = start(left, y + 4u, list.y, needs_l1);
    var l2 = start(left, y + 8u, list.y, needs_l2);
    var l3 = start(left, y + 12u, list.y, needs_l3);
    var r0 = start(right, y, list.y, needs_r0);
    var r1 = start(right, y + 4u, list.y, needs_r1);
    var r2 = start(right, y + 8u, list.y, needs_r2);
    var r3 = start(right, y + 12u, list.y, needs_r3);
    let last_left = max(max(last_of(l0), last_of(l1)), max(last_of(l2), last_of(l3)));
    let last_right = max(max(last_of(r0), last_of(r1)), max(last_of(r2), last_of(r3)));
    let last = furthest(max(last_left, last_right), lane);
    for (var entry = last + lane; entry < list.z; entry += LANES) {
        let at = 9u * entries[entry].y;
        for (var i = 0u; i < 9u; i++) {
            sums[at + i] = 0.0;
        }
    }
    let least = view.thresholds.y;
    for (var after = last; after > list.y; after--) {
        let entry = after - 1u;
        let pair = entries[entry];
        let splat = splats[pair.x];
        let dy = f32(y) + 0.5 - splat.mean_power.y;
        var own: Sums;
        let l = column_of(splat, f32(left) + 0.5);
        unblend(&l0, &own, splat, l, dy, entry, needs_l0, least);
        unblend(&l1, &own, splat, l, dy + 4.0, entry, needs_l1, least);
        unblend(&l2, &own, splat, l, dy + 8.0, entry, needs_l2, least);
        unblend(&l3, &own, splat, l, dy + 12.0, entry, needs_l3, least);
        let r = column_of(splat, f32(right) + 0.5);
        unblend(&r0, &own, splat, r, dy, entry, needs_r0, least);
        unblend(&r1, &own, splat, r, dy + 4.0, entry, needs_r1, least);
        unblend(&r2, &own, splat, r, dy + 8.0, entry, needs_r2, least);
        unblend(&r3, &own, splat, r, dy + 12.0, entry, needs_r3, least);
        let at = 9u * pair.y;
        sums[at + lane] = total_of_eight(own, lane);
        let blue = total_of_blue(own, lane);
        if lane == 0u {
            sums[at + 8u] = blue;
        }
    }
}
