// What `product.wgsl` does several times, in loops whose bound no compiler knows, `product.b.w`, which is 4: written out, a kernel takes a
// driver that runs it on a processor seconds to compile.

fn steps() -> u32 { return TILE_K / 4u * product.b.w; }

fn load_four_a(e: u32, first_m: u32, first_k: u32, end: u32) -> vec4f {
    var four = vec4f();
    for (var i = 0u; i < product.b.w; i++) {
        four[i] = load_a(e + i * THREADS, first_m, first_k, end);
    }
    return four;
}

// As many as B_LOADS says, and zeros.
fn load_four_b(e: u32, first_n: u32, first_k: u32, end: u32) -> vec4f {
    var four = vec4f();
    for (var i = 0u; i < min(product.b.w, B_LOADS); i++) {
        four[i] = load_b(e + i * THREADS, first_n, first_k, end);
    }
    return four;
}

fn keep_four_a(e: u32, values: vec4f) {
    var four = values;
    for (var i = 0u; i < product.b.w; i++) {
        keep_a(e + i * THREADS, four[i]);
    }
}

fn keep_four_b(e: u32, values: vec4f) {
    var four = values;
    for (var i = 0u; i < min(product.b.w, B_LOADS); i++) {
        keep_b(e + i * THREADS, four[i]);
    }
}

fn store_block(values: mat4x4f, m: u32, n: u32, slab: u32) {
    var block = values;
    for (var i = 0u; i < 4u * product.b.w; i++) {
        store(block[i / 4u][i % 4u], m + i / 4u, n + i % 4u, slab);
    }
}
