// Projects each Gaussian into the image: position, inverse covariance, extent, opacity, colour.
// One thread a Gaussian.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> core: array<vec4f>;
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read> delta_core: array<vec4f>;
@group(0) @binding(4) var<storage, read> delta_sh: array<f32>;
@group(0) @binding(5) var<storage, read_write> splats: array<Splat>;

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = (group.y * groups.x + group.x) * THREADS + thread;
    if index >= view.counts.x {
        return;
    }
    var row0 = core[index * 3u];
    var row1 = core[index * 3u + 1u];
    var row2 = core[index * 3u + 2u];
    if index < view.counts.y {
        row0 += delta_core[index * 3u];
        row1 += delta_core[index * 3u + 1u];
        row2 += delta_core[index * 3u + 2u];
    }
    let p = project_gaussian(row0, row1, row2);
    let extent = extent_of(p);
    let nearest = clamp(p.mean, vec2f(0.5), vec2f(view.size.xy) - 0.5);
    let seen = p.valid && all(extent > vec2f(0.0)) && all(abs(nearest - p.mean) <= extent);
    if !seen {
        splats[index].shape.z = 0.0;
        return;
    }
    let colour = colour_of(index, normalize(row0.xyz - view.centre_near.xyz));
    if !is_finite(colour.x + colour.y + colour.z) {
        splats[index].shape.z = 0.0;
        return;
    }
    let a = p.conic.x;
    let b = p.conic.y;
    let c = p.conic.z;
    // With the 3 sigma square every pixel of a touched tile counts.
    var column = vec4f(0.0, 1e9, 0.0, 0.0);
    if view.switches.y == 0u {
        let through_mean = extent.y * sqrt(max(1.0 - b / a * (b / c), 0.0) + 1e-5);
        column = vec4f(1.0 / extent.x, through_mean, -b / c, 0.0);
    }
    splats[index] = Splat(
        vec4f(p.mean, -0.5 * LOG2_E * a, -LOG2_E * b),
        vec4f(-0.5 * LOG2_E * c, log2(p.opacity), extent),
        vec4f(max(colour, vec3f(0.0)), p.camera.z),
        column,
    );
}
