//! A moving magnetic dipole.

use gramian::batch::{Items, Threads, simd::Path};
use gramian::dipole::batch::{self, Passes, Simulated};
use gramian::dipole::description::{Description, Motion};
use gramian::dipole::localize::{Background, Knowledge, Loss, Options};
use gramian::dipole::measured::Measured;
use gramian::dipole::tracker::{Bound as TrackBound, Sample, Tracker, Wander};
use gramian::dipole::{Pass, Sensors, field};
use gramian::posterior::Posterior;
use gramian::solve::Model;
use gramian::solve::noise::Whitening;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{Input, all_finite, plain_vector};
use crate::errors::InputError;
use crate::output::{self, Batch};
use crate::run;
use crate::solve::PyModel;

/// Fields (..., 3).
#[pyfunction]
#[pyo3(signature = (position, moment, out=None))]
fn dipole_field<'py>(
    py: Python<'py>,
    position: &Bound<'py, PyAny>,
    moment: &Bound<'py, PyAny>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    if out.is_none()
        && let Some((position, moment)) = plain_vector(position).zip(plain_vector(moment))
        && let Ok(field) = field(&position, &moment)
        && all_finite(&field)
    {
        return Ok(output::line(py, &field));
    }
    over_places(
        py,
        [position, moment],
        out,
        &[3],
        "the field",
        batch::dipole_field,
    )
}

/// Derivatives (..., 2, 3, 3): by position, then by moment.
#[pyfunction]
#[pyo3(signature = (position, moment, out=None))]
fn dipole_jacobian<'py>(
    py: Python<'py>,
    position: &Bound<'py, PyAny>,
    moment: &Bound<'py, PyAny>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let core = [2, 3, 3];
    over_places(
        py,
        [position, moment],
        out,
        &core,
        "the Jacobian",
        batch::dipole_jacobian,
    )
}

type OverPlaces =
    fn(Items<'_>, Items<'_>, Threads, &mut [f64]) -> Result<(), (usize, gramian::dipole::Error)>;

fn over_places<'py>(
    py: Python<'py>,
    [position, moment]: [&Bound<'py, PyAny>; 2],
    out: Option<&Bound<'py, PyAny>>,
    core: &[usize],
    result: &'static str,
    kernel: OverPlaces,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let mut position = vector(position, "position")?;
    let mut moment = vector(moment, "moment")?;
    let batch = Batch::into(&mut [&mut position, &mut moment], out)?.finite(result);
    let (position, moment) = (position.items()?, moment.items()?);
    batch.fill(py, core, 20.0, |range, threads, out| {
        let (position, moment) = (position.skip(range.start), moment.skip(range.start));
        kernel(position, moment, threads, out).map_err(|(trial, error)| (trial, error.at(0)))
    })
}

fn vector<'py>(value: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Input<'py>> {
    let input = Input::new(value, name, 1)?;
    input.expect(&[Some(3)], "x, y, z")?;
    Ok(input)
}

/// The arguments that all functions of passes share.
struct PassInputs<'py> {
    times: Input<'py>,
    position: Input<'py>,
    velocity: Input<'py>,
    moment: Input<'py>,
    sigma: Option<Input<'py>>,
    sensors: Input<'py>,
    kind: Kind,
    quadrupole: Option<Input<'py>>,
    batch: Batch,
}

/// What sensors measure: `Sensors::baselines`, one for each or none, and `Sensors::ambient`.
type Kind = (Vec<[f64; 3]>, Option<[f64; 3]>);

impl<'py> PassInputs<'py> {
    fn new(
        times: &Bound<'py, PyAny>,
        [position, velocity, moment]: [&Bound<'py, PyAny>; 3],
        sigma: Option<&Bound<'py, PyAny>>,
        sensors: &Bound<'py, PyAny>,
        kind: Option<Kind>,
        quadrupole: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        let mut times = Input::new(times, "times", 1)?;
        times.expect_entries()?;
        times.expect_increasing("s")?;
        let samples = times.core_shape()[0];
        let mut position = vector(position, "r0")?;
        let mut velocity = vector(velocity, "v")?;
        let mut moment = vector(moment, "m")?;
        let mut sensors = Input::new(sensors, "sensors", 2)?;
        sensors.expect(&[None, Some(3)], "a position x, y, z for each sensor")?;
        sensors.expect_entries()?;
        let single = kind.is_none();
        let kind = kind.unwrap_or_default();
        let count = sensors.core_shape()[0];
        expect_baselines(&kind.0, count)?;
        // Infinite for what was not measured.
        let read = if single {
            Input::levels
        } else {
            Input::levels_unchecked
        };
        let mut sigma = sigma.map(|s| read(s, "sigma [T]")).transpose()?;
        if let Some(sigma) = &sigma {
            let numbers = samples * count * if kind.1.is_some() { 1 } else { 3 };
            if single || sigma.core_shape() != [numbers] {
                sigma.expect_one_or(samples, "one standard deviation, or one for each time")?;
            }
            sigma.refuse(|s| !(s > 0.0), "T", "must be > 0")?;
        }
        let read = |entries| {
            let input = Input::new(entries, "quadrupole", 1)?;
            input.expect(&[Some(5)], "Qxx, Qyy, Qxy, Qxz, Qyz")?;
            PyResult::Ok(input)
        };
        let mut quadrupole = quadrupole.map(read).transpose()?;
        let mut inputs = vec![
            &mut times,
            &mut position,
            &mut velocity,
            &mut moment,
            &mut sensors,
        ];
        inputs.extend(&mut sigma);
        inputs.extend(&mut quadrupole);
        let batch = Batch::into(&mut inputs, out)?;
        Ok(Self {
            times,
            position,
            velocity,
            moment,
            sigma,
            sensors,
            kind,
            quadrupole,
            batch,
        })
    }

    fn samples(&self) -> usize {
        self.times.core_shape()[0]
    }

    fn sensors(&self) -> usize {
        self.sensors.core_shape()[0]
    }

    fn components(&self) -> usize {
        if self.kind.1.is_some() { 1 } else { 3 }
    }

    fn passes(&self) -> PyResult<Passes<'_>> {
        Ok(Passes {
            times: self.times.items()?,
            position: self.position.items()?,
            velocity: self.velocity.items()?,
            moment: self.moment.items()?,
            sigma: match &self.sigma {
                Some(sigma) => sigma.items()?,
                None => Items::shared(&[]),
            },
            sensors: self.sensors.items()?,
            baselines: &self.kind.0,
            ambient: self.kind.1,
            quadrupole: self.quadrupole.as_ref().map(Input::items).transpose()?,
        })
    }

    /// Runs a kernel that writes `core` numbers for each trial.
    fn run(
        &self,
        py: Python<'py>,
        core: &[usize],
        cost: f64,
        kernel: impl Fn(&Passes<'_>, Threads, &mut [f64]) -> Result<(), (usize, gramian::dipole::Error)>
        + Send
        + Sync,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let passes = self.passes()?;
        self.batch.fill(py, core, cost, |range, threads, out| {
            kernel(&passes.skip(range.start), threads, out)
        })
    }
}

/// What the sensors measure (..., K, S, components), without noise: no axis of `one`
/// sensor, and none of one component.
#[pyfunction]
#[pyo3(signature = (times, position, velocity, moment, sensors, kind, quadrupole, one, out=None))]
#[allow(clippy::too_many_arguments)]
fn dipole_measure<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    position: &Bound<'py, PyAny>,
    velocity: &Bound<'py, PyAny>,
    moment: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    kind: Kind,
    quadrupole: Option<&Bound<'py, PyAny>>,
    one: bool,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let inputs = PassInputs::new(
        times,
        [position, velocity, moment],
        None,
        sensors,
        Some(kind),
        quadrupole,
        out,
    )?;
    let mut core = vec![inputs.samples()];
    if !one {
        core.push(inputs.sensors());
    }
    if inputs.kind.1.is_none() {
        core.push(3);
    }
    let cost = (20 * inputs.samples() * inputs.sensors()) as f64;
    inputs.run(py, &core, cost, batch::dipole_measure)
}

/// Whitened rows (..., K * S * components, 9), or (.., 14) with a quadrupole.
#[pyfunction]
#[pyo3(signature = (times, position, velocity, moment, sigma, sensors, kind, quadrupole, out=None))]
#[allow(clippy::too_many_arguments)]
fn dipole_rows<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    position: &Bound<'py, PyAny>,
    velocity: &Bound<'py, PyAny>,
    moment: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    kind: Kind,
    quadrupole: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let inputs = PassInputs::new(
        times,
        [position, velocity, moment],
        Some(sigma),
        sensors,
        Some(kind),
        quadrupole,
        out,
    )?;
    let samples = inputs.samples() * inputs.sensors();
    let states = if quadrupole.is_some() { 14 } else { 9 };
    let core = [samples * inputs.components(), states];
    inputs.run(py, &core, (40 * samples) as f64, batch::dipole_rows)
}

/// Fisher information (..., 9, 9) of three-component sensors.
#[pyfunction]
#[pyo3(signature = (times, position, velocity, moment, sigma, sensors, out=None))]
#[allow(clippy::too_many_arguments)]
fn dipole_fisher<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    position: &Bound<'py, PyAny>,
    velocity: &Bound<'py, PyAny>,
    moment: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    sensors: &Bound<'py, PyAny>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let inputs = PassInputs::new(
        times,
        [position, velocity, moment],
        Some(sigma),
        sensors,
        None,
        None,
        out,
    )?;
    let cost = (inputs.sensors() * (200 + inputs.samples())) as f64;
    inputs.run(py, &[9, 9], cost, |passes, threads, out| {
        batch::dipole_fisher(passes, threads, Path::Best, out)
    })
}

/// What is known of nine states, from the root of the information (9, 9).
fn known_by(root: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Posterior<f64, 9>> {
    let root = Input::new(root, name, 2)?;
    root.expect(&[Some(9), Some(9)], "the root of the information")?;
    let mut known = Posterior::unknown();
    for row in root.slice()?.chunks_exact(9) {
        let mut line = [0.0; 9];
        line.copy_from_slice(row);
        known
            .update(&line)
            .map_err(|error| InputError::new_err(format!("{name}: {error}")))?;
    }
    Ok(known)
}

/// A dipole that wanders, sample by sample, of a record (K, S, 3): states and deviations
/// (K, 9), what each sample adds to chi-square (K,), the bound (K, 9) along the true states
/// where they are given, and the roots at the end.
#[pyfunction]
#[pyo3(signature = (times, field, sensors, sigma, start, state, root, wander, truth, bound_root))]
#[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)]
fn dipole_track<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    field: &Bound<'py, PyAny>,
    sensors: Vec<[f64; 3]>,
    sigma: &Bound<'py, PyAny>,
    start: f64,
    state: [f64; 9],
    root: &Bound<'py, PyAny>,
    wander: (f64, f64),
    truth: Option<&Bound<'py, PyAny>>,
    bound_root: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let times = Input::new(times, "times", 1)?;
    let samples = times.core_shape()[0];
    let field = Input::new(field, "field", 3)?;
    field.expect(&[Some(samples), Some(sensors.len()), Some(3)], "tesla")?;
    let sigma = Input::new(sigma, "sigma", 1)?;
    sigma.expect(&[Some(samples)], "one for each time")?;
    let truth = truth.map(|t| Input::new(t, "truth", 2)).transpose()?;
    if let Some(truth) = &truth {
        truth.expect(&[Some(samples), Some(9)], "a state for each time")?;
    }
    let mut tracker = Tracker::resumed(start, &state, known_by(root, "root")?)
        .map_err(|error| InputError::new_err(error.to_string()))?;
    let known = match bound_root {
        Some(root) => known_by(root, "bound_root")?,
        None => Posterior::unknown(),
    };
    let mut bound = TrackBound::resumed(start, known);
    let wander = Wander {
        acceleration: wander.0,
        moment: wander.1,
    };
    let (times, field, sigma) = (times.slice()?, field.slice()?, sigma.slice()?);
    let truth = truth.as_ref().map(Input::slice).transpose()?;
    let mut states = vec![0.0; 9 * samples];
    let (mut std, mut limit) = (states.clone(), states.clone());
    let mut chi2 = vec![0.0; samples];
    let outcome = run::interruptible(py, |stop| {
        for k in 0..samples {
            for (s, sensor) in sensors.iter().enumerate() {
                let at = 3 * (k * sensors.len() + s);
                let sample = Sample {
                    time: times[k],
                    sensor: *sensor,
                    field: [field[at], field[at + 1], field[at + 2]],
                    sigma: sigma[k],
                };
                chi2[k] += tracker.push(&sample, &wander).map_err(|e| (k, e))?;
                if let Some(truth) = truth {
                    let mut real = [0.0; 9];
                    real.copy_from_slice(&truth[9 * k..9 * k + 9]);
                    bound.push(&sample, &real, &wander).map_err(|e| (k, e))?;
                }
            }
            let answer = tracker.answer();
            states[9 * k..9 * k + 9].copy_from_slice(&answer.state);
            std[9 * k..9 * k + 9].copy_from_slice(&answer.std);
            limit[9 * k..9 * k + 9].copy_from_slice(&bound.std());
            if stop() {
                break;
            }
        }
        Ok::<(), (usize, gramian::dipole::Error)>(())
    })?;
    outcome.map_err(|(k, error)| InputError::new_err(format!("sample {k}: {error}")))?;
    let out = PyDict::new(py);
    let table = |values: Vec<f64>| PyArray1::from_vec(py, values).reshape([samples, 9]);
    let square = |known: &Posterior<f64, 9>| {
        PyArray1::from_slice(py, known.root().factor().as_flattened()).reshape([9, 9])
    };
    out.set_item("states", table(states)?)?;
    out.set_item("std", table(std)?)?;
    out.set_item("bound", table(limit)?)?;
    out.set_item("chi2", PyArray1::from_vec(py, chi2))?;
    out.set_item("root", square(tracker.known())?)?;
    out.set_item("bound_root", square(bound.known())?)?;
    Ok(out)
}

/// Of eleven numbers those that are known exactly (not NaN), and of eleven pairs
/// (mean, sigma) those that are known so.
fn knowledge(exact: [f64; 11], prior: [[f64; 2]; 11]) -> Knowledge {
    Knowledge {
        exact: exact.map(|x| (!x.is_nan()).then_some(x)),
        prior: prior.map(|[mean, sigma]| (!mean.is_nan()).then_some((mean, sigma))),
    }
}

/// Sensors of a record: `places`, `baselines` (none, or one for each) and `ambient`.
#[derive(FromPyObject)]
struct PySensors {
    places: Vec<[f64; 3]>,
    baselines: Vec<[f64; 3]>,
    ambient: Option<[f64; 3]>,
}

impl PySensors {
    fn sensors(&self) -> PyResult<Sensors<'_>> {
        expect_baselines(&self.baselines, self.places.len())?;
        Ok(Sensors {
            places: &self.places,
            baselines: &self.baselines,
            ambient: self.ambient,
        })
    }
}

fn expect_baselines(baselines: &[[f64; 3]], sensors: usize) -> PyResult<()> {
    let count = baselines.len();
    if count == 0 || count == sensors {
        return Ok(());
    }
    let text = format!("baselines has {count} entries: must be {sensors}, one a sensor");
    Err(InputError::new_err(text))
}

#[derive(FromPyObject)]
struct PyOptions {
    background: String,
    loss: String,
    sigma: Option<f64>,
    levels: Vec<f64>,
    origin: Option<f64>,
    starts: usize,
    rounds: u32,
    correlation: f64,
    others: bool,
}

impl PyOptions {
    fn options(&self) -> PyResult<Options<'_>> {
        Ok(Options {
            background: match self.background.as_str() {
                "none" => Background::None,
                "fit" => Background::Fit,
                other => return Err(unknown("background", other)),
            },
            loss: match self.loss.as_str() {
                "gaussian" => Loss::Gaussian,
                "huber" => Loss::Huber,
                other => return Err(unknown("loss", other)),
            },
            sigma: self.sigma,
            levels: &self.levels,
            origin: self.origin,
            starts: self.starts,
            rounds: self.rounds,
            correlation: self.correlation,
            others: self.others,
        })
    }
}

fn unknown(name: &str, given: &str) -> PyErr {
    InputError::new_err(format!("{name} = {given:?} is not one of the choices"))
}

/// Locates: see `batch::dipole_localize` for what (..., size) holds.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // Arguments are extracted into values.
fn dipole_localize<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    field: &Bound<'py, PyAny>,
    sensors: PySensors,
    exact: [f64; 11],
    prior: [[f64; 2]; 11],
    options: PyOptions,
) -> PyResult<Bound<'py, PyDict>> {
    let sensors = sensors.sensors()?;
    let mut times = Input::new(times, "times", 1)?;
    times.expect_entries()?;
    times.expect_increasing("s")?;
    let samples = times.core_shape()[0];
    // NaN is a number that is missing.
    let mut field = Input::unchecked(field, "field", 3)?;
    field.refuse(
        f64::is_infinite,
        "",
        "must be finite, or NaN where it is missing",
    )?;
    let (count, components) = (sensors.places.len(), sensors.components());
    let wanted = [Some(samples), Some(count), Some(components)];
    field.expect(&wanted, "the components for each time and sensor")?;
    let batch = Batch::of(&mut [&mut times, &mut field])?;
    let size = batch::dipole_localized_size(samples, sensors.channels());
    let (knowledge, options) = (knowledge(exact, prior), options.options()?);
    let (times, field) = (times.items()?, field.items()?);
    let cost = batch::localize_cost(field.size());
    let records = batch.fill(py, &[size], cost, |range, threads, out| {
        batch::dipole_localize(
            times.skip(range.start),
            field.skip(range.start),
            &sensors,
            &knowledge,
            &options,
            threads,
            out,
        )
    })?;
    let parts: [(&str, &[usize]); 12] = [
        ("state", &[9]),
        ("mirror", &[9]),
        ("cost", &[]),
        ("mirror_cost", &[]),
        ("sigma", &[]),
        ("converged", &[]),
        ("rounds", &[]),
        ("efficiency", &[]),
        ("status", &[]),
        ("background", &[count, components]),
        ("residuals", &[samples, count, components]),
        ("weights", &[samples, count, components]),
    ];
    batch.named(&records, &parts)
}

/// Simulates and locates: (trials, 12), see `batch::dipole_localize_trials`.
#[pyfunction]
#[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)]
fn dipole_localize_trials<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    state: [f64; 9],
    sigma: f64,
    sensors: PySensors,
    exact: [f64; 11],
    prior: [[f64; 2]; 11],
    options: PyOptions,
    seed: u64,
    first: u64,
    trials: usize,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let times = Input::new(times, "times", 1)?;
    times.expect_entries()?;
    times.expect_increasing("s")?;
    let (knowledge, options) = (knowledge(exact, prior), options.options()?);
    let pass = Pass::of(&state);
    let (times, sensors) = (times.slice()?, sensors.sensors()?);
    let cost = batch::localize_cost(times.len() * sensors.channels());
    Batch::trials(first, trials).fill(py, &[12], cost, |range, threads, out| {
        let simulated = Simulated {
            times,
            pass: &pass,
            sensors,
            sigma,
            seed,
            first: first + range.start as u64,
        };
        batch::dipole_localize_trials(&simulated, &knowledge, &options, threads, out)
    })
}

/// A record of a pass, and what is known of it: see `dipole::measured::Measured`.
#[pyclass(frozen, name = "DipoleRecord", module = "gramian._core")]
struct PyRecord {
    record: Measured,
    samples: usize,
}

impl PyRecord {
    fn states(&self, x: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
        let x = Input::new(x, "x", 1)?;
        x.expect(&[Some(self.record.states())], "one number for each state")?;
        Ok(x.slice()?.to_vec())
    }
}

#[pymethods]
impl PyRecord {
    #[new]
    #[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)]
    fn new(
        times: &Bound<'_, PyAny>,
        field: &Bound<'_, PyAny>,
        sensors: PySensors,
        weights: &Bound<'_, PyAny>,
        offsets: bool,
        exact: [f64; 11],
        prior: [[f64; 2]; 11],
        near: [f64; 9],
        correlation: f64,
        spacing: f64,
    ) -> PyResult<Self> {
        let times = Input::new(times, "times", 1)?;
        times.expect_entries()?;
        let samples = times.core_shape()[0];
        let sensors = sensors.sensors()?;
        let (count, components) = (sensors.places.len(), sensors.components());
        let shape = [Some(samples), Some(count), Some(components)];
        let field = Input::new(field, "field", 3)?;
        field.expect(&shape, "the components for each time and sensor")?;
        let weights = Input::new(weights, "weights", 3)?;
        weights.expect(&shape, "one for each number of the field")?;
        let quiet = sensors.quiet();
        let beside: Vec<f64> = field.slice()?.iter().map(|y| y - quiet).collect();
        let record = Measured::new(
            times.slice()?,
            &sensors,
            &beside,
            Whitening::first_order(
                times.slice()?,
                sensors.channels(),
                weights.slice()?.to_vec(),
                correlation,
                spacing,
            ),
            offsets,
            knowledge(exact, prior),
            &near,
        );
        Ok(Self { record, samples })
    }

    /// The same record with more to explain it: motion, dipoles, a quadrupole (with the
    /// components of the place that are the centre's), drift, and the deviations of the sensors'
    /// attitude (rad) and scale.
    #[pyo3(signature = (motion, sources, quadrupole, drift, attitude, scale, induced))]
    #[allow(clippy::too_many_arguments)]
    fn described(
        &self,
        motion: &str,
        sources: usize,
        quadrupole: Option<[bool; 3]>,
        drift: bool,
        attitude: Option<f64>,
        scale: Option<f64>,
        induced: Option<[f64; 3]>,
    ) -> PyResult<Self> {
        let motion = match motion {
            "straight" => Motion::Straight,
            "along" => Motion::Along,
            "accelerated" => Motion::Accelerated,
            "turning" => Motion::Turning,
            other => return Err(unknown("motion", other)),
        };
        let record = self.record.clone().with(Description {
            motion,
            sources,
            quadrupole,
            drift,
            attitude,
            scale,
            induced,
        });
        Ok(Self {
            record,
            samples: self.samples,
        })
    }

    /// Place (3,) of the body at a time, and its derivatives (3, n) by the states (n,).
    #[allow(clippy::type_complexity)]
    fn place<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        time: f64,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let (place, by) = self.record.place(&self.states(x)?, time);
        let n = by.len();
        let flat: Vec<f64> = (0..3 * n).map(|i| by[i % n][i / n]).collect();
        let matrix = PyArray1::from_vec(py, flat).reshape([3, n])?;
        Ok((PyArray1::from_slice(py, &place), matrix))
    }

    /// The five numbers of the quadrupole, and their derivatives (5, n) by the states (n,).
    #[allow(clippy::type_complexity)]
    fn quadrupole<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let (entries, by) = self.record.quadrupole(&self.states(x)?);
        let n = by.len();
        let flat: Vec<f64> = (0..5 * n).map(|i| by[i % n][i / n]).collect();
        let matrix = PyArray1::from_vec(py, flat).reshape([5, n])?;
        Ok((PyArray1::from_slice(py, &entries), matrix))
    }

    /// States with one dipole more, (seeds, n + 6), the most promising first.
    fn seeds<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        most: usize,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let x = self.states(x)?;
        let found = py
            .detach(|| self.record.seeds(&x, most))
            .map_err(|error| InputError::new_err(error.to_string()))?;
        let shape = [found.len(), x.len() + 6];
        PyArray1::from_vec(py, found.concat()).reshape(shape)
    }

    /// Where other solutions may be found for sensors of the total field and gradiometers,
    /// (starts, n).
    fn alike<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let x = self.states(x)?;
        let found = self.record.alike(&x);
        PyArray1::from_vec(py, found.concat()).reshape([found.len(), x.len()])
    }

    /// Weights of the numbers under Huber's loss, what they are to be multiplied by, sigma.
    #[pyo3(signature = (x, sigma))]
    fn robust<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        sigma: Option<f64>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, f64, f64)> {
        let x = self.states(x)?;
        let (weights, efficiency, sigma) = self
            .record
            .robust(&x, sigma)
            .map_err(|error| InputError::new_err(error.to_string()))?;
        Ok((PyArray1::from_vec(py, weights), efficiency, sigma))
    }

    /// The record as a model.
    fn model(&self) -> PyModel {
        PyModel::native(self.record.clone())
    }

    /// Names of the states.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.record.names()
    }

    /// Units of the states.
    #[getter]
    fn units(&self) -> Vec<&'static str> {
        self.record.units()
    }

    /// States (n,) of a pass (9,).
    fn coordinates<'py>(&self, py: Python<'py>, at: [f64; 9]) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.record.coordinates(&at))
    }

    /// Pass (9,) of states (n,), and its derivatives (9, n).
    #[allow(clippy::type_complexity)]
    fn expand<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        let (state, columns) = self.record.expand(&self.states(x)?);
        let n = columns.len();
        let flat: Vec<f64> = (0..9 * n).map(|i| columns[i % n][i / n]).collect();
        let matrix = PyArray1::from_vec(py, flat).reshape([9, n])?;
        Ok((PyArray1::from_slice(py, &state), matrix))
    }

    /// Correlation of neighbours and standard deviation of the noise at states (n,), of a
    /// record whose weights are relative.
    #[pyo3(signature = (x, spacing, sigma))]
    fn noise(
        &self,
        py: Python<'_>,
        x: &Bound<'_, PyAny>,
        spacing: f64,
        sigma: Option<f64>,
    ) -> PyResult<(f64, f64)> {
        let x = self.states(x)?;
        py.detach(|| self.record.noise(&x, spacing, sigma))
            .map_err(|error| InputError::new_err(error.to_string()))
    }

    /// What else may be true, as whitened columns: (name, (m, parameters)).
    fn alternatives<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<Vec<(String, Bound<'py, PyArray2<f64>>)>> {
        let found = self
            .record
            .alternatives(&self.states(x)?)
            .map_err(|error| InputError::new_err(error.to_string()))?;
        found
            .into_iter()
            .map(|(name, columns, count)| {
                let shape = [columns.len() / count, count];
                Ok((name, PyArray1::from_vec(py, columns).reshape(shape)?))
            })
            .collect()
    }

    /// Number of samples.
    fn __len__(&self) -> usize {
        self.samples
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyRecord>()?;
    module.add_function(wrap_pyfunction!(dipole_field, module)?)?;
    module.add_function(wrap_pyfunction!(dipole_jacobian, module)?)?;
    module.add_function(wrap_pyfunction!(dipole_measure, module)?)?;
    module.add_function(wrap_pyfunction!(dipole_rows, module)?)?;
    module.add_function(wrap_pyfunction!(dipole_fisher, module)?)?;
    module.add_function(wrap_pyfunction!(dipole_track, module)?)?;
    module.add_function(wrap_pyfunction!(dipole_localize, module)?)?;
    module.add_function(wrap_pyfunction!(dipole_localize_trials, module)?)
}
