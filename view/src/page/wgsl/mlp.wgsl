// The MLP of the field, forward: trunk, then for every head ReLU, hidden, ReLU, out, into the deltas. One thread a Gaussian.
// Weights come as 4 x 4 blocks (columns are inputs), so that a layer is a sum of matrix-vector products.
//
// Constants put before this text: IN4, WIDTH4 (inputs and width / 4), HEADS.

struct Head { column: u32, outputs: u32 }

@group(0) @binding(0) var<uniform> rows: vec4u;
@group(0) @binding(1) var<storage, read> features: array<vec4f>;
@group(0) @binding(2) var<storage, read> blocks: array<mat4x4f>;
@group(0) @binding(3) var<storage, read> biases: array<vec4f>;
@group(0) @binding(4) var<storage, read> heads: array<Head, HEADS>;
@group(0) @binding(5) var<storage, read_write> deltas: array<f32>;

const HEAD_BLOCKS = WIDTH4 * WIDTH4 + WIDTH4;
const HEAD_BIASES = WIDTH4 + 1u;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) thread: u32) {
    let row = (group.y * groups.x + group.x) * 64u + thread;
    if row >= rows.x {
        return;
    }
    var point = array<vec4f, IN4>();
    for (var k = 0u; k < IN4; k++) {
        point[k] = features[row * IN4 + k];
    }
    var trunk = array<vec4f, WIDTH4>();
    for (var j = 0u; j < WIDTH4; j++) {
        var sum = biases[j];
        for (var k = 0u; k < IN4; k++) {
            sum += blocks[j * IN4 + k] * point[k];
        }
        trunk[j] = max(sum, vec4f(0.0));
    }
    for (var head = 0u; head < HEADS; head++) {
        let first = WIDTH4 * IN4 + head * HEAD_BLOCKS;
        let bias = WIDTH4 + head * HEAD_BIASES;
        var out = biases[bias + WIDTH4];
        for (var j = 0u; j < WIDTH4; j++) {
            var sum = biases[bias + j];
            for (var k = 0u; k < WIDTH4; k++) {
                sum += blocks[first + j * WIDTH4 + k] * trunk[k];
            }
            out += blocks[first + WIDTH4 * WIDTH4 + j] * max(sum, vec4f(0.0));
        }
        for (var i = 0u; i < heads[head].outputs; i++) {
            deltas[row * 12u + heads[head].column + i] = out[i];
        }
    }
}
