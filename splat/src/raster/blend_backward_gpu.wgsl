// Walks each tile's list back to front and leaves, for every entry, the sums over the tile's pixels that the gradient
// of its splat is made of, at the entry's emission index (GPU shape: a workgroup a tile).
//
// Each thread owns a splat and visits the pixels one after the other, one step behind the thread before it, which owns
// the splat behind. The state of a pixel lies in shared memory and passes from thread to thread; the sums stay in
// registers, so that nothing is added up across threads. A thread that has seen all pixels goes on with the splat 256
// entries further, without a gap.

// Per pixel: transmittance in front of what has been walked; what lies behind, weighted by dL/d image; dL/d image;
// the entry at which the pixel had become opaque.
var<workgroup> transmittance: array<f32, PIXELS>;
var<workgroup> behind: array<f32, PIXELS>;
var<workgroup> d_pixel: array<vec4f, PIXELS>;
var<workgroup> stop: array<u32, PIXELS>;
var<workgroup> list: vec2u;
var<workgroup> furthest: atomic<u32>;

@compute @workgroup_size(PIXELS)
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
        atomicStore(&furthest, 0u);
    }
    let entry_range = workgroupUniformLoad(&list);
    let corner = TILE * vec2u(tile % view.size.z, tile / view.size.z);
    let own = corner + vec2u(thread % TILE, thread / TILE);
    let begun = pixel_of(own, entry_range.x);
    transmittance[thread] = begun.transmittance;
    behind[thread] = begun.behind;
    d_pixel[thread] = vec4f(begun.d_colour, 0.0);
    stop[thread] = begun.stop;
    atomicMax(&furthest, stop[thread]);
    let last = workgroupUniformLoad(&furthest);

    clear_sums(max(last, entry_range.x), entry_range.y, thread);
    let count = select(0u, last - entry_range.x, last > entry_range.x);
    let steps = select(0u, count + PIXELS - 1u, count > 0u);
    var splat: Splat;
    var emission = 0u;
    var v_sums = vec3f(0.0);
    var v_more = vec3f(0.0);
    var colour_sums = vec3f(0.0);
    for (var step = 0u; step < steps; step++) {
        let turn = step - thread;
        let walked = (turn / PIXELS) * PIXELS + thread;
        if step >= thread && walked < count {
            let pixel = turn % PIXELS;
            let entry = last - 1u - walked;
            if pixel == 0u {
                emission = entries[entry];
                splat = splats[owners[emission]];
                v_sums = vec3f(0.0);
                v_more = vec3f(0.0);
                colour_sums = vec3f(0.0);
            }
            let position = vec2f(corner + vec2u(pixel % TILE, pixel / TILE)) + 0.5;
            let d = position - splat.mean_power.xy;
            let alpha = alpha_of(splat, d);
            if alpha >= view.thresholds.x && entry < stop[pixel] {
                let d_colour = d_pixel[pixel].rgb;
                let t = transmittance[pixel] / (1.0 - alpha);
                let contrast = dot(d_colour, splat.colour_depth.rgb) - behind[pixel];
                transmittance[pixel] = t;
                behind[pixel] += alpha * contrast;
                let weight = alpha * t;
                colour_sums += weight * d_colour;
                let v = weight * contrast;
                v_sums += v * vec3f(1.0, d);
                v_more += v * vec3f(d.x * d.x, d.x * d.y, d.y * d.y);
            }
            if pixel == PIXELS - 1u {
                let at = SUMS * emission;
                for (var i = 0u; i < 3u; i++) {
                    sums[at + i] = v_sums[i];
                    sums[at + 3u + i] = v_more[i];
                    sums[at + 6u + i] = colour_sums[i];
                }
            }
        }
        workgroupBarrier();
    }
}
