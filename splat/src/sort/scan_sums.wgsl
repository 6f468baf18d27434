// Second step of a prefix sum: the exclusive prefix sum of the blocks' sums, in place, by one workgroup.

@group(0) @binding(0) var<storage, read_write> plan: Plan;
@group(0) @binding(1) var<storage, read_write> block_sums: array<u32>;

var<workgroup> rounds: u32;
var<workgroup> carry: u32;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    if thread == 0u {
        rounds = (plan.scan_blocks + THREADS - 1u) / THREADS;
        carry = 0u;
    }
    let count = workgroupUniformLoad(&rounds);
    for (var round = 0u; round < count; round++) {
        let block = round * THREADS + thread;
        var value = 0u;
        if block < plan.scan_blocks {
            value = block_sums[block];
        }
        let before = workgroupUniformLoad(&carry);
        let inclusive = add_saturating(before, inclusive_scan(thread, value));
        let previous = add_saturating(before, select(0u, sums[max(thread, 1u) - 1u], thread > 0u));
        if block < plan.scan_blocks {
            block_sums[block] = previous;
        }
        workgroupBarrier();
        if thread == THREADS - 1u {
            carry = inclusive;
        }
        workgroupBarrier();
    }
    if thread == THREADS - 1u {
        plan.total = carry;
    }
}
