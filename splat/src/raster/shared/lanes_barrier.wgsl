// Exchange among the eight threads of a workgroup through shared memory, where subgroups are smaller or missing. The
// order of the sums is that of `lanes_subgroup.wgsl`.

var<workgroup> exchange: array<f32, 72>;
var<workgroup> furthest_of_all: atomic<u32>;

fn eight_from(at: u32) -> f32 {
    let even = (exchange[at] + exchange[at + 4u]) + (exchange[at + 2u] + exchange[at + 6u]);
    return even + ((exchange[at + 1u] + exchange[at + 5u]) + (exchange[at + 3u] + exchange[at + 7u]));
}

// Sums over the eight threads: thread k is left with the k-th of the first eight sums.
fn total_of_eight(own: Sums, lane: u32) -> f32 {
    exchange[lane] = own.v;
    exchange[8u + lane] = own.v_dx;
    exchange[16u + lane] = own.v_dy;
    exchange[24u + lane] = own.v_dx_dx;
    exchange[32u + lane] = own.v_dx_dy;
    exchange[40u + lane] = own.v_dy_dy;
    exchange[48u + lane] = own.r;
    exchange[56u + lane] = own.g;
    exchange[64u + lane] = own.b;
    workgroupBarrier();
    return eight_from(8u * lane);
}

// To be called after `total_of_eight`.
fn total_of_blue(own: Sums, lane: u32) -> f32 {
    let sum = eight_from(64u);
    workgroupBarrier();
    return sum;
}

fn furthest(own: u32, lane: u32) -> u32 {
    if lane == 0u {
        atomicStore(&furthest_of_all, 0u);
    }
    workgroupBarrier();
    atomicMax(&furthest_of_all, own);
    return workgroupUniformLoad(&furthest_of_all);
}
