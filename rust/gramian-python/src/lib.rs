//! The extension module `gramian._core`: convert, detach from the interpreter,
//! call the crate, convert back. No mathematics.
#![allow(missing_docs)] // The public face is python/gramian; see _core.pyi.

mod bearings;
mod bearings_localize;
mod bearings_motion;
mod choose;
mod compiled;
mod convert;
mod dense;
mod dipole;
mod dipole_record;
mod dynamics;
mod errors;
mod inertial;
mod linear;
mod maneuver;
mod maneuver_plan;
mod model;
mod monte_carlo;
mod output;
mod posterior;
mod registration;
mod run;
mod solve;
#[cfg(feature = "large")]
mod sparse;
mod spine;
mod tracks;

use std::sync::atomic::{AtomicUsize, Ordering};

use pyo3::exceptions::PyImportError;
use pyo3::prelude::*;

/// The address of `sys` in the interpreter that loaded this module first.
static HOME: AtomicUsize = AtomicUsize::new(0);

/// Refuses a second interpreter: exceptions and types kept here belong to the first.
fn require_one_interpreter(py: Python<'_>) -> PyResult<()> {
    let sys = py.import("sys")?.as_ptr() as usize;
    match HOME.compare_exchange(0, sys, Ordering::SeqCst, Ordering::SeqCst) {
        Err(home) if home != sys => Err(PyImportError::new_err(
            "gramian is in use by another interpreter of this process: subinterpreters are not \
             supported; use processes",
        )),
        _ => Ok(()),
    }
}

#[pymodule(gil_used = true)]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    require_one_interpreter(module.py())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    spine::register(module)?;
    #[cfg(feature = "large")]
    sparse::register(module)?;
    choose::register(module)?;
    compiled::register(module)?;
    bearings::register(module)?;
    bearings_localize::register(module)?;
    bearings_motion::register(module)?;
    dipole::register(module)?;
    inertial::register(module)?;
    dipole_record::register(module)?;
    dynamics::register(module)?;
    linear::register(module)?;
    maneuver::register(module)?;
    model::register(module)?;
    monte_carlo::register(module)?;
    posterior::register(module)?;
    registration::register(module)?;
    tracks::register(module)?;
    solve::register(module)?;
    maneuver_plan::register(module)
}
