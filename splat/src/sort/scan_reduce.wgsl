// First step of a prefix sum: the sum of each block.

@group(0) @binding(0) var<storage, read> plan: Plan;
@group(0) @binding(1) var<storage, read> numbers: array<u32>;
@group(0) @binding(2) var<storage, read_write> block_sums: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = group.y * groups.x + group.x;
    let first = block * BLOCK + thread * PER_THREAD;
    var sum = 0u;
    for (var i = first; i < min(first + PER_THREAD, plan.scanned); i++) {
        sum = add_saturating(sum, numbers[i]);
    }
    let total = inclusive_scan(thread, sum);
    if thread == THREADS - 1u && block < plan.scan_blocks {
        block_sums[block] = total;
    }
}
