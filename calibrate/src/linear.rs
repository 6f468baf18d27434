//! Decompositions of matrices whose size the data decide, safe for sizes of nought and for numbers that are not finite: the
//! library beneath panics on the one and may go on forever with the other.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Eigenvalues of a symmetric matrix, and the vectors that belong to them, as columns.
pub(crate) struct Eigen {
    pub values: DVector<f64>,
    pub vectors: DMatrix<f64>,
}

/// The eigenvalues of a symmetric matrix: none of an empty one; all nil of one with a number that is not finite, so that
/// whoever asks what it determines learns that it is nothing.
pub(crate) fn symmetric_eigen(matrix: DMatrix<f64>) -> Eigen {
    let size = matrix.nrows();
    if size == 0 || !matrix.iter().all(|value| value.is_finite()) {
        return Eigen { values: DVector::zeros(size), vectors: DMatrix::identity(size, size) };
    }
    let eigen = SymmetricEigen::new(matrix);
    Eigen { values: eigen.eigenvalues, vectors: eigen.eigenvectors }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_single_and_endless_matrices_have_eigenvalues() {
        assert_eq!(symmetric_eigen(DMatrix::zeros(0, 0)).values.len(), 0);
        assert_eq!(symmetric_eigen(DMatrix::from_element(1, 1, 4.0)).values[0], 4.0);
        let eigen = symmetric_eigen(DMatrix::from_row_slice(2, 2, &[2.0, 0.0, 0.0, f64::NAN]));
        assert_eq!((eigen.values.as_slice(), eigen.vectors.ncols()), (&[0.0, 0.0][..], 2));
    }
}
