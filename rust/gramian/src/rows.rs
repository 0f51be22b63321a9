//! Rows: the one array that every question is asked of.
//!
//! A row is one whitened line of a measurement Jacobian, (d h / d x) / sigma.
//! Models push rows; accumulators receive them.

/// Receives whitened rows of length `N`.
///
/// Implemented by [`Information`](crate::information::Information), which sums
/// row^T row, and by [`SquareRoot`](crate::square_root::SquareRoot), which keeps
/// the triangular factor of that sum and so twice the digits.
pub trait RowSink<T, const N: usize> {
    /// Takes in one row.
    fn push(&mut self, row: &[T; N]);
}

#[cfg(any(feature = "alloc", test))]
impl<T: Copy, const N: usize> RowSink<T, N> for alloc::vec::Vec<[T; N]> {
    fn push(&mut self, row: &[T; N]) {
        alloc::vec::Vec::push(self, *row);
    }
}
