// Moves each pair of a block to its place among the pairs of its digit, keeping their order. Each thread owns eight
// consecutive pairs; sixteen counters a thread, packed in pairs, are summed over the threads.

@group(0) @binding(0) var<storage, read> plan: Plan;
@group(0) @binding(1) var<uniform> shift: vec4u;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read> places: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_values: array<u32>;

const WORDS = DIGITS / 2u;

var<workgroup> counters: array<u32, THREADS * WORDS>;
// Where the block's pairs of each digit begin.
var<workgroup> begins: array<u32, DIGITS>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = group.y * groups.x + group.x;
    let first = block * BLOCK + thread * PER_THREAD;
    let count = select(0u, min(PER_THREAD, plan.count - first), first < plan.count);
    // What is read is asked for at once: memory answers late.
    var own_keys = array<u32, PER_THREAD>();
    var own_values = array<u32, PER_THREAD>();
    for (var i = 0u; i < PER_THREAD; i++) {
        if i < count {
            own_keys[i] = keys[first + i];
            own_values[i] = values[first + i];
        }
    }
    if thread < DIGITS && block < plan.blocks {
        begins[thread] = places[thread * plan.blocks + block];
    }
    for (var word = 0u; word < WORDS; word++) {
        counters[word * THREADS + thread] = 0u;
    }
    for (var i = 0u; i < PER_THREAD; i++) {
        let digit = (own_keys[i] >> shift.x) & (DIGITS - 1u);
        counters[(digit >> 1u) * THREADS + thread] += select(0u, 1u << ((digit & 1u) * 16u), i < count);
    }
    var own: array<u32, WORDS>;
    for (var word = 0u; word < WORDS; word++) {
        own[word] = counters[word * THREADS + thread];
    }
    for (var offset = 1u; offset < THREADS; offset = 2u * offset) {
        workgroupBarrier();
        // Given a value, for browsers do not set it to zero anew.
        var before = array<u32, WORDS>();
        if thread >= offset {
            for (var word = 0u; word < WORDS; word++) {
                before[word] = counters[word * THREADS + thread - offset];
            }
        }
        workgroupBarrier();
        for (var word = 0u; word < WORDS; word++) {
            counters[word * THREADS + thread] += before[word];
        }
    }
    // From here on each thread touches its own counters alone.
    for (var word = 0u; word < WORDS; word++) {
        counters[word * THREADS + thread] -= own[word];
    }
    for (var i = 0u; i < PER_THREAD; i++) {
        if i >= count {
            break;
        }
        let digit = (own_keys[i] >> shift.x) & (DIGITS - 1u);
        let half = (digit & 1u) * 16u;
        let counter = (digit >> 1u) * THREADS + thread;
        let place = begins[digit] + ((counters[counter] >> half) & 0xffffu);
        counters[counter] += 1u << half;
        sorted_keys[place] = own_keys[i];
        sorted_values[place] = own_values[i];
    }
}
