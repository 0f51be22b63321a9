//! Which candidates to add.

use gramian::choose::{Design, Goal};
use numpy::PyArray1;
use pyo3::prelude::*;

use crate::convert::Input;
use crate::errors::{InputError, input_at};
use crate::run;

/// Chosen numbers, worth after each, rank after each; then the chosen after exchange and
/// their worth; then weights, worth and limit of the relaxation where there is one.
type Answer<'py> = (
    Vec<usize>,
    Vec<f64>,
    Vec<usize>,
    Vec<usize>,
    f64,
    Option<(Bound<'py, PyArray1<f64>>, f64, f64)>,
);

/// `base` (K, n), `rows` (m, n) of all candidates one after the other, `ends` where each
/// ends.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn choose<'py>(
    py: Python<'py>,
    base: &Bound<'py, PyAny>,
    rows: &Bound<'py, PyAny>,
    ends: Vec<usize>,
    budget: usize,
    goal: &str,
    weights: &Bound<'py, PyAny>,
    exchange: usize,
    steps: usize,
) -> PyResult<Answer<'py>> {
    let base = Input::new(base, "base", 2)?;
    let rows = Input::new(rows, "candidates", 2)?;
    let weights = Input::new(weights, "weights", 1)?;
    let n = base.core_shape()[1];
    rows.expect(&[None, Some(n)], "one number for each state")?;
    weights.expect(&[Some(n)], "one number for each state")?;
    let goal = match goal {
        "D" => Goal::D,
        "A" => Goal::A(weights.slice()?.to_vec()),
        "E" => Goal::E(weights.slice()?.to_vec()),
        _ => {
            return Err(InputError::new_err(format!(
                "goal = {goal:?}: must be D, A or E"
            )));
        }
    };
    let data = rows.slice()?;
    let mut groups = Vec::with_capacity(ends.len());
    let mut before = 0;
    for end in ends {
        let group = data
            .get(before * n..end * n)
            .ok_or_else(|| InputError::new_err("a candidate ends beyond its rows"))?;
        groups.push(group);
        before = end;
    }
    let base = base.slice()?;
    let (greedy, swapped, worth, relaxed) = run::detached(py, |_| {
        let design = Design::new(n, base, &groups)?;
        let greedy = design.greedy(&goal, budget)?;
        let (swapped, worth) = design.exchange(&goal, &greedy.chosen, exchange);
        let relaxed = design.relax(&goal, budget, 1e-4, steps)?;
        Ok((greedy, swapped, worth, relaxed))
    })?
    .map_err(|error: gramian::scalar::NumberError| input_at("", error))?;
    Ok((
        greedy.chosen,
        greedy.worth,
        greedy.rank,
        swapped,
        worth,
        relaxed.map(|r| (PyArray1::from_vec(py, r.weights), r.worth, r.limit)),
    ))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(choose, module)?)
}
