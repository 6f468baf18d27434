// A prefix sum by one workgroup, for numbers that are few: each becomes the sum of those before it.

@group(0) @binding(0) var<storage, read> plan: Plan;
@group(0) @binding(1) var<storage, read_write> numbers: array<u32>;

var<workgroup> rounds: u32;
var<workgroup> carry: u32;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) thread: u32) {
    if thread == 0u {
        rounds = plan.scan_blocks;
        carry = 0u;
    }
    let count = workgroupUniformLoad(&rounds);
    for (var round = 0u; round < count; round++) {
        let first = round * BLOCK + thread * PER_THREAD;
        // Asked for at once: memory answers late.
        var own = array<u32, PER_THREAD>();
        for (var i = 0u; i < PER_THREAD; i++) {
            if first + i < plan.scanned {
                own[i] = numbers[first + i];
            }
        }
        var sum = 0u;
        for (var i = 0u; i < PER_THREAD; i++) {
            sum = add_saturating(sum, own[i]);
        }
        let carried = workgroupUniformLoad(&carry);
        let inclusive = add_saturating(carried, inclusive_scan(thread, sum));
        var before = carried;
        if thread > 0u {
            before = add_saturating(before, sums[thread - 1u]);
        }
        for (var i = 0u; i < PER_THREAD; i++) {
            if first + i < plan.scanned {
                numbers[first + i] = before;
            }
            before = add_saturating(before, own[i]);
        }
        workgroupBarrier();
        if thread == THREADS - 1u {
            carry = inclusive;
        }
        workgroupBarrier();
    }
}
