// Blends the two rows of every time plane between which the time falls into one line.

struct Time {
    row: u32,
    weight: f32,  // of the next row
    groups: u32,  // of all lines
    padding: u32,
}

@group(0) @binding(0) var<uniform> time: Time;
@group(0) @binding(1) var<storage, read> levels: array<Level>;
@group(0) @binding(2) var<storage, read> parameters: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> lines: array<vec4f>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= time.groups {
        return;
    }
    for (var level = 0u; level < LEVELS; level++) {
        for (var axis = 0u; axis < 3u; axis++) {
            let length = levels[level].cells[axis] * F4;
            let start = levels[level].lines[axis];
            if id.x >= start && id.x < start + length {
                let low = levels[level].times[axis] + time.row * length + id.x - start;
                lines[id.x] = mix(parameters[low], parameters[low + length], time.weight);
            }
        }
    }
}
