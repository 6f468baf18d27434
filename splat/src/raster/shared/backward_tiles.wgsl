// What the backward blending of a tile begins with, in both forms of the GPU shape: what is bound, a thread a pixel.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> entries: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read> lists: array<vec4u>;
@group(0) @binding(5) var<storage, read> image: array<vec4f>;
@group(0) @binding(6) var<storage, read> stops: array<u32>;
@group(0) @binding(7) var<storage, read> d_image: array<vec4f>;
// Nine an entry: see `Sums` in `blend_backward_cpu.wgsl`.
@group(0) @binding(8) var<storage, read_write> sums: array<f32>;

const PIXELS = 256u;
const SUMS = 9u;

// A pixel before its list is walked: transmittance in front of all entries; what lies behind them, weighted by dL/d image; dL/d colour;
// the entry at which it had become opaque.
struct Pixel {
    transmittance: f32,
    behind: f32,
    d_colour: vec3f,
    stop: u32,
}

// The pixel at `at` of the image; outside of it, one whose list of entries from `first` on is over.
fn pixel_of(at: vec2u, first: u32) -> Pixel {
    if at.x >= view.size.x || at.y >= view.size.y {
        return Pixel(1.0, 0.0, vec3f(0.0), first);
    }
    let index = at.y * view.size.x + at.x;
    let d = d_image[index];
    return Pixel(image[index].w, dot(d.rgb, view.background.rgb) + d.w, d.rgb, stops[index]);
}

// The sums of the entries from `first` to `end` that no pixel had come to, by all threads of the tile.
fn clear_sums(first: u32, end: u32, thread: u32) {
    for (var entry = first + thread; entry < end; entry += PIXELS) {
        let at = SUMS * entries[entry];
        for (var i = 0u; i < SUMS; i++) {
            sums[at + i] = 0.0;
        }
    }
}
