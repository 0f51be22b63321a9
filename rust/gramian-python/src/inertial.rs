//! The error model of a strapdown navigator.

use gramian::inertial::{
    self, Error, ErrorModel, GravityGradient, Leg, Motion, Segments, Start, error_model,
};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;

use crate::errors::InputError;

fn input(error: Error) -> PyErr {
    InputError::new_err(error.to_string())
}

#[pyfunction]
fn inertial_radii(latitude: f64) -> PyResult<(f64, f64)> {
    inertial::radii(latitude).map_err(input)
}

#[pyfunction]
fn inertial_gravity(latitude: f64, height: f64) -> PyResult<f64> {
    inertial::gravity(latitude, height).map_err(input)
}

#[pyfunction]
fn inertial_rotation(
    py: Python<'_>,
    heading: f64,
    pitch: f64,
    roll: f64,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let matrix = inertial::rotation(heading, pitch, roll).map_err(input)?;
    Ok(PyArray2::from_owned_array(
        py,
        numpy::ndarray::arr2(&matrix),
    ))
}

#[pyfunction]
fn inertial_combinations_at_rest(
    py: Python<'_>,
    latitude: f64,
    height: f64,
    earth_rate: f64,
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let rows = inertial::combinations_at_rest(latitude, height, earth_rate).map_err(input)?;
    Ok(PyArray2::from_owned_array(py, numpy::ndarray::arr2(&rows)))
}

/// Error models one after the other.
#[derive(Default)]
struct Models {
    states: usize,
    a: Vec<f64>,
    c: Vec<f64>,
    per_metre: Vec<f64>,
}

impl Models {
    fn push(&mut self, motion: &Motion<f64>, lever_arm_states: bool) -> Result<(), Error> {
        if lever_arm_states {
            self.keep::<18>(&error_model(motion)?);
        } else {
            self.keep::<15>(&error_model(motion)?);
        }
        Ok(())
    }

    fn keep<const N: usize>(&mut self, model: &ErrorModel<f64, N>) {
        self.states = N;
        self.a.extend_from_slice(model.a.as_flattened());
        self.c.extend_from_slice(model.c.as_flattened());
        self.per_metre.extend_from_slice(&model.per_metre);
    }
}

/// A (segments, n, n), C (segments, 6, n) and one metre north, west, up in the units of
/// the place (segments, 3).
type Matrices<'py> = (
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray2<f64>>,
);

impl Models {
    fn arrays(self, py: Python<'_>) -> PyResult<Matrices<'_>> {
        use numpy::PyArrayMethods;
        let (n, count) = (self.states, self.per_metre.len() / 3);
        Ok((
            PyArray1::from_vec(py, self.a).reshape([count, n, n])?,
            PyArray1::from_vec(py, self.c).reshape([count, 6, n])?,
            PyArray1::from_vec(py, self.per_metre).reshape([count, 3])?,
        ))
    }
}

fn gradient(include: bool) -> GravityGradient {
    if include {
        GravityGradient::Include
    } else {
        GravityGradient::Omit
    }
}

#[pyfunction]
#[pyo3(signature = (
    latitude, height, specific_force, velocity, attitude, angular_rate, lever_arm,
    lever_arm_states, earth_rate, gravity_gradient
))]
#[allow(clippy::too_many_arguments)]
fn inertial_error_model(
    py: Python<'_>,
    latitude: f64,
    height: f64,
    specific_force: Option<[f64; 3]>,
    velocity: [f64; 3],
    attitude: [[f64; 3]; 3],
    angular_rate: [f64; 3],
    lever_arm: [f64; 3],
    lever_arm_states: bool,
    earth_rate: f64,
    gravity_gradient: bool,
) -> PyResult<Matrices<'_>> {
    let motion = Motion {
        latitude,
        height,
        velocity,
        specific_force,
        attitude,
        angular_rate,
        lever_arm,
        earth_rate,
        gravity_gradient: gradient(gravity_gradient),
    };
    let mut models = Models::default();
    models.push(&motion, lever_arm_states).map_err(input)?;
    models.arrays(py)
}

/// The matrices of each segment; duration, beginning, heading, speed, latitude and
/// longitude of each (segments, 6); the leg of each.
type Flight<'py> = (
    Matrices<'py>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<usize>>,
);

#[pyfunction]
#[pyo3(signature = (
    legs, start, step, largest_turn, lever_arm, lever_arm_states, earth_rate, gravity_gradient
))]
#[allow(clippy::too_many_arguments)]
fn inertial_segments(
    py: Python<'_>,
    legs: Vec<[f64; 4]>,
    start: [f64; 5],
    step: f64,
    largest_turn: f64,
    lever_arm: [f64; 3],
    lever_arm_states: bool,
    earth_rate: f64,
    gravity_gradient: bool,
) -> PyResult<Flight<'_>> {
    use numpy::PyArrayMethods;
    let legs: Vec<Leg<f64>> = legs
        .into_iter()
        .map(|[duration, turn, speed_change, bank]| Leg {
            duration,
            turn,
            speed_change,
            bank,
        })
        .collect();
    let [latitude, longitude, height, speed, heading] = start;
    let start = Start {
        latitude,
        longitude,
        height,
        speed,
        heading,
    };
    let (mut models, mut table, mut owner) = (Models::default(), vec![], vec![]);
    for segment in Segments::new(&legs, start, step, largest_turn, earth_rate).map_err(input)? {
        let segment = segment.map_err(input)?;
        let motion = Motion {
            lever_arm,
            gravity_gradient: gradient(gravity_gradient),
            ..segment.motion
        };
        models.push(&motion, lever_arm_states).map_err(input)?;
        table.extend_from_slice(&[
            segment.duration,
            segment.time,
            segment.heading,
            segment.speed,
            motion.latitude,
            segment.longitude,
        ]);
        owner.push(segment.leg);
    }
    py.check_signals()?;
    let table = PyArray1::from_vec(py, table).reshape([owner.len(), 6])?;
    Ok((models.arrays(py)?, table, PyArray1::from_vec(py, owner)))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("EARTH_RATE", inertial::EARTH_RATE)?;
    module.add_function(wrap_pyfunction!(inertial_radii, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_gravity, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_rotation, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_combinations_at_rest, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_error_model, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_segments, module)?)
}
