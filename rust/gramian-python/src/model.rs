//! A model of the user's own: a Python function called back by the crate.

use gramian::numbers::derivative::{Error, Jacobian, Options, jacobian};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::Input;
use crate::errors::InputError;

/// The derivatives of a function and what was done to find them.
#[pyclass(frozen, name = "Differences", module = "gramian._core")]
struct Differences {
    found: Jacobian,
    states: usize,
}

#[pymethods]
impl Differences {
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.matrix(py, &self.found.values)
    }

    fn error<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.matrix(py, &self.found.error)
    }

    fn noise<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.found.noise)
    }

    fn step<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.found.step)
    }

    #[getter]
    fn evaluations(&self) -> usize {
        self.found.evaluations
    }

    #[getter]
    fn groups(&self) -> usize {
        self.found.groups
    }
}

impl Differences {
    fn matrix<'py>(&self, py: Python<'py>, values: &[f64]) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let outputs = values.len() / self.states;
        PyArray1::from_slice(py, values).reshape([outputs, self.states])
    }
}

/// The derivatives of `function` at `x`, where its value is `at`.
///
/// `function` takes points (count, n) and returns outputs (count, m), NaN where it has
/// none; what it raises is passed on. `pattern` has for each state the outputs it moves.
#[pyfunction]
#[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)]
fn differences(
    py: Python<'_>,
    function: &Bound<'_, PyAny>,
    x: &Bound<'_, PyAny>,
    at: &Bound<'_, PyAny>,
    scale: &Bound<'_, PyAny>,
    weight: &Bound<'_, PyAny>,
    period: &Bound<'_, PyAny>,
    noise: &Bound<'_, PyAny>,
    step: &Bound<'_, PyAny>,
    pattern: Option<Vec<Vec<usize>>>,
    names: Vec<String>,
) -> PyResult<Differences> {
    let (x, at) = (Input::new(x, "x", 1)?, Input::new(at, "h(x)", 1)?);
    let (n, m) = (x.core_shape()[0], at.core_shape()[0]);
    let scale = Input::unchecked(scale, "scale", 1)?;
    let weight = Input::new(weight, "sigma", 1)?;
    let period = Input::new(period, "periods", 1)?;
    let noise = Input::unchecked(noise, "noise", 1)?;
    let step = Input::unchecked(step, "step", 1)?;
    for input in [&scale, &step] {
        input.expect(&[Some(n)], "one for each state")?;
    }
    for input in [&weight, &period, &noise] {
        input.expect(&[Some(m)], "one for each measurement")?;
    }
    if let Some(pattern) = &pattern
        && (pattern.len() != n
            || pattern
                .iter()
                .any(|rows| rows.iter().any(|&i| i >= m) || !rows.is_sorted()))
    {
        return Err(InputError::new_err(format!(
            "sparsity: must have {n} columns and {m} rows"
        )));
    }
    let options = Options {
        scale: scale.slice()?,
        weight: weight.slice()?,
        period: period.slice()?,
        noise: noise.slice()?,
        step: step.slice()?,
        pattern: pattern.as_deref(),
    };
    let (x, at) = (x.slice()?, at.slice()?);
    let found = jacobian(x, at, &options, |points, out| -> PyResult<()> {
        py.check_signals()?;
        let points = PyArray1::from_slice(py, points).reshape([points.len() / n, n])?;
        let values = function.call1((points,))?;
        let values = Input::unchecked(&values, "h(x)", 2)?;
        values.expect(&[Some(out.len() / m), Some(m)], "one row for each point")?;
        out.copy_from_slice(values.slice()?);
        Ok(())
    });
    let name = |state: usize| names.get(state).map_or("?", String::as_str);
    match found {
        Ok(found) => Ok(Differences { found, states: n }),
        Err(Error::Function(error)) => Err(error),
        Err(Error::Jump {
            output,
            state,
            below,
            above,
            step,
        }) => {
            let state_name = name(state);
            let lean = (above - below).abs() < 1e-3 * (above - at[output]).abs().max(1e-300);
            Err(InputError::new_err(if lean {
                format!(
                    "h(x)[{output}] has a kink where {state_name} = {}: it has no derivative there",
                    x[state]
                )
            } else {
                format!(
                    "h(x)[{output}] jumps from {below:.6} to {above:.6} where {state_name} moves from \
                     {} - {step:.2e} to {} + {step:.2e}: for an angle that wraps give \
                     angles=[{output}], or its period in periods",
                    x[state], x[state]
                )
            }))
        }
        Err(Error::Kink { output, state, .. }) => Err(InputError::new_err(format!(
            "h(x)[{output}] has a kink where {} = {}: it has no derivative there",
            name(state),
            x[state]
        ))),
        Err(Error::NotFinite {
            output,
            state,
            step,
        }) => Err(InputError::new_err(format!(
            "h(x)[{output}] is not finite where {} = {} +- {step:.2e}: h must have values around x",
            name(state),
            x[state]
        ))),
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(differences, module)?)?;
    module.add_class::<Differences>()
}
