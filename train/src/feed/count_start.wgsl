// The ON and OFF counts of all pixels that are known between two edges: those at one image of counts less those at another. They are sums
// modulo 2^32; `count_add.wgsl` brings them to their edges.

struct Parameters {
    // Counts: two a pixel.
    words: u32,
    threads: u32,
    // Bit 0: there is an image that is added, bit 1: one that is taken away.
    images: u32,
    // Where they begin in their buffers.
    more_from: u32,
    less_from: u32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

@group(0) @binding(0) var<uniform> p: Parameters;
@group(0) @binding(1) var<storage, read> more: array<u32>;
@group(0) @binding(2) var<storage, read> less: array<u32>;
@group(0) @binding(3) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let thread = (group.y * groups.x + group.x) * 64u + lane;
    if (thread >= p.threads) { return; }
    for (var word = thread; word < p.words; word += p.threads) {
        var sum = 0u;
        if ((p.images & 1u) != 0u) { sum = more[p.more_from + word]; }
        if ((p.images & 2u) != 0u) { sum -= less[p.less_from + word]; }
        sums[word] = sum;
    }
}
