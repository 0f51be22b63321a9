//! Quantities of simulated trials, and sums over trials.

use gramian::batch::{moments as tree, simd::Path};

use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::convert::Input;
use crate::errors::InputError;
use crate::output::Batch;

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
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let mut times = Input::new(times, "times", 1)?;
    times.expect_entries()?;
    times.expect_increasing("s")?;
    let m = times.core_shape()[0];
    let mut bearings = Input::new(bearings, "bearings", 1)?;
    bearings.expect(&[Some(m)], "a bearing for each time")?;
    let mut sigma = Input::levels(sigma, "sigma")?;
    sigma.expect_one_or(m, "one standard deviation, or one for each time")?;
    sigma.expect_positive("rad")?;
    if Batch::of(&mut [&mut times, &mut bearings, &mut sigma])?.len() != 1 {
        return Err(InputError::new_err(
            "the inputs have leading axes: all trials share one track",
        ));
    }
    let (times, bearings, sigma) = (times.slice()?, bearings.slice()?, sigma.slice()?);
    let cost = 12.0 * m as f64;
    Batch::trials(first, trials).fill(py, &[], cost, |range, threads, out| {
        let first = first + range.start as u64;
        gramian::bearings::batch::bearing_log_det_trials(
            times,
            bearings,
            sigma,
            seed,
            first,
            threads,
            Path::Best,
            out,
        );
    })
}

/// The node of the trials whose `values` (trials, d) are `ok` (trials,).
#[pyfunction]
fn moments<'py>(
    py: Python<'py>,
    values: &Bound<'py, PyAny>,
    ok: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let values = Input::unchecked(values, "values", 2)?;
    let d = values.core_shape()[1];
    let ok: PyReadonlyArray1<'py, bool> = ok.extract()?;
    let out = PyArray1::zeros(py, [tree::size(d)], false);
    {
        let (values, ok) = (values.slice()?, ok.as_slice()?);
        if d == 0 || values.len() != d * ok.len() {
            return Err(InputError::new_err("values and ok do not match"));
        }
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        py.detach(|| tree::moments(values, ok, d, write));
    }
    Ok(out)
}

/// The node of both `left` and `right`, of vectors of `d`.
#[pyfunction]
fn merge_moments<'py>(
    py: Python<'py>,
    d: usize,
    left: &Bound<'py, PyAny>,
    right: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let size = tree::size(d);
    let left = Input::unchecked(left, "left", 1)?;
    let right = Input::unchecked(right, "right", 1)?;
    for node in [&left, &right] {
        node.expect(&[Some(size)], "the numbers of a node")?;
    }
    let mut both = left.slice()?.to_vec();
    tree::merge(d, &mut both, right.slice()?);
    Ok(PyArray1::from_vec(py, both))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(bearing_log_det_trials, module)?)?;
    module.add_function(wrap_pyfunction!(moments, module)?)?;
    module.add_function(wrap_pyfunction!(merge_moments, module)?)
}
