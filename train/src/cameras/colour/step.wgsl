// One step of Adam over the gain and the offset of one camera, from what the threads of `photometric.wgsl` summed; then all
// are shifted so that the cameras stay neutral in the mean: what they have in common is the scene's. One workgroup.

struct Step {
    view: u32,
    // How many threads summed.
    threads: u32,
    // What their sums are multiplied by.
    scale: f32,
    // Weight of |gain - 1|^2 + |offset|^2.
    prior: f32,
    beta1: f32,
    beta2: f32,
    rate: f32,        // learning rate / (1 - beta1^step)
    root_scale: f32,  // 1 / sqrt(1 - beta2^step)
    epsilon: f32,
    cameras: u32,
    unused0: u32,
    unused1: u32,
}

@group(0) @binding(0) var<uniform> step: Step;
// Two a thread: gradient of the gain, gradient of the offset.
@group(0) @binding(1) var<storage, read> partial: array<vec4f>;
// Two a camera: gain, offset; red, green, blue and 1 where the camera takes part, else 0.
@group(0) @binding(2) var<storage, read_write> colours: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> first_moment: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> second_moment: array<vec4f>;

const LANES = 64u;

var<workgroup> sums: array<vec4f, 128>;

@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) lane: u32) {
    var gain = vec4f(0.0);
    var offset = vec4f(0.0);
    for (var thread = lane; thread < step.threads; thread += LANES) {
        gain += partial[2u * thread];
        offset += partial[2u * thread + 1u];
    }
    sums[2u * lane] = gain;
    sums[2u * lane + 1u] = offset;
    workgroupBarrier();
    if lane > 1u {
        return;
    }
    var sum = vec4f(0.0);
    for (var k = 0u; k < LANES; k++) {
        sum += sums[2u * k + lane];
    }
    let at = 2u * step.view + lane;
    let neutral = vec3f(1.0 - f32(lane));
    let gradient = step.scale * sum + 2.0 * step.prior * vec4f(colours[at].rgb - neutral, 0.0);
    let m = step.beta1 * first_moment[at] + (1.0 - step.beta1) * gradient;
    let v = step.beta2 * second_moment[at] + (1.0 - step.beta2) * gradient * gradient;
    first_moment[at] = m;
    second_moment[at] = v;
    colours[at] -= step.rate * m / (sqrt(v) * step.root_scale + step.epsilon);

    var astray = vec4f(0.0);
    for (var camera = 0u; camera < step.cameras; camera++) {
        let row = colours[2u * camera + lane];
        astray += row.w * vec4f(row.rgb - neutral, 1.0);
    }
    let shift = astray.rgb / max(astray.w, 1.0);
    for (var camera = 0u; camera < step.cameras; camera++) {
        let row = colours[2u * camera + lane];
        colours[2u * camera + lane] = vec4f(row.rgb - row.w * shift, row.w);
    }
}
