// Colour as seen from a direction: real spherical harmonics up to degree 3, with the signs of the 3DGS code.

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

// Coefficient k of Gaussian `index`, deformed. `sh`, `delta_sh` and `view` are the stage's bindings.
fn sh_coefficient(index: u32, k: u32) -> vec3f {
    let at = index * view.counts.w + 3u * k;
    var c = vec3f(sh[at], sh[at + 1u], sh[at + 2u]);
    if index < view.counts.y && view.switches.x != 0u {
        c += vec3f(delta_sh[at], delta_sh[at + 1u], delta_sh[at + 2u]);
    }
    return c;
}

// The colour of Gaussian `index` towards unit vector `d`, before it is clamped at 0.
fn colour_of(index: u32, d: vec3f) -> vec3f {
    let degree = view.counts.z;
    var colour = vec3f(0.5) + SH0 * sh_coefficient(index, 0u);
    if degree == 0u {
        return colour;
    }
    let x = d.x;
    let y = d.y;
    let z = d.z;
    colour += SH1 * (z * sh_coefficient(index, 2u) - y * sh_coefficient(index, 1u) - x * sh_coefficient(index, 3u));
    if degree == 1u {
        return colour;
    }
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    colour += SH2A * x * y * sh_coefficient(index, 4u);
    colour -= SH2A * y * z * sh_coefficient(index, 5u);
    colour += SH2B * (2.0 * zz - xx - yy) * sh_coefficient(index, 6u);
    colour -= SH2A * x * z * sh_coefficient(index, 7u);
    colour += SH2C * (xx - yy) * sh_coefficient(index, 8u);
    if degree == 2u {
        return colour;
    }
    colour -= SH3A * y * (3.0 * xx - yy) * sh_coefficient(index, 9u);
    colour += SH3B * x * y * z * sh_coefficient(index, 10u);
    colour -= SH3C * y * (4.0 * zz - xx - yy) * sh_coefficient(index, 11u);
    colour += SH3D * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * sh_coefficient(index, 12u);
    colour -= SH3C * x * (4.0 * zz - xx - yy) * sh_coefficient(index, 13u);
    colour += SH3E * z * (xx - yy) * sh_coefficient(index, 14u);
    colour -= SH3A * x * (xx - 3.0 * yy) * sh_coefficient(index, 15u);
    return colour;
}
