// One regulariser of one plane: the mean square of a difference along an axis, or the mean distance from 1, with its
// gradient. Each thread owns eight values of the gradient, so that nothing is added twice; each workgroup leaves its
// share of the loss.

const EACH = 8u;

struct Regular {
    offset: u32,
    length: u32,
    step: u32,       // floats between neighbours along the axis
    cells: u32,      // cells along the axis
    taps: vec4f,     // x, y, z: the difference; all 0 for the distance from 1
    reach: u32,      // taps - 1
    scale: f32,      // of the gradient
    first_sum: u32,
    padding: u32,
}

@group(0) @binding(0) var<uniform> regular: Regular;
@group(0) @binding(1) var<storage, read> parameters: array<f32>;
@group(0) @binding(2) var<storage, read_write> gradients: array<f32>;
@group(0) @binding(3) var<storage, read_write> sums: array<f32>;

var<workgroup> shares: array<f32, 256>;

// The difference whose first tap is value `i` of the plane.
fn difference(i: u32) -> f32 {
    let at = regular.offset + i;
    var value = regular.taps.x * parameters[at] + regular.taps.y * parameters[at + regular.step];
    if regular.reach == 2u {
        value += regular.taps.z * parameters[at + 2u * regular.step];
    }
    return value;
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group.y * groups.x + group.x;
    var share = 0.0;
    for (var round = 0u; round < EACH; round++) {
        let i = (number * EACH + round) * 256u + thread;
        if i >= regular.length {
            continue;
        }
        var d = 0.0;
        if regular.reach == 0u {
            let off = parameters[regular.offset + i] - 1.0;
            share += abs(off);
            d = sign(off);
        } else {
            let position = i / regular.step % regular.cells;
            for (var tap = 0u; tap <= regular.reach; tap++) {
                if position >= tap && position - tap + regular.reach < regular.cells {
                    let value = difference(i - tap * regular.step);
                    d += regular.taps[tap] * value;
                    if tap == 0u {
                        share += value * value;
                    }
                }
            }
        }
        gradients[regular.offset + i] += regular.scale * d;
    }
    shares[thread] = share;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if thread < half {
            shares[thread] += shares[thread + half];
        }
        workgroupBarrier();
    }
    if thread == 0u && number * EACH * 256u < regular.length {
        sums[regular.first_sum + number] = shares[0];
    }
}
