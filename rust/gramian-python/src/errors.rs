//! Errors of the crate to Python exceptions, in one place.

use pyo3::{PyErr, PyResult};

use crate::output::Batch;

pyo3::import_exception!(gramian.exceptions, InputError);
pyo3::import_exception!(gramian.exceptions, UnobservableError);

/// An error about what was given in one trial; `place` comes from `Batch::place`.
pub fn input_at(place: &str, error: impl core::error::Error) -> PyErr {
    InputError::new_err(format!("{place}{error}"))
}

/// Refuses results, `size` numbers a trial, that left double precision.
pub fn refuse_overflow(batch: &Batch, size: usize, out: &[f64], result: &str) -> PyResult<()> {
    match out.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(index) => Err(InputError::new_err(format!(
            "{}{result} overflows float64: choose other units of time",
            batch.place(index / size)
        ))),
    }
}
