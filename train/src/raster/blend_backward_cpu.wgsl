// Walks each tile's list back to front and leaves, for every entry, the sums over the tile's pixels that the gradient
// of its splat is made of, at the entry's emission index (CPU shape: one thread a tile).

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> entries: array<vec2u>;
@group(0) @binding(3) var<storage, read> lists: array<vec4u>;
@group(0) @binding(4) var<storage, read> image: array<vec4f>;
@group(0) @binding(5) var<storage, read> stops: array<u32>;
@group(0) @binding(6) var<storage, read> d_image: array<vec4f>;
// With v = dL/d power and (dx, dy) the distance from the mean: sums of v, v dx, v dy, v dx dx.
@group(0) @binding(7) var<storage, read_write> moments: array<vec4f>;
// Sums of v dx dy, v dy dy; dL/d red, dL/d green.
@group(0) @binding(8) var<storage, read_write> moments_colour: array<vec4f>;
// dL/d blue.
@group(0) @binding(9) var<storage, read_write> d_blue: array<f32>;

struct Row {
    // Transmittance in front of what has been walked.
    t: vec4f,
    // dL/d colour.
    r: vec4f,
    g: vec4f,
    b: vec4f,
    // Colour (and transmittance) behind, weighted by dL/d image.
    behind: vec4f,
    stop: vec4u,
}

// Sums over the rows of a tile, by column.
struct Sums {
    v: vec4f,
    v_dy: vec4f,
    v_dy_dy: vec4f,
    r: vec4f,
    g: vec4f,
    b: vec4f,
}

fn start(x: u32, y: u32, first: u32) -> Row {
    var row: Row;
    row.stop = vec4u(first);
    row.t = vec4f(1.0);
    if y >= view.size.y {
        return row;
    }
    let at = y * view.size.x + x;
    for (var i = 0u; i < TILE; i++) {
        if x + i < view.size.x {
            let d = d_image[at + i];
            row.t[i] = image[at + i].w;
            row.r[i] = d.r;
            row.g[i] = d.g;
            row.b[i] = d.b;
            row.behind[i] = dot(d.rgb, view.background.rgb) + d.w;
            row.stop[i] = stops[at + i];
        }
    }
    return row;
}

// The loss depends on alpha through T (colour - colour behind). The bound on alpha is not differentiated, as in the
// 3DGS code, so that opaque splats keep moving.
fn unblend(row: ptr<function, Row>, sums: ptr<function, Sums>, bell: Bell, dx: vec4f, dy: f32, entry: u32) {
    let unbounded = bell.opacity * falloff(bell, dx, dy);
    let bounded = min(unbounded, vec4f(LARGEST_ALPHA));
    let counts = (bounded >= vec4f(NEGLIGIBLE_ALPHA)) & (vec4u(entry) < (*row).stop);
    let alpha = select(vec4f(0.0), bounded, counts);
    let t = (*row).t / (1.0 - alpha);
    let colour = bell.colour.r * (*row).r + bell.colour.g * (*row).g + bell.colour.b * (*row).b;
    let contrast = colour - (*row).behind;
    let weight = alpha * t;
    (*row).t = t;
    (*row).behind += alpha * contrast;
    (*sums).r += weight * (*row).r;
    (*sums).g += weight * (*row).g;
    (*sums).b += weight * (*row).b;
    let v = select(vec4f(0.0), unbounded * t * contrast, counts);
    let v_dy = v * dy;
    (*sums).v += v;
    (*sums).v_dy += v_dy;
    (*sums).v_dy_dy += v_dy * dy;
}

fn total(x: vec4f) -> f32 {
    return (x.x + x.y) + (x.z + x.w);
}

fn last_of(row: Row) -> u32 {
    return max(max(row.stop.x, row.stop.y), max(row.stop.z, row.stop.w));
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let slot = (group.y * groups.x + group.x) * THREADS + thread;
    if slot >= view.size.z * view.size.w {
        return;
    }
    let list = lists[slot];
    let x = TILE * (list.x % view.size.z);
    let y = TILE * (list.x / view.size.z);
    let columns = vec4f(f32(x)) + vec4f(0.5, 1.5, 2.5, 3.5);
    var row0 = start(x, y, list.y);
    var row1 = start(x, y + 1u, list.y);
    var row2 = start(x, y + 2u, list.y);
    var row3 = start(x, y + 3u, list.y);
    let last = max(max(last_of(row0), last_of(row1)), max(last_of(row2), last_of(row3)));
    for (var entry = last; entry < list.z; entry++) {
        let emission = entries[entry].y;
        moments[emission] = vec4f(0.0);
        moments_colour[emission] = vec4f(0.0);
        d_blue[emission] = 0.0;
    }
    for (var after = last; after > list.y; after--) {
        let entry = after - 1u;
        let pair = entries[entry];
        let bell = bell_of(splats[pair.x]);
        let dx = columns - bell.mean.x;
        let dy = f32(y) + 0.5 - bell.mean.y;
        var sums: Sums;
        unblend(&row0, &sums, bell, dx, dy, entry);
        unblend(&row1, &sums, bell, dx, dy + 1.0, entry);
        unblend(&row2, &sums, bell, dx, dy + 2.0, entry);
        unblend(&row3, &sums, bell, dx, dy + 3.0, entry);
        let v_dx = sums.v * dx;
        moments[pair.y] = vec4f(total(sums.v), total(v_dx), total(sums.v_dy), dot(v_dx, dx));
        moments_colour[pair.y] = vec4f(dot(sums.v_dy, dx), total(sums.v_dy_dy), total(sums.r), total(sums.g));
        d_blue[pair.y] = total(sums.b);
    }
}
