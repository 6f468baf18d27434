// Blends the splats of each tile front to back (CPU shape: one thread a tile).

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
// Splat and emission index, sorted by tile, then depth.
@group(0) @binding(2) var<storage, read> entries: array<vec2u>;
// Tile, first entry, end of entries; longest lists first, so that neighbouring threads walk equally far.
@group(0) @binding(3) var<storage, read> lists: array<vec4u>;
@group(0) @binding(4) var<storage, read_write> image: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> depth: array<f32>;
// Entry at which each pixel had become opaque, or the end of its tile's list.
@group(0) @binding(6) var<storage, read_write> stops: array<u32>;

struct Row {
    // Transmittance; negative once the pixel is opaque.
    t: vec4f,
    r: vec4f,
    g: vec4f,
    b: vec4f,
    z: vec4f,
    stop: vec4u,
}

fn blend(row: ptr<function, Row>, bell: Bell, z: f32, dx: vec4f, dy: f32, entry: u32) {
    let alpha = min(bell.opacity * falloff(bell, dx, dy), vec4f(LARGEST_ALPHA));
    let t = (*row).t;
    let next = t * (1.0 - alpha);
    let counts = (alpha >= vec4f(NEGLIGIBLE_ALPHA)) & (t > vec4f(0.0));
    let enough = next >= vec4f(LEAST_TRANSMITTANCE);
    let taken = counts & enough;
    let ends = counts & !enough;
    let weight = select(vec4f(0.0), alpha * t, taken);
    (*row).r += weight * bell.colour.r;
    (*row).g += weight * bell.colour.g;
    (*row).b += weight * bell.colour.b;
    if WITH_DEPTH {
        (*row).z += weight * z;
    }
    (*row).t = select(select(t, -t, ends), next, taken);
    (*row).stop = select((*row).stop, vec4u(entry), ends);
}

fn start(y: u32, inside_x: vec4<bool>, end: u32) -> Row {
    var row: Row;
    row.t = select(vec4f(-1.0), vec4f(1.0), inside_x & vec4<bool>(y < view.size.y));
    row.stop = vec4u(end);
    return row;
}

fn finish(row: ptr<function, Row>, x: u32, y: u32) {
    if y >= view.size.y {
        return;
    }
    let t = abs((*row).t);
    let at = y * view.size.x + x;
    for (var i = 0u; i < TILE; i++) {
        if x + i < view.size.x {
            let colour = vec3f((*row).r[i], (*row).g[i], (*row).b[i]) + t[i] * view.background.rgb;
            image[at + i] = vec4f(colour, t[i]);
            stops[at + i] = (*row).stop[i];
            if WITH_DEPTH {
                depth[at + i] = (*row).z[i];
            }
        }
    }
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
    let inside_x = columns < vec4f(f32(view.size.x));
    var row0 = start(y, inside_x, list.z);
    var row1 = start(y + 1u, inside_x, list.z);
    var row2 = start(y + 2u, inside_x, list.z);
    var row3 = start(y + 3u, inside_x, list.z);
    for (var entry = list.y; entry < list.z; entry++) {
        let splat = splats[entries[entry].x];
        let bell = bell_of(splat);
        let dx = columns - bell.mean.x;
        let dy = f32(y) + 0.5 - bell.mean.y;
        let z = splat.colour_depth.w;
        blend(&row0, bell, z, dx, dy, entry);
        blend(&row1, bell, z, dx, dy + 1.0, entry);
        blend(&row2, bell, z, dx, dy + 2.0, entry);
        blend(&row3, bell, z, dx, dy + 3.0, entry);
        let clearest = max(max(row0.t, row1.t), max(row2.t, row3.t));
        if all(clearest < vec4f(0.0)) {
            break;
        }
    }
    finish(&row0, x, y);
    finish(&row1, x, y + 1u);
    finish(&row2, x, y + 2u);
    finish(&row3, x, y + 3u);
}
