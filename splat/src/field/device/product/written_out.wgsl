// What `product.wgsl` does several times, written out, as graphics processors have it fast.

fn steps() -> u32 { return TILE_K; }

fn load_four_a(e: u32, first_m: u32, first_k: u32, end: u32) -> vec4f {
    return vec4f(
        load_a(e, first_m, first_k, end),
        load_a(e + THREADS, first_m, first_k, end),
        load_a(e + 2u * THREADS, first_m, first_k, end),
        load_a(e + 3u * THREADS, first_m, first_k, end),
    );
}

// As many as B_LOADS says, and zeros.
fn load_four_b(e: u32, first_n: u32, first_k: u32, end: u32) -> vec4f {
    var four = vec4f(load_b(e, first_n, first_k, end), 0.0, 0.0, 0.0);
    if B_LOADS > 1u {
        four.y = load_b(e + THREADS, first_n, first_k, end);
    }
    if B_LOADS > 2u {
        four.z = load_b(e + 2u * THREADS, first_n, first_k, end);
        four.w = load_b(e + 3u * THREADS, first_n, first_k, end);
    }
    return four;
}

fn keep_four_a(e: u32, four: vec4f) {
    keep_a(e, four.x);
    keep_a(e + THREADS, four.y);
    keep_a(e + 2u * THREADS, four.z);
    keep_a(e + 3u * THREADS, four.w);
}

fn keep_four_b(e: u32, four: vec4f) {
    keep_b(e, four.x);
    if B_LOADS > 1u {
        keep_b(e + THREADS, four.y);
    }
    if B_LOADS > 2u {
        keep_b(e + 2u * THREADS, four.z);
        keep_b(e + 3u * THREADS, four.w);
    }
}

fn store_row(row: vec4f, m: u32, n: u32, slab: u32) {
    store(row.x, m, n, slab);
    store(row.y, m, n + 1u, slab);
    store(row.z, m, n + 2u, slab);
    store(row.w, m, n + 3u, slab);
}

fn store_block(block: mat4x4f, m: u32, n: u32, slab: u32) {
    store_row(block[0], m, n, slab);
    store_row(block[1], m + 1u, n, slab);
    store_row(block[2], m + 2u, n, slab);
    store_row(block[3], m + 3u, n, slab);
}
