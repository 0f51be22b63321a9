//! Estimates of a moving target from bearings.

use gramian::batch::simd::Path;
use gramian::bearings::batch::localize::{self as kernel, Layout, Options, Prior, Track};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::Input;
use crate::errors::InputError;
use crate::output::Batch;

/// Times, observer, sigma and prior as they come from Python.
struct Given<'py> {
    times: Input<'py>,
    observer: Input<'py>,
    sigma: Input<'py>,
    prior: Option<(Input<'py>, Input<'py>)>,
}

impl<'py> Given<'py> {
    /// `several`: bearings of several observers may have the same time.
    fn new(
        times: &Bound<'py, PyAny>,
        observer: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
        prior: Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>,
        states: usize,
        several: bool,
    ) -> PyResult<Self> {
        if !matches!(states, 2 | 4 | 6 | 8) {
            return Err(InputError::new_err(format!(
                "{states} states: must be 2, 4, 6 or 8"
            )));
        }
        let times = Input::new(times, "times", 1)?;
        times.expect_entries()?;
        if !several {
            times.expect_increasing("s")?;
        }
        let m = times.core_shape()[0];
        let observer = Input::new(observer, "observer", 2)?;
        observer.expect(&[Some(m), Some(2)], "an east and a north for each time")?;
        let sigma = Input::levels(sigma, "sigma [rad]")?;
        sigma.expect_one_or(m, "one standard deviation, or one for each time")?;
        sigma.expect_positive("rad")?;
        let prior = prior
            .map(|(mean, sigma)| {
                let mean = Input::new(&mean, "prior mean", 1)?;
                let sigma = Input::unchecked(&sigma, "prior sigma", 1)?;
                mean.expect(&[Some(states)], "one mean for each state")?;
                sigma.expect(&[Some(states)], "one deviation for each state")?;
                sigma.expect_positive("")?;
                Ok::<_, PyErr>((mean, sigma))
            })
            .transpose()?;
        Ok(Self {
            times,
            observer,
            sigma,
            prior,
        })
    }

    fn inputs<'a>(&'a mut self, more: &'a mut Input<'py>) -> Vec<&'a mut Input<'py>> {
        let mut all = vec![&mut self.times, &mut self.observer, &mut self.sigma, more];
        if let Some((mean, sigma)) = &mut self.prior {
            all.extend([mean, sigma]);
        }
        all
    }

    fn track(&self) -> PyResult<Track<'_>> {
        let prior = self.prior.as_ref().map(|(mean, sigma)| {
            Ok::<_, PyErr>(Prior {
                mean: mean.items()?,
                sigma: sigma.items()?,
            })
        });
        Ok(Track {
            times: self.times.items()?,
            observer: self.observer.items()?,
            sigma: self.sigma.items()?,
            prior: prior.transpose()?,
        })
    }
}

fn from_trial<'a>(track: &Track<'a>, first: usize) -> Track<'a> {
    Track {
        times: track.times.skip(first),
        observer: track.observer.skip(first),
        sigma: track.sigma.skip(first),
        prior: track.prior.map(|prior| Prior {
            mean: prior.mean.skip(first),
            sigma: prior.sigma.skip(first),
        }),
    }
}

/// Results (..., size) as `Layout::size` orders them.
#[pyfunction]
#[pyo3(signature = (times, observer, bearings, sigma, states, prior, several, rtol, max_iterations, weak_ratio, correlation))]
#[allow(clippy::too_many_arguments)]
fn bearings_localize<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    observer: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    states: usize,
    prior: Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>,
    several: bool,
    rtol: Option<f64>,
    max_iterations: u32,
    weak_ratio: f64,
    correlation: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let mut given = Given::new(times, observer, sigma, prior, states, several)?;
    let m = given.times.core_shape()[0];
    let mut bearings = Input::new(bearings, "bearings", 1)?;
    bearings.expect(&[Some(m)], "one bearing for each time")?;
    let batch = Batch::of(&mut given.inputs(&mut bearings))?;
    let options = Options {
        rtol,
        max_iterations,
        weak_ratio,
        correlation,
    };
    let size = Layout { states }.size();
    let (track, bearings) = (given.track()?, bearings.items()?);
    let cost = kernel::cost(m, states);
    let records = batch.fill(py, &[size], cost, |range, threads, out| {
        kernel::localize(
            &from_trial(&track, range.start),
            bearings.skip(range.start),
            states,
            options,
            threads,
            Path::Best,
            out,
        );
    })?;
    let n = states;
    let parts: [(&str, &[usize]); 8] = [
        ("state", &[n]),
        ("null_direction", &[n]),
        ("covariance", &[n, n]),
        ("status", &[]),
        ("nullity", &[]),
        ("iterations", &[]),
        ("chi2", &[]),
        ("lag_p_value", &[]),
    ];
    batch.named(&records, &parts)
}

/// Results (trials, size) as `Layout::trial_size` orders them, of the simulated
/// trials `first..first + trials`.
#[pyfunction]
#[pyo3(signature = (times, observer, truth, sigma, seed, first, trials, prior, several, rtol, max_iterations, weak_ratio))]
#[allow(clippy::too_many_arguments)]
fn bearings_localize_trials<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    observer: &Bound<'py, PyAny>,
    truth: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    seed: u64,
    first: u64,
    trials: usize,
    prior: Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>,
    several: bool,
    rtol: Option<f64>,
    max_iterations: u32,
    weak_ratio: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let mut truth = Input::new(truth, "truth", 1)?;
    let states = truth.core_shape()[0];
    let mut given = Given::new(times, observer, sigma, prior, states, several)?;
    let m = given.times.core_shape()[0];
    let batch = Batch::of(&mut given.inputs(&mut truth))?;
    if batch.len() != 1 && batch.len() != trials {
        return Err(InputError::new_err(format!(
            "the inputs have {} leading entries: must have none, or one for each of {trials} trials",
            batch.len()
        )));
    }
    let options = Options {
        rtol,
        max_iterations,
        weak_ratio,
        ..Options::default()
    };
    let size = Layout { states }.trial_size();
    let (track, truth) = (given.track()?, truth.items()?);
    let cost = kernel::cost(m, states) + 15.0 * m as f64;
    let batch = Batch::trials(first, trials);
    let records = batch.fill(py, &[size], cost, |range, threads, out| {
        kernel::simulate_and_localize(
            &from_trial(&track, range.start),
            truth.skip(range.start),
            seed,
            first + range.start as u64,
            options,
            threads,
            Path::Best,
            out,
        )
    })?;
    let parts: [(&str, &[usize]); 6] = [
        ("error", &[states]),
        ("std", &[states]),
        ("nees", &[]),
        ("chi2", &[]),
        ("status", &[]),
        ("iterations", &[]),
    ];
    batch.named(&records, &parts)
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(bearings_localize, module)?)?;
    module.add_function(wrap_pyfunction!(bearings_localize_trials, module)?)
}
