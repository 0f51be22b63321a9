//! Models with their measurements, and what is asked of them: see `gramian::solve`.
// Arguments come from Python by value, and results go back as tuples.
#![allow(clippy::needless_pass_by_value, clippy::type_complexity)]
// The method itself is not general enough in its lifetime.
#![allow(clippy::redundant_closure_for_method_calls)]

use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use gramian::bearings::Measured;
use gramian::bounds::threshold;
use gramian::forward_model;
use gramian::solve::fit::{self, Channel, Fit};
use gramian::solve::other_solutions::{Found, Search, other_solutions};
use gramian::solve::starts::{Spread, multi_start};
use gramian::solve::trials::{Trials, recall};
use gramian::solve::unbounded::within_reach;
use gramian::solve::{
    Combination, Distance, Function, Held, Loss, Model, Options, Solution, WithPrior, region,
};
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::exceptions::{PyArithmeticError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::convert::Input;
use crate::errors::InputError;
use crate::output::Batch;

type Shared = Arc<dyn Model<Error = String> + Send + Sync>;

/// What Python raised inside a kernel, kept until the kernel has come back.
type Raised = Arc<Mutex<Option<PyErr>>>;

/// A model of the crate, its errors as text.
struct Native<M>(M);

impl<M: Model> Model for Native<M>
where
    M::Error: core::fmt::Display,
{
    type Error = String;

    forward_model!(this => this.0; states, measurements, priors, exact, channels, change, extent, retract, rounding, symmetries);

    fn linearize(&self, x: &[f64], r: &mut [f64], rows: Option<&mut [f64]>) -> Result<(), String> {
        self.0.linearize(x, r, rows).map_err(|e| e.to_string())
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), String> {
        self.0.difference(a, b, out).map_err(|e| e.to_string())
    }
}

/// Functions in Python as a model.
struct Given {
    states: usize,
    measurements: usize,
    /// How many of the last measurements are exact, prior knowledge.
    priors: usize,
    /// Groups of states that keep the length of their vector, and the length.
    groups: Vec<(Vec<usize>, f64)>,
    /// Which of these groups mean the same with the opposite sign: unit quaternions.
    twofold: Vec<usize>,
    /// x -> (residuals, rows).
    linearize: Py<PyAny>,
    /// a, b -> h(b) - h(a), whitened.
    difference: Py<PyAny>,
    /// x -> states with the same data.
    symmetries: Option<Py<PyAny>>,
    raised: Raised,
}

impl Given {
    /// A state where the function has no value is no error of the program; anything
    /// else is, and ends the search.
    fn keep(&self, py: Python<'_>, error: PyErr) -> String {
        let text = if error.is_instance_of::<InputError>(py) {
            error.value(py).to_string()
        } else {
            error.to_string()
        };
        if !(error.is_instance_of::<PyValueError>(py)
            || error.is_instance_of::<PyArithmeticError>(py))
        {
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
        text
    }

    fn ended(&self) -> bool {
        self.raised
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .is_some()
    }

    fn copy(value: &Bound<'_, PyAny>, name: &'static str, out: &mut [f64]) -> PyResult<()> {
        let value = Input::new(value, name, 0)?;
        let from = value.slice()?;
        if from.len() != out.len() {
            return Err(InputError::new_err(format!(
                "{name} has {} entries: must have {}",
                from.len(),
                out.len()
            )));
        }
        out.copy_from_slice(from);
        Ok(())
    }
}

impl Model for Given {
    type Error = String;

    fn states(&self) -> usize {
        self.states
    }

    fn measurements(&self) -> usize {
        self.measurements
    }

    fn priors(&self) -> usize {
        self.priors
    }

    fn exact(&self) -> Range<usize> {
        self.measurements - self.priors..self.measurements
    }

    fn change(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
            *out = b - a;
        }
        for (group, _) in self.twofold.iter().filter_map(|&k| self.groups.get(k)) {
            if group.iter().map(|&i| a[i] * b[i]).sum::<f64>() < 0.0 {
                for &i in group {
                    out[i] = -b[i] - a[i];
                }
            }
        }
    }

    fn retract(&self, x: &mut [f64]) {
        for (group, length) in &self.groups {
            let now = group.iter().fold(0.0_f64, |norm, &i| norm.hypot(x[i]));
            if now > 0.0 && now.is_finite() {
                for &i in group {
                    x[i] *= length / now;
                }
            }
        }
    }

    fn linearize(&self, x: &[f64], r: &mut [f64], rows: Option<&mut [f64]>) -> Result<(), String> {
        if self.ended() {
            return Err(String::new());
        }
        Python::attach(|py| {
            let at = PyArray1::from_slice(py, x);
            let called = self
                .linearize
                .call1(py, (at, rows.is_some()))
                .and_then(|pair| pair.extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>(py))
                .and_then(|(residuals, jacobian)| {
                    Self::copy(&residuals, "residuals", r)?;
                    rows.map_or(Ok(()), |rows| Self::copy(&jacobian, "rows", rows))
                });
            called
                .and_then(|()| py.check_signals())
                .map_err(|error| self.keep(py, error))
        })
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), String> {
        Python::attach(|py| {
            let pair = (PyArray1::from_slice(py, a), PyArray1::from_slice(py, b));
            self.difference
                .bind(py)
                .call1(pair)
                .and_then(|value| Self::copy(&value, "difference", out))
                .map_err(|error| self.keep(py, error))
        })
    }

    fn symmetries(&self, x: &[f64], found: &mut dyn FnMut(&[f64])) {
        let Some(function) = &self.symmetries else {
            return;
        };
        Python::attach(|py| {
            let images = function
                .bind(py)
                .call1((PyArray1::from_slice(py, x),))
                .and_then(|value| {
                    let images = Input::new(&value, "symmetries", 2)?;
                    images.expect(&[None, Some(self.states)], "one state a line")?;
                    Ok(images.slice()?.to_vec())
                });
            match images {
                Ok(images) => images.chunks_exact(self.states).for_each(&mut *found),
                Err(error) => {
                    self.keep(py, error);
                }
            }
        });
    }
}

/// A model that now and then hears Ctrl-C.
struct Watched {
    model: Shared,
    raised: Raised,
    last: Mutex<Instant>,
}

impl Watched {
    fn interrupted(&self) -> bool {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() > Duration::from_millis(100) {
            *last = Instant::now();
            if let Err(error) = Python::attach(|py| py.check_signals()) {
                *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            }
        }
        let raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
        raised.is_some()
    }
}

impl Model for Watched {
    type Error = String;

    forward_model!(this => this.model; states, measurements, priors, exact, channels, change, extent, retract, rounding, symmetries);

    fn linearize(&self, x: &[f64], r: &mut [f64], rows: Option<&mut [f64]>) -> Result<(), String> {
        if self.interrupted() {
            return Err(String::new());
        }
        self.model.linearize(x, r, rows)
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), String> {
        if self.interrupted() {
            return Err(String::new());
        }
        self.model.difference(a, b, out)
    }
}

/// A function of the states, of the crate or in Python: x -> (value, gradient).
enum Held1 {
    Native(Box<dyn Function + Send + Sync>),
    Given {
        function: Py<PyAny>,
        range: (f64, f64),
        raised: Raised,
    },
}

impl Function for Held1 {
    fn value(&self, x: &[f64], gradient: &mut [f64]) -> f64 {
        match self {
            Self::Native(function) => function.value(x, gradient),
            Self::Given {
                function, raised, ..
            } => Python::attach(|py| {
                let called = function
                    .call1(py, (PyArray1::from_slice(py, x),))
                    .and_then(|pair| pair.extract::<(f64, Bound<'_, PyAny>)>(py))
                    .and_then(|(value, slope)| {
                        Given::copy(&slope, "gradient", gradient)?;
                        Ok(value)
                    });
                called.unwrap_or_else(|error| {
                    if !error.is_instance_of::<PyArithmeticError>(py) {
                        *raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    }
                    f64::NAN
                })
            }),
        }
    }

    fn range(&self) -> (f64, f64) {
        match self {
            Self::Native(function) => function.range(),
            Self::Given { range, .. } => *range,
        }
    }

    fn state(&self) -> Option<usize> {
        match self {
            Self::Native(function) => function.state(),
            Self::Given { .. } => None,
        }
    }
}

/// A model together with its measurements: see `gramian::solve::Model`.
#[pyclass(frozen, name = "Model", module = "gramian._core")]
pub struct PyModel {
    model: Shared,
    raised: Raised,
}

impl PyModel {
    /// For a model of the crate.
    pub fn native<M: Model + Send + 'static>(model: M) -> Self
    where
        M::Error: core::fmt::Display,
    {
        Self {
            model: Arc::new(Native(model)),
            raised: Raised::default(),
        }
    }

    /// Calls a kernel, the lock released, and raises what Python raised inside.
    fn run<R: Send>(
        &self,
        py: Python<'_>,
        kernel: impl FnOnce(&Watched) -> R + Send,
    ) -> PyResult<R> {
        let watched = Watched {
            model: Arc::clone(&self.model),
            raised: Arc::clone(&self.raised),
            last: Mutex::new(Instant::now()),
        };
        let result = py.detach(|| kernel(&watched));
        let raised = self
            .raised
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        raised.map_or(Ok(result), Err)
    }

    fn state(&self, value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Vec<f64>> {
        let state = Input::new(value, name, 1)?;
        state.expect(&[Some(self.model.states())], "one number for each state")?;
        Ok(state.slice()?.to_vec())
    }

    /// chi2 at a state, as the solution that a kernel starts from.
    fn solution(model: &Watched, x: Vec<f64>) -> Result<Solution, String> {
        let mut residuals = vec![0.0; model.measurements()];
        model.linearize(&x, &mut residuals, None)?;
        Ok(Solution {
            chi2: residuals.iter().map(|r| r * r).sum(),
            x,
            iterations: 0,
            converged: true,
            held: true,
            determined: true,
            slopes: Vec::new(),
        })
    }

    fn search(
        &self,
        from: Vec<Vec<f64>>,
        spread: Option<(&str, Vec<f64>, Vec<f64>)>,
        starts: usize,
        seed: u64,
    ) -> PyResult<Search> {
        let spread = spread.map(|(kind, first, second)| match kind {
            "box" => Spread::Box {
                low: first,
                high: second,
            },
            _ => Spread::Normal {
                mean: first,
                sigma: second,
            },
        });
        if spread
            .as_ref()
            .is_some_and(|s| s.states() != self.model.states())
        {
            return Err(InputError::new_err(
                "spread: must have a pair for each state",
            ));
        }
        Ok(Search {
            from,
            weakest: true,
            spread,
            starts,
            seed,
            options: Options::default(),
        })
    }

    fn function(&self, value: &Bound<'_, PyAny>) -> PyResult<Held1> {
        if value.is_callable() {
            let range = match value.getattr("range") {
                Ok(range) => range.extract()?,
                Err(_) => (f64::NEG_INFINITY, f64::INFINITY),
            };
            return Ok(Held1::Given {
                function: value.clone().unbind(),
                range,
                raised: Arc::clone(&self.raised),
            });
        }
        if let Ok((states, from)) = value.extract::<(Vec<usize>, Vec<f64>)>() {
            if states.iter().any(|&k| k >= self.model.states()) || states.len() != from.len() {
                return Err(InputError::new_err(
                    "distance: must name states of the model, and a coordinate for each",
                ));
            }
            return Ok(Held1::Native(Box::new(Distance { states, from })));
        }
        let combination = self.state(value, "combination")?;
        Ok(Held1::Native(Box::new(Combination(combination))))
    }

    fn states_of(&self, value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Vec<Vec<f64>>> {
        let n = self.model.states();
        let states = Input::new(value, name, 2)?;
        states.expect(&[None, Some(n)], "one state a line")?;
        Ok(states
            .slice()?
            .chunks_exact(n.max(1))
            .map(<[f64]>::to_vec)
            .collect())
    }
}

fn record<'py>(py: Python<'py>, s: &Solution) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    out.set_item("x", PyArray1::from_slice(py, &s.x))?;
    out.set_item("chi2", s.chi2)?;
    out.set_item("iterations", s.iterations)?;
    out.set_item("converged", s.converged)?;
    out.set_item("determined", s.determined)?;
    Ok(out)
}

#[pymethods]
impl PyModel {
    /// From functions in Python; the last `priors` measurements are prior knowledge, and the
    /// states of each of `groups` keep the length of their vector; those at the places `twofold`
    /// of them mean the same with the opposite sign.
    #[staticmethod]
    #[pyo3(signature = (
        states, measurements, linearize, difference, symmetries, priors=0, groups=Vec::new(),
        twofold=Vec::new()
    ))]
    #[allow(clippy::too_many_arguments)]
    fn from_functions(
        states: usize,
        measurements: usize,
        linearize: Py<PyAny>,
        difference: Py<PyAny>,
        symmetries: Option<Py<PyAny>>,
        priors: usize,
        groups: Vec<(Vec<usize>, f64)>,
        twofold: Vec<usize>,
    ) -> PyResult<Self> {
        if groups.iter().any(|(g, _)| g.iter().any(|&i| i >= states)) {
            return Err(InputError::new_err("groups: must name states of the model"));
        }
        let raised = Raised::default();
        Ok(Self {
            model: Arc::new(Given {
                states,
                measurements,
                priors: priors.min(measurements),
                groups,
                twofold,
                linearize,
                difference,
                symmetries,
                raised: Arc::clone(&raised),
            }),
            raised,
        })
    }

    /// Bearings of one target.
    #[staticmethod]
    fn bearings(
        times: &Bound<'_, PyAny>,
        observer: &Bound<'_, PyAny>,
        bearings: &Bound<'_, PyAny>,
        sigma: &Bound<'_, PyAny>,
        states: usize,
    ) -> PyResult<Self> {
        let times = Input::new(times, "times", 1)?;
        times.expect_entries()?;
        let m = times.core_shape()[0];
        let observer = Input::new(observer, "observer", 2)?;
        observer.expect(&[Some(m), Some(2)], "an east and a north for each time")?;
        let bearings = Input::new(bearings, "bearings", 1)?;
        bearings.expect(&[Some(m)], "one bearing for each time")?;
        let sigma = Input::new(sigma, "sigma", 1)?;
        if sigma.core_shape() != [1] {
            sigma.expect(&[Some(m)], "one standard deviation, or one for each time")?;
        }
        sigma.expect_positive("rad")?;
        let first = times.slice()?[0];
        Ok(Self::native(Measured {
            times: times.slice()?.iter().map(|t| t - first).collect(),
            observer: observer.slice()?.as_chunks::<2>().0.to_vec(),
            bearings: bearings.slice()?.to_vec(),
            sigma: sigma.slice()?.to_vec(),
            states,
        }))
    }

    #[getter]
    fn states(&self) -> usize {
        self.model.states()
    }

    #[getter]
    fn measurements(&self) -> usize {
        self.model.measurements()
    }

    /// The same with independent normal priors of combinations of the states (q, n): their
    /// means (q,) and deviations (q,), infinite for none.
    fn with_prior(
        &self,
        combinations: &Bound<'_, PyAny>,
        mean: &Bound<'_, PyAny>,
        sigma: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let combinations = Input::new(combinations, "prior", 2)?;
        combinations.expect(
            &[None, Some(self.model.states())],
            "one coefficient for each state",
        )?;
        let count = combinations.core_shape()[0];
        let mean = Input::new(mean, "prior mean", 1)?;
        let sigma = Input::unchecked(sigma, "prior sigma", 1)?;
        for each in [&mean, &sigma] {
            each.expect(&[Some(count)], "one for each combination")?;
        }
        let model = WithPrior::new(
            Arc::clone(&self.model),
            combinations.slice()?,
            mean.slice()?,
            sigma.slice()?,
        );
        Ok(Self {
            model: Arc::new(model),
            raised: Arc::clone(&self.raised),
        })
    }

    /// The same with some states known, which are no states of it any more.
    fn with_known(&self, known: Vec<Option<f64>>) -> PyResult<Self> {
        if known.len() != self.model.states() {
            return Err(InputError::new_err(format!(
                "known has {} entries: must have {}",
                known.len(),
                self.model.states()
            )));
        }
        Ok(Self {
            model: Arc::new(Held::new(Arc::clone(&self.model), &known)),
            raised: Arc::clone(&self.raised),
        })
    }

    /// Residuals and rows at a state.
    fn linearize<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let x = self.state(x, "x")?;
        let (m, n) = (self.model.measurements(), self.model.states());
        let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
        self.run(py, |model| {
            model.linearize(&x, &mut residuals, Some(&mut rows))
        })?
        .map_err(InputError::new_err)?;
        let rows = PyArray1::from_vec(py, rows).reshape([m, n])?;
        Ok((PyArray1::from_vec(py, residuals), rows))
    }

    /// What the starts reach, the best first.
    #[pyo3(signature = (starts, loss, max_iterations))]
    fn minimize<'py>(
        &self,
        py: Python<'py>,
        starts: &Bound<'py, PyAny>,
        loss: (&str, f64),
        max_iterations: u32,
    ) -> PyResult<Bound<'py, PyList>> {
        let starts = self.states_of(starts, "starts")?;
        let loss = match loss {
            ("huber", c) => Loss::Huber(c),
            ("tukey", c) => Loss::Tukey(c),
            _ => Loss::Squares,
        };
        let options = Options {
            max_iterations,
            loss,
            ..Options::default()
        };
        let (clusters, unbounded) = self.run(py, |model| {
            let first: Vec<_> = starts.iter().take(4).cloned().collect();
            let mut clusters = multi_start(model, starts.into_iter(), options);
            let mut unbounded = false;
            if let Some(best) = clusters.first_mut()
                && let Some(within) = within_reach(model, &best.solution, &first, options)
            {
                unbounded = within.unbounded;
                best.solution = within.solution;
            }
            (clusters, unbounded)
        })?;
        let records = clusters.iter().map(|c| {
            let out = record(py, &c.solution)?;
            out.set_item("hits", c.hits)?;
            out.set_item("unbounded", unbounded)?;
            Ok(out)
        });
        PyList::new(py, records.collect::<PyResult<Vec<_>>>()?)
    }

    /// Other solutions, from states `more` too, and the best of all.
    #[pyo3(signature = (x, more, spread, starts, seed))]
    fn others<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        more: &Bound<'py, PyAny>,
        spread: Option<(&str, Vec<f64>, Vec<f64>)>,
        starts: usize,
        seed: u64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let x = self.state(x, "x")?;
        let search = self.search(self.states_of(more, "more")?, spread, starts, seed)?;
        let found: Found = self
            .run(py, |model| {
                Self::solution(model, x).map(|from| other_solutions(model, &from, &search))
            })?
            .map_err(InputError::new_err)?;
        let out = record(py, &found.best)?;
        let others = found.others.iter().map(|other| {
            let out = record(py, &other.solution)?;
            out.set_item("distance", other.distance)?;
            out.set_item("chance", other.chance)?;
            out.set_item("hits", other.hits)?;
            Ok(out)
        });
        out.set_item(
            "others",
            PyList::new(py, others.collect::<PyResult<Vec<_>>>()?)?,
        )?;
        out.set_item("starts", found.starts)?;
        out.set_item("single", found.single)?;
        out.set_item("unseen", found.unseen)?;
        Ok(out)
    }

    /// Interval of a function: a combination, (states, from) for a distance, or a
    /// function in Python.
    fn interval<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        others: &Bound<'py, PyAny>,
        function: &Bound<'py, PyAny>,
        rise: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (x, others) = (self.state(x, "x")?, self.states_of(others, "others")?);
        let function = self.function(function)?;
        let found = self
            .run(py, |model| {
                let best = Self::solution(model, x)?;
                let others: Vec<Solution> = others
                    .into_iter()
                    .filter_map(|x| Self::solution(model, x).ok())
                    .collect();
                let options = Options::default();
                Ok(region::interval(
                    model, &best, &others, &function, rise, options,
                ))
            })?
            .map_err(InputError::new_err::<String>)?;
        let out = PyDict::new(py);
        let pieces: Vec<_> = found.pieces.iter().map(|p| (p.low, p.high)).collect();
        out.set_item("pieces", pieces)?;
        let certain = found.pieces.iter().all(|p| p.certain == [true; 2]);
        out.set_item("certain", certain)?;
        out.set_item("local", found.local)?;
        out.set_item("solves", found.solves)?;
        let better = found.better.as_ref().map(|s| record(py, s)).transpose()?;
        out.set_item("better", better)?;
        Ok(out)
    }

    /// Contours of a pair of functions: (points, closed) each.
    fn contours<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        others: &Bound<'py, PyAny>,
        functions: (Bound<'py, PyAny>, Bound<'py, PyAny>),
        rise: f64,
    ) -> PyResult<Vec<(Bound<'py, PyArray2<f64>>, bool, bool)>> {
        let (x, others) = (self.state(x, "x")?, self.states_of(others, "others")?);
        let pair = (self.function(&functions.0)?, self.function(&functions.1)?);
        let found = self
            .run(py, |model| {
                let best = Self::solution(model, x)?;
                let others: Vec<Solution> = others
                    .into_iter()
                    .filter_map(|x| Self::solution(model, x).ok())
                    .collect();
                let functions: [&dyn Function; 2] = [&pair.0, &pair.1];
                let (fineness, options) = (region::Fineness::default(), Options::default());
                Ok(region::contours(
                    model, &best, &others, functions, rise, fineness, options,
                ))
            })?
            .map_err(InputError::new_err::<String>)?;
        found
            .iter()
            .map(|c| {
                let flat: Vec<f64> = c.points.iter().flatten().copied().collect();
                let points = PyArray1::from_vec(py, flat).reshape([c.points.len(), 2])?;
                Ok((points, c.closed, c.complete))
            })
            .collect()
    }

    /// Simulates records of the state `truth`, whose exact data the model has, and answers
    /// them: (trials, size), see `gramian::solve::trials::Trials::run`.
    #[pyo3(signature = (truth, starts, spread, search, function, rises, alternatives, shift, seed, first, trials))]
    #[allow(clippy::too_many_arguments)]
    fn trials<'py>(
        &self,
        py: Python<'py>,
        truth: &Bound<'py, PyAny>,
        starts: &Bound<'py, PyAny>,
        spread: Option<(&str, Vec<f64>, Vec<f64>)>,
        search: Option<(usize, u64)>,
        function: Option<Bound<'py, PyAny>>,
        rises: [f64; 2],
        alternatives: Vec<Bound<'py, PyAny>>,
        shift: Option<Bound<'py, PyAny>>,
        seed: u64,
        first: u64,
        trials: usize,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (truth, starts) = (
            self.state(truth, "truth")?,
            self.states_of(starts, "starts")?,
        );
        let data = self.model.measurements() - self.model.priors();
        let mut columns = Vec::new();
        for given in &alternatives {
            let given = Input::new(given, "columns", 2)?;
            given.expect(&[Some(data), None], "a line for each measurement")?;
            columns.push((given.slice()?.to_vec(), given.core_shape()[1]));
        }
        let shift = match shift {
            None => Vec::new(),
            Some(given) => {
                let given = Input::new(&given, "shift", 1)?;
                given.expect(&[Some(data)], "one for each measurement")?;
                given.slice()?.to_vec()
            }
        };
        let function = function.map(|f| self.function(&f)).transpose()?;
        let search = search
            .map(|(starts, seed)| self.search(Vec::new(), spread, starts, seed))
            .transpose()?;
        let size = self.model.measurements();
        let (m, n) = (size as f64, truth.len() as f64);
        // Of an evaluation, in ns: measured too, as the model may be a Python function.
        let started = Instant::now();
        let (mut left, mut rows) = (vec![0.0; size], vec![0.0; size * truth.len()]);
        // What fails here fails in the trials, and is told there.
        let _ = self.model.linearize(&truth, &mut left, Some(&mut rows));
        let once = (200.0 * m * n).max(started.elapsed().as_nanos() as f64);
        // Of a solve, times how many there are.
        let cost = once * (10.0 + 5.0 * starts.len() as f64);
        let head = Trials::<dyn Model<Error = String> + Send + Sync>::HEAD;
        let size = head + truth.len() + columns.len();
        Batch::trials(first, trials).fill(py, &[size], cost, |range, threads, out| {
            let trials = Trials {
                model: &*self.model,
                truth: &truth,
                starts: &starts,
                search: search.as_ref(),
                function: function.as_ref().map(|f| f as &(dyn Function + Sync)),
                rises,
                alternatives: &columns,
                shift: &shift,
                seed,
                first: first + range.start as u64,
            };
            trials.run(threads, cost, out);
            // What Python raised, Ctrl-C among it, ends the rest.
            let raised = self.raised.lock();
            let raised = raised.unwrap_or_else(PoisonError::into_inner).take();
            raised.map_or(Ok(()), Err)
        })
    }

    /// How many other minima there are, by `many` starts, how many of them a search of `starts`
    /// finds, and how many places came up that are no minima of their own.
    #[pyo3(signature = (x, spread, starts, seed, many, reach))]
    #[allow(clippy::too_many_arguments)]
    fn recall<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        spread: (&str, Vec<f64>, Vec<f64>),
        starts: usize,
        seed: u64,
        many: usize,
        reach: f64,
    ) -> PyResult<(usize, usize, usize)> {
        let x = self.state(x, "x")?;
        let search = self.search(Vec::new(), Some(spread), starts, seed)?;
        let recall = self.run(py, |model| recall(model, &x, &search, many, reach))?;
        Ok((recall.minima, recall.found, recall.level))
    }

    /// What the residuals at a state say.
    fn fit<'py>(&self, py: Python<'py>, x: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
        let x = self.state(x, "x")?;
        let fit = self
            .run(py, |model| Fit::new(model, &x))?
            .map_err(InputError::new_err)?;
        let out = PyDict::new(py);
        let data = fit.residuals.len() - fit.priors;
        out.set_item("chi2", fit.chi2())?;
        out.set_item("dof", fit.dof())?;
        out.set_item("p_value", fit.p_value())?;
        out.set_item(
            "residuals",
            PyArray1::from_slice(py, &fit.residuals[..data]),
        )?;
        out.set_item(
            "standardized",
            PyArray1::from_slice(py, &fit.standardized()[..data]),
        )?;
        let lag = fit.lag1();
        out.set_item("lag1", (lag.correlation, lag.mean, lag.sigma, lag.p_value))?;
        Ok(out)
    }

    /// The Weiss-Weinstein bound (n, n), the largest standard error of its diagonal, and
    /// which test vectors count.
    fn weiss_weinstein<'py>(
        &self,
        py: Python<'py>,
        mean: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
        vectors: &Bound<'py, PyAny>,
        samples: usize,
    ) -> PyResult<(
        Bound<'py, PyArray2<f64>>,
        Bound<'py, PyArray1<f64>>,
        Vec<usize>,
    )> {
        let (mean, sigma) = (self.state(mean, "mean")?, self.state(sigma, "sigma")?);
        let vectors = self.states_of(vectors, "vectors")?;
        let n = mean.len();
        let found = self
            .run(py, |model| {
                threshold::weiss_weinstein(model, &mean, &sigma, &vectors, samples)
            })?
            .map_err(InputError::new_err)?;
        let bound = PyArray1::from_vec(py, found.bound).reshape([n, n])?;
        let error = PyArray1::from_vec(py, found.standard_error);
        Ok((bound, error, found.used))
    }

    /// Score tests of alternatives, whitened columns (m, parameters) each.
    fn scores<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        alternatives: Vec<Bound<'py, PyAny>>,
        alpha: f64,
        power: f64,
    ) -> PyResult<(Vec<Bound<'py, PyDict>>, Vec<Vec<f64>>)> {
        let x = self.state(x, "x")?;
        let fit = self
            .run(py, |model| Fit::new(model, &x))?
            .map_err(InputError::new_err)?;
        let priors = fit.priors;
        // All of them are tested together at alpha.
        let share = alpha / alternatives.len().max(1) as f64;
        let mut found = Vec::new();
        for columns in &alternatives {
            let columns = Input::new(columns, "columns", 2)?;
            let data = fit.residuals.len() - priors;
            columns.expect(&[Some(data), None], "a line for each measurement")?;
            let score = fit.score(columns.slice()?, columns.core_shape()[1], share, power);
            found.push(score);
        }
        let alike = found
            .iter()
            .map(|a| found.iter().map(|b| fit::correlation(a, b)).collect())
            .collect();
        let records = found.iter().map(|score| {
            let out = PyDict::new(py);
            out.set_item("statistic", score.statistic)?;
            out.set_item("dof", score.dof)?;
            out.set_item("p_value", score.p_value)?;
            out.set_item("restored", score.restored)?;
            out.set_item("size", PyArray1::from_slice(py, &score.size))?;
            out.set_item("detectable", score.detectable)?;
            out.set_item("effect", PyArray1::from_slice(py, &score.effect))?;
            Ok(out)
        });
        Ok((records.collect::<PyResult<_>>()?, alike))
    }
}

/// What each channel of recordings (..., m) looks like, with the deviation of each value and
/// the places of the readings of each channel: (..., channels, 3), first 0 for a sound one,
/// 1 for a constant one, 2 for one stuck from one sample to another, 3 for a copy of a channel.
#[pyfunction]
fn channels<'py>(
    py: Python<'py>,
    values: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    places: Vec<Vec<usize>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let mut values = Input::unchecked(values, "values", 1)?;
    let m = values.core_shape()[0];
    let mut sigma = Input::unchecked(sigma, "sigma", 1)?;
    sigma.expect(&[Some(m)], "one for each value")?;
    if places.iter().flatten().any(|&i| i >= m) {
        return Err(InputError::new_err(format!(
            "places: must be of the {m} values"
        )));
    }
    let batch = Batch::of(&mut [&mut values, &mut sigma])?;
    let (values, sigma) = (values.items()?, sigma.items()?);
    let places: Vec<&[usize]> = places.iter().map(Vec::as_slice).collect();
    let size = 3 * places.len();
    let cost = 100.0 + 3.0 * m as f64;
    batch.fill(py, &[places.len(), 3], cost, |range, threads, out| {
        let first = range.start;
        let Ok(()) = threads.over(out, size.max(1), cost, |trial, out: &mut [f64]| {
            let (values, sigma) = (values.get(first + trial), sigma.get(first + trial));
            let found = fit::channels(values, sigma, &places);
            for (out, channel) in out.chunks_exact_mut(3).zip(found) {
                let told = match channel {
                    Channel::Sound => [0.0; 3],
                    Channel::Constant => [1.0, 0.0, 0.0],
                    Channel::Stuck { first, last } => [2.0, first as f64, last as f64],
                    Channel::Copy { of } => [3.0, of as f64, 0.0],
                };
                out.copy_from_slice(&told);
            }
            Ok::<(), core::convert::Infallible>(())
        });
    })
}

/// The Barankin bound (n, n) from rows at x, offsets of test points and the differences
/// of their exact data.
#[pyfunction]
fn barankin<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
    offsets: &Bound<'py, PyAny>,
    differences: &Bound<'py, PyAny>,
) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
    let rows = Input::new(rows, "rows", 2)?;
    let (m, n) = (rows.core_shape()[0], rows.core_shape()[1]);
    let offsets = Input::new(offsets, "offsets", 2)?;
    offsets.expect(&[None, Some(n)], "a test point a line")?;
    let points = offsets.core_shape()[0];
    let differences = Input::new(differences, "differences", 2)?;
    differences.expect(&[Some(points), Some(m)], "a test point a line")?;
    let bound = threshold::barankin(rows.slice()?, n, offsets.slice()?, differences.slice()?);
    bound
        .map(|b| PyArray1::from_vec(py, b).reshape([n, n]))
        .transpose()
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyModel>()?;
    module.add_function(wrap_pyfunction!(channels, module)?)?;
    module.add_function(wrap_pyfunction!(barankin, module)?)
}
