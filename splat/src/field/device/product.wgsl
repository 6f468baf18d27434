// A matrix product, tile by tile through shared memory: C = A B, where A is m x k and B is k x n, each anywhere in its
// buffer with any strides. A workgroup makes a tile of TILE_M x TILE_N; a thread makes DOWN x ACROSS blocks of 4 x 4 of it,
// which it holds in registers, and loads its share of the next step along k while it works on this one.
// The sum over k can be cut into slabs that are summed later. Every sum has a fixed order.
//
// Constants put before this text: TILE_M, TILE_N, DOWN, ACROSS and THREADS (TILE_M * TILE_N = 16 * DOWN * ACROSS * THREADS);
// A_ALONG_K and B_ALONG_N, whether neighbours along k or n are neighbours in memory (they only steer which thread loads
// what); BIAS; COLUMNS, whether the sums of B's columns are stored behind each slab. Behind it comes what is done several times: see
// `product/written_out.wgsl` and `product/looped.wgsl`.

const TILE_K = 8u;
// Values of A and B that a thread loads in a step along k: 4 or 8, and 1, 2 or 4.
const A_LOADS = TILE_M * TILE_K / THREADS;
const B_LOADS = TILE_N * TILE_K / THREADS;
// Groups of four along m and n, and threads along them.
const GROUPS_M = TILE_M / 4u;
const GROUPS_N = TILE_N / 4u;
const THREADS_M = GROUPS_M / DOWN;
const THREADS_N = GROUPS_N / ACROSS;

struct Product {
    m: u32,
    n: u32,
    k: u32,
    slab: u32,   // values of k a slab
    a: vec4u,    // offset, stride along m, stride along k; 1 where the product is cut off at zero, 2 where there is a mask
    b: vec4u,    // offset, stride along k, stride along n; 4
    c: vec4u,    // offset, stride along m, stride along n, stride from slab to slab
    more: vec4u, // offset of the bias in B's buffer; offset and stride along m of the mask; offset of the sums of columns in a slab
}

@group(0) @binding(0) var<uniform> product: Product;
@group(0) @binding(1) var<storage, read> a_values: array<f32>;
@group(0) @binding(2) var<storage, read> b_values: array<f32>;
@group(0) @binding(3) var<storage, read_write> c_values: array<f32>;
// Anything where there is none.
@group(0) @binding(4) var<storage, read> mask: array<f32>;

// Groups of four along m and n, [k, group]. Those of a step k lie where `group ^ k` says, so that threads that load
// neighbours along k write to different banks.
var<workgroup> a_tile: array<vec4f, GROUPS_M * TILE_K>;
var<workgroup> b_tile: array<vec4f, GROUPS_N * TILE_K>;

fn a_place(k: u32, group: u32) -> u32 { return k * GROUPS_M + (group ^ (k & (GROUPS_M - 1u))); }
fn b_place(k: u32, group: u32) -> u32 { return k * GROUPS_N + (group ^ (k & (GROUPS_N - 1u))); }

// Where value `e` of a tile lies in it: along k, and along m or n.
fn a_within(e: u32) -> vec2u {
    return select(vec2u(e / TILE_M, e % TILE_M), vec2u(e % TILE_K, e / TILE_K), A_ALONG_K);
}
fn b_within(e: u32) -> vec2u {
    return select(vec2u(e % TILE_K, e / TILE_K), vec2u(e / TILE_N, e % TILE_N), B_ALONG_N);
}

fn load_a(e: u32, first_m: u32, first_k: u32, end: u32) -> f32 {
    let at = vec2u(first_k, first_m) + a_within(e);
    if at.x >= end || at.y >= product.m {
        return 0.0;
    }
    return a_values[product.a.x + at.y * product.a.y + at.x * product.a.z];
}

fn load_b(e: u32, first_n: u32, first_k: u32, end: u32) -> f32 {
    let at = vec2u(first_k, first_n) + b_within(e);
    if at.x >= end || at.y >= product.n {
        return 0.0;
    }
    return b_values[product.b.x + at.x * product.b.y + at.y * product.b.z];
}

fn keep_a(e: u32, value: f32) {
    let at = a_within(e);
    a_tile[a_place(at.x, at.y / 4u)][at.y % 4u] = value;
}

fn keep_b(e: u32, value: f32) {
    let at = b_within(e);
    b_tile[b_place(at.x, at.y / 4u)][at.y % 4u] = value;
}

// Rows of four of a column times a row.
fn outer(a: vec4f, b: vec4f) -> mat4x4f {
    return mat4x4f(a.x * b, a.y * b, a.z * b, a.w * b);
}

fn store(sum: f32, m: u32, n: u32, slab: u32) {
    if m >= product.m || n >= product.n {
        return;
    }
    var value = sum;
    if BIAS {
        value += b_values[product.more.x + n];
    }
    if (product.a.w & 1u) != 0u {
        value = max(value, 0.0);
    }
    if (product.a.w & 2u) != 0u && mask[product.more.y + m * product.more.z + n] == 0.0 {
        value = 0.0;
    }
    c_values[product.c.x + slab * product.c.w + m * product.c.y + n * product.c.z] = value;
}

@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let tiles_m = (product.m + TILE_M - 1u) / TILE_M;
    let tiles_n = (product.n + TILE_N - 1u) / TILE_N;
    let number = group.y * groups.x + group.x;
    let first_n = number % tiles_n * TILE_N;
    let first_m = number / tiles_n % tiles_m * TILE_M;
    let slab = number / (tiles_n * tiles_m);
    let end = min(product.k, (slab + 1u) * product.slab);
    let across = thread % THREADS_N;
    let down = thread / THREADS_N;

    // Blocks [down][across] of 4 x 4.
    var block_00 = mat4x4f();
    var block_01 = mat4x4f();
    var block_10 = mat4x4f();
    var block_11 = mat4x4f();
    // A thread loads of one column of B alone, as THREADS is a multiple of TILE_N.
    var column = 0.0;

    let begin = slab * product.slab;
    var next_a = load_four_a(thread, first_m, begin, end);
    var more_a = vec4f();
    if A_LOADS > 4u {
        more_a = load_four_a(thread + 4u * THREADS, first_m, begin, end);
    }
    var next_b = load_four_b(thread, first_n, begin, end);
    for (var next_k = begin + TILE_K; next_k < end + TILE_K; next_k += TILE_K) {
        keep_four_a(thread, next_a);
        if A_LOADS > 4u {
            keep_four_a(thread + 4u * THREADS, more_a);
        }
        keep_four_b(thread, next_b);
        if COLUMNS {
            column += dot(next_b, vec4f(1.0));
        }
        workgroupBarrier();
        next_a = load_four_a(thread, first_m, next_k, end);
        if A_LOADS > 4u {
            more_a = load_four_a(thread + 4u * THREADS, first_m, next_k, end);
        }
        next_b = load_four_b(thread, first_n, next_k, end);
        for (var k = 0u; k < steps(); k++) {
            let a_0 = a_tile[a_place(k, down)];
            let b_0 = b_tile[b_place(k, across)];
            block_00 += outer(a_0, b_0);
            if ACROSS > 1u {
                let b_1 = b_tile[b_place(k, across + THREADS_N)];
                block_01 += outer(a_0, b_1);
                if DOWN > 1u {
                    let a_1 = a_tile[a_place(k, down + THREADS_M)];
                    block_10 += outer(a_1, b_0);
                    block_11 += outer(a_1, b_1);
                }
            } else if DOWN > 1u {
                let a_1 = a_tile[a_place(k, down + THREADS_M)];
                block_10 += outer(a_1, b_0);
            }
        }
        workgroupBarrier();
    }
    if begin >= product.k {
        return;
    }

    let m = first_m + 4u * down;
    let n = first_n + 4u * across;
    store_block(block_00, m, n, slab);
    if ACROSS > 1u {
        store_block(block_01, m, n + TILE_N / 2u, slab);
    }
    if DOWN > 1u {
        store_block(block_10, m + TILE_M / 2u, n, slab);
        if ACROSS > 1u {
            store_block(block_11, m + TILE_M / 2u, n + TILE_N / 2u, slab);
        }
    }
    if COLUMNS {
        b_tile[thread / 4u][thread % 4u] = column;
        workgroupBarrier();
        let n = first_n + thread;
        if first_m == 0u && thread < TILE_N && n < product.n {
            var sum = 0.0;
            for (var part = thread; part < THREADS; part += TILE_N) {
                sum += b_tile[part / 4u][part % 4u];
            }
            c_values[product.c.x + slab * product.c.w + product.more.w + n] = sum;
        }
    }
}
