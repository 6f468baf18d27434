// From the gradient of each splat to the gradient of its Gaussian's parameters. One thread a Gaussian that touches a
// tile; the gradients of the deltas have been cleared.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> core: array<vec4f>;
@group(0) @binding(2) var<storage, read> sh: array<f32>;
@group(0) @binding(3) var<storage, read> delta_core: array<vec4f>;
@group(0) @binding(4) var<storage, read> delta_sh: array<f32>;
// Ten a row: see `gather.wgsl`. Where POSE is asked for, six of them become what the Gaussian says of the camera's pose.
@group(0) @binding(5) var<storage, read_write> d_splats: array<u32>;
@group(0) @binding(6) var<storage, read_write> d_core: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> d_sh: array<f32>;
@group(0) @binding(8) var<storage, read_write> d_delta_core: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> d_delta_sh: array<f32>;
@group(0) @binding(10) var<storage, read_write> screen: array<vec4f>;

// Whether the gradient of the deltas is wanted, and that of their SH.
fn wants_delta(index: u32) -> bool {
    return index < view.counts.y && view.outputs.x != 0u;
}

fn wants_delta_sh(index: u32) -> bool {
    return index < view.counts.y && view.outputs.y != 0u;
}

// The gradient of the view's direction; adds the gradient of the coefficients on the way.
fn harmonics_backward(index: u32, direction: vec3f, d_colour: vec3f) -> vec3f {
    var harmonics = harmonics_at(direction);
    var g = vec3f(0.0);
    for (var k = 0u; k < harmonics_count(); k++) {
        let at = index * view.counts.w + 3u * k;
        let harmonic = harmonics[k];
        let d = harmonic.w * d_colour;
        d_sh[at] += d.x;
        d_sh[at + 1u] += d.y;
        d_sh[at + 2u] += d.z;
        if wants_delta_sh(index) {
            d_delta_sh[at] = d.x;
            d_delta_sh[at + 1u] = d.y;
            d_delta_sh[at + 2u] = d.z;
        }
        g += dot(sh_coefficient(index, k), d_colour) * harmonic.xyz;
    }
    return g;
}

// The gradient of the unit quaternion, from that of the columns of its rotation.
fn rotation_backward(q: vec4f, d0: vec3f, d1: vec3f, d2: vec3f) -> vec4f {
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    return 2.0 * vec4f(
        z * (d0.y - d1.x) + y * (d2.x - d0.z) + x * (d1.z - d2.y),
        y * (d1.x + d0.y) + z * (d2.x + d0.z) + w * (d1.z - d2.y) - 2.0 * x * (d1.y + d2.z),
        x * (d1.x + d0.y) + z * (d2.y + d1.z) + w * (d2.x - d0.z) - 2.0 * y * (d0.x + d2.z),
        x * (d2.x + d0.z) + y * (d2.y + d1.z) + w * (d0.y - d1.x) - 2.0 * z * (d0.x + d1.y),
    );
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = (group.y * groups.x + group.x) * THREADS + thread;
    if row >= view.outputs.z {
        return;
    }
    let at = 10u * row;
    let index = d_splats[at + 9u];
    let moves = index < view.counts.y;
    if index == NOBODY || !(moves || (view.switches.z & STILL_LEARN) != 0u) {
        d_splats[at + 9u] = NOBODY;
        return;
    }
    var row0 = core[index * 3u];
    var row1 = core[index * 3u + 1u];
    var row2 = core[index * 3u + 2u];
    if moves {
        row0 += delta_core[index * 3u];
        row1 += delta_core[index * 3u + 1u];
        row2 += delta_core[index * 3u + 2u];
    }
    let p = project_gaussian(row0, row1, row2);

    // Colour.
    let offset = row0.xyz - view.centre_near.xyz;
    let inverse_distance = inverseSqrt(dot(offset, offset));
    let direction = offset * inverse_distance;
    let d_colour = vec3f(bitcast<f32>(d_splats[at + 6u]), bitcast<f32>(d_splats[at + 7u]), bitcast<f32>(d_splats[at + 8u]));
    let d_direction = harmonics_backward(index, direction, d_colour);
    var d_mean = inverse_distance * (d_direction - direction * dot(direction, d_direction));

    // Power = -1/2 (a dx^2 + 2 b dx dy + c dy^2), (dx, dy) = pixel - mean.
    let v = bitcast<f32>(d_splats[at]);
    let v_d = vec2f(bitcast<f32>(d_splats[at + 1u]), bitcast<f32>(d_splats[at + 2u]));
    let a = p.conic.x;
    let b = p.conic.y;
    let c = p.conic.z;
    let d_pixel = vec2f(a * v_d.x + b * v_d.y, b * v_d.x + c * v_d.y);
    let conic = mat2x2f(a, b, b, c);
    let half_xy = -0.5 * bitcast<f32>(d_splats[at + 4u]);
    let d_conic = mat2x2f(-0.5 * bitcast<f32>(d_splats[at + 3u]), half_xy, half_xy, -0.5 * bitcast<f32>(d_splats[at + 5u]));
    let d_covariance = conic * d_conic * conic;
    let xx = -d_covariance[0][0];
    let xy = -0.5 * (d_covariance[0][1] + d_covariance[1][0]);
    let yy = -d_covariance[1][1];

    // covariance = root root^T, root = jacobian rotation scale.
    let d_root_x = 2.0 * (xx * p.root_x + xy * p.root_y);
    let d_root_y = 2.0 * (xy * p.root_x + yy * p.root_y);
    var d_log_scale = d_root_x * p.root_x + d_root_y * p.root_y;
    d_log_scale = select(d_log_scale, vec3f(0.0), vec3f(row0.w, row1.xy) > vec3f(LARGEST_LOG_SCALE));
    let scaled_x = d_root_x * p.scale;
    let scaled_y = d_root_y * p.scale;
    let d_jacobian_x = p.rotation * scaled_x;
    let d_jacobian_y = p.rotation * scaled_y;
    let d_unit = rotation_backward(
        p.quaternion,
        scaled_x.x * p.jacobian_x + scaled_y.x * p.jacobian_y,
        scaled_x.y * p.jacobian_x + scaled_y.y * p.jacobian_y,
        scaled_x.z * p.jacobian_x + scaled_y.z * p.jacobian_y,
    );
    let d_quaternion = p.inverse_length * (d_unit - p.quaternion * dot(p.quaternion, d_unit));

    // jacobian_x = fx/z (w0 - slope.x w2), mean = f slope + c; likewise y.
    let inverse_z = 1.0 / p.camera.z;
    let focal = view.pinhole.xy * inverse_z;
    let w2 = view.world_to_camera[2].xyz;
    let d_slope = -focal * vec2f(dot(w2, d_jacobian_x), dot(w2, d_jacobian_y));
    let d_free_slope = select(d_slope, vec2f(0.0), p.bounded);
    let d_camera_xy = d_free_slope * inverse_z + focal * d_pixel;
    let along = dot(p.jacobian_x, d_jacobian_x) + dot(p.jacobian_y, d_jacobian_y);
    let d_camera_z = -inverse_z * (along + dot(p.camera.xy, d_camera_xy));
    let w0 = view.world_to_camera[0].xyz;
    let w1 = view.world_to_camera[1].xyz;
    if (view.switches.z & POSE) != 0u {
        // A camera that turns by w and moves by t: world_to_camera becomes exp(w) world_to_camera + t, the centre moves by -W^T t.
        let d_camera = vec3f(d_camera_xy, d_camera_z);
        let d_shift = d_camera + vec3f(dot(w0, d_mean), dot(w1, d_mean), dot(w2, d_mean));
        let a = focal.x * vec3f(dot(w0, d_jacobian_x), dot(w1, d_jacobian_x), dot(w2, d_jacobian_x));
        let b = focal.y * vec3f(dot(w0, d_jacobian_y), dot(w1, d_jacobian_y), dot(w2, d_jacobian_y));
        let back = -p.slope.x * a - p.slope.y * b;
        let d_turn = cross(p.camera, d_camera) + vec3f(back.y - b.z, a.z - back.x, b.x - a.y);
        d_splats[at] = bitcast<u32>(d_turn.x);
        d_splats[at + 1u] = bitcast<u32>(d_turn.y);
        d_splats[at + 2u] = bitcast<u32>(d_turn.z);
        d_splats[at + 3u] = bitcast<u32>(d_shift.x);
        d_splats[at + 4u] = bitcast<u32>(d_shift.y);
        d_splats[at + 5u] = bitcast<u32>(d_shift.z);
    }
    d_mean += w0 * d_camera_xy.x + w1 * d_camera_xy.y + w2 * d_camera_z;

    let d_logit = v * (1.0 - p.opacity);
    let d0 = vec4f(d_mean, d_log_scale.x);
    let d1 = vec4f(d_log_scale.yz, d_quaternion.xy);
    let d2 = vec4f(d_quaternion.zw, d_logit, 0.0);
    d_core[3u * index] += d0;
    d_core[3u * index + 1u] += d1;
    d_core[3u * index + 2u] += d2;
    if wants_delta(index) {
        d_delta_core[3u * index] = d0;
        d_delta_core[3u * index + 1u] = d1;
        d_delta_core[3u * index + 2u] = d2;
    }
    if (view.switches.z & STATISTICS) != 0u {
        let before = screen[index];
        let moved = 0.5 * vec2f(view.size.xy) * d_pixel;
        screen[index] = vec4f(before.xy + moved, max(before.z, ceil(radius_of(p.covariance))), before.w + 1.0);
    }
}
