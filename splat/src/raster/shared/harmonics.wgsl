// Real spherical harmonics up to degree 3, with the signs of the 3DGS code.

const SH0 = 0.28209479177387814;
const SH1 = 0.4886025119029199;
const SH2A = 1.0925484305920792;
const SH2B = 0.31539156525252005;
const SH2C = 0.5462742152960396;
const SH3A = 0.5900435899266435;
const SH3B = 2.890611442640554;
const SH3C = 0.4570457994644658;
const SH3D = 0.3731763325901154;
const SH3E = 1.445305721320277;

// The harmonics at unit vector `d`: the gradient of each, and its value. Loops over them keep kernels small, which a driver compiles
// at their first use: written out, the sixteen terms took a processor nine seconds.
fn harmonics_at(d: vec3f) -> array<vec4f, 16> {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    let far = 4.0 * zz - xx - yy;
    return array<vec4f, 16>(
        vec4f(0.0, 0.0, 0.0, SH0),
        -SH1 * vec4f(0.0, 1.0, 0.0, y),
        SH1 * vec4f(0.0, 0.0, 1.0, z),
        -SH1 * vec4f(1.0, 0.0, 0.0, x),
        SH2A * vec4f(y, x, 0.0, x * y),
        -SH2A * vec4f(0.0, z, y, y * z),
        SH2B * vec4f(-2.0 * x, -2.0 * y, 4.0 * z, 2.0 * zz - xx - yy),
        -SH2A * vec4f(z, 0.0, x, x * z),
        SH2C * vec4f(2.0 * x, -2.0 * y, 0.0, xx - yy),
        -SH3A * vec4f(6.0 * x * y, 3.0 * (xx - yy), 0.0, y * (3.0 * xx - yy)),
        SH3B * vec4f(y * z, x * z, x * y, x * y * z),
        -SH3C * vec4f(-2.0 * x * y, far - 2.0 * yy, 8.0 * y * z, y * far),
        SH3D * vec4f(-6.0 * x * z, -6.0 * y * z, 6.0 * zz - 3.0 * xx - 3.0 * yy, z * (2.0 * zz - 3.0 * xx - 3.0 * yy)),
        -SH3C * vec4f(far - 2.0 * xx, -2.0 * x * y, 8.0 * x * z, x * far),
        SH3E * vec4f(2.0 * x * z, -2.0 * y * z, xx - yy, z * (xx - yy)),
        -SH3A * vec4f(3.0 * (xx - yy), -6.0 * x * y, 0.0, x * (xx - 3.0 * yy)),
    );
}
