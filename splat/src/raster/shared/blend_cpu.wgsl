// What both blending passes of the CPU shape share. A workgroup of eight threads walks the list of a tile of 16 x 16
// pixels together, so that what it loads is the same for all of them. Each thread owns two columns of the tile, in
// blocks of four rows; a block that a splat misses in all eight columns is jumped over.

const TILE = 16u;
const LANES = 8u;
const ROWS = vec4f(0.0, 1.0, 2.0, 3.0);

// One column of a tile as a splat sees it.
struct Column {
    dx: f32,
    // Lowest and highest dy that is covered, with a margin for rounding.
    low: f32,
    high: f32,
    // log2 of alpha is dy (c dy + linear) + constant.
    linear: f32,
    constant: f32,
}

fn column_of(splat: Splat, x: f32) -> Column {
    let dx = x - splat.mean_power.x;
    let across = dx * splat.column.x;
    let inside = 1.0 - across * across;
    let half = select(-1e9, splat.column.y * sqrt(max(inside, 0.0)) + 0.01, inside > -1e-4);
    let middle = splat.column.z * dx;
    let constant = splat.mean_power.z * dx * dx + splat.shape.y;
    return Column(dx, middle - half, middle + half, splat.mean_power.w * dx, constant);
}

// Whether the splat reaches the block whose first row lies `dy` from the mean.
fn reaches(column: Column, dy: f32) -> bool {
    return dy <= column.high && dy + 3.0 >= column.low;
}

// log2 of the largest alpha of a splat. Rounding can lift the power of a needle above 0: this bounds that too.
fn largest_of(splat: Splat) -> f32 {
    return min(splat.shape.y, LOG2_LARGEST_ALPHA);
}

// log2 of alpha in the four rows of a block.
fn log_alpha(splat: Splat, column: Column, dy: vec4f) -> vec4f {
    return min(dy * (splat.shape.x * dy + column.linear) + column.constant, vec4f(largest_of(splat)));
}
