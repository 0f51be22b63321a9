//! Rows of many states: blocked factorisations of the feature `large`, or, without it, the
//! plain ones for any number of states.

#[cfg(feature = "large")]
pub use gramian::large::{
    dense::{crlb_std, observability},
    singular_values,
};
#[cfg(not(feature = "large"))]
pub use plain::{crlb_std, observability, singular_values};

/// Whether blocked factorisations are there, and the faster ones.
#[cfg(feature = "large")]
pub const fn is_large(n: usize) -> bool {
    n >= gramian::large::dense::LEAST_STATES
}

/// Without them no number of states is large.
#[cfg(not(feature = "large"))]
pub const fn is_large(_: usize) -> bool {
    false
}

#[cfg(not(feature = "large"))]
mod plain {
    use gramian::observability::{self, Observability};
    use gramian::scalar::NumberError;

    pub fn observability(
        rows: &[f64],
        errors: &[f64],
        n: usize,
        rtol: Option<f64>,
    ) -> Result<Observability<f64>, NumberError> {
        Observability::inexact(rows, errors, &[], n, rtol)
    }

    pub fn crlb_std(rows: &[f64], n: usize, rtol: Option<f64>) -> Result<Vec<f64>, NumberError> {
        Ok(Observability::new(rows, n, rtol)?.crlb_std())
    }

    pub fn singular_values(rows: &[f64], n: usize) -> Result<Vec<f64>, NumberError> {
        Ok(observability::singular_values(rows, n)?.0)
    }
}
