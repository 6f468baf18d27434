// Sums what the tiles left for each Gaussian, in the order of emission. One thread a Gaussian that touches a tile.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
// Gaussian, first emission index, number of entries.
@group(0) @binding(2) var<storage, read> ranges: array<vec4u>;
// Nine an entry: see `Sums` in `blend_backward_cpu.wgsl`.
@group(0) @binding(3) var<storage, read> sums: array<f32>;
// Ten a range: the bits of the nine sums, and the Gaussian (NOBODY where there was no entry, or none that counts).
@group(0) @binding(4) var<storage, read_write> d_splats: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = (group.y * groups.x + group.x) * THREADS + thread;
    if row >= view.outputs.z {
        return;
    }
    let range = ranges[row];
    let to = 10u * row;
    if range.z == 0u {
        d_splats[to + 9u] = NOBODY;
        return;
    }
    var moments0 = vec3f(0.0);
    var moments1 = vec3f(0.0);
    var d_colour = vec3f(0.0);
    for (var i = range.y; i < range.y + range.z; i++) {
        let at = 9u * i;
        moments0 += vec3f(sums[at], sums[at + 1u], sums[at + 2u]);
        moments1 += vec3f(sums[at + 3u], sums[at + 4u], sums[at + 5u]);
        d_colour += vec3f(sums[at + 6u], sums[at + 7u], sums[at + 8u]);
    }
    // Seen outside of that part alone, it is not seen.
    let untold = all(moments0 == vec3f(0.0)) && all(moments1 == vec3f(0.0)) && all(d_colour == vec3f(0.0));
    if untold && (view.switches.z & IN_PART) != 0u {
        d_splats[to + 9u] = NOBODY;
        return;
    }
    // A channel that was clamped at 0 passes nothing on.
    d_colour = select(vec3f(0.0), d_colour, splats[range.x].colour_depth.rgb > vec3f(0.0));
    d_splats[to] = bitcast<u32>(moments0.x);
    d_splats[to + 1u] = bitcast<u32>(moments0.y);
    d_splats[to + 2u] = bitcast<u32>(moments0.z);
    d_splats[to + 3u] = bitcast<u32>(moments1.x);
    d_splats[to + 4u] = bitcast<u32>(moments1.y);
    d_splats[to + 5u] = bitcast<u32>(moments1.z);
    d_splats[to + 6u] = bitcast<u32>(d_colour.r);
    d_splats[to + 7u] = bitcast<u32>(d_colour.g);
    d_splats[to + 8u] = bitcast<u32>(d_colour.b);
    d_splats[to + 9u] = range.x;
}
