// Turns the fixed-point sums of one pass into gradients, and clears them. A spatial plane takes its own; a line is shared
// out to the two rows of its time plane.

struct Flush {
    sums: u32,    // first sum
    to: u32,      // where the plane, or the lower row, starts in the gradients
    length: u32,
    stride: u32,  // floats to the next row; 0 for a spatial plane
    weight: f32,  // of the next row
}

@group(0) @binding(0) var<uniform> flush: Flush;
@group(0) @binding(1) var<storage, read_write> low_words: array<u32>;
@group(0) @binding(2) var<storage, read_write> high_words: array<u32>;
@group(0) @binding(3) var<storage, read_write> gradients: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let i = (group.y * groups.x + group.x) * 256u + thread;
    if i >= flush.length {
        return;
    }
    var low = low_words[flush.sums + i];
    var high = high_words[flush.sums + i];
    if (low | high) == 0u {
        return;
    }
    low_words[flush.sums + i] = 0u;
    high_words[flush.sums + i] = 0u;
    let negative = high >= 0x80000000u;
    if negative {
        low = ~low + 1u;
        high = ~high + u32(low == 0u);
    }
    let magnitude = (f32(high) * 4294967296.0 + f32(low)) / 1099511627776.0;
    let value = select(magnitude, -magnitude, negative);
    if flush.stride == 0u {
        gradients[flush.to + i] += value;
    } else {
        gradients[flush.to + i] += (1.0 - flush.weight) * value;
        gradients[flush.to + flush.stride + i] += flush.weight * value;
    }
}
