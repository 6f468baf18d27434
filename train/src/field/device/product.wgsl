// A matrix product, tile by tile through shared memory: C = A B, where A is m x k and B is k x n, each anywhere in its
// buffer with any strides. A workgroup of 256 threads makes a tile of TILE_M x TILE_N; a thread makes ROWS x 4 of it.
// The sum over k can be cut into slabs that are summed later. Every sum has a fixed order.
//
// Constants put before this text: TILE_M, TILE_N, ROWS (TILE_M * TILE_N = 1024 * ROWS); A_ALONG_K and B_ALONG_N, whether
// neighbours along k or n are neighbours in memory (they only steer which thread loads what); BIAS, RELU.

const TILE_K = 16u;
const ACROSS = TILE_N / 4u;

struct Product {
    m: u32,
    n: u32,
    k: u32,
    slab: u32,   // values of k a slab
    a: vec4u,    // offset, stride along m, stride along k
    b: vec4u,    // offset, stride along k, stride along n
    c: vec4u,    // offset, stride along m, stride along n, stride from slab to slab
    more: vec4u, // offset of the bias in B's buffer; offset and stride along m of the mask
}

@group(0) @binding(0) var<uniform> product: Product;
@group(0) @binding(1) var<storage, read> a_values: array<f32>;
@group(0) @binding(2) var<storage, read> b_values: array<f32>;
@group(0) @binding(3) var<storage, read_write> c_values: array<f32>;
// MASK @group(0) @binding(4) var<storage, read> mask: array<f32>;

var<workgroup> a_tile: array<f32, TILE_M * TILE_K>;  // [k, m]
var<workgroup> b_tile: array<f32, TILE_N * TILE_K>;  // [k, n]

@compute @workgroup_size(256)
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
    let across = thread % ACROSS;
    let down = thread / ACROSS;

    var sums: array<vec4f, ROWS>;
    for (var first_k = slab * product.slab; first_k < end; first_k += TILE_K) {
        for (var e = thread; e < TILE_M * TILE_K; e += 256u) {
            let at_k = select(e / TILE_M, e % TILE_K, A_ALONG_K);
            let at_m = select(e % TILE_M, e / TILE_K, A_ALONG_K);
            let k = first_k + at_k;
            let m = first_m + at_m;
            var value = 0.0;
            if k < end && m < product.m {
                value = a_values[product.a.x + m * product.a.y + k * product.a.z];
            }
            a_tile[at_k * TILE_M + at_m] = value;
        }
        for (var e = thread; e < TILE_N * TILE_K; e += 256u) {
            let at_k = select(e % TILE_K, e / TILE_N, B_ALONG_N);
            let at_n = select(e / TILE_K, e % TILE_N, B_ALONG_N);
            let k = first_k + at_k;
            let n = first_n + at_n;
            var value = 0.0;
            if k < end && n < product.n {
                value = b_values[product.b.x + k * product.b.y + n * product.b.z];
            }
            b_tile[at_k * TILE_N + at_n] = value;
        }
        workgroupBarrier();
        for (var k = 0u; k < TILE_K; k++) {
            let at = k * TILE_N + across * 4u;
            let b = vec4f(b_tile[at], b_tile[at + 1u], b_tile[at + 2u], b_tile[at + 3u]);
            for (var i = 0u; i < ROWS; i++) {
                sums[i] += a_tile[k * TILE_M + down * ROWS + i] * b;
            }
        }
        workgroupBarrier();
    }

    for (var i = 0u; i < ROWS; i++) {
        let m = first_m + down * ROWS + i;
        if m >= product.m || slab * product.slab >= product.k {
            continue;
        }
        for (var j = 0u; j < 4u; j++) {
            let n = first_n + across * 4u + j;
            if n >= product.n {
                continue;
            }
            var value = sums[i][j];
            if BIAS {
                value += b_values[product.more.x + n];
            }
            if RELU {
                value = max(value, 0.0);
            }
            // MASK value = select(value, 0.0, mask[product.more.y + m * product.more.z + n] == 0.0);
            c_values[product.c.x + slab * product.c.w + m * product.c.y + n * product.c.z] = value;
        }
    }
}
