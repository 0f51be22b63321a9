//! Rows: the one array that every question is asked of.
//!
//! A row is one whitened line of a measurement Jacobian, (d h / d x) / sigma.
//! Models push rows; accumulators receive them.

use crate::scalar::NumberError;

/// Receives whitened rows of length `N`.
///
/// Implemented by [`Information`](crate::information::Information), which sums
/// row^T row, and by [`SquareRootInformation`](crate::square_root::SquareRootInformation), which keeps
/// the triangular factor of that sum and so twice the digits.
pub trait RowSink<T, const N: usize> {
    /// Takes in one row.
    ///
    /// # Errors
    /// [`NumberError`] for an entry that is not finite, or for information that
    /// exceeds the numbers of this type. The row is not taken in then.
    fn push(&mut self, row: &[T; N]) -> Result<(), NumberError>;
}

#[cfg(any(feature = "alloc", test))]
impl<T: crate::scalar::Real, const N: usize> RowSink<T, N> for alloc::vec::Vec<[T; N]> {
    fn push(&mut self, row: &[T; N]) -> Result<(), NumberError> {
        crate::scalar::check_finite("row", row)?;
        alloc::vec::Vec::push(self, *row);
        Ok(())
    }
}
