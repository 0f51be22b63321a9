//! Errors of the crate to Python exceptions, in one place.

use pyo3::PyErr;

pyo3::import_exception!(gramian.exceptions, InputError);
pyo3::import_exception!(gramian.exceptions, UnobservableError);

/// An error about what was given in one trial; `place` comes from `Batch::place`.
pub fn input_at(place: &str, error: impl core::error::Error) -> PyErr {
    InputError::new_err(format!("{place}{error}"))
}
