// The lin-log intensity of an event camera's pixel; `p.lin_log` and `p.linear_light` are the caller's.

// Of display values (BT.601, as v2e and OpenCV), and of linear light (sRGB's primaries).
const LUMA = vec3f(0.299, 0.587, 0.114);
const LUMINANCE = vec3f(0.2126, 0.7152, 0.0722);

// The gradient of the lin-log intensity of a display colour, and the intensity itself.
fn lin_log(colour: vec3f) -> vec4f {
    var x = 255.0 * dot(LUMA, colour);
    var slope = 255.0 * LUMA;
    if (p.linear_light != 0u) {
        x = 255.0 * dot(LUMINANCE, vec3f(to_linear(colour.r), to_linear(colour.g), to_linear(colour.b)));
        slope = 255.0 * LUMINANCE * vec3f(d_to_linear(colour.r), d_to_linear(colour.g), d_to_linear(colour.b));
    }
    if (x <= p.lin_log) {
        let linear = log(p.lin_log) / p.lin_log;
        return vec4f(slope * linear, x * linear);
    }
    return vec4f(slope / x, log(x));
}
