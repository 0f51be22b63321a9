//! Rows of targets of any order of motion, in the plane and in space.

use gramian::bearings::batch::{Motion, motion_rows};
use numpy::{PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::{Batch, Input};
use crate::errors::InputError;
use crate::{errors, run};

/// Rows (..., m, n) in the plane, (..., 2 m, n) in space; `sigma` holds there
/// the deviations of azimuth and behind them those of elevation.
#[pyfunction]
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
    let mut sigma = Input::new(sigma, "sigma", 1)?;
    if sigma.core_shape() != [dimensions - 1] {
        sigma.expect(
            &[Some(m * (dimensions - 1))],
            "one standard deviation, or one for each time (in space, of azimuth and of elevation)",
        )?;
    }
    sigma.expect_positive("rad")?;
    let batch = Batch::of(&mut [&mut times, &mut observer, &mut target, &mut sigma])?;
    let lines = m * (dimensions - 1);
    let out = batch.zeros(py, &[lines, n]);
    {
        let (times, observer, sigma) = (times.items()?, observer.items()?, sigma.items()?);
        let target = target.items()?;
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        let size = lines * n;
        run::in_pieces(py, batch.len(), 10.0 * size as f64, |range, threads| {
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
                &mut write[range.start * size..range.end * size],
            )
            .map_err(|(trial, error)| errors::input_at(&batch.place(range.start + trial), error))
        })?;
    }
    Ok(out)
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(bearing_motion_rows, module)?)
}
