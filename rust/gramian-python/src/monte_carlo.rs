//! Quantities of simulated trials.

use gramian::batch::{self, simd::Path};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::{Batch, Input};
use crate::errors::InputError;
use crate::run;

/// Log determinants (trials,) of the Gram matrices of simulated bearings, from
/// the bearings (m,) without noise.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn bearing_log_det_trials<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    seed: u64,
    first: u64,
    trials: usize,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let mut times = Input::new(times, "times", 1)?;
    times.expect_entries()?;
    times.expect_increasing("s")?;
    let m = times.core_shape()[0];
    let mut bearings = Input::new(bearings, "bearings", 1)?;
    bearings.expect(&[Some(m)], "a bearing for each time")?;
    let mut sigma = Input::new(sigma, "sigma", 1)?;
    if sigma.core_shape() != [1] {
        sigma.expect(&[Some(m)], "one standard deviation, or one for each time")?;
    }
    sigma.expect_positive("rad")?;
    if Batch::of(&mut [&mut times, &mut bearings, &mut sigma])?.len() != 1 {
        return Err(InputError::new_err(
            "the inputs have leading axes: all trials share one track",
        ));
    }
    let out = PyArray1::zeros(py, [trials], false);
    {
        let (times, bearings, sigma) = (times.slice()?, bearings.slice()?, sigma.slice()?);
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        run::in_pieces(py, trials, 12.0 * m as f64, |range, threads| {
            batch::bearing_log_det_trials(
                times,
                bearings,
                sigma,
                seed,
                first + range.start as u64,
                threads,
                Path::Best,
                &mut write[range],
            );
            Ok(())
        })?;
    }
    Ok(out)
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(bearing_log_det_trials, module)?)
}
