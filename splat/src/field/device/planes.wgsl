// What the kernels of the planes share. F4 (features / 4) and LEVELS are constants put before this text.
//
// A point has LEVELS * F4 groups of four features. Each group of a level is the product of the six planes' values there.
// The time planes come blended into lines over their other axis, since all points of a pass share one time.

const GROUPS = LEVELS * F4;

// One level. Places of planes and lines count groups of four values, those of sums count single values.
struct Level {
    cells: vec4u,      // along x, y, z
    planes: vec4u,     // xy, xz, yz in the vector of all planes
    times: vec4u,      // xt, yt, zt in the vector of all planes
    lines: vec4u,      // the blended lines over x, y, z
    sums: vec4u,       // fixed-point sums of xy, xz, yz
    line_sums: vec4u,  // fixed-point sums of the lines
}

struct Cell {
    index: u32,
    weight: f32,  // of the next cell
}

// Cell of a coordinate in [0, 1], the first value at 0 and the last at 1. NaN lands on 0.
fn locate(along: f32, cells: u32) -> Cell {
    let clamped = select(0.0, min(along, 1.0), along > 0.0);
    let position = clamped * f32(cells - 1u);
    let index = min(u32(position), cells - 2u);
    return Cell(index, position - f32(index));
}

// The axes along columns and rows of the spatial planes.
fn column_axis(plane: u32) -> u32 { return select(0u, 1u, plane == 2u); }
fn row_axis(plane: u32) -> u32 { return select(2u, 1u, plane == 0u); }
