//! Factorisations of large matrices: the only module that names faer.

use alloc::vec::Vec;

/// Singular values, descending, of a row-major matrix with `columns` columns.
///
/// # Errors
/// [`NoConvergence`] when the iteration does not end, as with non-finite input.
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
