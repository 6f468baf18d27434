// One step of Adam over rows of parameters, four floats at a time, with a learning rate for each column.
//
// PER_THREAD vectors a thread: 1 on GPUs, several on software adapters, where a thread costs more than its work.

struct Step {
    vectors: u32,      // rows * row_vectors
    row_vectors: u32,  // a quarter of the row's floats
    beta1: f32,
    beta2: f32,
    epsilon: f32,
    rate_scale: f32,   // 1 / (1 - beta1^step)
    root_scale: f32,   // 1 / sqrt(1 - beta2^step)
    padding: u32,
}

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> rates: array<vec4f>;
@group(0) @binding(2) var<storage, read> gradients: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> parameters: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> first_moment: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> second_moment: array<vec4f>;
// MASK @group(0) @binding(6) var<storage, read> mask: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let first = ((group.y * groups.x + group.x) * 256u + thread) * PER_THREAD;
    for (var i = first; i < min(first + PER_THREAD, step.vectors); i++) {
        // MASK if mask[i / step.row_vectors] == 0u { continue; }
        let gradient = gradients[i];
        let m = step.beta1 * first_moment[i] + (1.0 - step.beta1) * gradient;
        let v = step.beta2 * second_moment[i] + (1.0 - step.beta2) * gradient * gradient;
        first_moment[i] = m;
        second_moment[i] = v;
        let rate = step.rate_scale * rates[i % step.row_vectors];
        parameters[i] -= rate * m / (sqrt(v) * step.root_scale + step.epsilon);
    }
}
