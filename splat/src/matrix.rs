//! Matrix products on the host: a safe face for the crate `gemm-f32`.

use gemm_common::Parallelism;

/// A matrix inside a slice.
#[derive(Clone, Copy)]
pub struct Matrix<'a> {
    data: &'a [f32],
    rows: usize,
    cols: usize,
    row_stride: usize,
    col_stride: usize,
}

impl<'a> Matrix<'a> {
    /// `rows` x `cols` values, the rows `stride` floats apart.
    pub fn new(data: &'a [f32], rows: usize, cols: usize, stride: usize) -> Self {
        assert!(rows == 0 || cols == 0 || data.len() >= (rows - 1) * stride + cols, "a matrix lies within its slice");
        Self { data, rows, cols, row_stride: stride, col_stride: 1 }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The rows of a matrix that was not transposed.
    pub fn each_row(&self) -> impl Iterator<Item = &'a [f32]> {
        debug_assert_eq!(self.col_stride, 1);
        let cols = self.cols;
        self.data.chunks(self.row_stride.max(1)).take(self.rows).map(move |row| &row[..cols])
    }

    /// The same values with rows and columns exchanged.
    pub fn transposed(self) -> Self {
        Self { rows: self.cols, cols: self.rows, row_stride: self.col_stride, col_stride: self.row_stride, ..self }
    }
}

/// `out = a b`, or `out += a b`, where the rows of `out` lie `stride` floats apart. Runs on the calling thread, so that
/// the order of the sums depends on nothing but the sizes.
#[expect(unsafe_code, reason = "the crate gemm takes pointers and strides; the sizes are asserted before")]
pub fn multiply(out: &mut [f32], stride: usize, a: Matrix<'_>, b: Matrix<'_>, add: bool) {
    assert_eq!(a.cols, b.rows, "inner dimensions agree");
    if a.rows == 0 || b.cols == 0 {
        return;
    }
    assert!(stride >= b.cols && out.len() >= (a.rows - 1) * stride + b.cols, "the result lies within its slice");
    let gemm = gemm_f32::gemm::f32::get_gemm_fn();
    // The kernels want a result whose columns are contiguous. This one's rows are, so that it is computed as
    // out^T = b^T a^T.
    // SAFETY: the constructor of `Matrix` and the assertions above keep every element within its slice; transposing
    // exchanges sizes and strides together. `out` is borrowed mutably, so that it overlaps neither operand, and its rows
    // do not overlap because `stride >= b.cols`.
    unsafe {
        gemm(
            b.cols,
            a.rows,
            a.cols,
            out.as_mut_ptr(),
            stride as isize,
            1,
            add,
            b.data.as_ptr(),
            b.row_stride as isize,
            b.col_stride as isize,
            a.data.as_ptr(),
            a.row_stride as isize,
            a.col_stride as isize,
            1.0,
            1.0,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}
