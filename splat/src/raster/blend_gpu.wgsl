// Blends the splats of each tile front to back (GPU shape): a workgroup a tile, a thread a pixel, splats fetched
// together.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
// Emission indices, sorted by tile, then depth; the splat of each emission index.
@group(0) @binding(2) var<storage, read> entries: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
// y, z: first entry and end of entries of each tile.
@group(0) @binding(4) var<storage, read> lists: array<vec4u>;
@group(0) @binding(5) var<storage, read_write> image: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> depth: array<f32>;
@group(0) @binding(7) var<storage, read_write> stops: array<u32>;

const BATCH = 256u;

var<workgroup> batch: array<Splat, BATCH>;
var<workgroup> alive: atomic<u32>;
var<workgroup> list: vec2u;

@compute @workgroup_size(BATCH)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let tile = group.y * groups.x + group.x;
    if thread == 0u {
        list = vec2u(0u);
        if tile < view.size.z * view.size.w {
            list = lists[tile].yz;
        }
    }
    let entry_range = workgroupUniformLoad(&list);
    let x = TILE * (tile % view.size.z) + thread % TILE;
    let y = TILE * (tile / view.size.z) + thread / TILE;
    let pixel = vec2f(f32(x), f32(y)) + 0.5;
    let inside = x < view.size.x && y < view.size.y;

    var going = inside;
    var t = 1.0;
    var colour = vec3f(0.0);
    var z = 0.0;
    var stop = entry_range.y;
    for (var first = entry_range.x; first < entry_range.y; first += BATCH) {
        if thread == 0u {
            atomicStore(&alive, 0u);
        }
        workgroupBarrier();
        if going {
            atomicStore(&alive, 1u);
        }
        let fetched = first + thread;
        if fetched < entry_range.y {
            batch[thread] = splats[owners[entries[fetched]]];
        }
        if workgroupUniformLoad(&alive) == 0u {
            break;
        }
        let size = min(BATCH, entry_range.y - first);
        for (var i = 0u; i < size && going; i++) {
            let splat = batch[i];
            let d = pixel - splat.mean_power.xy;
            let alpha = alpha_of(splat, d);
            if alpha < view.thresholds.x {
                continue;
            }
            let next = t * (1.0 - alpha);
            if next < view.thresholds.z {
                stop = first + i;
                going = false;
                break;
            }
            colour += alpha * t * splat.colour_depth.rgb;
            if WITH_DEPTH {
                z += alpha * t * splat.colour_depth.w;
            }
            t = next;
        }
        workgroupBarrier();
    }
    if inside {
        let at = y * view.size.x + x;
        image[at] = vec4f(colour + t * view.background.rgb, t);
        stops[at] = stop;
        if WITH_DEPTH {
            depth[at] = z;
        }
    }
}
