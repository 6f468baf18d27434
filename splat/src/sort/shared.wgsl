// How much there is to scan or to sort; the Rust side is `plan.rs`.
struct Plan {
    // Pairs to sort.
    count: u32,
    // Blocks of pairs.
    blocks: u32,
    // Numbers to scan.
    scanned: u32,
    // Blocks of numbers.
    scan_blocks: u32,
    // Arguments of indirect dispatches: workgroups by blocks of pairs, and by blocks of numbers.
    block_groups: vec4u,
    scan_groups: vec4u,
    // Sum of what was scanned last, up to 2^32 - 1.
    total: u32,
}

const THREADS = 256u;
// Elements of a thread; a workgroup owns a block of 2048.
const PER_THREAD = 8u;
const BLOCK = 2048u;
const DIGITS = 16u;

fn add_saturating(a: u32, b: u32) -> u32 {
    return select(a + b, 0xffffffffu, a + b < a);
}
