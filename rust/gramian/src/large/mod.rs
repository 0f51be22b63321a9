//! Problems too large for the plain loops of the spine: the only place that names faer.

pub mod dense;
pub mod sparse;

use alloc::vec::Vec;

/// Singular values, descending, of a row-major matrix with `columns` columns.
///
/// # Errors
/// [`NoConvergence`] when the iteration does not end, as with entries that are not finite.
///
/// ```
/// let values = gramian::large::singular_values(&[3.0, 0.0, 0.0, 4.0], 2).unwrap();
/// assert!((values[0] - 4.0).abs() < 1e-15);
/// ```
pub fn singular_values(a: &[f64], columns: usize) -> Result<Vec<f64>, NoConvergence> {
    let rows = a.len().checked_div(columns).unwrap_or(0);
    faer::MatRef::from_row_major_slice(a, rows, columns)
        .singular_values()
        .map_err(|_| NoConvergence)
}

/// An iteration that did not end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the singular value iteration did not converge: is every entry finite?")]
pub struct NoConvergence;
