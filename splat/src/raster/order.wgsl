// The tile counts of the Gaussians in order of depth, for the prefix sum (GPU shape). One thread a Gaussian.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> by_depth: array<u32>;
@group(0) @binding(3) var<storage, read_write> offsets: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = (group.y * groups.x + group.x) * THREADS + thread;
    if rank < view.counts.x {
        offsets[rank] = counts[by_depth[rank]];
    }
}
