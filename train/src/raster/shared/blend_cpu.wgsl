// What both blending passes of the CPU shape share. One thread owns a tile of 4 x 4 pixels and walks its list alone:
// no barriers, no sums across threads. Pixels are kept by rows of four.

const TILE = 4u;

// The exponent of a splat in base 2 is a dx^2 + b dx dy + c dy^2 at distance (dx, dy) of its mean.
struct Bell {
    mean: vec2f,
    a: f32,
    b: f32,
    c: f32,
    opacity: f32,
    colour: vec3f,
}

fn bell_of(splat: Splat) -> Bell {
    const LOG2_E = 1.4426950408889634;
    return Bell(
        splat.mean_conic.xy,
        -0.5 * LOG2_E * splat.mean_conic.z,
        -LOG2_E * splat.mean_conic.w,
        -0.5 * LOG2_E * splat.shape.x,
        splat.shape.y,
        splat.colour_depth.xyz,
    );
}

// exp(power) at four pixels of a row. Rounding can lift the power of a needle above 0, hence the bound.
fn falloff(bell: Bell, dx: vec4f, dy: f32) -> vec4f {
    return exp2(min(dx * (bell.a * dx + bell.b * dy) + bell.c * dy * dy, vec4f(0.0)));
}
