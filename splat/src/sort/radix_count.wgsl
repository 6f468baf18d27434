// Counts the digits of each block, digit-major: where the prefix sum of the counts is where each block's digits go.

@group(0) @binding(0) var<storage, read> plan: Plan;
@group(0) @binding(1) var<uniform> shift: vec4u;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> counts: array<u32>;

// Neighbours often have the same digit, and would wait for each other at one counter.
const COPIES = 16u;

var<workgroup> histogram: array<atomic<u32>, DIGITS * COPIES>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = group.y * groups.x + group.x;
    atomicStore(&histogram[thread], 0u);
    workgroupBarrier();
    for (var i = 0u; i < PER_THREAD; i++) {
        let at = block * BLOCK + i * THREADS + thread;
        if at < plan.count {
            atomicAdd(&histogram[((keys[at] >> shift.x) & (DIGITS - 1u)) * COPIES + thread % COPIES], 1u);
        }
    }
    workgroupBarrier();
    if thread < DIGITS && block < plan.blocks {
        var sum = 0u;
        for (var copy = 0u; copy < COPIES; copy++) {
            sum += atomicLoad(&histogram[thread * COPIES + copy]);
        }
        counts[thread * plan.blocks + block] = sum;
    }
}
