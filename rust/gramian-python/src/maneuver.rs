//! Observer maneuver: laws, paths, information.

use gramian::batch::simd::Path;
use gramian::batch::{Items, Threads};
use gramian::maneuver::batch::{self, Determinant, Paths, Sightings};
use gramian::maneuver::{AtStandoff, Law, Side, TwoLegGoal, best_two_legs, heading, two_leg_terms};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{Input, Number, plain_numbers};
use crate::errors::InputError;
use crate::output::{self, Batch};
use crate::run;

pub fn law(name: &str) -> PyResult<Law> {
    Ok(match name {
        "max_det" => Law::MaxDet,
        "hammel_liu" => Law::HammelLiu,
        "bearing_rate" => Law::BearingRate,
        "circle" => Law::Circle,
        "perpendicular" => Law::Perpendicular,
        _ => {
            return Err(InputError::new_err(format!(
                "law = \"{name}\": must be \"max_det\", \"hammel_liu\", \"bearing_rate\", \
                 \"circle\" or \"perpendicular\""
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

fn one_side(number: f64) -> Option<Side> {
    match number {
        1.0 => Some(Side::Right),
        -1.0 => Some(Side::Left),
        _ => None,
    }
}

/// Headings (...,), a number for a single one; all inputs broadcast.
#[pyfunction]
#[pyo3(signature = (bearing, range_, step, law, side, out=None))]
fn maneuver_heading<'py>(
    py: Python<'py>,
    bearing: &Bound<'py, PyAny>,
    range_: &Bound<'py, PyAny>,
    step: &Bound<'py, PyAny>,
    law: &str,
    side: &Bound<'py, PyAny>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let law = self::law(law)?;
    if out.is_none()
        && let Some([bearing, range, step, side]) = plain_numbers([bearing, range_, step, side])
        && let Some(side) = one_side(side)
        && let Ok(heading) = heading(bearing, range, step, law, side)
    {
        return output::number(py, heading);
    }
    let mut bearing = Input::new(bearing, "bearing", 0)?;
    let mut range = Input::new(range_, "range_", 0)?;
    range.expect_positive("m")?;
    let mut step = Input::new(step, "step [m]", 0)?;
    step.expect_positive("m")?;
    let mut side = Input::new(side, "side", 0)?;
    expect_sides(&side)?;
    let batch = Batch::into(&mut [&mut bearing, &mut range, &mut step, &mut side], out)?;
    let (bearing, range) = (bearing.items()?, range.items()?);
    let (step, side) = (step.items()?, side.items()?);
    batch.fill_numbers(py, 50.0, |trials, threads, out| {
        batch::headings(
            bearing.skip(trials.start),
            range.skip(trials.start),
            step.skip(trials.start),
            side.skip(trials.start),
            law,
            threads,
            out,
        )
    })
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
) -> PyResult<Bound<'py, PyDict>> {
    let law = self::law(law)?;
    let mut target = Input::new(target, "target", 1)?;
    target.expect(&[Some(2)], "east and north")?;
    let mut start = Input::new(start, "start [m]", 1)?;
    start.expect(&[Some(2)], "east and north")?;
    let mut step = Input::new(step, "step [m]", 0)?;
    step.expect_positive("m")?;
    let mut side = Input::new(side, "side", 1)?;
    side.expect_one_or(samples.saturating_sub(1), "one side for each leg")?;
    expect_sides(&side)?;
    let mut sigma = Input::new(sigma, "sigma [rad]", 0)?;
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
    let (target, start, step) = (target.items()?, start.items()?, step.items()?);
    let (side, sigma, standoff) = (side.items()?, sigma.items()?, standoff.items()?);
    let records = batch.fill(
        py,
        &[size],
        15.0 * samples as f64,
        |trials, threads, out| {
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
            batch::trajectories(paths, samples, threads, Path::Best, out)
        },
    )?;
    let parts: [(&str, &[usize]); 7] = [
        ("count", &[]),
        ("path", &[samples, 2]),
        ("bearings", &[samples]),
        ("ranges", &[samples]),
        ("headings", &[samples.saturating_sub(1)]),
        ("information", &[samples, 2, 2]),
        ("det", &[samples]),
    ];
    batch.named(&records, &parts)
}

/// Sides (..., samples - 1) of the legs of paths flown to one side.
#[pyfunction]
fn maneuver_best_sides<'py>(
    py: Python<'py>,
    bearings: &Bound<'py, PyAny>,
    ranges: &Bound<'py, PyAny>,
    count: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let mut bearings = Input::new(bearings, "bearings", 1)?;
    bearings.expect_entries()?;
    let samples = bearings.core_shape()[0];
    let mut ranges = Input::new(ranges, "ranges", 1)?;
    ranges.expect(&[Some(samples)], "one for each bearing")?;
    let mut count = Input::new(count, "count", 0)?;
    let batch = Batch::of(&mut [&mut bearings, &mut ranges, &mut count])?;
    let (bearings, ranges, count) = (bearings.items()?, ranges.items()?, count.items()?);
    let cost = (samples as f64).min(512.0).powi(2) * 10.0;
    batch.fill(py, &[samples - 1], cost, |trials, threads, out| {
        let first = trials.start;
        batch::sides(
            bearings.skip(first),
            ranges.skip(first),
            count.skip(first),
            samples,
            threads,
            out,
        )
    })
}

/// Determinant and variance of the range of two legs, in units of the track.
#[pyfunction]
fn maneuver_two_leg_terms(turn: f64, first: f64, second: f64) -> PyResult<(f64, f64)> {
    let terms = two_leg_terms(turn, first, second)
        .map_err(|error| InputError::new_err(error.to_string()))?;
    Ok((terms.determinant, terms.range_variance))
}

/// The best turn, cross speeds, determinant and variance of the range of two legs.
#[pyfunction]
fn maneuver_best_two_legs(cross: f64, of_range: bool) -> PyResult<(f64, f64, f64, f64, f64)> {
    let goal = if of_range {
        TwoLegGoal::Range
    } else {
        TwoLegGoal::Determinant
    };
    let best =
        best_two_legs(cross, goal).map_err(|error| InputError::new_err(error.to_string()))?;
    let terms = best.terms;
    Ok((
        best.turn,
        best.first,
        best.second,
        terms.determinant,
        terms.range_variance,
    ))
}

/// The checked inputs of `maneuver_fisher` and `maneuver_fisher_det`.
struct Inputs<'py, T: Number = f64> {
    positions: Input<'py, T>,
    target: Input<'py, T>,
    times: Input<'py, T>,
    sigma: Input<'py, T>,
    batch: Batch,
}

impl<'py, T: Number> Inputs<'py, T> {
    fn new(
        positions: &Bound<'py, PyAny>,
        target: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
        times: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        let inputs = Self::unchecked(positions, target, sigma, times, out)?;
        inputs.positions.check_finite()?;
        Ok(inputs)
    }

    /// The same for a kernel that refuses positions that are not finite.
    fn unchecked(
        positions: &Bound<'py, PyAny>,
        target: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
        times: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        let mut positions = Input::<T>::of(positions, "path", 2)?;
        positions.expect(&[None, Some(2)], "an east and a north for each bearing")?;
        positions.expect_entries()?;
        let m = positions.core_shape()[0];
        let mut target = Input::<T>::of(target, "target", 1)?;
        target.check_finite()?;
        let mut times = if let Some(times) = times {
            let times = Input::<T>::of(times, "times", 1)?;
            times.check_finite()?;
            times.expect(&[Some(m)], "one for each position")?;
            times.expect_increasing("s")?;
            times
        } else {
            Input::absent("times")
        };
        let mut sigma = Input::<T>::levels_of(sigma, "sigma [rad]")?;
        sigma.check_finite()?;
        sigma.expect_one_or(m, "one standard deviation, or one for each position")?;
        sigma.expect_positive("rad")?;
        let batch = Batch::into(
            &mut [&mut positions, &mut target, &mut times, &mut sigma],
            out,
        )?;
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

    fn sightings(&self) -> PyResult<Sightings<'_, T>> {
        Ok(Sightings {
            positions: self.positions.items()?,
            target: self.target.items()?,
            times: self.times.items()?,
            sigma: self.sigma.items()?,
        })
    }

    fn fisher(
        &self,
        py: Python<'py>,
        core: &[usize],
        determinant: bool,
    ) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
        let (sightings, cost) = (self.sightings()?, self.samples() as f64);
        self.batch
            .fill(py, core, cost, |trials, threads, out| {
                let sightings = sightings.skip(trials.start);
                batch::fisher(sightings, determinant, threads, Path::Best, out)
            })
            // The kernel refuses what is not finite; here is where its place is known.
            .or_else(|error| self.positions.check_finite().and(Err(error)))
    }
}

/// Information (..., n, n): n is 2 for a fixed target, 4 with times.
#[pyfunction]
#[pyo3(signature = (positions, target, sigma, times, single, out=None))]
fn maneuver_fisher<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    times: Option<&Bound<'py, PyAny>>,
    single: bool,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let given = [positions, target, sigma];
    Ok(if single {
        fisher_of::<f32>(py, given, times, out)?.into_any()
    } else {
        fisher_of::<f64>(py, given, times, out)?.into_any()
    })
}

fn fisher_of<'py, T: Number>(
    py: Python<'py>,
    [positions, target, sigma]: [&Bound<'py, PyAny>; 3],
    times: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let inputs = Inputs::<T>::unchecked(positions, target, sigma, times, out)?;
    let n = inputs.sightings()?.states();
    inputs.fisher(py, &[n, n], false)
}

/// Information (..., n, n) and its determinant (...,), in one pass.
#[pyfunction]
#[pyo3(signature = (positions, target, sigma, times, out=None))]
fn maneuver_fisher_and_det<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    times: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let inputs = Inputs::<f64>::unchecked(positions, target, sigma, times, out)?;
    let n = inputs.sightings()?.states();
    let both = inputs.fisher(py, &[n * n + 1], true)?;
    inputs
        .batch
        .named(&both, &[("fisher", &[n, n]), ("det", &[])])
}

/// Determinants (...,) of the information.
#[pyfunction]
#[pyo3(signature = (positions, target, sigma, times, pairs, out=None))]
fn maneuver_fisher_det<'py>(
    py: Python<'py>,
    positions: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    times: Option<&Bound<'py, PyAny>>,
    pairs: bool,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let inputs = Inputs::<f64>::new(positions, target, sigma, times, out)?;
    let sightings = inputs.sightings()?;
    let method = if pairs {
        Determinant::Pairs
    } else {
        Determinant::Root
    };
    let m = inputs.samples() as f64;
    let cost = if pairs { m * m } else { 40.0 * m };
    if cost > run::PIECE {
        return inputs.batch.fill_apart(py, &[], cost, |trial| {
            let owned = [
                sightings.positions,
                sightings.target,
                sightings.times,
                sightings.sigma,
            ]
            .map(|items| items.get(trial).to_vec());
            move |threads: Threads, out: &mut [f64]| {
                let [positions, target, times, sigma] = owned.each_ref().map(|x| Items::shared(x));
                let sightings = Sightings {
                    positions,
                    target,
                    times,
                    sigma,
                };
                batch::fisher_det(sightings, method, threads, out)
            }
        });
    }
    inputs.batch.fill(py, &[], cost, |trials, threads, out| {
        batch::fisher_det(sightings.skip(trials.start), method, threads, out)
    })
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(maneuver_best_sides, module)?)?;
    module.add_function(wrap_pyfunction!(maneuver_best_two_legs, module)?)?;
    module.add_function(wrap_pyfunction!(maneuver_two_leg_terms, module)?)?;
    module.add_function(wrap_pyfunction!(maneuver_fisher, module)?)?;
    module.add_function(wrap_pyfunction!(maneuver_fisher_and_det, module)?)?;
    module.add_function(wrap_pyfunction!(maneuver_fisher_det, module)?)?;
    module.add_function(wrap_pyfunction!(maneuver_heading, module)?)?;
    module.add_function(wrap_pyfunction!(maneuver_trajectory, module)?)
}
