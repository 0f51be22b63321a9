//! Registration biases of sensors.

use gramian::batch::simd::Path;
use gramian::registration::batch::{self, Degree, Scene};
use gramian::registration::estimate::{Method, Question};
use gramian::registration::measured::Measured;
use gramian::registration::{Dimension, Layout};
use gramian::solve::Model;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::Input;
use crate::errors::InputError;
use crate::output::Batch;
use crate::solve::PyModel;

/// Sensors, noise, biases and targets as they come from Python.
struct Given<'py> {
    layout: Layout,
    sensors: Input<'py>,
    sigma: Input<'py>,
    biases: Input<'py>,
    positions: Input<'py>,
}

/// Which biases there are beyond those of the measured quantities: gain,
/// position, attitude.
type Extras = (bool, bool, bool);

/// Linearisations at most, tolerance, noise share, bend: see `Question`.
type Settings = (usize, f64, f64, f64);

/// Places (N, d), or with a third axis places (K, N, d) of platforms that move.
fn sensors_of<'py>(value: &Bound<'py, PyAny>) -> PyResult<Input<'py>> {
    let axes = value
        .getattr("ndim")
        .and_then(|ndim| ndim.extract::<usize>());
    Input::new(
        value,
        "sensors",
        if axes.is_ok_and(|axes| axes == 3) {
            3
        } else {
            2
        },
    )
}

/// Checks that platforms that move have places for each of `looks` looks.
fn expect_looks(sensors: &Input<'_>, looks: usize) -> PyResult<()> {
    match sensors.core_shape() {
        &[_, count, d] => sensors.expect(
            &[Some(looks), Some(count), Some(d)],
            "the places of all sensors for each look",
        ),
        _ => Ok(()),
    }
}

fn layout_of(sensors: &Input<'_>, (gain, position, attitude): Extras) -> PyResult<Layout> {
    let (count, d) = match *sensors.core_shape() {
        [count, d] | [_, count, d] => (count, d),
        _ => (0, 0),
    };
    let dimension = match d {
        2 => Dimension::Plane,
        3 => Dimension::Space,
        _ => {
            sensors.expect(&[None, Some(2)], "east and north, or east, north and up")?;
            Dimension::Plane
        }
    };
    Ok(Layout {
        dimension,
        sensors: count,
        gain,
        position,
        attitude,
    })
}

impl<'py> Given<'py> {
    /// `core` is the number of axes of one item of `targets`: 2 for positions,
    /// 3 for reports.
    fn new(
        targets: (&Bound<'py, PyAny>, &'static str, usize),
        sensors: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
        biases: &Bound<'py, PyAny>,
        extras: Extras,
    ) -> PyResult<Self> {
        let sensors = sensors_of(sensors)?;
        let layout = layout_of(&sensors, extras)?;
        let (count, d) = (layout.sensors, layout.size());
        let sigma = Input::new(sigma, "sigma", 2)?;
        sigma.expect(&[Some(count), Some(d)], "one line for each sensor")?;
        let biases = Input::new(biases, "biases", 1)?;
        biases.expect(&[Some(layout.states())], "the biases of all sensors")?;
        let (value, name, core) = targets;
        let positions = Input::new(value, name, core)?;
        if core == 2 {
            positions.expect(&[None, Some(d)], "one position for each look")?;
        } else {
            let wanted = [None, Some(count), Some(d)];
            positions.expect(&wanted, "for each look one line from each sensor")?;
        }
        positions.expect_entries()?;
        expect_looks(&sensors, positions.core_shape()[0])?;
        Ok(Self {
            layout,
            sensors,
            sigma,
            biases,
            positions,
        })
    }

    fn batch(&mut self, out: Option<&Bound<'py, PyAny>>) -> PyResult<Batch> {
        let inputs = &mut [
            &mut self.sensors,
            &mut self.sigma,
            &mut self.biases,
            &mut self.positions,
        ];
        Batch::into(inputs, out)
    }

    fn scene(&self) -> PyResult<Scene<'_>> {
        Ok(Scene {
            layout: self.layout,
            sensors: self.sensors.items()?,
            sigma: self.sigma.items()?,
            biases: self.biases.items()?,
            positions: self.positions.items()?,
        })
    }

    fn looks(&self) -> usize {
        self.positions.core_shape()[0]
    }

    /// An array, `core` for each trial, that `kernel` fills: `out`, or a new one.
    fn fill(
        mut self,
        py: Python<'py>,
        out: Option<&Bound<'py, PyAny>>,
        core: &[usize],
        cost: impl Fn(&Scene<'_>) -> f64,
        mut kernel: impl FnMut(
            Scene<'_>,
            gramian::batch::Threads,
            &mut [f64],
        ) -> Result<(), (usize, gramian::registration::Error)>
        + Send,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let batch = self.batch(out)?;
        let scene = self.scene()?;
        batch.fill(py, core, cost(&scene), |range, threads, out| {
            kernel(scene.skip(range.start), threads, out)
        })
    }
}

fn rows_cost(scene: &Scene<'_>) -> f64 {
    scene.cost()
}

fn fisher_cost(scene: &Scene<'_>) -> f64 {
    scene.fisher_cost()
}

/// Rows (..., K (N-1) d, n).
#[pyfunction]
#[pyo3(signature = (positions, sensors, sigma, biases, extras, out=None))]
fn registration_rows<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    biases: &Bound<'py, PyAny>,
    extras: Extras,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let given = Given::new((positions, "positions", 2), sensors, sigma, biases, extras)?;
    let count = given.looks() * given.layout.sensors.saturating_sub(1) * given.layout.size();
    let core = [count, given.layout.states()];
    given.fill(py, out, &core, rows_cost, batch::rows)
}

/// How much of each column of the rows is rounding of coordinates (..., n).
#[pyfunction]
fn registration_rounding<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    biases: &Bound<'py, PyAny>,
    extras: Extras,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let given = Given::new((positions, "positions", 2), sensors, sigma, biases, extras)?;
    let n = given.layout.states();
    given.fill(py, None, &[n], rows_cost, batch::rounding)
}

/// Fisher information (..., n, n).
#[pyfunction]
#[pyo3(signature = (positions, sensors, sigma, biases, extras, out=None))]
fn registration_fisher<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    biases: &Bound<'py, PyAny>,
    extras: Extras,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let given = Given::new((positions, "positions", 2), sensors, sigma, biases, extras)?;
    let n = given.layout.states();
    given.fill(py, out, &[n, n], fisher_cost, |scene, threads, out| {
        batch::fisher(scene, threads, Path::Best, out)
    })
}

/// eta (...) of whole tracks.
#[pyfunction]
#[pyo3(signature = (positions, sensors, sigma, biases, out=None))]
fn registration_eta<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    biases: &Bound<'py, PyAny>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let simple = (false, false, false);
    let given = Given::new((positions, "positions", 2), sensors, sigma, biases, simple)?;
    given.fill(py, out, &[], rows_cost, batch::eta)
}

/// eta (..., K) along tracks.
#[pyfunction]
#[pyo3(signature = (positions, sensors, sigma, biases, window, out=None))]
fn registration_running_eta<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    biases: &Bound<'py, PyAny>,
    window: Option<usize>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let simple = (false, false, false);
    let given = Given::new((positions, "positions", 2), sensors, sigma, biases, simple)?;
    let core = [given.looks()];
    given.fill(py, out, &core, rows_cost, |scene, threads, out| {
        batch::running_eta(scene, window, threads, out)
    })
}

/// Degrees (..., pairs) between two instants of two sensors in the plane.
#[pyfunction]
#[pyo3(signature = (positions, sensors, sigma, instants, whitened, out=None))]
fn registration_pair_degrees<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    instants: Vec<(usize, usize)>,
    whitened: bool,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let simple = (false, false, false);
    let none = PyArray1::<f64>::zeros(py, 4, false);
    let given = Given::new((positions, "positions", 2), sensors, sigma, &none, simple)?;
    let looks = given.looks();
    for (place, &(i, j)) in instants.iter().enumerate() {
        if i >= looks || j >= looks {
            return Err(InputError::new_err(format!(
                "instants[{place}] = ({i}, {j}): must be below {looks}, the number of looks"
            )));
        }
    }
    let instants: Vec<[usize; 2]> = instants.into_iter().map(|(i, j)| [i, j]).collect();
    let degree = if whitened {
        Degree::Pair
    } else {
        Degree::Paper
    };
    let core = [instants.len()];
    given.fill(py, out, &core, rows_cost, |scene, threads, out| {
        batch::pair_degrees(scene, degree, &instants, threads, out)
    })
}

/// Reports (..., K, N, d) without noise.
#[pyfunction]
fn registration_reports<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    biases: &Bound<'py, PyAny>,
    extras: Extras,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let given = Given::new((positions, "positions", 2), sensors, sigma, biases, extras)?;
    let core = [given.looks(), given.layout.sensors, given.layout.size()];
    given.fill(py, None, &core, rows_cost, batch::reports)
}

/// Positions (..., K, N, d) where each sensor's reports put the target.
#[pyfunction]
fn registration_places<'py>(
    py: Python<'py>,
    reports: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    biases: &Bound<'py, PyAny>,
    extras: Extras,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let given = Given::new((reports, "reports", 3), sensors, sigma, biases, extras)?;
    let core = given.positions.core_shape().to_vec();
    given.fill(py, None, &core, rows_cost, |scene, threads, out| {
        let Scene {
            layout,
            sensors,
            biases,
            positions,
            ..
        } = scene;
        batch::places(layout, sensors, biases, positions, threads, out);
        Ok(())
    })
}

fn method_of(name: &str) -> PyResult<Method> {
    match name {
        "ls" => Ok(Method::LeastSquares),
        "gls" => Ok(Method::Generalised),
        "ml" => Ok(Method::MaximumLikelihood),
        _ => Err(InputError::new_err(format!(
            "method = {name:?}: must be \"ls\", \"gls\" or \"ml\""
        ))),
    }
}

/// What [`Question`] borrows.
struct Asked<'py> {
    layout: Layout,
    sensors: Input<'py>,
    sigma: Input<'py>,
    prior: Option<Input<'py>>,
    method: Method,
    iterations: usize,
    tolerance: f64,
    noise_share: f64,
    bend: f64,
}

impl<'py> Asked<'py> {
    fn new(
        sensors: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
        extras: Extras,
        prior: Option<&Bound<'py, PyAny>>,
        method: &str,
        (iterations, tolerance, noise_share, bend): Settings,
    ) -> PyResult<Self> {
        let sensors = sensors_of(sensors)?;
        let layout = layout_of(&sensors, extras)?;
        let sigma = Input::new(sigma, "sigma", 2)?;
        let wanted = [Some(layout.sensors), Some(layout.size())];
        sigma.expect(&wanted, "one line for each sensor")?;
        sensors.expect_single("all estimates share them")?;
        sigma.expect_single("all estimates share them")?;
        let prior = prior
            .map(|value| Input::unchecked(value, "prior", 1))
            .transpose()?;
        if let Some(prior) = &prior {
            prior.expect(&[Some(layout.states())], "a deviation for each bias")?;
            prior.expect_positive("")?;
        }
        Ok(Self {
            layout,
            sensors,
            sigma,
            prior,
            method: method_of(method)?,
            iterations,
            tolerance,
            noise_share,
            bend,
        })
    }

    fn question(&self) -> PyResult<Question<'_, f64>> {
        Ok(Question {
            layout: self.layout,
            sensors: self.sensors.slice()?,
            sigma: self.sigma.slice()?,
            prior: self.prior.as_ref().map(Input::slice).transpose()?,
            method: self.method,
            iterations: self.iterations,
            tolerance: self.tolerance,
            noise_share: self.noise_share,
            bend: self.bend,
        })
    }
}

/// What a record of `answer_size` holds, by name.
fn named_answer<'py>(
    batch: &Batch,
    records: &Bound<'py, PyArrayDyn<f64>>,
    layout: &Layout,
    looks: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let n = layout.states();
    let parts: [(&str, &[usize]); 10] = [
        ("biases", &[n]),
        ("covariance", &[n, n]),
        ("directions", &[n, n]),
        ("status", &[]),
        ("iterations", &[]),
        ("chi_square", &[]),
        ("nullity", &[]),
        ("noise_share", &[]),
        ("bend", &[]),
        ("positions", &[looks, layout.size()]),
    ];
    batch.named(records, &parts)
}

/// Answers (..., size) from reports (..., K, N, d): see
/// `gramian::registration::batch::answer_size`.
#[pyfunction]
#[pyo3(signature = (reports, sensors, sigma, extras, prior, method, settings, keep_positions))]
#[allow(clippy::too_many_arguments)]
fn registration_estimate<'py>(
    py: Python<'py>,
    reports: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    extras: Extras,
    prior: Option<&Bound<'py, PyAny>>,
    method: &str,
    settings: Settings,
    keep_positions: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let asked = Asked::new(sensors, sigma, extras, prior, method, settings)?;
    let layout = asked.layout;
    let mut reports = Input::new(reports, "reports", 3)?;
    let wanted = [None, Some(layout.sensors), Some(layout.size())];
    reports.expect(&wanted, "for each look one line from each sensor")?;
    reports.expect_entries()?;
    let looks = reports.core_shape()[0];
    expect_looks(&asked.sensors, looks)?;
    let size = batch::answer_size(&layout, if keep_positions { looks } else { 0 });
    let trials = Batch::of(&mut [&mut reports])?;
    let (question, reports) = (asked.question()?, reports.items()?);
    let records = trials.fill(py, &[size], 3000.0 * looks as f64, |range, threads, out| {
        batch::estimate(
            &question,
            reports.skip(range.start),
            keep_positions,
            threads,
            out,
        )
    })?;
    named_answer(
        &trials,
        &records,
        &layout,
        if keep_positions { looks } else { 0 },
    )
}

/// Answers (trials, size) of trials `first..first + trials` under `seed`:
/// simulated and estimated in one pass.
#[pyfunction]
#[pyo3(signature = (positions, sensors, sigma, biases, extras, prior, method, settings, seed, first, trials))]
#[allow(clippy::too_many_arguments)]
fn registration_estimate_trials<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    biases: &Bound<'py, PyAny>,
    extras: Extras,
    prior: Option<&Bound<'py, PyAny>>,
    method: &str,
    settings: Settings,
    seed: u64,
    first: u64,
    trials: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let asked = Asked::new(sensors, sigma, extras, prior, method, settings)?;
    let layout = asked.layout;
    let positions = Input::new(positions, "positions", 2)?;
    positions.expect(&[None, Some(layout.size())], "one position for each look")?;
    positions.expect_entries()?;
    let biases = Input::new(biases, "biases", 1)?;
    biases.expect(&[Some(layout.states())], "the biases of all sensors")?;
    positions.expect_single("all trials share them")?;
    expect_looks(&asked.sensors, positions.core_shape()[0])?;
    biases.expect_single("all trials share them")?;
    let size = batch::answer_size(&layout, 0);
    let question = asked.question()?;
    let (positions, biases) = (positions.slice()?, biases.slice()?);
    let cost = 3000.0 * positions.len() as f64;
    let batch = Batch::trials(first, trials);
    let records = batch.fill(py, &[size], cost, |range, threads, out| {
        let streams = (seed, first + range.start as u64);
        batch::estimate_trials(&question, positions, biases, streams, threads, out)
    })?;
    named_answer(&batch, &records, &layout, 0)
}

/// Reports of one set of looks: see `registration::measured::Measured`.
#[pyclass(frozen, name = "RegistrationRecord", module = "gramian._core")]
struct PyRecord(Measured);

#[pymethods]
impl PyRecord {
    #[new]
    fn new(
        reports: &Bound<'_, PyAny>,
        sensors: &Bound<'_, PyAny>,
        sigma: &Bound<'_, PyAny>,
        extras: Extras,
        truth: Option<(Bound<'_, PyAny>, Bound<'_, PyAny>)>,
        velocity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let sensors = sensors_of(sensors)?;
        let layout = layout_of(&sensors, extras)?;
        let shape = [Some(layout.sensors), Some(layout.size())];
        let sigma = Input::new(sigma, "sigma", 2)?;
        sigma.expect(&shape, "one line for each sensor")?;
        // NaN where a report is missing.
        let reports = Input::unchecked(reports, "reports", 3)?;
        let wanted = [None, shape[0], shape[1]];
        reports.expect(&wanted, "for each look one line from each sensor")?;
        let looks = [Some(reports.core_shape()[0]), shape[1]];
        expect_looks(&sensors, reports.core_shape()[0])?;
        let of_looks = |value: &Bound<'_, PyAny>, name: &'static str| {
            let value = Input::unchecked(value, name, 2)?;
            value.expect(&looks, "one line for each look")?;
            PyResult::Ok(value.slice()?.to_vec())
        };
        let truth = match truth {
            None => None,
            Some((places, spread)) => {
                let spread = Input::new(&spread, "truth_sigma", 1)?;
                spread.expect(&[shape[1]], "one for each coordinate")?;
                Some((of_looks(&places, "truth")?, spread.slice()?.to_vec()))
            }
        };
        let velocity = velocity.map(|v| of_looks(v, "velocity")).transpose()?;
        Ok(Self(Measured {
            layout,
            sensors: sensors.slice()?.to_vec(),
            sigma: sigma.slice()?.to_vec(),
            reports: reports.slice()?.to_vec(),
            truth,
            velocity,
        }))
    }

    /// The likeliest positions (K, d); NaN where nothing places a target.
    #[allow(clippy::needless_pass_by_value)]
    fn positions<'py>(&self, py: Python<'py>, x: Vec<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.expect_states(&x)?;
        let d = self.0.layout.size();
        let places = self
            .0
            .positions(&x)
            .map_err(|error| InputError::new_err(error.to_string()))?;
        let looks = places.len() / d;
        PyArray1::from_vec(py, places).reshape([looks, d])
    }

    /// How many lines each look has with its position eliminated; 0 where nothing places
    /// the target.
    fn lines(&self) -> Vec<usize> {
        let looks = self.0.reports.len() / (self.0.layout.sensors * self.0.layout.size());
        (0..looks)
            .map(|k| self.0.lines_of(k).unwrap_or(0))
            .collect()
    }

    /// The reports as a model of the biases.
    fn model(&self) -> PyModel {
        PyModel::native(self.0.clone())
    }

    /// What else may be true: (kind, which bias or sensor, whitened column).
    #[allow(clippy::type_complexity, clippy::needless_pass_by_value)]
    fn alternatives<'py>(
        &self,
        py: Python<'py>,
        x: Vec<f64>,
        velocity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Vec<(&'static str, usize, Bound<'py, PyArray1<f64>>)>> {
        self.expect_states(&x)?;
        let velocity = match velocity {
            None => None,
            Some(v) => Some(Input::new(v, "velocity", 2)?.slice()?.to_vec()),
        };
        let found = self
            .0
            .alternatives(&x, velocity.as_deref())
            .map_err(|error| InputError::new_err(error.to_string()))?;
        Ok(found
            .into_iter()
            .map(|(kind, index, column)| (kind, index, PyArray1::from_vec(py, column)))
            .collect())
    }
}

impl PyRecord {
    fn expect_states(&self, x: &[f64]) -> PyResult<()> {
        let n = self.0.states();
        if x.len() == n {
            return Ok(());
        }
        Err(InputError::new_err(format!(
            "biases has {} entries: must have {n}",
            x.len()
        )))
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyRecord>()?;
    module.add_function(wrap_pyfunction!(registration_rows, module)?)?;
    module.add_function(wrap_pyfunction!(registration_rounding, module)?)?;
    module.add_function(wrap_pyfunction!(registration_fisher, module)?)?;
    module.add_function(wrap_pyfunction!(registration_eta, module)?)?;
    module.add_function(wrap_pyfunction!(registration_running_eta, module)?)?;
    module.add_function(wrap_pyfunction!(registration_pair_degrees, module)?)?;
    module.add_function(wrap_pyfunction!(registration_reports, module)?)?;
    module.add_function(wrap_pyfunction!(registration_places, module)?)?;
    module.add_function(wrap_pyfunction!(registration_estimate, module)?)?;
    module.add_function(wrap_pyfunction!(registration_estimate_trials, module)?)
}
