// Adds slabs to gradients, each sum in an order of its own: a workgroup makes 64 sums, each of four quarters of the slabs.
// What lies behind the weights of a slab are biases.

struct Reduce {
    weights: u32,
    biases: u32,
    slabs: u32,
    to_weights: u32,
    to_biases: u32,
}

@group(0) @binding(0) var<uniform> reduce: Reduce;
@group(0) @binding(1) var<storage, read> slabs: array<f32>;
@group(0) @binding(2) var<storage, read_write> gradients: array<f32>;

var<workgroup> quarters: array<f32, 256>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let length = reduce.weights + reduce.biases;
    let i = (group.y * groups.x + group.x) * 64u + thread % 64u;
    var sum = 0.0;
    if i < length {
        for (var slab = thread / 64u; slab < reduce.slabs; slab += 4u) {
            sum += slabs[slab * length + i];
        }
    }
    quarters[thread] = sum;
    workgroupBarrier();
    if thread < 64u && i < length {
        let all = quarters[thread] + quarters[thread + 64u] + quarters[thread + 128u] + quarters[thread + 192u];
        let to = select(reduce.to_biases + i - reduce.weights, reduce.to_weights + i, i < reduce.weights);
        gradients[to] += all;
    }
}
