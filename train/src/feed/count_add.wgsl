// Counts events, or takes them away. Sums are modulo 2^32, so that the order of the threads does not matter.

struct Parameters {
    first: u32,
    events: u32,
    threads: u32,
    // 1, or 2^32 - 1.
    step: u32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
// Of each event twice its pixel, and one more if it is ON.
@group(0) @binding(1) var<storage, read> events: array<u32>;
// ON and OFF events of each pixel.
@group(0) @binding(2) var<storage, read_write> sums: array<atomic<u32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let thread = (group.y * groups.x + group.x) * 64u + lane;
    if (thread >= p.threads) { return; }
    for (var event = thread; event < p.events; event += p.threads) {
        atomicAdd(&sums[events[p.first + event] ^ 1u], p.step);
    }
}
