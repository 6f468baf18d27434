// The trajectory regulariser: |x' - r| summed over rows and axes, where r lies between two sets of position deltas, and
// its gradient sign(x' - r) times a scale. Each thread owns ROWS rows and leaves its sum.

const ROWS = 16u;

struct Trajectory {
    rows: u32,
    blend: f32,
    scale: f32,  // weight / (3 rows)
    padding: u32,
}

@group(0) @binding(0) var<uniform> trajectory: Trajectory;
@group(0) @binding(1) var<storage, read> positions: array<f32>;
@group(0) @binding(2) var<storage, read> before: array<f32>;
@group(0) @binding(3) var<storage, read> after: array<f32>;
@group(0) @binding(4) var<storage, read_write> d_core: array<f32>;
@group(0) @binding(5) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let owner = (group.y * groups.x + group.x) * 64u + thread;
    if owner * ROWS >= trajectory.rows {
        return;
    }
    var sum = 0.0;
    for (var row = owner * ROWS; row < min(owner * ROWS + ROWS, trajectory.rows); row++) {
        for (var axis = 0u; axis < 3u; axis++) {
            let i = row * 12u + axis;
            let reference = (1.0 - trajectory.blend) * before[i] + trajectory.blend * after[i];
            let off = positions[i] - reference;
            sum += abs(off);
            d_core[i] += trajectory.scale * sign(off);
        }
    }
    sums[owner] = sum;
}
