//! Nonlinear systems along a trajectory: the user's functions are called back.

use gramian::dynamics::{self, Failure, Path, System};
use gramian::inertial::{self, Unknown, Visual};
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

use crate::convert::Input;
use crate::errors::{self, InputError};
use crate::run;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Functions of times (k) and states (k, n) that return float64 arrays.
struct Functions<'py> {
    py: Python<'py>,
    rate: Bound<'py, PyAny>,
    rate_jacobian: Option<Bound<'py, PyAny>>,
    output: Bound<'py, PyAny>,
    output_jacobian: Option<Bound<'py, PyAny>>,
    scale: Vec<f64>,
    outputs: usize,
    names: Vec<String>,
    takes_many: bool,
}

fn call<'py>(
    py: Python<'py>,
    function: &Bound<'py, PyAny>,
    t: &[f64],
    x: &[f64],
    out: &mut [f64],
) -> PyResult<()> {
    let times = PyArray1::from_slice(py, t);
    let points = PyArray1::from_slice(py, x).reshape([t.len(), x.len() / t.len().max(1)])?;
    let found: PyReadonlyArrayDyn<'py, f64> = function.call1((times, points))?.extract()?;
    let found = found.as_slice()?;
    if found.len() != out.len() {
        return Err(InputError::new_err(format!(
            "a function of the system returned {} numbers: must be {}",
            found.len(),
            out.len()
        )));
    }
    out.copy_from_slice(found);
    Ok(())
}

impl System for Functions<'_> {
    type Error = PyErr;

    fn states(&self) -> usize {
        self.scale.len()
    }

    fn outputs(&self) -> usize {
        self.outputs
    }

    fn takes_many(&self) -> bool {
        self.takes_many
    }

    /// An interrupt is no fault of a guess.
    fn is_final(&self, error: &PyErr) -> bool {
        !error.is_instance_of::<PyException>(self.py)
    }

    fn rate(&mut self, t: &[f64], x: &[f64], out: &mut [f64]) -> PyResult<()> {
        self.py.check_signals()?;
        call(self.py, &self.rate, t, x, out)
    }

    fn rate_jacobian(&mut self, t: &[f64], x: &[f64], out: &mut [f64]) -> PyResult<()> {
        let (py, n) = (self.py, self.scale.len());
        if let Some(function) = &self.rate_jacobian {
            return call(py, function, t, x, out);
        }
        let f = |t: &[f64], x: &[f64], out: &mut [f64]| call(py, &self.rate, t, x, out);
        let mut error = vec![0.0; out.len()];
        // A step that is tried may go anywhere: what f does there is not judged.
        dynamics::differences(f, t, x, n, &self.scale, out, &mut error).map(|_| ())
    }

    fn output(&mut self, t: &[f64], x: &[f64], out: &mut [f64]) -> PyResult<()> {
        call(self.py, &self.output, t, x, out)
    }

    fn output_jacobian(
        &mut self,
        t: &[f64],
        x: &[f64],
        out: &mut [f64],
        error: &mut [f64],
    ) -> PyResult<()> {
        let py = self.py;
        if let Some(function) = &self.output_jacobian {
            return call(py, function, t, x, out);
        }
        let h = |t: &[f64], x: &[f64], out: &mut [f64]| call(py, &self.output, t, x, out);
        let bad = dynamics::differences(h, t, x, self.outputs, &self.scale, out, error)?;
        let Some(bad) = bad else { return Ok(()) };
        Err(InputError::new_err(format!(
            "h[{}] at t = {} changes by {:.3e} for each unit of {} over a step of {:.1e}, and by \
             {:.3e} over {:.1e}: it jumps there or bends within the step: give scale, a jacobian, \
             or sine and cosine of an angle that wraps",
            bad.value,
            t[bad.point],
            bad.slopes[0],
            self.names[bad.state],
            bad.steps[0],
            bad.slopes[1],
            bad.steps[1],
        )))
    }
}

type Followed<'py> = (
    Array<'py>,
    Array<'py>,
    Array<'py>,
    Array<'py>,
    Array<'py>,
    Array<'py>,
    usize,
);

/// States (K, n), outputs (K, p), transitions (K - 1, n, n), output Jacobians (K, p, n), what
/// longer steps would change in the transitions, errors of the Jacobians, and the steps taken.
/// Without `rtol` the system is a map.
#[pyfunction]
#[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)] // Python's values.
fn dynamics_follow<'py>(
    py: Python<'py>,
    rate: Bound<'py, PyAny>,
    rate_jacobian: Option<Bound<'py, PyAny>>,
    output: Bound<'py, PyAny>,
    output_jacobian: Option<Bound<'py, PyAny>>,
    outputs: usize,
    scale: Vec<f64>,
    x0: Vec<f64>,
    times: Vec<f64>,
    rtol: Option<f64>,
    most: usize,
    names: Vec<String>,
    takes_many: bool,
) -> PyResult<Followed<'py>> {
    let n = scale.len();
    let mut system = Functions {
        py,
        rate,
        rate_jacobian,
        output,
        output_jacobian,
        scale,
        outputs,
        names,
        takes_many,
    };
    let found = match rtol {
        Some(rtol) => dynamics::integrate(&mut system, &x0, &times, rtol, most),
        None => dynamics::iterate(&mut system, &x0, &times),
    };
    packed(py, found, |error| error, [n, outputs], &times)
}

/// A trajectory of n states and p outputs in arrays, or why there is none.
fn packed<'py, E>(
    py: Python<'py>,
    found: Result<dynamics::Trajectory, Failure<E>>,
    told: impl FnOnce(E) -> PyErr,
    [n, outputs]: [usize; 2],
    times: &[f64],
) -> PyResult<Followed<'py>> {
    let found = found.map_err(|error| match error {
        Failure::System(error) => told(error),
        Failure::Number(error) => errors::input_at("", error),
        Failure::Stuck { time, step } => InputError::new_err(format!(
            "the trajectory cannot be followed beyond t = {time}: steps of {step:.1e} are not \
             accurate enough: is f smooth and finite there?"
        )),
        Failure::TooFar { most, time } => InputError::new_err(format!(
            "max_steps = {most}: so many steps of the integrator came no farther than t = {time} \
             of {}: give fewer or earlier times, or allow more steps",
            times[times.len() - 1]
        )),
        Failure::Infinite { state, time } => {
            InputError::new_err(format!("state {state} is not finite at t = {time}"))
        }
    })?;
    let count = times.len();
    let array = |data: Vec<f64>, shape: &[usize]| -> PyResult<Array<'py>> {
        PyArray1::from_vec(py, data).reshape(shape.to_vec())
    };
    Ok((
        array(found.states, &[count, n])?,
        array(found.outputs, &[count, outputs])?,
        array(found.transitions, &[count - 1, n, n])?,
        array(found.jacobians, &[count, outputs, n])?,
        array(found.transition_changes, &[count - 1, n, n])?,
        array(found.jacobian_errors, &[count, outputs, n])?,
        found.steps,
    ))
}

/// A camera beside a navigator as a system.
struct Camera<'py> {
    py: Python<'py>,
    visual: Visual,
}

/// A fault of the model, or Ctrl-C.
enum Fault {
    Model(inertial::Error),
    Python(PyErr),
}

impl Camera<'_> {
    fn each(
        &self,
        t: &[f64],
        x: &[f64],
        out: &mut [f64],
        one: impl Fn(&Visual, f64, &[f64], &mut [f64]) -> Result<(), inertial::Error>,
    ) -> Result<(), Fault> {
        self.py.check_signals().map_err(Fault::Python)?;
        let (n, size) = (self.visual.states(), out.len() / t.len().max(1));
        for ((&t, x), out) in t
            .iter()
            .zip(x.chunks_exact(n))
            .zip(out.chunks_exact_mut(size))
        {
            one(&self.visual, t, x, out).map_err(Fault::Model)?;
        }
        Ok(())
    }
}

impl System for Camera<'_> {
    type Error = Fault;

    fn states(&self) -> usize {
        self.visual.states()
    }

    fn outputs(&self) -> usize {
        self.visual.outputs()
    }

    fn rate(&mut self, t: &[f64], x: &[f64], out: &mut [f64]) -> Result<(), Fault> {
        self.each(t, x, out, |v, t, x, out| {
            v.rate(t, x, out);
            Ok(())
        })
    }

    fn rate_jacobian(&mut self, t: &[f64], x: &[f64], out: &mut [f64]) -> Result<(), Fault> {
        self.each(t, x, out, |v, t, x, out| {
            v.rate_jacobian(t, x, out);
            Ok(())
        })
    }

    fn output(&mut self, t: &[f64], x: &[f64], out: &mut [f64]) -> Result<(), Fault> {
        self.each(t, x, out, Visual::output)
    }

    fn output_jacobian(
        &mut self,
        t: &[f64],
        x: &[f64],
        out: &mut [f64],
        _: &mut [f64],
    ) -> Result<(), Fault> {
        self.each(t, x, out, |v, _, x, out| {
            v.output_jacobian(x, out);
            Ok(())
        })
    }
}

fn vectors(values: &[f64]) -> Vec<[f64; 3]> {
    values.as_chunks::<3>().0.to_vec()
}

/// The trajectory of a camera beside a navigator, as `dynamics_follow` gives one, after its
/// first state. Mounting: rows of the matrix from body to camera, then the arm, then gravity.
#[pyfunction]
#[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)] // Python's values.
fn inertial_visual(
    py: Python<'_>,
    times: Vec<f64>,
    gyro: Vec<f64>,
    accel: Vec<f64>,
    landmarks: Vec<f64>,
    mounting: Vec<f64>,
    start: Vec<f64>,
    unknown: Vec<String>,
    rtol: f64,
    most: usize,
) -> PyResult<(Vec<f64>, Followed<'_>)> {
    let input = |error: inertial::Error| InputError::new_err(error.to_string());
    let unknown = unknown
        .iter()
        .map(|name| {
            Ok(match name.as_str() {
                "camera_rotation" => Unknown::CameraRotation,
                "camera_arm" => Unknown::CameraArm,
                "gravity" => Unknown::Gravity,
                "gravity_strength" => Unknown::GravityStrength,
                "scale" => Unknown::Scale,
                "landmarks" => Unknown::Landmarks,
                _ => return Err(InputError::new_err(format!("unknown has {name:?}"))),
            })
        })
        .collect::<PyResult<_>>()?;
    let [a, b, c, arm, gravity] = vectors(&mounting)[..] else {
        return Err(InputError::new_err("mounting: must be 15 numbers"));
    };
    let [place, attitude, velocity] = [0..3, 3..7, 7..10].map(|part| start.get(part));
    let (Some(place), Some(attitude), Some(velocity)) = (place, attitude, velocity) else {
        return Err(InputError::new_err("start: must be 10 numbers"));
    };
    let visual = Visual {
        times: times.clone(),
        gyro: vectors(&gyro),
        accel: vectors(&accel),
        camera: [a, b, c],
        arm,
        gravity,
        landmarks: vectors(&landmarks),
        unknown,
    };
    visual.check().map_err(input)?;
    let x0 = visual
        .start(
            core::array::from_fn(|i| place[i]),
            core::array::from_fn(|i| attitude[i]),
            core::array::from_fn(|i| velocity[i]),
        )
        .map_err(input)?;
    let shape = [visual.states(), visual.outputs()];
    let mut system = Camera { py, visual };
    let found = dynamics::integrate(&mut system, &x0, &times, rtol, most);
    let told = |fault| match fault {
        Fault::Model(error) => input(error),
        Fault::Python(error) => error,
    };
    Ok((x0, packed(py, found, told, shape, &times)?))
}

/// What a trajectory left behind, as Python holds it.
struct Kept<'py> {
    arrays: [Input<'py>; 4],
    n: usize,
    p: usize,
}

impl<'py> Kept<'py> {
    fn new(arrays: [&Bound<'py, PyAny>; 4]) -> PyResult<Self> {
        let transitions = Input::new(arrays[0], "transitions", 3)?;
        let changes = Input::new(arrays[1], "transition_changes", 3)?;
        let white = Input::new(arrays[2], "jacobians", 3)?;
        let errors = Input::new(arrays[3], "jacobian_errors", 3)?;
        let (count, p, n) = {
            let shape = white.core_shape();
            (shape[0], shape[1], shape[2])
        };
        let between = [Some(count.saturating_sub(1)), Some(n), Some(n)];
        transitions.expect(&between, "one between each two samples")?;
        changes.expect(&between, "one between each two samples")?;
        errors.expect(&[Some(count), Some(p), Some(n)], "as jacobians")?;
        Ok(Self {
            arrays: [transitions, changes, white, errors],
            n,
            p,
        })
    }

    fn path(&self) -> PyResult<Path<'_>> {
        let [transitions, changes, jacobians, errors] = &self.arrays;
        Ok(Path {
            transitions: transitions.slice()?,
            changes: changes.slice()?,
            jacobians: jacobians.slice()?,
            errors: errors.slice()?,
            n: self.n,
            p: self.p,
        })
    }
}

type RowsAndErrors<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

/// Rows (samples p, n) about the state at sample `first`, of the samples before `last`, and
/// their errors.
#[pyfunction]
fn dynamics_rows<'py>(
    py: Python<'py>,
    transitions: &Bound<'py, PyAny>,
    changes: &Bound<'py, PyAny>,
    white: &Bound<'py, PyAny>,
    errors: &Bound<'py, PyAny>,
    first: usize,
    last: usize,
) -> PyResult<RowsAndErrors<'py>> {
    let kept = Kept::new([transitions, changes, white, errors])?;
    let rows = kept
        .path()?
        .rows(first, last)
        .map_err(|error| errors::input_at("", error))?;
    let (count, n) = (rows.values.len() / kept.n, kept.n);
    Ok((
        PyArray1::from_vec(py, rows.values).reshape([count, n])?,
        PyArray1::from_vec(py, rows.errors).reshape([count, n])?,
    ))
}

type Windows<'py> = (
    Vec<usize>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Vec<Bound<'py, PyArray2<f64>>>,
);

/// Ranks, deviations (windows, n), singular values (windows, m), null spaces (k, n) of
/// windows of `width` samples. `basis` (K, n, m): the free directions.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // Python's values.
fn dynamics_windows<'py>(
    py: Python<'py>,
    transitions: &Bound<'py, PyAny>,
    changes: &Bound<'py, PyAny>,
    white: &Bound<'py, PyAny>,
    errors: &Bound<'py, PyAny>,
    width: usize,
    rtol: Option<f64>,
    basis: Option<&Bound<'py, PyAny>>,
) -> PyResult<Windows<'py>> {
    let kept = Kept::new([transitions, changes, white, errors])?;
    let (path, n) = (kept.path()?, kept.n);
    let basis = basis
        .map(|basis| Input::new(basis, "tangent", 3))
        .transpose()?;
    let m = basis.as_ref().map_or(n, |basis| basis.core_shape()[2]);
    let basis = match &basis {
        Some(basis) => Some((basis.slice()?, m)),
        None => None,
    };
    let found = run::detached(py, |_| dynamics::windows(&path, width, rtol, basis))?
        .map_err(|error| errors::input_at("", error))?;
    let count = found.len();
    let std: Vec<f64> = found.iter().flat_map(|look| look.std.clone()).collect();
    let values: Vec<f64> = found
        .iter()
        .flat_map(|look| look.singular_values.clone())
        .collect();
    let null_spaces = found
        .iter()
        .map(|look| {
            PyArray1::from_vec(py, look.null_space.concat()).reshape([look.null_space.len(), n])
        })
        .collect::<PyResult<Vec<_>>>()?;
    Ok((
        found.iter().map(|look| look.rank).collect(),
        PyArray1::from_vec(py, std).reshape([count, n])?,
        PyArray1::from_vec(py, values).reshape([count, m])?,
        null_spaces,
    ))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(dynamics_follow, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_visual, module)?)?;
    module.add_function(wrap_pyfunction!(dynamics_rows, module)?)?;
    module.add_function(wrap_pyfunction!(dynamics_windows, module)?)
}
