//! Which candidates to add.

use gramian::choose::{ChoiceError, Design, Goal, Gram};
use numpy::PyArray1;
use pyo3::exceptions::PyKeyboardInterrupt;
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
    let (greedy, swapped, worth, relaxed) = run::interruptible(py, |stop| {
        let design = Design::new(n, base, &groups)?;
        let greedy = design.greedy(&goal, budget, stop)?;
        let (swapped, worth) = design.exchange(&goal, &greedy.chosen, exchange, stop)?;
        let relaxed = design.relax(&goal, budget, 1e-4, steps, stop)?;
        Ok((greedy, swapped, worth, relaxed))
    })?
    .map_err(refused)?;
    Ok((
        greedy.chosen,
        greedy.worth,
        greedy.rank,
        swapped,
        worth,
        relaxed.map(|r| (PyArray1::from_vec(py, r.weights), r.worth, r.limit)),
    ))
}

/// By value, as `map_err` gives it.
#[allow(clippy::needless_pass_by_value)]
fn refused(error: ChoiceError) -> PyErr {
    match error {
        ChoiceError::Number(error) => input_at("", error),
        ChoiceError::Interrupted => PyKeyboardInterrupt::new_err(()),
    }
}

/// Chooses where everything is observable, from what the candidates' rows see of each
/// other: `c`, and `g` for a sum of variances; `worth` is that of what is known already.
/// Returns what greedy took with the worth after each, what exchange left with its worth,
/// and fractions, their worth and the limit.
#[pyfunction]
#[allow(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    clippy::type_complexity
)]
fn choose_observable<'py>(
    py: Python<'py>,
    c: &Bound<'py, PyAny>,
    g: Option<&Bound<'py, PyAny>>,
    ends: Vec<usize>,
    budget: usize,
    worth: f64,
    exchange: usize,
    steps: usize,
) -> PyResult<(
    Vec<usize>,
    Vec<f64>,
    Vec<usize>,
    f64,
    Option<(Bound<'py, PyArray1<f64>>, f64, f64)>,
)> {
    let c = Input::new(c, "c", 2)?.slice()?.to_vec();
    let g = match g {
        Some(g) => Some(Input::new(g, "g", 2)?.slice()?.to_vec()),
        None => None,
    };
    let base = Gram::new(&ends, c, g, worth)
        .ok_or_else(|| InputError::new_err("c and g must have a line for each row"))?;
    let (greedy, swapped, reached, relaxed) = run::interruptible(py, |stop| {
        let mut gram = base.clone();
        let greedy = gram.greedy(budget, stop)?;
        let swapped = gram.exchange(&greedy.chosen, exchange, stop)?;
        let reached = gram.worth();
        let relaxed = base.relax(budget, 1e-4, steps, stop)?;
        Ok((greedy, swapped, reached, relaxed))
    })?
    .map_err(refused)?;
    Ok((
        greedy.chosen,
        greedy.worth,
        swapped,
        reached,
        relaxed.map(|r| (PyArray1::from_vec(py, r.weights), r.worth, r.limit)),
    ))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(choose_observable, module)?)?;
    module.add_function(wrap_pyfunction!(choose, module)?)
}
