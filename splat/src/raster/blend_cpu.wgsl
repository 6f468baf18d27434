// Blends the splats of each tile front to back (CPU shape).

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
// Splat and emission index, sorted by tile, then depth.
@group(0) @binding(2) var<storage, read> entries: array<vec2u>;
// Tile, first entry, end of entries, needed blocks; longest lists first.
@group(0) @binding(3) var<storage, read> lists: array<vec4u>;
@group(0) @binding(4) var<storage, read_write> image: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> depth: array<f32>;
// Entry at which each pixel had become opaque, or the end of its tile's list.
@group(0) @binding(6) var<storage, read_write> stops: array<u32>;

// Four pixels of a column.
struct Block {
    // Transmittance; negative once the pixel is opaque.
    t: vec4f,
    r: vec4f,
    g: vec4f,
    b: vec4f,
    z: vec4f,
    stop: vec4u,
}

fn blend(block: ptr<function, Block>, splat: Splat, column: Column, dy: f32, entry: u32, needed: bool, thresholds: vec4f) {
    if needed && reaches(column, dy) {
        let power = log_alpha(splat, column, dy + ROWS);
        let t = (*block).t;
        let counts = (power >= vec4f(thresholds.y)) & (t > vec4f(0.0));
        let share = select(vec4f(0.0), exp2(power) * t, counts);
        let next = t - share;
        let ends = counts & (next < vec4f(thresholds.z));
        let weight = select(share, vec4f(0.0), ends);
        (*block).t = select(next, -t, ends);
        (*block).stop = select((*block).stop, vec4u(entry), ends);
        (*block).r += weight * splat.colour_depth.r;
        (*block).g += weight * splat.colour_depth.g;
        (*block).b += weight * splat.colour_depth.b;
        if WITH_DEPTH {
            (*block).z += weight * splat.colour_depth.w;
        }
    }
}

fn start(x: u32, y: u32, end: u32) -> Block {
    var block: Block;
    let rows = vec4u(y) + vec4u(0u, 1u, 2u, 3u);
    block.t = select(vec4f(-1.0), vec4f(1.0), (rows < vec4u(view.size.y)) & vec4<bool>(x < view.size.x));
    block.stop = vec4u(end);
    return block;
}

fn finish(block: ptr<function, Block>, x: u32, y: u32) {
    if x >= view.size.x {
        return;
    }
    let t = abs((*block).t);
    for (var i = 0u; i < 4u; i++) {
        if y + i < view.size.y {
            let at = (y + i) * view.size.x + x;
            let colour = vec3f((*block).r[i], (*block).g[i], (*block).b[i]) + t[i] * view.background.rgb;
            image[at] = vec4f(colour, t[i]);
            stops[at] = (*block).stop[i];
            if WITH_DEPTH {
                depth[at] = (*block).z[i];
            }
        }
    }
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
    var l0 = start(left, y, list.z);
    var l1 = start(left, y + 4u, list.z);
    var l2 = start(left, y + 8u, list.z);
    var l3 = start(left, y + 12u, list.z);
    var r0 = start(right, y, list.z);
    var r1 = start(right, y + 4u, list.z);
    var r2 = start(right, y + 8u, list.z);
    var r3 = start(right, y + 12u, list.z);
    let thresholds = view.thresholds;
    for (var entry = list.y; entry < list.z; entry++) {
        let splat = splats[entries[entry].x];
        let dy = f32(y) + 0.5 - splat.mean_power.y;
        let l = column_of(splat, f32(left) + 0.5);
        blend(&l0, splat, l, dy, entry, needs_l0, thresholds);
        blend(&l1, splat, l, dy + 4.0, entry, needs_l1, thresholds);
        blend(&l2, splat, l, dy + 8.0, entry, needs_l2, thresholds);
        blend(&l3, splat, l, dy + 12.0, entry, needs_l3, thresholds);
        let r = column_of(splat, f32(right) + 0.5);
        blend(&r0, splat, r, dy, entry, needs_r0, thresholds);
        blend(&r1, splat, r, dy + 4.0, entry, needs_r1, thresholds);
        blend(&r2, splat, r, dy + 8.0, entry, needs_r2, thresholds);
        blend(&r3, splat, r, dy + 12.0, entry, needs_r3, thresholds);
        if entry % 16u == 15u {
            let clearest = max(max(max(l0.t, l1.t), max(l2.t, l3.t)), max(max(r0.t, r1.t), max(r2.t, r3.t)));
            if all(clearest < vec4f(0.0)) {
                break;
            }
        }
    }
    finish(&l0, left, y);
    finish(&l1, left, y + 4u);
    finish(&l2, left, y + 8u);
    finish(&l3, left, y + 12u);
    finish(&r0, right, y);
    finish(&r1, right, y + 4u);
    finish(&r2, right, y + 8u);
    finish(&r3, right, y + 12u);
}
