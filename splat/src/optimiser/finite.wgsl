// Counts the values that are NaN or infinite. It looks at the bits, since shader compilers may assume that NaN does not
// happen.

@group(0) @binding(0) var<uniform> count: vec4u;
@group(0) @binding(1) var<storage, read> values: array<u32>;
@group(0) @binding(2) var<storage, read_write> found: atomic<u32>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    var here = 0u;
    for (var i = id.x; i < count.x; i += groups.x * 256u) {
        here += u32((values[i] & 0x7f800000u) == 0x7f800000u);
    }
    if here > 0u {
        atomicAdd(&found, here);
    }
}
