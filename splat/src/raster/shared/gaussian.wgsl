// Activation of a Gaussian's parameters and its projection (EWA splatting, Zwicker et al. 2001).

const LARGEST_LOG_SCALE = 20.0;
const LEAST_SQUARED_QUATERNION = 1e-12;

struct Projection {
    // Whether everything below is finite and in front of the near plane.
    valid: bool,
    camera: vec3f,
    // x/z and y/z, bounded; whether the bound was met.
    slope: vec2f,
    bounded: vec2<bool>,
    quaternion: vec4f,
    inverse_length: f32,
    scale: vec3f,
    rotation: mat3x3f,
    // Rows of the Jacobian of the pixel position with respect to the world position.
    jacobian_x: vec3f,
    jacobian_y: vec3f,
    // Rows of the square root of the covariance: covariance = root root^T.
    root_x: vec3f,
    root_y: vec3f,
    mean: vec2f,
    // xx, xy, yy, with the low pass.
    covariance: vec3f,
    // a, b, c.
    conic: vec3f,
    opacity: f32,
}

// `q`: unit quaternion (w, x, y, z). Columns of the result are the axes of the Gaussian in the world.
fn rotation_of(q: vec4f) -> mat3x3f {
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    return mat3x3f(
        vec3f(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        vec3f(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        vec3f(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    );
}

// Rows of `core`: mean, log-scale, quaternion, opacity logit, in three vec4f.
fn project_gaussian(row0: vec4f, row1: vec4f, row2: vec4f) -> Projection {
    var p: Projection;
    let mean = row0.xyz;
    let w0 = view.world_to_camera[0];
    let w1 = view.world_to_camera[1];
    let w2 = view.world_to_camera[2];
    p.camera = vec3f(dot(w0.xyz, mean) + w0.w, dot(w1.xyz, mean) + w1.w, dot(w2.xyz, mean) + w2.w);
    let log_scale = vec3f(row0.w, row1.xy);
    p.scale = exp(min(log_scale, vec3f(LARGEST_LOG_SCALE)));
    let raw = vec4f(row1.zw, row2.xy);
    let squared = dot(raw, raw);
    p.inverse_length = inverseSqrt(max(squared, LEAST_SQUARED_QUATERNION));
    p.quaternion = raw * p.inverse_length;
    p.rotation = rotation_of(p.quaternion);
    p.opacity = 1.0 / (1.0 + exp(-row2.z));

    let z = p.camera.z;
    // A Gaussian that reaches the camera would be a veil over the whole image; see RenderOptions::near_sigmas.
    let reach = view.background.w * length((w2.xyz * p.rotation) * p.scale);
    let in_front = z > view.centre_near.w && z > reach;
    let inverse_z = 1.0 / select(1.0, z, in_front);
    let slope = p.camera.xy * inverse_z;
    let lower = view.slope_bounds.xz;
    let upper = view.slope_bounds.yw;
    p.slope = clamp(slope, lower, upper);
    p.bounded = (slope < lower) | (slope > upper);
    p.mean = view.pinhole.xy * slope + view.pinhole.zw;
    p.jacobian_x = view.pinhole.x * inverse_z * (w0.xyz - p.slope.x * w2.xyz);
    p.jacobian_y = view.pinhole.y * inverse_z * (w1.xyz - p.slope.y * w2.xyz);
    p.root_x = (p.jacobian_x * p.rotation) * p.scale;
    p.root_y = (p.jacobian_y * p.rotation) * p.scale;
    let xx = dot(p.root_x, p.root_x);
    let yy = dot(p.root_y, p.root_y);
    let xy = dot(p.root_x, p.root_y);
    let low_pass = bitcast<f32>(view.outputs.w);
    p.covariance = vec3f(xx + low_pass, xy, yy + low_pass);
    // The determinant by the Cauchy-Binet formula: a sum of squares, exact where xx yy - xy xy would cancel.
    let minors = cross(p.root_x, p.root_y);
    let determinant = dot(minors, minors) + low_pass * (xx + yy) + low_pass * low_pass;
    p.conic = vec3f(p.covariance.z, -xy, p.covariance.x) / determinant;
    let sum = p.mean.x + p.mean.y + p.conic.x + p.conic.y + p.conic.z + p.opacity + dot(p.scale, vec3f(1.0));
    p.valid = in_front && is_finite(sum) && is_finite(determinant) && squared >= LEAST_SQUARED_QUATERNION;
    return p;
}

// Half width and half height of what the splat covers, pixels; not positive where that is nothing.
fn extent_of(p: Projection) -> vec2f {
    if view.switches.y != 0u {
        return vec2f(ceil(radius_of(p.covariance)));
    }
    let squared = squared_reach(log2(p.opacity));
    if p.opacity < view.thresholds.x || !(squared > 0.0) {
        return vec2f(0.0);
    }
    return sqrt(squared * p.covariance.xz);
}

// 3 sigma along the longest axis, pixels.
fn radius_of(covariance: vec3f) -> f32 {
    let middle = 0.5 * (covariance.x + covariance.z);
    let half_difference = 0.5 * (covariance.x - covariance.z);
    return 3.0 * sqrt(middle + length(vec2f(half_difference, covariance.y)));
}
