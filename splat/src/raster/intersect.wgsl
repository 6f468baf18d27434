// Counts the tiles that each splat touches, and makes the pairs for the sort by depth (GPU shape). One thread a
// Gaussian.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;
@group(0) @binding(3) var<storage, read_write> keys: array<u32>;
@group(0) @binding(4) var<storage, read_write> values: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = (group.y * groups.x + group.x) * THREADS + thread;
    if index >= view.counts.x {
        return;
    }
    let splat = splats[index];
    let rows = tile_rows(splat);
    var count = 0u;
    for (var row = rows.x; row < rows.y; row++) {
        let columns = tile_columns(splat, row);
        count += columns.y - columns.x;
    }
    counts[index] = count;
    // Depths are positive, so that their bits sort as they do; what is not seen comes last.
    keys[index] = select(0xffffffffu, bitcast<u32>(splat.colour_depth.w), count > 0u);
    values[index] = index;
}
