//! Bearings-only target motion.

use gramian::batch::Items;
use gramian::batch::simd::Path;
use gramian::bearings::batch::{self, GRAM_SIZE, Method, Quadruples, TEST_SIZE, Target};
use gramian::bearings::{Error, Form, Monitor};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods};
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

/// Times, bearings and weights that fit together.
struct Track<'py> {
    times: Input<'py>,
    bearings: Input<'py>,
    weights: Option<Input<'py>>,
    batch: Batch,
    m: usize,
}

impl<'py> Track<'py> {
    /// `least` is how many bearings the question needs.
    fn new(
        times: &Bound<'py, PyAny>,
        bearings: &Bound<'py, PyAny>,
        weights: Option<&Bound<'py, PyAny>>,
        least: usize,
    ) -> PyResult<Self> {
        let mut times = Input::new(times, "times", 1)?;
        let m = times.core_shape()[0];
        let mut bearings = Input::new(bearings, "bearings", 1)?;
        bearings.expect(&[Some(m)], "a bearing for each time")?;
        if m < least {
            return Err(errors::input_at(
                "",
                Error::TooFew {
                    given: m,
                    wanted: least,
                },
            ));
        }
        times.expect_increasing("s")?;
        let mut weights = weights.map(|w| Input::new(w, "weights", 1)).transpose()?;
        if let Some(weights) = &weights {
            weights.expect(&[Some(m)], "a weight for each bearing")?;
            weights.expect_nonnegative()?;
        }
        let batch = match &mut weights {
            Some(weights) => Batch::of(&mut [&mut times, &mut bearings, weights])?,
            None => Batch::of(&mut [&mut times, &mut bearings])?,
        };
        Ok(Self {
            times,
            bearings,
            weights,
            batch,
            m,
        })
    }

    fn weights(&self) -> PyResult<Option<Items<'_>>> {
        self.weights.as_ref().map(Input::items).transpose()
    }
}

/// D (...) of four bearings (..., 4), in any order.
#[pyfunction]
fn bearing_discriminant<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    form: &str,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let form = match form {
        "5" => Form::Products,
        "13" => Form::Cotangents,
        _ => Form::Sines,
    };
    let mut times = Input::new(times, "times", 1)?;
    let mut bearings = Input::new(bearings, "bearings", 1)?;
    times.expect(&[Some(4)], "four instants")?;
    bearings.expect(&[Some(4)], "four bearings")?;
    let batch = Batch::of(&mut [&mut times, &mut bearings])?;
    let out = batch.zeros(py, &[]);
    {
        let (times, bearings) = (times.items()?, bearings.items()?);
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        run::in_pieces(py, batch.len(), 60.0, |range, threads| {
            batch::discriminants(
                times.skip(range.start),
                bearings.skip(range.start),
                form,
                threads,
                &mut write[range.clone()],
            )
            .map_err(|(trial, error)| errors::input_at(&batch.place(range.start + trial), error))
        })?;
    }
    Ok(out)
}

/// Sums (...) of D^2 over all quadruples, or of sin^2 over all pairs.
#[pyfunction]
#[pyo3(signature = (times, bearings, weights, method, order))]
fn bearing_discriminant_sum<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    weights: Option<&Bound<'py, PyAny>>,
    method: &str,
    order: usize,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let method = match method {
        "factored" => Method::Factored,
        "qr" => Method::Qr,
        _ => Method::Direct,
    };
    let track = Track::new(times, bearings, weights, 2 * (order + 1))?;
    let (m, batch) = (track.m, &track.batch);
    let out = batch.zeros(py, &[]);
    {
        let (times, bearings) = (track.times.items()?, track.bearings.items()?);
        let weights = track.weights()?;
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        let at = |trial: usize, error: Error| errors::input_at(&batch.place(trial), error);
        let cost = batch::discriminant_cost(m, method);
        if order == 1 && method != Method::Qr && cost > 1e8 {
            // One long sum: pieces of it, so that Ctrl-C is heard.
            let mut sum = Quadruples::new(m, method, Path::Best);
            let mut parts = vec![0.0; sum.parts()];
            for (trial, out) in write.iter_mut().enumerate() {
                let weights = weights.map(|w| w.get(trial));
                sum.load(times.get(trial), bearings.get(trial), weights)
                    .map_err(|error| at(trial, error))?;
                let part = 3.0 * cost / m as f64;
                run::in_pieces(py, sum.parts(), part, |range, threads| {
                    sum.run(range.clone(), threads, &mut parts[range]);
                    Ok(())
                })?;
                *out = sum.total(&parts);
            }
        } else {
            run::in_pieces(py, batch.len(), cost, |range, threads| {
                let (times, bearings) = (times.skip(range.start), bearings.skip(range.start));
                let weights = weights.map(|w| w.skip(range.start));
                let out = &mut write[range.clone()];
                if order == 0 {
                    batch::fixed_target_sum(times, bearings, weights, method, threads, out)
                } else {
                    batch::discriminant_sum(times, bearings, weights, method, threads, out)
                }
                .map_err(|(trial, error)| at(range.start + trial, error))
            })?;
        }
        errors::refuse_overflow(batch, 1, write, "the sum of squares")?;
    }
    Ok(out)
}

/// Indices and values (..., 5) of the quadruples with the largest |D|.
#[pyfunction]
fn bearing_best_quadruple<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let track = Track::new(times, bearings, None, 4)?;
    let batch = &track.batch;
    let out = batch.zeros(py, &[5]);
    {
        let (times, bearings) = (track.times.items()?, track.bearings.items()?);
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        let cost = 4.0 * batch::discriminant_cost(track.m.min(200), Method::Direct);
        run::in_pieces(py, batch.len(), cost, |range, threads| {
            batch::best_quadruples(
                times.skip(range.start),
                bearings.skip(range.start),
                threads,
                &mut write[5 * range.start..5 * range.end],
            )
            .map_err(|(trial, error)| errors::input_at(&batch.place(range.start + trial), error))
        })?;
    }
    Ok(out)
}

/// Gram matrices and determinants (..., 17).
#[pyfunction]
#[pyo3(signature = (times, bearings, weights))]
fn bearing_gram<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    weights: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let mut times = Input::new(times, "times", 1)?;
    times.expect_entries()?;
    times.expect_increasing("s")?;
    let m = times.core_shape()[0];
    // Whether these are finite shows in the sums, at no cost.
    let mut bearings = Input::unchecked(bearings, "bearings", 1)?;
    bearings.expect(&[Some(m)], "a bearing for each time")?;
    let mut weights = weights.map(|w| Input::new(w, "weights", 1)).transpose()?;
    if let Some(weights) = &weights {
        weights.expect(&[Some(m)], "a weight for each bearing")?;
        weights.expect_nonnegative()?;
    }
    let batch = match &mut weights {
        Some(weights) => Batch::of(&mut [&mut times, &mut bearings, weights])?,
        None => Batch::of(&mut [&mut times, &mut bearings])?,
    };
    let out = batch.zeros(py, &[GRAM_SIZE]);
    let mut finite = true;
    {
        let (times, angles) = (times.items()?, bearings.items()?);
        let weights = weights.as_ref().map(Input::items).transpose()?;
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        run::in_pieces(py, batch.len(), 1.2 * m as f64, |range, threads| {
            let out = &mut write[range.start * GRAM_SIZE..range.end * GRAM_SIZE];
            batch::bearing_gram(
                times.skip(range.start),
                angles.skip(range.start),
                weights.map(|w| w.skip(range.start)),
                threads,
                Path::Best,
                out,
            );
            // The determinant leaves double precision before the matrix does.
            finite &= out
                .chunks_exact(GRAM_SIZE)
                .all(|o| o[0].is_finite() && o[GRAM_SIZE - 1].is_finite());
            Ok(())
        })?;
    }
    if !finite {
        bearings.check_finite()?;
        let read = out.readonly();
        errors::refuse_overflow(&batch, GRAM_SIZE, read.as_slice()?, "the Gram matrix")?;
    }
    Ok(out)
}

/// Statistic, p-value and relative motion (..., 6).
#[pyfunction]
fn bearing_test<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let Track {
        mut times,
        mut bearings,
        m,
        ..
    } = Track::new(times, bearings, None, 4)?;
    let mut sigma = Input::new(sigma, "sigma", 1)?;
    if sigma.core_shape() != [1] {
        sigma.expect(
            &[Some(m)],
            "one standard deviation, or one for each bearing",
        )?;
    }
    sigma.expect_positive("rad")?;
    let batch = Batch::of(&mut [&mut times, &mut bearings, &mut sigma])?;
    let out = batch.zeros(py, &[TEST_SIZE]);
    {
        let (times, bearings, sigma) = (times.items()?, bearings.items()?, sigma.items()?);
        let mut write = out.readwrite();
        let write = write.as_slice_mut()?;
        run::in_pieces(
            py,
            batch.len(),
            300.0 + 25.0 * m as f64,
            |range, threads| {
                batch::observability_tests(
                    times.skip(range.start),
                    bearings.skip(range.start),
                    sigma.skip(range.start),
                    threads,
                    Path::Best,
                    &mut write[range.start * TEST_SIZE..range.end * TEST_SIZE],
                )
                .map_err(|(trial, error)| {
                    errors::input_at(&batch.place(range.start + trial), error)
                })
            },
        )?;
    }
    Ok(out)
}

/// Observability while the bearings arrive.
#[pyclass(module = "gramian._core")]
struct BearingMonitor(Monitor<f64>);

#[pymethods]
impl BearingMonitor {
    #[new]
    fn new() -> Self {
        Self(Monitor::new())
    }

    #[pyo3(signature = (time, bearing, sigma, distance))]
    fn push(&mut self, time: f64, bearing: f64, sigma: f64, distance: Option<f64>) -> PyResult<()> {
        self.0
            .push(time, bearing, sigma, distance)
            .map_err(|error| errors::input_at("", error))
    }

    /// Count, rank, and det, logdet, singular value, statistic, dof, p-value,
    /// bounds (4), relative motion (4).
    fn answer<'py>(&self, py: Python<'py>) -> (u32, usize, Bound<'py, PyArray1<f64>>) {
        let a = self.0.answer();
        let mut numbers = vec![
            a.determinant,
            a.log_determinant,
            a.singular_value,
            a.statistic,
            a.dof,
            a.p_value,
        ];
        numbers.extend(a.crlb_std);
        numbers.extend(a.relative_motion);
        (a.count, a.rank, PyArray1::from_vec(py, numbers))
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(bearing_best_quadruple, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_discriminant, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_discriminant_sum, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_gram, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_rows, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_test, module)?)?;
    module.add_class::<BearingMonitor>()
}
