// Finds where the list of each tile begins and ends among the sorted pairs (GPU shape). Eight pairs a thread; lists of
// tiles that nothing touches have been cleared.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> plan: Plan;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> lists: array<vec4u>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = group.y * groups.x + group.x;
    for (var i = 0u; i < PER_THREAD; i++) {
        let at = block * BLOCK + i * THREADS + thread;
        if at >= plan.count {
            return;
        }
        let tile = keys[at];
        if tile >= view.size.z * view.size.w {
            return;
        }
        if at == 0u || keys[max(at, 1u) - 1u] != tile {
            lists[tile].y = at;
        }
        if at + 1u == plan.count || keys[min(at + 1u, plan.count - 1u)] != tile {
            lists[tile].z = at + 1u;
        }
    }
}
