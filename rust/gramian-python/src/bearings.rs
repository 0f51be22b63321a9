//! Bearings-only target motion.

use gramian::batch::{self, Target};
use numpy::{PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::{Batch, Input};
use crate::{errors, run};

/// Rows (..., m, 4). `positions` is None for a target state (..., 4).
#[pyfunction]
fn bearing_rows<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    observer: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    is_state: bool,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let mut times = Input::new(times, "times", 1)?;
    times.expect_entries()?;
    times.expect_increasing("s")?;
    let m = times.core_shape()[0];
    let mut observer = Input::new(observer, "observer", 2)?;
    observer.expect(&[Some(m), Some(2)], "an east and a north for each time")?;
    let mut target = Input::new(target, "target", if is_state { 1 } else { 2 })?;
    if is_state {
        target.expect(&[Some(4)], "x0, y0, vx, vy")?;
    } else {
        target.expect(&[Some(m), Some(2)], "an east and a north for each time")?;
    }
    let mut sigma = Input::new(sigma, "sigma", 1)?;
    if sigma.core_shape() != [1] {
        sigma.expect(&[Some(m)], "one standard deviation, or one for each time")?;
    }
    sigma.expect_positive("rad")?;
    let batch = Batch::of(&mut [&mut times, &mut observer, &mut target, &mut sigma])?;
    let out = batch.zeros(py, &[m, 4]);
    {
        let (times, observer, sigma) = (times.items()?, observer.items()?, sigma.items()?);
        let target = target.items()?;
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        run::in_pieces(py, batch.len(), 10.0 * m as f64, |range, threads| {
            let target = target.skip(range.start);
            batch::bearing_rows(
                times.skip(range.start),
                observer.skip(range.start),
                if is_state {
                    Target::State(target)
                } else {
                    Target::Positions(target)
                },
                sigma.skip(range.start),
                threads,
                &mut write[range.start * m * 4..range.end * m * 4],
            )
            .map_err(|(trial, error)| errors::input_at(&batch.place(range.start + trial), error))
        })?;
    }
    Ok(out)
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(bearing_rows, module)?)
}
