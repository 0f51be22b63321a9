//! The planner's objective and its paths, and the closed loop.

use gramian::batch::{Items, Threads};
use gramian::maneuver::Side;
use gramian::maneuver::batch::closed_loop::{self, Guidance, LostBearing, PER_SAMPLE, Setting};
use gramian::maneuver::batch::plan::{self, Candidate, Course, HeadingSource};
use gramian::maneuver::plan::Criterion;
use gramian::maneuver::steer::Limits;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::Input;
use crate::errors::{self, InputError};
use crate::output::Batch;

/// The criterion of a path for 2 or 4 states, ready to be asked many times.
#[pyclass(frozen, module = "gramian._core")]
pub struct PlanObjective(Sized);

enum Sized {
    Fixed(plan::Objective<2>),
    Moving(plan::Objective<4>),
}

/// Calls the same function of either size.
macro_rules! either {
    ($self:expr, $objective:ident => $body:expr) => {
        match &$self.0 {
            Sized::Fixed($objective) => $body,
            Sized::Moving($objective) => $body,
        }
    };
}

type ValueAndGradient<'py> = (f64, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl PlanObjective {
    #[new]
    #[pyo3(signature = (start, dt, counts, targets, weights, sigma, scale, prior, criterion, sharpness, combinations))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        start: &Bound<'_, PyAny>,
        dt: f64,
        counts: Vec<usize>,
        targets: &Bound<'_, PyAny>,
        weights: &Bound<'_, PyAny>,
        sigma: f64,
        scale: &Bound<'_, PyAny>,
        prior: &Bound<'_, PyAny>,
        criterion: &str,
        sharpness: f64,
        combinations: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let start = pair(start, "start")?;
        let targets = Input::new(targets, "targets", 2)?;
        targets.expect(&[None, Some(4)], "x0, y0, vx, vy of each possible target")?;
        let count = targets.core_shape()[0];
        let weights = Input::new(weights, "weights", 1)?;
        weights.expect(&[Some(count)], "one for each possible target")?;
        let scale = Input::new(scale, "scale", 1)?;
        let n = scale.core_shape()[0];
        let prior = Input::new(prior, "prior", 3)?;
        prior.expect(&[Some(count), None, Some(n)], "rows for each target")?;
        let combinations = Input::new(combinations, "combinations", 2)?;
        combinations.expect(&[Some(count), Some(n)], "one for each possible target")?;
        let given = Given {
            start,
            dt,
            counts,
            targets: targets.slice()?,
            weights: weights.slice()?,
            sigma,
            scale: scale.slice()?,
            prior: prior.slice()?,
            criterion,
            sharpness,
            combinations: combinations.slice()?,
        };
        match n {
            2 => Ok(Self(Sized::Fixed(given.objective()?))),
            4 => Ok(Self(Sized::Moving(given.objective()?))),
            _ => Err(InputError::new_err(format!(
                "scale has {n} entries: must have 2 or 4"
            ))),
        }
    }

    fn gradient<'py>(
        &self,
        py: Python<'py>,
        headings: &Bound<'py, PyAny>,
        lengths: &Bound<'py, PyAny>,
    ) -> PyResult<ValueAndGradient<'py>> {
        let headings = self.legs(headings, "headings")?;
        let lengths = self.legs(lengths, "lengths")?;
        let (headings, lengths) = (headings.slice()?, lengths.slice()?);
        let mut by_heading = vec![0.0; headings.len()];
        let mut by_length = vec![0.0; headings.len()];
        let value = either!(self, objective => objective.gradient(
            headings, lengths, &mut by_heading, &mut by_length
        ))
        .map_err(|error| errors::input_at("", error))?;
        Ok((
            value,
            PyArray1::from_vec(py, by_heading),
            PyArray1::from_vec(py, by_length),
        ))
    }

    fn values<'py>(
        &self,
        py: Python<'py>,
        headings: &Bound<'py, PyAny>,
        lengths: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let mut headings = self.legs(headings, "headings")?;
        let mut lengths = self.legs(lengths, "lengths")?;
        let batch = Batch::of(&mut [&mut headings, &mut lengths])?;
        let (headings, lengths) = (headings.items()?, lengths.items()?);
        let cost = 100.0 * either!(self, objective => objective.samples()) as f64;
        batch.fill(py, &[], cost, |range, threads, out| {
            let (headings, lengths) = (headings.skip(range.start), lengths.skip(range.start));
            either!(self, objective => objective.values(headings, lengths, threads, out));
        })
    }

    fn along<'py>(
        &self,
        py: Python<'py>,
        headings: &Bound<'py, PyAny>,
        lengths: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let headings = self.legs(headings, "headings")?;
        let lengths = self.legs(lengths, "lengths")?;
        let (headings, lengths) = (headings.slice()?, lengths.slice()?);
        let mut out = vec![0.0; either!(self, objective => objective.samples())];
        either!(self, objective => objective.along(headings, lengths, &mut out))
            .map_err(|error| errors::input_at("", error))?;
        Ok(PyArray1::from_vec(py, out))
    }
}

impl PlanObjective {
    fn legs<'py>(&self, value: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Input<'py>> {
        let input = Input::new(value, name, 1)?;
        let legs = either!(self, objective => objective.legs());
        input.expect(&[Some(legs)], "one for each leg")?;
        Ok(input)
    }
}

struct Given<'a> {
    start: [f64; 2],
    dt: f64,
    counts: Vec<usize>,
    targets: &'a [f64],
    weights: &'a [f64],
    sigma: f64,
    scale: &'a [f64],
    prior: &'a [f64],
    criterion: &'a str,
    sharpness: f64,
    combinations: &'a [f64],
}

impl Given<'_> {
    fn objective<const N: usize>(self) -> PyResult<plan::Objective<N>> {
        let (combinations, _) = self.combinations.as_chunks::<N>();
        let (targets, _) = self.targets.as_chunks::<4>();
        let rows = self.prior.len().checked_div(targets.len()).unwrap_or(0);
        let mut candidates = Vec::with_capacity(targets.len());
        for (i, &state) in targets.iter().enumerate() {
            let criterion = match self.criterion {
                "D" => Criterion::LogDet,
                "A" => Criterion::Trace,
                "E" => Criterion::SmallestEigenvalue {
                    sharpness: self.sharpness,
                },
                "combination" => Criterion::Combination(combinations[i]),
                other => {
                    return Err(InputError::new_err(format!(
                        "criterion = {other:?}: must be \"D\", \"A\", \"E\" or \"combination\""
                    )));
                }
            };
            candidates.push(Candidate {
                state,
                weight: self.weights[i],
                criterion,
                prior: plan::prior(&self.prior[i * rows..(i + 1) * rows]),
            });
        }
        let mut scale = [1.0; N];
        scale.copy_from_slice(self.scale);
        Ok(plan::Objective::new(
            self.start,
            self.dt,
            self.counts,
            self.sigma,
            scale,
            candidates,
        ))
    }
}

/// The clearance of a path from circles: see `gramian::maneuver::batch::plan::Clearance`.
#[pyclass(frozen, module = "gramian._core")]
pub struct PlanClearance(plan::Clearance);

type Gradients<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

#[pymethods]
impl PlanClearance {
    /// `circles` (n, 5): step, east, north, radius, and 1 where the whole step is to
    /// stay clear.
    #[new]
    fn new(
        start: &Bound<'_, PyAny>,
        counts: Vec<usize>,
        circles: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let circles = Input::new(circles, "circles", 2)?;
        circles.expect(&[None, Some(5)], "step, east, north, radius, whole")?;
        let (rows, _) = circles.slice()?.as_chunks::<5>();
        let steps: usize = counts.iter().sum();
        let mut near = Vec::with_capacity(rows.len());
        for &[step, east, north, radius, whole] in rows {
            if !(0.0..steps as f64).contains(&step) {
                return Err(InputError::new_err(format!(
                    "circles: step {step} is not one of {steps}"
                )));
            }
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            near.push(plan::Near {
                step: step as usize,
                center: [east, north],
                radius,
                whole: whole != 0.0,
            });
        }
        let start = pair(start, "start")?;
        Ok(Self(plan::Clearance::new(start, counts, near)))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn values<'py>(
        &self,
        py: Python<'py>,
        headings: &Bound<'py, PyAny>,
        lengths: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (headings, lengths) = (
            self.legs(headings, "headings")?,
            self.legs(lengths, "lengths")?,
        );
        let mut out = vec![0.0; self.0.len()];
        self.0
            .values(headings.slice()?, lengths.slice()?, &mut out)
            .map_err(|error| errors::input_at("", error))?;
        Ok(PyArray1::from_vec(py, out))
    }

    fn gradient<'py>(
        &self,
        py: Python<'py>,
        headings: &Bound<'py, PyAny>,
        lengths: &Bound<'py, PyAny>,
    ) -> PyResult<Gradients<'py>> {
        let (headings, lengths) = (
            self.legs(headings, "headings")?,
            self.legs(lengths, "lengths")?,
        );
        let shape = [self.0.len(), headings.core_shape()[0]];
        let (by_heading, by_length) = (
            PyArray2::zeros(py, shape, false),
            PyArray2::zeros(py, shape, false),
        );
        {
            let (mut turn, mut stretch) = (by_heading.readwrite(), by_length.readwrite());
            self.0
                .gradient(
                    headings.slice()?,
                    lengths.slice()?,
                    turn.as_slice_mut()?,
                    stretch.as_slice_mut()?,
                )
                .map_err(|error| errors::input_at("", error))?;
        }
        Ok((by_heading, by_length))
    }
}

impl PlanClearance {
    /// Not checked for what is not finite: an optimiser may try such a path.
    fn legs<'py>(&self, value: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Input<'py>> {
        let input = Input::unchecked(value, name, 1)?;
        input.expect(&[Some(self.0.legs())], "one for each leg")?;
        if input.batch_shape().is_empty() {
            return Ok(input);
        }
        Err(InputError::new_err(format!(
            "{name} is of several paths: must be of one"
        )))
    }
}

/// Headings (paths, steps + 1) that keep the limits: the last entry counts the
/// steps that could not. `wish` is "headings" (paths, steps), "arcs" (paths, 3)
/// or a law, for which `wanted` is (1, 1): the side.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn plan_steered<'py>(
    py: Python<'py>,
    start: &Bound<'py, PyAny>,
    dt: f64,
    lengths: &Bound<'py, PyAny>,
    first: Option<f64>,
    standoff: f64,
    targets: &Bound<'py, PyAny>,
    keep_out: &Bound<'py, PyAny>,
    max_turn: f64,
    wish: &str,
    wanted: &Bound<'py, PyAny>,
    aim: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let start = pair(start, "start")?;
    let lengths = Input::new(lengths, "lengths", 1)?;
    let steps = lengths.core_shape()[0];
    let targets = Input::new(targets, "targets", 2)?;
    targets.expect(&[None, Some(4)], "x0, y0, vx, vy of each possible target")?;
    let keep_out = Input::new(keep_out, "keep_out", 2)?;
    keep_out.expect(&[None, Some(3)], "east, north and radius of each circle")?;
    let aim = Input::new(aim, "aim", 1)?;
    aim.expect(&[Some(4)], "x0, y0, vx, vy")?;
    let mut wanted = Input::new(wanted, "wanted", 1)?;
    let kind = match wish {
        "headings" => {
            wanted.expect(&[Some(steps)], "one heading for each step")?;
            None
        }
        "arcs" => {
            wanted.expect(&[Some(3)], "offset, side and step of turning back")?;
            None
        }
        law => {
            wanted.expect(&[Some(1)], "the side")?;
            Some(crate::maneuver::law(law)?)
        }
    };
    let batch = Batch::of(&mut [&mut wanted])?;
    let items = wanted.items()?;
    let side = side_of(wanted.slice()?.first().copied().unwrap_or(1.0));
    let mut point = [0.0; 4];
    point.copy_from_slice(aim.slice()?);
    let course = Course {
        start,
        dt,
        lengths: lengths.slice()?,
        first,
        limits: Limits {
            standoff,
            targets: targets.slice()?.as_chunks().0,
            keep_out: keep_out.slice()?.as_chunks().0,
            max_turn,
        },
    };
    let circles = targets.core_shape()[0] + keep_out.core_shape()[0];
    let cost = (steps * (100 + 100 * circles)) as f64;
    batch.fill(py, &[steps + 1], cost, |range, threads: Threads, out| {
        let part: Items<'_> = items.skip(range.start);
        let wish = match (kind, wish) {
            (Some(law), _) => HeadingSource::Law(law, side, point),
            (None, "headings") => HeadingSource::Headings(part),
            _ => HeadingSource::Arcs(part, point),
        };
        plan::steered(&course, wish, threads, out);
    })
}

/// Trials (..., steps + 1, 5): position, estimate, believed deviation. `guide` is
/// "headings" or a law, for which `wanted` is (1,): the side.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn maneuver_closed_loop<'py>(
    py: Python<'py>,
    target: &Bound<'py, PyAny>,
    start: &Bound<'py, PyAny>,
    length: f64,
    steps: usize,
    sigma: f64,
    first_range: (f64, f64),
    opening: usize,
    when_lost: &str,
    standoff: f64,
    keep_out: &Bound<'py, PyAny>,
    max_turn: f64,
    guide: &str,
    wanted: &Bound<'py, PyAny>,
    noise: &Bound<'py, PyAny>,
    lost: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let keep_out = Input::new(keep_out, "keep_out", 2)?;
    keep_out.expect(&[None, Some(3)], "east, north and radius of each circle")?;
    let setting = Setting {
        target: pair(target, "target")?,
        start: pair(start, "start")?,
        length,
        steps,
        sigma,
        range: first_range,
        opening,
        lost: match when_lost {
            "predict" => LostBearing::Predict,
            "hold" => LostBearing::Hold,
            other => {
                return Err(InputError::new_err(format!(
                    "when_lost = {other:?}: must be \"predict\" or \"hold\""
                )));
            }
        },
        standoff,
        keep_out: keep_out.slice()?.as_chunks().0,
        max_turn,
    };
    let mut noise = Input::new(noise, "noise", 1)?;
    noise.expect(&[Some(steps + 1)], "one number for each bearing")?;
    let mut lost = Input::new(lost, "lost", 1)?;
    lost.expect(&[Some(steps + 1)], "one number for each bearing")?;
    let mut wanted = Input::new(wanted, "wanted", 1)?;
    let law = if guide == "headings" {
        wanted.expect(&[Some(steps)], "one heading for each step")?;
        None
    } else {
        wanted.expect(&[Some(1)], "the side")?;
        Some(crate::maneuver::law(guide)?)
    };
    let side = side_of(wanted.slice()?.first().copied().unwrap_or(1.0));
    let batch = Batch::of(&mut [&mut noise, &mut lost, &mut wanted])?;
    let (noise, lost, wanted) = (noise.items()?, lost.items()?, wanted.items()?);
    let cost = 50.0 * ((steps + 1) * (steps + 1)) as f64;
    batch.fill(py, &[steps + 1, PER_SAMPLE], cost, |range, threads, out| {
        let guide = match law {
            Some(law) => Guidance::Law(law, side),
            None => Guidance::Headings(wanted.skip(range.start)),
        };
        closed_loop::closed_loop(
            &setting,
            guide,
            noise.skip(range.start),
            lost.skip(range.start),
            threads,
            out,
        );
    })
}

fn side_of(sign: f64) -> Side {
    if sign < 0.0 { Side::Left } else { Side::Right }
}

fn pair(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<[f64; 2]> {
    let input = Input::new(value, name, 1)?;
    input.expect(&[Some(2)], "east and north")?;
    let slice = input.slice()?;
    Ok([slice[0], slice[1]])
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(maneuver_closed_loop, module)?)?;
    module.add_function(wrap_pyfunction!(plan_steered, module)?)?;
    module.add_class::<PlanClearance>()?;
    module.add_class::<PlanObjective>()
}
