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

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = group.y * groups.x + group.x;
    let first = block * BLOCK + thread * PER_THREAD;
    let end = min(first + PER_THREAD, plan.count);
    for (var word = 0u; word < WORDS; word++) {
        counters[word * THREADS + thread] = 0u;
    }
    for (var i = first; i < end; i++) {
        let digit = (keys[i] >> shift.x) & (DIGITS - 1u);
        counters[(digit >> 1u) * THREADS + thread] += 1u << ((digit & 1u) * 16u);
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
    for (var i = first; i < end; i++) {
        let key = keys[i];
        let digit = (key >> shift.x) & (DIGITS - 1u);
        let half = (digit & 1u) * 16u;
        let counter = (digit >> 1u) * THREADS + thread;
        let place = places[digit * plan.blocks + block] + ((counters[counter] >> half) & 0xffffu);
        counters[counter] += 1u << half;
        sorted_keys[place] = key;
        sorted_values[place] = values[i];
    }
}
