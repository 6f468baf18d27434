// Exchange among the eight threads of a workgroup, where a subgroup has at least eight threads.

fn fold(low: f32, high: f32, upper: bool, distance: u32) -> f32 {
    return select(low, high, upper) + subgroupShuffleXor(select(high, low, upper), distance);
}

// Sums over the eight threads, two halves of the threads taking over half of the sums each, and so on: thread k is left
// with the k-th of the first eight sums.
fn total_of_eight(own: Sums, lane: u32) -> f32 {
    let third = (lane & 4u) != 0u;
    let a = fold(own.v, own.v_dx_dy, third, 4u);
    let b = fold(own.v_dx, own.v_dy_dy, third, 4u);
    let c = fold(own.v_dy, own.r, third, 4u);
    let d = fold(own.v_dx_dx, own.g, third, 4u);
    let second = (lane & 2u) != 0u;
    let e = fold(a, c, second, 2u);
    let f = fold(b, d, second, 2u);
    return fold(e, f, (lane & 1u) != 0u, 1u);
}

fn total_of_blue(own: Sums, lane: u32) -> f32 {
    let sum = own.b + subgroupShuffleXor(own.b, 4u);
    let sums = sum + subgroupShuffleXor(sum, 2u);
    return sums + subgroupShuffleXor(sums, 1u);
}

fn furthest(own: u32, lane: u32) -> u32 {
    return subgroupMax(own);
}
