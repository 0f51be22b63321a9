//! The posterior bound.

use gramian::batch::simd::Path;
use gramian::batch::{Items, Threads};
use gramian::bounds::batch::{self, Recursion};
use gramian::posterior::{Form, semidefinite_root};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::Input;
use crate::errors::InputError;
use crate::output::Batch;
use crate::run;

/// Upper triangular factors (..., n, n) of covariances that may be singular.
#[pyfunction]
fn semidefinite_roots<'py>(
    py: Python<'py>,
    covariance: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let mut covariance = Input::new(covariance, "covariance", 2)?;
    covariance.expect_entries()?;
    let n = covariance.core_shape()[1];
    covariance.expect(&[Some(n), Some(n)], "a covariance")?;
    let batch = Batch::of(&mut [&mut covariance])?;
    let covariance = covariance.items()?;
    let cost = (n * n * n) as f64;
    batch.fill(py, &[n, n], cost, |range, _, out| {
        for (trial, out) in out.chunks_exact_mut(n * n).enumerate() {
            semidefinite_root(covariance.get(range.start + trial), n, out)
                .map_err(|error| (trial, error))?;
        }
        Ok::<_, (usize, _)>(())
    })
}

/// Standard deviations (..., steps, n) and factors (..., steps or 1, n, n), side
/// by side on the last axis.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn posterior<'py>(
    py: Python<'py>,
    root: &Bound<'py, PyAny>,
    rows: &Bound<'py, PyAny>,
    after: &Bound<'py, PyAny>,
    transition: &Bound<'py, PyAny>,
    noise: &Bound<'py, PyAny>,
    is_covariance: bool,
    every_root: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let mut root = Input::new(root, "prior", 2)?;
    let n = root.core_shape()[1];
    root.expect(&[Some(n), Some(n)], "a triangular factor")?;
    let mut rows = Input::new(rows, "rows", 3)?;
    rows.expect(&[None, None, Some(n)], "rows at each step")?;
    let steps = rows.core_shape()[0];
    if steps == 0 || n == 0 {
        return Err(InputError::new_err(
            "rows is empty: there must be at least one step",
        ));
    }
    let legs = steps - 1;
    let mut after = Input::new(after, "spread", 3)?;
    after.expect(&[Some(legs), None, Some(n)], "rows for each transition")?;
    let mut transition = Input::new(transition, "transition", 3)?;
    let mut noise = Input::new(noise, "process_noise", 3)?;
    for input in [&transition, &noise] {
        if input.core_shape() != [1, n, n] {
            input.expect(
                &[Some(legs), Some(n), Some(n)],
                "one matrix for each transition",
            )?;
        }
    }
    let batch = Batch::of(&mut [
        &mut root,
        &mut rows,
        &mut after,
        &mut transition,
        &mut noise,
    ])?;
    let core = steps * n + if every_root { steps } else { 1 } * n * n;
    let (root, rows, after) = (root.items()?, rows.items()?, after.items()?);
    let (transition, noise) = (transition.items()?, noise.items()?);
    let cost = 0.3 * (steps * n * n * n) as f64;
    let recursion = Recursion {
        form: if is_covariance {
            Form::Covariance
        } else {
            Form::Information
        },
        states: n,
        steps,
        root,
        rows,
        after,
        transition,
        noise,
        every_root,
    };
    let records = if cost > run::PIECE {
        batch.fill_apart(py, &[core], cost, |trial| {
            let owned = [root, rows, after, transition, noise].map(|x| x.get(trial).to_vec());
            let (form, states) = (recursion.form, n);
            move |threads: Threads, out: &mut [f64]| {
                let [root, rows, after, transition, noise] =
                    owned.each_ref().map(|x| Items::shared(x));
                let recursion = Recursion {
                    form,
                    states,
                    steps,
                    root,
                    rows,
                    after,
                    transition,
                    noise,
                    every_root,
                };
                batch::posterior(recursion, threads, Path::Best, out);
            }
        })?
    } else {
        batch.fill(py, &[core], cost, |trials, threads, out| {
            let first = trials.start;
            let recursion = Recursion {
                root: root.skip(first),
                rows: rows.skip(first),
                after: after.skip(first),
                transition: transition.skip(first),
                noise: noise.skip(first),
                ..recursion
            };
            batch::posterior(recursion, threads, Path::Best, out);
        })?
    };
    let roots = if every_root { steps } else { 1 };
    batch.named(&records, &[("std", &[steps, n]), ("roots", &[roots, n, n])])
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(semidefinite_roots, module)?)?;
    module.add_function(wrap_pyfunction!(posterior, module)?)
}
