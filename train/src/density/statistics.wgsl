// Adds what the renders of one iteration saw of every Gaussian to what was seen since the last densification.

// How many, and whether those without a gradient were not looked at.
@group(0) @binding(0) var<uniform> rows: vec4u;
// Sum of the screen-space gradient (NDC units), largest radius (pixels), number of renders.
@group(0) @binding(1) var<storage, read> screen: array<vec4f>;
// Sum of gradient norms, iterations seen, largest radius, unused.
@group(0) @binding(2) var<storage, read_write> seen: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let row = (group.y * groups.x + group.x) * 64u + lane;
    if (row >= rows.x) { return; }
    let now = screen[row];
    if (now.w > 0.0 && (rows.y == 0u || any(now.xy != vec2f(0.0)))) {
        let before = seen[row];
        seen[row] = vec4f(before.x + length(now.xy), before.y + 1.0, max(before.z, now.z), 0.0);
    }
}
