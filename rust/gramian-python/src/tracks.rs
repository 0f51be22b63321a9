//! Tracks: carriers, scenes, and what follows from them.
// Arguments come from Python by value.
#![allow(clippy::needless_pass_by_value)]

use gramian::batch::{Items, Threads};
use gramian::solve::Model;
use gramian::tracks::carrier::Carrier;
use gramian::tracks::scene::departures::Departure;
use gramian::tracks::scene::estimate::{
    self as kernel, Layout, Loss, Options, Status, Task, Verdict,
};
use gramian::tracks::scene::{
    Channel, InSensor, Kind, Measured, Moving, Noise, Parameter, Scene, TurnTimes,
};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyInt};

use crate::convert::Input;
use crate::errors::{InputError, input_at};
use crate::output::{self, Batch};
use crate::run;
use crate::solve::PyModel;

/// An array and a matrix beside it.
type Pair<'py, A> = (Bound<'py, A>, Bound<'py, PyArray2<f64>>);

/// What a departure is, which order, time or sensor, and its columns.
type NamedColumns<'py> = (&'static str, f64, Bound<'py, PyArray2<f64>>);

/// Where a sensor is: see `gramian::tracks::carrier::Carrier`.
#[pyclass(frozen, name = "TrackCarrier", module = "gramian._core")]
struct TrackCarrier(Carrier);

#[pymethods]
impl TrackCarrier {
    /// A path (m, D) at `times`, or a fixed place (D,) without them.
    #[new]
    #[pyo3(signature = (path, times, velocity, heading))]
    fn new(
        path: &Bound<'_, PyAny>,
        times: Option<&Bound<'_, PyAny>>,
        velocity: Option<&Bound<'_, PyAny>>,
        heading: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let Some(times) = times else {
            let path = Input::new(path, "path", 1)?;
            let heading = heading.map(PyAnyMethods::extract::<f64>).transpose()?;
            let found = Carrier::fixed(path.slice()?, heading);
            return Ok(Self(found.map_err(|error| input_at("", error))?));
        };
        let path = Input::new(path, "path", 2)?;
        let times = Input::new(times, "times", 1)?;
        let velocity = velocity.map(|v| Input::new(v, "velocity", 2)).transpose()?;
        let heading = heading.map(|h| Input::new(h, "heading", 1)).transpose()?;
        let found = Carrier::along(
            path.core_shape()[1],
            times.slice()?,
            path.slice()?,
            velocity.as_ref().map(Input::slice).transpose()?,
            heading.as_ref().map(Input::slice).transpose()?,
        );
        Ok(Self(found.map_err(|error| input_at("", error))?))
    }

    /// Places and velocities (m, D) at `times`.
    fn at<'py>(
        &self,
        py: Python<'py>,
        times: &Bound<'py, PyAny>,
    ) -> PyResult<Pair<'py, PyArray2<f64>>> {
        let times = Input::new(times, "times", 1)?;
        let found = self
            .0
            .at(times.slice()?)
            .map_err(|error| input_at("", error))?;
        let d = self.0.dimension();
        let array = |flat: &[f64]| {
            let array = PyArray2::zeros(py, [flat.len() / d, d], false);
            array.readwrite().as_slice_mut()?.copy_from_slice(flat);
            Ok::<_, PyErr>(array)
        };
        Ok((array(&found.place)?, array(&found.velocity)?))
    }

    /// Headings (m,) at `times`: those given, or those of the velocity.
    fn headings<'py>(
        &self,
        py: Python<'py>,
        times: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let times = Input::new(times, "times", 1)?;
        let found = self.0.headings(times.slice()?);
        Ok(PyArray1::from_vec(
            py,
            found.map_err(|error| input_at("", error))?,
        ))
    }
}

/// Whole numbers are nuisance states, others are values.
fn parameter(value: &Bound<'_, PyAny>) -> PyResult<Parameter> {
    if value.is_instance_of::<PyInt>() {
        return Ok(Parameter::State(value.extract()?));
    }
    Ok(Parameter::Fixed(value.extract()?))
}

fn kind_of(name: &str, speed: f64) -> PyResult<Kind> {
    Ok(match name {
        "bearing" => Kind::Bearing,
        "elevation" => Kind::Elevation,
        "range" => Kind::Range,
        "range_rate" => Kind::RangeRate,
        "frequency" => Kind::Frequency(speed),
        "time_difference" => Kind::TimeDifference(speed),
        "frequency_difference" => Kind::FrequencyDifference(speed),
        "cone_angle" => Kind::ConeAngle,
        "signal_strength" => Kind::SignalStrength,
        "position" => Kind::Position,
        "speed" => Kind::Speed,
        "course" => Kind::Course,
        _ => {
            return Err(InputError::new_err(format!(
                "{name:?} is no kind of sensor"
            )));
        }
    })
}

fn channel(given: &Bound<'_, PyDict>) -> PyResult<Channel> {
    let item = |name: &str| -> PyResult<Option<Bound<'_, PyAny>>> {
        Ok(given.get_item(name)?.filter(|value| !value.is_none()))
    };
    let needed = |name: &str| -> PyResult<Bound<'_, PyAny>> {
        item(name)?.ok_or_else(|| InputError::new_err(format!("a sensor has no {name}")))
    };
    let kind: String = needed("kind")?.extract()?;
    let speed = item("speed")?.map_or(Ok(1.0), |s| s.extract())?;
    let times = needed("times")?;
    let times = Input::new(&times, "times", 1)?;
    let times = times.slice()?.to_vec();
    let carried = |name: &str| {
        item(name)?
            .map(|carrier| {
                let carrier = carrier.cast::<TrackCarrier>()?;
                carrier
                    .get()
                    .0
                    .at(&times)
                    .map_err(|error| input_at("", error))
            })
            .transpose()
    };
    let numbers = |name: &'static str, core: usize| -> PyResult<Vec<f64>> {
        let value = needed(name)?;
        let input = Input::new(&value, name, core)?;
        Ok(input.slice()?.to_vec())
    };
    let noise = if let Some(matrix) = item("covariance")? {
        let matrix = Input::new(&matrix, "covariance", 2)?;
        matrix.expect(&[None, None], "one square matrix")?;
        Noise::Covariance {
            size: matrix.core_shape()[0],
            matrix: matrix.slice()?.to_vec(),
        }
    } else if let Some(time) = item("correlation_time")? {
        Noise::Correlated {
            sigma: numbers("sigma", 0)?,
            time: time.extract()?,
        }
    } else {
        Noise::Sigma(numbers("sigma", 0)?)
    };
    let pair: (Bound<'_, PyAny>, Bound<'_, PyAny>) = needed("parameters")?.extract()?;
    let mut bias = Vec::new();
    for entry in needed("bias")?.try_iter()? {
        let (factor, value): (f64, Bound<'_, PyAny>) = entry?.extract()?;
        bias.push((factor, parameter(&value)?));
    }
    let (carrier, second) = (carried("carrier")?, carried("second")?);
    Ok(Channel {
        kind: kind_of(&kind, speed)?,
        carrier,
        second,
        parameters: [parameter(&pair.0)?, parameter(&pair.1)?],
        bias,
        scale: parameter(&needed("scale")?)?,
        clock: parameter(&needed("clock")?)?,
        true_path: needed("true_path")?.extract()?,
        delay: item("delay")?.map(|d| d.extract()).transpose()?,
        noise,
        detection: numbers("detection", 0)?,
        times,
    })
}

/// One target and its sensors: see `gramian::tracks::scene::Scene`.
#[pyclass(frozen, name = "TrackScene", module = "gramian._core")]
struct TrackScene {
    scene: Scene,
    labels: Vec<String>,
}

impl TrackScene {
    fn error(&self, place: &str, error: InSensor) -> PyErr {
        labelled(&self.labels, place, error)
    }
}

fn labelled(labels: &[String], place: &str, error: InSensor) -> PyErr {
    match labels.get(error.sensor) {
        Some(label) => InputError::new_err(format!("{place}{label}: {}", error.error)),
        None => InputError::new_err(format!("{place}{}", error.error)),
    }
}

#[pymethods]
impl TrackScene {
    #[new]
    #[pyo3(signature = (dimension, motion, order, turns, unknown_turns, reference, nuisances, channels, labels))]
    // pyo3 hands over values.
    #[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)]
    fn new(
        dimension: usize,
        motion: &str,
        order: usize,
        turns: Option<Vec<f64>>,
        unknown_turns: usize,
        reference: f64,
        nuisances: usize,
        channels: Vec<Bound<'_, PyDict>>,
        labels: Vec<String>,
    ) -> PyResult<Self> {
        if !matches!(dimension, 2 | 3) {
            return Err(InputError::new_err(format!(
                "dimension = {dimension}: must be 2 or 3"
            )));
        }
        let times = || {
            turns
                .clone()
                .map_or(TurnTimes::Unknown(unknown_turns), TurnTimes::Known)
        };
        let moving = match motion {
            "polynomial" => Moving::Polynomial { order },
            "legs" => Moving::Legs(times()),
            "steady_legs" => Moving::SteadyLegs(times()),
            "coordinated_turn" => Moving::CoordinatedTurn,
            _ => return Err(InputError::new_err(format!("{motion:?} is no motion"))),
        };
        let mut all = Vec::with_capacity(channels.len());
        for (given, label) in channels.iter().zip(&labels) {
            all.push(channel(given).map_err(|error| {
                let text = error.value(given.py()).to_string();
                InputError::new_err(format!("{label}: {text}"))
            })?);
        }
        let scene = Scene::new(dimension, moving, reference, nuisances, all)
            .map_err(|error| labelled(&labels, "", error))?;
        Ok(Self { scene, labels })
    }

    #[getter]
    fn states(&self) -> usize {
        self.scene.states()
    }

    #[getter]
    fn measurements(&self) -> usize {
        self.scene.measurements()
    }

    /// Whitened rows (..., m, n) at states (..., n).
    #[pyo3(signature = (states, out = None))]
    fn rows<'py>(
        &self,
        py: Python<'py>,
        states: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (n, m) = (self.scene.states(), self.scene.measurements());
        let mut states = Input::new(states, "state", 1)?;
        states.expect(&[Some(n)], "one number for each state")?;
        let batch = Batch::into(&mut [&mut states], out)?;
        let out = batch.array(py, &[m, n])?;
        {
            let states = states.items()?;
            let mut write = output::writable(&out)?;
            let write = write.as_slice_mut()?;
            let cost = (m * (10 + n)) as f64 + 500.0;
            run::in_pieces(py, batch.len(), cost, |range, threads| {
                let out = &mut write[range.start * m * n..range.end * m * n];
                threads
                    .over(out, m * n, cost, |trial, out| {
                        let trial = range.start + trial;
                        let x = states.get(trial);
                        self.scene.rows_into(x, out).map_err(|e| (trial, e))
                    })
                    .map_err(|(trial, error)| self.error(&batch.place(trial), error))
            })?;
        }
        Ok(out)
    }

    /// How much of each column of the rows (n,) at a state (n,) is rounding of coordinates.
    fn rounding<'py>(
        &self,
        py: Python<'py>,
        state: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let state = Input::new(state, "state", 1)?;
        state.expect(&[Some(self.scene.states())], "one number for each state")?;
        state.expect_single("one state")?;
        Ok(PyArray1::from_vec(py, self.scene.rounding(state.slice()?)))
    }

    /// Exact values (..., m) at states (..., n).
    fn values<'py>(
        &self,
        py: Python<'py>,
        states: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (n, m) = (self.scene.states(), self.scene.measurements());
        let mut states = Input::new(states, "state", 1)?;
        states.expect(&[Some(n)], "one number for each state")?;
        let batch = Batch::of(&mut [&mut states])?;
        let out = batch.array(py, &[m])?;
        {
            let states = states.items()?;
            let mut write = out.readwrite();
            let write = write.as_slice_mut()?;
            for (trial, out) in write.chunks_exact_mut(m.max(1)).enumerate() {
                let found = self.scene.values(states.get(trial));
                out.copy_from_slice(
                    &found.map_err(|error| self.error(&batch.place(trial), error))?,
                );
            }
        }
        Ok(out)
    }

    /// Measurements (trials, m) of the streams `first..first + trials`.
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        state: &Bound<'py, PyAny>,
        seed: u64,
        first: u64,
        trials: usize,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (n, m) = (self.scene.states(), self.scene.measurements());
        let state = Input::new(state, "state", 1)?;
        state.expect(&[Some(n)], "one number for each state")?;
        let exact = self
            .scene
            .values(state.slice()?)
            .map_err(|error| self.error("", error))?;
        let out = output::array(py, &[trials, m])?;
        {
            let mut write = out.readwrite();
            let write = write.as_slice_mut()?;
            let cost = 20.0 * m as f64;
            run::in_pieces(py, trials, cost, |range, threads| {
                let out = &mut write[range.start * m..range.end * m];
                let each = |trial: usize, out: &mut [f64]| {
                    let trial = first + (range.start + trial) as u64;
                    self.scene.simulate(&exact, seed, trial, out);
                    Ok(())
                };
                let Ok::<(), core::convert::Infallible>(()) = threads.over(out, m, cost, each);
                Ok(())
            })?;
        }
        Ok(out)
    }

    /// Places and velocities of the target (times, 2 D) of one state.
    fn track<'py>(
        &self,
        py: Python<'py>,
        state: &Bound<'py, PyAny>,
        times: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let state = Input::new(state, "state", 1)?;
        state.expect(&[Some(self.scene.states())], "one number for each state")?;
        let times = Input::new(times, "times", 1)?;
        let since: Vec<f64> = times
            .slice()?
            .iter()
            .map(|t| t - self.scene.reference())
            .collect();
        let d = self.scene.dimension();
        let flat =
            self.scene
                .motion()
                .track(d, &state.slice()?[..self.scene.motion_states()], &since);
        let out = PyArray2::zeros(py, [since.len(), 2 * d], false);
        out.readwrite().as_slice_mut()?.copy_from_slice(&flat);
        Ok(out)
    }

    /// Derivatives of the places (times, D, n) of the target by one state.
    fn slopes<'py>(
        &self,
        py: Python<'py>,
        state: &Bound<'py, PyAny>,
        times: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (n, own) = (self.scene.states(), self.scene.motion_states());
        let state = Input::new(state, "state", 1)?;
        state.expect(&[Some(n)], "one number for each state")?;
        let times = Input::new(times, "times", 1)?;
        let reference = self.scene.reference();
        let since: Vec<f64> = times.slice()?.iter().map(|t| t - reference).collect();
        let d = self.scene.dimension();
        let flat = self
            .scene
            .motion()
            .slopes(d, &state.slice()?[..own], &since);
        let out = PyArray3::zeros(py, [since.len(), d, n], false);
        {
            let mut write = out.readwrite();
            let rows = write.as_slice_mut()?.chunks_exact_mut(n);
            for (out, row) in rows.zip(flat.chunks_exact(own)) {
                out[..own].copy_from_slice(row);
            }
        }
        Ok(out)
    }

    /// Ways in which the scene may be wrong, at a state (n,): of each what it is, which
    /// order, time (s) or sensor, and its whitened columns (m', parameters).
    fn departures<'py>(
        &self,
        py: Python<'py>,
        measurements: &Bound<'py, PyAny>,
        state: &Bound<'py, PyAny>,
        turns: &Bound<'py, PyAny>,
    ) -> PyResult<Vec<NamedColumns<'py>>> {
        let measurements = Input::unchecked(measurements, "measurements", 1)?;
        let state = Input::new(state, "state", 1)?;
        let turns = Input::new(turns, "turns", 1)?;
        let reference = self.scene.reference();
        let turns: Vec<f64> = turns.slice()?.iter().map(|t| t - reference).collect();
        let measured = Measured::new(&self.scene, measurements.slice()?, &[])
            .map_err(|error| self.error("", error))?;
        state.expect(&[Some(measured.states())], "one number for each state")?;
        let found = measured
            .departures(state.slice()?, &turns)
            .map_err(|error| self.error("", error))?;
        found
            .into_iter()
            .map(|(departure, flat)| {
                let (kind, which) = match departure {
                    Departure::Order(order) => ("order", order as f64),
                    Departure::Turn(time) => ("turn", time + reference),
                    Departure::Bias(sensor) => ("bias", sensor as f64),
                    Departure::Scale(sensor) => ("scale", sensor as f64),
                    Departure::Clock(sensor) => ("clock", sensor as f64),
                };
                let m = measured.measurements();
                let out = PyArray2::zeros(py, [m, flat.len() / m.max(1)], false);
                out.readwrite().as_slice_mut()?.copy_from_slice(&flat);
                Ok((kind, which, out))
            })
            .collect()
    }

    /// Whitened residuals (m',) and rows (m', n) of measurements (m,) at a state (n,):
    /// without those that are missing.
    fn linearize<'py>(
        &self,
        py: Python<'py>,
        measurements: &Bound<'py, PyAny>,
        state: &Bound<'py, PyAny>,
    ) -> PyResult<Pair<'py, PyArray1<f64>>> {
        let measurements = Input::unchecked(measurements, "measurements", 1)?;
        let state = Input::new(state, "state", 1)?;
        let measured = Measured::new(&self.scene, measurements.slice()?, &[])
            .map_err(|error| self.error("", error))?;
        let (m, n) = (measured.measurements(), measured.states());
        state.expect(&[Some(n)], "one number for each state")?;
        let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
        measured
            .linearize(state.slice()?, &mut residuals, Some(&mut rows))
            .map_err(|error| self.error("", error))?;
        let out = PyArray2::zeros(py, [m, n], false);
        out.readwrite().as_slice_mut()?.copy_from_slice(&rows);
        Ok((PyArray1::from_vec(py, residuals), out))
    }

    /// The scene with measurements (m,), NaN for those that are missing: a model to estimate
    /// from.
    fn model(&self, measurements: &Bound<'_, PyAny>) -> PyResult<PyModel> {
        let measurements = Input::unchecked(measurements, "measurements", 1)?;
        let measured = Measured::new(&self.scene, measurements.slice()?, &[])
            .map_err(|error| self.error("", error))?;
        Ok(PyModel::native(measured.into_owned()))
    }

    /// The mirror image of a state, where there is one.
    fn mirrored<'py>(
        &self,
        py: Python<'py>,
        state: &Bound<'py, PyAny>,
    ) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        let state = Input::new(state, "state", 1)?;
        state.expect(&[Some(self.scene.states())], "one number for each state")?;
        let found = self.scene.mirrored(state.slice()?);
        Ok(found.map(|x| PyArray1::from_vec(py, x)))
    }

    /// States (k, n) to begin from.
    fn starts<'py>(
        &self,
        py: Python<'py>,
        measurements: &Bound<'py, PyAny>,
        known: &Bound<'py, PyAny>,
        mean: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n = self.scene.states();
        let z = Input::unchecked(measurements, "measurements", 1)?;
        z.expect(&[Some(self.scene.measurements())], "all measurements")?;
        let known = Input::unchecked(known, "known", 1)?;
        let mean = Input::new(mean, "prior mean", 1)?;
        let sigma = Input::unchecked(sigma, "prior sigma", 1)?;
        for input in [&known, &mean, &sigma] {
            input.expect(&[Some(n)], "one number for each state")?;
        }
        let found = self
            .scene
            .starts(z.slice()?, mean.slice()?, sigma.slice()?, known.slice()?);
        let out = PyArray2::zeros(py, [found.len(), n], false);
        out.readwrite()
            .as_slice_mut()?
            .copy_from_slice(&found.concat());
        Ok(out)
    }

    /// Estimates of measurements (..., m), by name.
    #[pyo3(signature = (measurements, known, mean, sigma, starts, max_iterations, loss, constant, polish, rtol, alpha, weak_ratio, correlation))]
    #[allow(clippy::too_many_arguments)]
    fn estimate<'py>(
        &self,
        py: Python<'py>,
        measurements: &Bound<'py, PyAny>,
        known: &Bound<'py, PyAny>,
        mean: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
        starts: Option<&Bound<'py, PyAny>>,
        max_iterations: u32,
        loss: &str,
        constant: f64,
        polish: usize,
        rtol: Option<f64>,
        alpha: f64,
        weak_ratio: f64,
        correlation: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (n, m) = (self.scene.states(), self.scene.measurements());
        let mut z = Input::unchecked(measurements, "measurements", 1)?;
        z.expect(&[Some(m)], "all measurements of the sensors in their order")?;
        let known = Input::unchecked(known, "known", 1)?;
        let mean = Input::new(mean, "prior mean", 1)?;
        let sigma = Input::unchecked(sigma, "prior sigma", 1)?;
        for input in [&known, &mean, &sigma] {
            input.expect(&[Some(n)], "one number for each state")?;
        }
        let starts = starts.map(|s| Input::new(s, "start", 2)).transpose()?;
        if let Some(starts) = &starts {
            starts.expect(&[None, Some(n)], "one number for each state")?;
        }
        let batch = Batch::of(&mut [&mut z])?;
        let loss = match loss {
            "huber" => Loss::Huber(constant),
            "tukey" => Loss::Tukey(constant),
            _ => Loss::Squares,
        };
        let task = Task {
            scene: &self.scene,
            known: known.slice()?,
            mean: mean.slice()?,
            sigma: sigma.slice()?,
            options: Options {
                max_iterations,
                loss,
                polish,
                rtol,
                correlation,
            },
        };
        let size = Layout { states: n }.size();
        let mut flat = vec![0.0; size * batch.len()];
        {
            let z = z.items()?;
            let starts = starts
                .as_ref()
                .map(|s| Ok::<_, PyErr>(Items::shared(s.slice()?)))
                .transpose()?;
            let cost = kernel::cost(&self.scene, polish);
            let write = &mut flat;
            run::in_pieces(py, batch.len(), cost, |range, threads: Threads| {
                kernel::estimate(
                    task,
                    z.skip(range.start),
                    starts,
                    threads,
                    &mut write[range.start * size..range.end * size],
                )
                .map_err(|error| self.error("", error))
            })?;
        }
        let out = PyDict::new(py);
        let mut at = 0;
        let parts: [(&str, &[usize]); 13] = [
            ("state", &[n]),
            ("covariance", &[n, n]),
            ("null_direction", &[n]),
            ("other", &[n]),
            ("cost", &[]),
            ("other_cost", &[]),
            ("chi2", &[]),
            ("present", &[]),
            ("rank", &[]),
            ("iterations", &[]),
            ("converged", &[]),
            ("vagueness", &[]),
            ("lag_p_value", &[]),
        ];
        for (name, shape) in parts {
            let width: usize = shape.iter().product();
            let array = batch.array(py, shape)?;
            {
                let mut write = array.readwrite();
                for (out, from) in write
                    .as_slice_mut()?
                    .chunks_exact_mut(width)
                    .zip(flat.chunks_exact(size))
                {
                    out.copy_from_slice(&from[at..at + width]);
                }
            }
            at += width;
            out.set_item(name, array)?;
        }
        let verdicts: Vec<_> = flat
            .chunks_exact(size)
            .map(|trial| task.judge(trial, alpha, weak_ratio))
            .collect();
        put_verdicts(py, &batch, &verdicts, &out)?;
        Ok(out)
    }
}

/// Puts the parts of verdicts into the answer.
fn put_verdicts(
    py: Python<'_>,
    batch: &Batch,
    verdicts: &[Verdict],
    out: &Bound<'_, PyDict>,
) -> PyResult<()> {
    for (name, value) in [
        (
            "code",
            (|v| f64::from(v.status as u8)) as fn(&Verdict) -> f64,
        ),
        ("dof", |v| v.dof),
        ("p_value", |v| v.p_value),
    ] {
        let array = batch.array(py, &[])?;
        for (out, verdict) in array.readwrite().as_slice_mut()?.iter_mut().zip(verdicts) {
            *out = value(verdict);
        }
        out.set_item(name, array)?;
    }
    Ok(())
}

/// The statuses of an estimate, worst first.
#[pyfunction]
fn track_statuses() -> Vec<&'static str> {
    Status::ALL.iter().map(|status| status.name()).collect()
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(track_statuses, module)?)?;
    module.add_class::<TrackCarrier>()?;
    module.add_class::<TrackScene>()
}
