// Third step of a prefix sum: each number becomes the sum of those before it.

@group(0) @binding(0) var<storage, read> plan: Plan;
@group(0) @binding(1) var<storage, read> block_sums: array<u32>;
@group(0) @binding(2) var<storage, read_write> numbers: array<u32>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = group.y * groups.x + group.x;
    let first = block * BLOCK + thread * PER_THREAD;
    let end = min(first + PER_THREAD, plan.scanned);
    var sum = 0u;
    for (var i = first; i < end; i++) {
        sum = add_saturating(sum, numbers[i]);
    }
    let inclusive = inclusive_scan(thread, sum);
    if block >= plan.scan_blocks {
        return;
    }
    var before = block_sums[block];
    if thread > 0u {
        before = add_saturating(before, sums[thread - 1u]);
    }
    for (var i = first; i < end; i++) {
        let number = numbers[i];
        numbers[i] = before;
        before = add_saturating(before, number);
    }
}
