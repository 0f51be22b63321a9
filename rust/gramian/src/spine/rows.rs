//! Rows: the one array that every question is asked of.
//!
//! A row is one whitened line of a measurement Jacobian, (d h / d x) / sigma.
//! Models push rows; accumulators receive them.
//!
//! ```
//! use gramian::rows::RowSink;
//! use gramian::scalar::NumberError;
//! use gramian::square_root::SquareRootInformation;
//!
//! /// Ranges to beacons, to 1 m: a model of one's own is a function that pushes rows.
//! fn ranges(
//!     at: [f64; 2],
//!     beacons: &[[f64; 2]],
//!     sink: &mut impl RowSink<f64, 2>,
//! ) -> Result<(), NumberError> {
//!     for beacon in beacons {
//!         let offset = [at[0] - beacon[0], at[1] - beacon[1]];
//!         let range = offset[0].hypot(offset[1]);
//!         sink.push(&offset.map(|x| x / range))?;
//!     }
//!     Ok(())
//! }
//!
//! let mut root = SquareRootInformation::new();
//! ranges([50.0, 0.0], &[[0.0, 0.0], [100.0, 0.0]], &mut root)?;
//! // On the line between the beacons nothing tells north.
//! assert_eq!(root.crlb_std()[1], f64::INFINITY);
//! # Ok::<(), NumberError>(())
//! ```

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
    /// overflows. The row is not taken in then.
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
