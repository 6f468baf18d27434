// From the number of intersections to the plan of their sort (GPU shape). One thread.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> counted: Plan;
@group(0) @binding(2) var<storage, read_write> plan: Plan;

fn groups_of(count: u32) -> vec4u {
    if count > 65535u {
        return vec4u(32768u, (count + 32767u) / 32768u, 1u, 0u);
    }
    return vec4u(count, 1u, 1u, 0u);
}

@compute @workgroup_size(1)
fn main() {
    plan.count = min(counted.total, view.switches.w);
    plan.blocks = (plan.count + BLOCK - 1u) / BLOCK;
    plan.scanned = DIGITS * plan.blocks;
    plan.scan_blocks = (plan.scanned + BLOCK - 1u) / BLOCK;
    plan.block_groups = groups_of(plan.blocks);
    plan.scan_groups = groups_of(plan.scan_blocks);
}
