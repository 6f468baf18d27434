// Colour as seen from a direction, by the harmonics.

// Coefficient k of Gaussian `index`, deformed. `sh`, `delta_sh` and `view` are the stage's bindings.
fn sh_coefficient(index: u32, k: u32) -> vec3f {
    let at = index * view.counts.w + 3u * k;
    var c = vec3f(sh[at], sh[at + 1u], sh[at + 2u]);
    if index < view.counts.y && view.switches.x != 0u {
        c += vec3f(delta_sh[at], delta_sh[at + 1u], delta_sh[at + 2u]);
    }
    return c;
}

// How many harmonics the view's degree has.
fn harmonics_count() -> u32 {
    return (view.counts.z + 1u) * (view.counts.z + 1u);
}

// The colour of Gaussian `index` towards unit vector `d`, before it is clamped at 0.
fn colour_of(index: u32, d: vec3f) -> vec3f {
    var harmonics = harmonics_at(d);
    var colour = vec3f(0.5);
    for (var k = 0u; k < harmonics_count(); k++) {
        colour += harmonics[k].w * sh_coefficient(index, k);
    }
    return colour;
}
