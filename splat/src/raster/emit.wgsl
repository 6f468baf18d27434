// Writes one (tile, emission index) pair for every tile that a splat touches, nearest splats first; a splat's pairs
// are consecutive (GPU shape). One thread a Gaussian. What there is no room for is left out, and seen in the plan.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> counts: array<u32>;
@group(0) @binding(3) var<storage, read> by_depth: array<u32>;
@group(0) @binding(4) var<storage, read> offsets: array<u32>;
// Gaussian, first emission index, number of entries.
@group(0) @binding(5) var<storage, read_write> ranges: array<vec4u>;
@group(0) @binding(6) var<storage, read_write> keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> values: array<u32>;
// The splat of each emission index.
@group(0) @binding(8) var<storage, read_write> owners: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = (group.y * groups.x + group.x) * THREADS + thread;
    if rank >= view.counts.x {
        return;
    }
    let index = by_depth[rank];
    let capacity = view.switches.w;
    let first = min(offsets[rank], capacity);
    let end = first + min(counts[index], capacity - first);
    ranges[rank] = vec4u(index, first, end - first, 0u);
    let splat = splats[index];
    let rows = tile_rows(splat);
    var at = first;
    for (var row = rows.x; row < rows.y; row++) {
        let columns = tile_columns(splat, row);
        for (var column = columns.x; column < columns.y && at < end; column++) {
            keys[at] = row * view.size.z + column;
            values[at] = at;
            owners[at] = index;
            at++;
        }
    }
    // Where a compiler rounds differently here than in the count, the rest belongs to no tile.
    for (; at < end; at++) {
        keys[at] = view.size.z * view.size.w;
        values[at] = at;
        owners[at] = index;
    }
}
