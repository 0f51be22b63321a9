//! The error model of a strapdown navigator.

use gramian::inertial::{
    self, Error, GravityGradient, Group, Leg, Motion, Output, Recorded, Sample, Segment, Segments,
    Start, Sway, error_model,
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

/// What a model is asked for: the arms of antenna and odometer, groups of states and
/// outputs by name, the rate of the Earth, whether gravity changes with the place.
type Wanted = ([f64; 3], [f64; 3], Vec<String>, Vec<String>, f64, bool);

fn group(name: &str) -> PyResult<Group> {
    Ok(match name {
        "lever_arm" => Group::LeverArm,
        "gyro_scale" => Group::GyroScale,
        "gyro_misalignment" => Group::GyroMisalignment,
        "accelerometer_scale" => Group::AccelerometerScale,
        "accelerometer_nonorthogonality" => Group::AccelerometerNonorthogonality,
        "accelerometer_misalignment" => Group::AccelerometerMisalignment,
        "g_sensitivity" => Group::GSensitivity,
        "odometer_scale" => Group::OdometerScale,
        "odometer_mounting" => Group::OdometerMounting,
        "odometer_arm" => Group::OdometerArm,
        _ => return Err(InputError::new_err(format!("estimated has {name:?}"))),
    })
}

fn output(name: &str) -> PyResult<Output> {
    Ok(match name {
        "velocity" => Output::Velocity,
        "position" => Output::Position,
        "odometer" => Output::Odometer,
        "side_slip" => Output::SideSlip,
        "zero_velocity" => Output::ZeroVelocity,
        "zero_angular_rate" => Output::ZeroAngularRate,
        "heading" => Output::Heading,
        _ => return Err(InputError::new_err(format!("outputs has {name:?}"))),
    })
}

/// Error models one after the other.
struct Models {
    lever_arm: [f64; 3],
    odometer_arm: [f64; 3],
    columns: Vec<usize>,
    outputs: Vec<Output>,
    earth_rate: f64,
    gravity_gradient: GravityGradient,
    a: Vec<f64>,
    c: Vec<f64>,
    per_metre: Vec<f64>,
}

impl Models {
    fn new(wanted: Wanted) -> PyResult<Self> {
        let (lever_arm, odometer_arm, groups, outputs, earth_rate, gradient) = wanted;
        let mut columns: Vec<usize> = Group::Core.columns().collect();
        for name in groups {
            columns.extend(group(&name)?.columns());
        }
        Ok(Self {
            lever_arm,
            odometer_arm,
            columns,
            outputs: outputs
                .iter()
                .map(|name| output(name))
                .collect::<Result<_, _>>()?,
            earth_rate,
            gravity_gradient: if gradient {
                GravityGradient::Include
            } else {
                GravityGradient::Omit
            },
            a: vec![],
            c: vec![],
            per_metre: vec![],
        })
    }

    fn push(&mut self, motion: Motion<f64>) -> Result<(), Error> {
        let model = error_model(&Motion {
            lever_arm: self.lever_arm,
            odometer_arm: self.odometer_arm,
            earth_rate: self.earth_rate,
            gravity_gradient: self.gravity_gradient,
            ..motion
        })?;
        let n = self.columns.len();
        for line in &model.a {
            self.a.extend(self.columns.iter().map(|&k| line[k]));
        }
        // All other states are constant.
        self.a.resize(self.a.len() + (n - model.a.len()) * n, 0.0);
        for &output in &self.outputs {
            for line in &model.output(output)?[..output.len()] {
                self.c.extend(self.columns.iter().map(|&k| line[k]));
            }
        }
        self.per_metre.extend_from_slice(&model.per_metre);
        Ok(())
    }
}

/// A (segments, n, n), C (segments, p, n) and one metre north, west, up in the units of
/// the place (segments, 3).
type Matrices<'py> = (
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray2<f64>>,
);

impl Models {
    fn arrays(self, py: Python<'_>) -> PyResult<Matrices<'_>> {
        use numpy::PyArrayMethods;
        let (n, count) = (self.columns.len(), self.per_metre.len() / 3);
        let p = self
            .outputs
            .iter()
            .map(|output| output.len())
            .sum::<usize>();
        Ok((
            PyArray1::from_vec(py, self.a).reshape([count, n, n])?,
            PyArray1::from_vec(py, self.c).reshape([count, p, n])?,
            PyArray1::from_vec(py, self.per_metre).reshape([count, 3])?,
        ))
    }
}

#[pyfunction]
#[pyo3(signature = (latitude, height, specific_force, velocity, attitude, angular_rate, wanted))]
#[allow(clippy::too_many_arguments)]
fn inertial_error_model(
    py: Python<'_>,
    latitude: f64,
    height: f64,
    specific_force: Option<[f64; 3]>,
    velocity: [f64; 3],
    attitude: [[f64; 3]; 3],
    angular_rate: [f64; 3],
    wanted: Wanted,
) -> PyResult<Matrices<'_>> {
    let mut models = Models::new(wanted)?;
    let motion = Motion {
        specific_force,
        velocity,
        attitude,
        angular_rate,
        ..Motion::at_rest(latitude, height, models.earth_rate)
    };
    models.push(motion).map_err(input)?;
    models.arrays(py)
}

/// The matrices of each segment; duration, beginning, heading, speed, latitude and
/// longitude of each (segments, 6); the leg of each.
type Flight<'py> = (
    Matrices<'py>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<usize>>,
);

fn flown(
    py: Python<'_>,
    mut models: Models,
    segments: impl Iterator<Item = Result<Segment<f64>, Error>>,
) -> PyResult<Flight<'_>> {
    use numpy::PyArrayMethods;
    let (mut table, mut owner) = (vec![], vec![]);
    for segment in segments {
        let segment = segment.map_err(input)?;
        models.push(segment.motion).map_err(input)?;
        table.extend_from_slice(&[
            segment.duration,
            segment.time,
            segment.heading,
            segment.speed,
            segment.motion.latitude,
            segment.longitude,
        ]);
        owner.push(segment.leg);
        if owner.len() % 4096 == 0 {
            py.check_signals()?;
        }
    }
    py.check_signals()?;
    let table = PyArray1::from_vec(py, table).reshape([owner.len(), 6])?;
    Ok((models.arrays(py)?, table, PyArray1::from_vec(py, owner)))
}

#[pyfunction]
fn inertial_segments(
    py: Python<'_>,
    legs: Vec<[f64; 4]>,
    start: [f64; 5],
    step: f64,
    largest_turn: f64,
    wanted: Wanted,
) -> PyResult<Flight<'_>> {
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
    let models = Models::new(wanted)?;
    let segments =
        Segments::new(&legs, start, step, largest_turn, models.earth_rate).map_err(input)?;
    flown(py, models, segments)
}

#[pyfunction]
#[pyo3(signature = (times, velocity, angles, legs, place, step, largest_turn, wanted))]
#[allow(clippy::too_many_arguments)]
fn inertial_recorded(
    py: Python<'_>,
    times: Vec<f64>,
    velocity: Vec<[f64; 3]>,
    angles: Vec<[f64; 3]>,
    legs: Vec<usize>,
    place: [f64; 3],
    step: f64,
    largest_turn: f64,
    wanted: Wanted,
) -> PyResult<Flight<'_>> {
    let samples: Vec<Sample<f64>> = times
        .into_iter()
        .zip(velocity)
        .zip(angles)
        .zip(legs)
        .map(|(((time, velocity), angles), leg)| Sample {
            time,
            velocity,
            angles,
            leg,
        })
        .collect();
    let models = Models::new(wanted)?;
    let segments =
        Recorded::new(&samples, place, step, largest_turn, models.earth_rate).map_err(input)?;
    flown(py, models, segments)
}

/// Heading, pitch and roll less their means, (times, 3).
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
fn inertial_sway(
    py: Python<'_>,
    times: Vec<f64>,
    amplitude: [f64; 3],
    period: [f64; 3],
    phase: [f64; 3],
) -> PyResult<Bound<'_, PyArray2<f64>>> {
    use numpy::PyArrayMethods;
    let sway = Sway {
        amplitude,
        period,
        phase,
    };
    let mut angles = Vec::with_capacity(3 * times.len());
    for &time in &times {
        angles.extend_from_slice(&sway.at(time).map_err(input)?);
    }
    PyArray1::from_vec(py, angles).reshape([times.len(), 3])
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("EARTH_RATE", inertial::EARTH_RATE)?;
    module.add_function(wrap_pyfunction!(inertial_radii, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_gravity, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_rotation, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_combinations_at_rest, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_error_model, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_recorded, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_sway, module)?)?;
    module.add_function(wrap_pyfunction!(inertial_segments, module)?)
}
