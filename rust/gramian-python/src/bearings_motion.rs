//! Rows of targets of any order of motion, in the plane and in space.

use gramian::bearings::batch::{Motion, motion_rows};
use gramian::bearings::{Frame, Whereabouts, frame};
use gramian::rounding;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::Input;
use crate::errors::InputError;
use crate::output::Batch;

/// Rows (..., m, n) in the plane, (..., 2 m, n) in space; `sigma` holds there
/// the deviations of azimuth and behind them those of elevation.
#[pyfunction]
#[pyo3(signature = (times, observer, target, sigma, dimensions, order, is_state, several, out=None))]
#[allow(clippy::too_many_arguments)]
fn bearing_motion_rows<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    observer: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    dimensions: usize,
    order: usize,
    is_state: bool,
    several: bool,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    if !(2..=3).contains(&dimensions) || order > 3 {
        return Err(InputError::new_err(format!(
            "{dimensions} dimensions, order {order}: must be 2 or 3, and 0 to 3"
        )));
    }
    let mut times = Input::new(times, "times", 1)?;
    times.expect_entries()?;
    if !several {
        times.expect_increasing("s")?;
    }
    let m = times.core_shape()[0];
    let n = dimensions * (order + 1);
    let mut observer = Input::new(observer, "observer", 2)?;
    observer.expect(&[Some(m), Some(dimensions)], "a position for each time")?;
    let mut target = Input::new(target, "target", if is_state { 1 } else { 2 })?;
    if is_state {
        target.expect(&[Some(n)], "a state of that order")?;
    } else {
        target.expect(&[Some(m), Some(dimensions)], "a position for each time")?;
    }
    let mut sigma = Input::levels(sigma, "sigma")?;
    if sigma.core_shape() != [dimensions - 1] {
        sigma.expect(
            &[Some(m * (dimensions - 1))],
            "one standard deviation, or one for each time (in space, of azimuth and of elevation)",
        )?;
    }
    sigma.expect_positive("rad")?;
    let batch = Batch::into(
        &mut [&mut times, &mut observer, &mut target, &mut sigma],
        out,
    )?;
    let lines = m * (dimensions - 1);
    let (times, observer, sigma) = (times.items()?, observer.items()?, sigma.items()?);
    let target = target.items()?;
    let size = lines * n;
    batch.fill(
        py,
        &[lines, n],
        10.0 * size as f64,
        |range, threads, out| {
            let target = target.skip(range.start);
            motion_rows(
                times.skip(range.start),
                observer.skip(range.start),
                if is_state {
                    Motion::State(target)
                } else {
                    Motion::Positions(target)
                },
                sigma.skip(range.start),
                dimensions,
                order,
                threads,
                out,
            )
        },
    )
}

/// Rows (lines, n) of one track without columns that are rounding alone, their relative
/// accuracy (None: that of plain rows), by name the combinations (n,) of its frame, and the
/// scales of the states (NaN: none).
/// The arguments are those of the rows, which have checked them.
#[pyfunction]
fn bearing_frame<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    observer: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    rows: &Bound<'py, PyAny>,
    is_state: bool,
) -> PyResult<FramedRows<'py>> {
    let times = Input::new(times, "times", 1)?;
    let observer = Input::new(observer, "observer", 2)?;
    let target = Input::new(target, "target", if is_state { 1 } else { 2 })?;
    let rows = Input::new(rows, "rows", 2)?;
    for input in [&times, &observer, &target, &rows] {
        input.expect_single("a problem is one track")?;
    }
    let (m, dimensions) = (times.core_shape()[0], observer.core_shape()[1]);
    let n = rows.core_shape()[1];
    let target = target.slice()?;
    let target = if is_state {
        Whereabouts::State(target)
    } else {
        Whereabouts::Positions(target)
    };
    let (times, observer) = (times.slice()?, observer.slice()?);
    let named = PyDict::new(py);
    let (accuracy, scales) = match dimensions {
        2 => of_frame(&frame::<2>(times, observer, target), n, &named)?,
        _ => of_frame(&frame::<3>(times, observer, target), n, &named)?,
    };
    let mut left = rows.slice()?.to_vec();
    let noise = rounding::of_columns(&left, n, &accuracy, dimensions);
    let rtol = rounding::remove(&mut left, n, &noise);
    let left = PyArray1::from_vec(py, left).reshape([m * (dimensions - 1), n])?;
    Ok((left, rtol, named, PyArray1::from_vec(py, scales)))
}

type FramedRows<'py> = (
    Bound<'py, PyArray2<f64>>,
    Option<f64>,
    Bound<'py, PyDict>,
    Bound<'py, PyArray1<f64>>,
);

/// The accuracy of each line and the scales; the combinations go into `named`.
fn of_frame<const D: usize>(
    frame: &Frame<D>,
    n: usize,
    named: &Bound<'_, PyDict>,
) -> PyResult<(Vec<f64>, Vec<f64>)> {
    let moving = n > D;
    for (name, first, direction) in [
        ("range", 0, Some(frame.range)),
        ("bearing", 0, Some(frame.bearing)),
        ("elevation", 0, frame.elevation),
        ("speed", D, frame.speed.filter(|_| moving)),
        ("course", D, frame.course.filter(|_| moving)),
    ] {
        if let Some(direction) = direction {
            let mut wide = vec![0.0; n];
            wide[first..first + D].copy_from_slice(&direction);
            named.set_item(name, PyArray1::from_vec(named.py(), wide))?;
        }
    }
    let lines = frame.accuracy.iter();
    let accuracy = lines.flat_map(|x| std::iter::repeat_n(*x, D - 1)).collect();
    let scales = (0..)
        .flat_map(|power| std::iter::repeat_n(frame.scale(power).unwrap_or(f64::NAN), D))
        .take(n)
        .collect();
    Ok((accuracy, scales))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(bearing_frame, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_motion_rows, module)?)
}
