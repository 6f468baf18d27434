// The sRGB transfer function and its derivative. Below zero it is continued as a straight line; the slopes stay finite.

fn to_linear(x: f32) -> f32 {
    return select(pow((x + 0.055) / 1.055, 2.4), x / 12.92, x <= 0.04045);
}

fn d_to_linear(x: f32) -> f32 {
    return select(2.4 / 1.055 * pow((x + 0.055) / 1.055, 1.4), 1.0 / 12.92, x <= 0.04045);
}

fn to_display(x: f32) -> f32 {
    return select(1.055 * pow(max(x, 0.0031308), 1.0 / 2.4) - 0.055, x * 12.92, x <= 0.0031308);
}

fn d_to_display(x: f32) -> f32 {
    return select(1.055 / 2.4 * pow(max(x, 0.0031308), 1.0 / 2.4 - 1.0), 12.92, x <= 0.0031308);
}
