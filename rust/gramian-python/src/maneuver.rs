//! Observer maneuver: laws, paths, information.

use gramian::batch::simd::Path;
use gramian::maneuver::batch::{self, Determinant, Paths, Sightings};
use gramian::maneuver::{AtStandoff, Law};
use numpy::{PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::{Batch, Input};
use crate::errors::{self, InputError};
use crate::run;

fn law(name: &str) -> PyResult<Law> {
    Ok(match name {
        "max_det" => Law::MaxDet,
        "hammel_liu" => Law::HammelLiu,
        "bearing_rate" => Law::BearingRate,
        "perpendicular" => Law::Perpendicular,
        _ => {
            return Err(InputError::new_err(format!(
                "law = \"{name}\": must be \"max_det\", \"hammel_liu\", \"bearing_rate\" or \
                 \"perpendicular\""
            )));
        }
    })
}

/// Sides are 1 (right) or -1 (left).
fn expect_sides(sides: &Input<'_>) -> PyResult<()> {
    match sides.slice()?.iter().find(|&&x| x.abs() != 1.0) {
        None => Ok(()),
        Some(given) => Err(InputError::new_err(format!(
            "side = {given}: must be 1 (right of the line of sight) or -1 (left)"
        ))),
    }
}

/// Headings (...,); all inputs broadcast.
#[pyfunction]
fn maneuver_heading<'py>(
    py: Python<'py>,
    bearing: &Bound<'py, PyAny>,
    range_: &Bound<'py, PyAny>,
    step: &Bound<'py, PyAny>,
    law: &str,
    side: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let law = self::law(law)?;
    let mut bearing = Input::new(bearing, "bearing", 0)?;
    let mut range = Input::new(range_, "range_", 0)?;
    range.expect_positive("m")?;
    let mut step = Input::new(step, "step", 0)?;
    step.expect_positive("m")?;
    let mut side = Input::new(side, "side", 0)?;
    expect_sides(&side)?;
    let batch = Batch::of(&mut [&mut bearing, &mut range, &mut step, &mut side])?;
    let out = batch.zeros(py, &[]);
    {
        let (bearing, range) = (bearing.items()?, range.items()?);
        let (step, side) = (step.items()?, side.items()?);
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        run::in_pieces(py, batch.len(), 50.0, |trials, threads| {
            batch::headings(
                bearing.skip(trials.start),
                range.skip(trials.start),
                step.skip(trials.start),
                side.skip(trials.start),
                law,
                threads,
                &mut write[trials.clone()],
            )
            .map_err(|(trial, error)| errors::input_at(&batch.place(trials.start + trial), error))
        })?;
    }
    Ok(out)
}

/// Paths (..., 10 samples): see `gramian::maneuver::batch::path_size`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn maneuver_trajectory<'py>(
    py: Python<'py>,
    target: &Bound<'py, PyAny>,
    start: &Bound<'py, PyAny>,
    step: &Bound<'py, PyAny>,
    samples: usize,
    law: &str,
    side: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    standoff: &Bound<'py, PyAny>,
    circles: bool,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let law = self::law(law)?;
    let mut target = Input::new(target, "target", 1)?;
    target.expect(&[Some(2)], "east and north")?;
    let mut start = Input::new(start, "start", 1)?;
    start.expect(&[Some(2)], "east and north")?;
    let mut step = Input::new(step, "step", 0)?;
    step.expect_positive("m")?;
    let mut side = Input::new(side, "side", 0)?;
    expect_sides(&side)?;
    let mut sigma = Input::new(sigma, "sigma", 0)?;
    sigma.expect_positive("rad")?;
    let mut standoff = Input::new(standoff, "standoff", 0)?;
    standoff.expect_nonnegative()?;
    let batch = Batch::of(&mut [
        &mut target,
        &mut start,
        &mut step,
        &mut side,
        &mut sigma,
        &mut standoff,
    ])?;
    let size = batch::path_size(samples);
    let out = batch.zeros(py, &[size]);
    {
        let (target, start, step) = (target.items()?, start.items()?, step.items()?);
        let (side, sigma, standoff) = (side.items()?, sigma.items()?, standoff.items()?);
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        run::in_pieces(py, batch.len(), 15.0 * samples as f64, |trials, threads| {
            let first = trials.start;
            let paths = Paths {
                target: target.skip(first),
                start: start.skip(first),
                step: step.skip(first),
                side: side.skip(first),
                sigma: sigma.skip(first),
                standoff: standoff.skip(first),
                law,
                at_standoff: if circles {
                    AtStandoff::Circle
                } else {
                    AtStandoff::Stop
                },
            };
            let out = &mut write[first * size..trials.end * size];
            batch::trajectories(paths, samples, threads, Path::Best, out)
                .map_err(|(trial, error)| errors::input_at(&batch.place(first + trial), error))
        })?;
    }
    Ok(out)
}

/// The checked inputs of `maneuver_fisher` and `maneuver_fisher_det`.
struct Inputs<'py> {
    positions: Input<'py>,
    target: Input<'py>,
    times: Input<'py>,
    sigma: Input<'py>,
    batch: Batch,
}

impl<'py> Inputs<'py> {
    fn new(
        py: Python<'py>,
        positions: &Bound<'py, PyAny>,
        target: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
        times: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        let inputs = Self::unchecked(py, positions, target, sigma, times)?;
        inputs.positions.check_finite()?;
        Ok(inputs)
    }

    /// The same for a kernel that refuses positions that are not finite.
    fn unchecked(
        py: Python<'py>,
        positions: &Bound<'py, PyAny>,
        target: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
        times: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        let mut positions = Input::unchecked(positions, "path", 2)?;
        positions.expect(&[None, Some(2)], "an east and a north for each bearing")?;
        positions.expect_entries()?;
        let m = positions.core_shape()[0];
        let mut target = Input::new(target, "target", 1)?;
        let mut times = if let Some(times) = times {
            let times = Input::new(times, "times", 1)?;
            times.expect(&[Some(m)], "one for each position")?;
            times.expect_increasing("s")?;
            times
        } else {
            Input::new(
                PyArrayDyn::<f64>::zeros(py, vec![0], false).as_any(),
                "times",
                1,
            )?
        };
        let mut sigma = Input::new(sigma, "sigma", 1)?;
        if sigma.core_shape() != [1] {
            sigma.expect(
                &[Some(m)],
                "one standard deviation, or one for each position",
            )?;
        }
        sigma.expect_positive("rad")?;
        let batch = Batch::of(&mut [&mut positions, &mut target, &mut times, &mut sigma])?;
        Ok(Self {
            positions,
            target,
            times,
            sigma,
            batch,
        })
    }

    fn samples(&self) -> usize {
        self.positions.core_shape()[0]
    }

    fn sightings(&self) -> PyResult<Sightings<'_>> {
        Ok(Sightings {
            positions: self.positions.items()?,
            target: self.target.items()?,
            times: self.times.items()?,
            sigma: self.sigma.items()?,
        })
    }
}

/// Information (..., n, n): n is 2 for a fixed target, 4 with times.
#[pyfunction]
#[pyo3(signature = (positions, target, sigma, times))]
fn maneuver_fisher<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    times: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let inputs = Inputs::unchecked(py, positions, target, sigma, times)?;
    let sightings = inputs.sightings()?;
    let n = sightings.states();
    let out = inputs.batch.zeros(py, &[n, n]);
    {
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        let cost = inputs.samples() as f64;
        run::in_pieces(py, inputs.batch.len(), cost, |trials, threads| {
            let out = &mut write[trials.start * n * n..trials.end * n * n];
            batch::fisher(sightings.skip(trials.start), threads, Path::Best, out).map_err(
                |(trial, error)| errors::input_at(&inputs.batch.place(trials.start + trial), error),
            )
        })
        // The kernel refuses what is not finite; here is where its place is known.
        .or_else(|error| inputs.positions.check_finite().and(Err(error)))?;
    }
    Ok(out)
}

/// Determinants (...,) of the information.
#[pyfunction]
#[pyo3(signature = (positions, target, sigma, times, pairs))]
fn maneuver_fisher_det<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    times: Option<&Bound<'py, PyAny>>,
    pairs: bool,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let inputs = Inputs::new(py, positions, target, sigma, times)?;
    let sightings = inputs.sightings()?;
    let method = if pairs {
        Determinant::Pairs
    } else {
        Determinant::Root
    };
    let out = inputs.batch.zeros(py, &[]);
    {
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        let m = inputs.samples() as f64;
        let cost = if pairs { m * m } else { 40.0 * m };
        run::in_pieces(py, inputs.batch.len(), cost, |trials, threads| {
            let out = &mut write[trials.clone()];
            batch::fisher_det(sightings.skip(trials.start), method, threads, out).map_err(
                |(trial, error)| errors::input_at(&inputs.batch.place(trials.start + trial), error),
            )
        })?;
    }
    Ok(out)
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(maneuver_fisher, module)?)?;
    module.add_function(wrap_pyfunction!(maneuver_fisher_det, module)?)?;
    module.add_function(wrap_pyfunction!(maneuver_heading, module)?)?;
    module.add_function(wrap_pyfunction!(maneuver_trajectory, module)?)
}
