var<workgroup> sums: array<u32, THREADS>;

// The sum of `value` over the threads up to and including this one (Hillis and Steele 1986).
fn inclusive_scan(thread: u32, value: u32) -> u32 {
    var sum = value;
    sums[thread] = sum;
    for (var offset = 1u; offset < THREADS; offset = 2u * offset) {
        workgroupBarrier();
        var before = 0u;
        if thread >= offset {
            before = sums[thread - offset];
        }
        workgroupBarrier();
        sum = add_saturating(sum, before);
        sums[thread] = sum;
    }
    workgroupBarrier();
    return sum;
}
