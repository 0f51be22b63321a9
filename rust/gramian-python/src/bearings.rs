//! Bearings-only target motion.

use std::sync::{Arc, OnceLock};

use gramian::batch::Items;
use gramian::batch::simd::Path;
use gramian::bearings::batch::{self, Method, Quadruples, TEST_SIZE, Target};
use gramian::bearings::{Answer, Error, Form, Kept, Monitor};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{Input, all_finite, number_text, real};
use crate::errors::InputError;
use crate::output::{self, Batch};
use crate::{errors, run};

/// Rows (..., m, 4). `positions` is None for a target state (..., 4).
#[pyfunction]
#[pyo3(signature = (times, observer, target, sigma, is_state, out=None))]
fn bearing_rows<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    observer: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
    is_state: bool,
    out: Option<&Bound<'py, PyAny>>,
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
    let mut sigma = Input::levels(sigma, "sigma [rad]")?;
    sigma.expect_one_or(m, "one standard deviation, or one for each time")?;
    sigma.expect_positive("rad")?;
    let batch = Batch::into(
        &mut [&mut times, &mut observer, &mut target, &mut sigma],
        out,
    )?;
    let (times, observer, sigma) = (times.items()?, observer.items()?, sigma.items()?);
    let target = target.items()?;
    batch.fill(py, &[m, 4], 10.0 * m as f64, |range, threads, out| {
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
            out,
        )
    })
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
        out: Option<&Bound<'py, PyAny>>,
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
            Some(weights) => Batch::into(&mut [&mut times, &mut bearings, weights], out)?,
            None => Batch::into(&mut [&mut times, &mut bearings], out)?,
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
#[pyo3(signature = (times, bearings, form, out=None))]
fn bearing_discriminant<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    form: &str,
    out: Option<&Bound<'py, PyAny>>,
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
    let batch = Batch::into(&mut [&mut times, &mut bearings], out)?;
    let (times, bearings) = (times.items()?, bearings.items()?);
    batch.fill(py, &[], 60.0, |range, threads, out| {
        batch::discriminants(
            times.skip(range.start),
            bearings.skip(range.start),
            form,
            threads,
            out,
        )
    })
}

/// Sums (...) of D^2 over all quadruples, or of sin^2 over all pairs.
#[pyfunction]
#[pyo3(signature = (times, bearings, weights, method, order, out=None))]
fn bearing_discriminant_sum<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    weights: Option<&Bound<'py, PyAny>>,
    method: &str,
    order: usize,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let method = match method {
        "factored" => Method::Factored,
        "qr" => Method::Qr,
        _ => Method::Direct,
    };
    let track = Track::new(times, bearings, weights, 2 * (order + 1), out)?;
    let (m, batch) = (track.m, &track.batch);
    let (times, bearings) = (track.times.items()?, track.bearings.items()?);
    let weights = track.weights()?;
    let cost = batch::discriminant_cost(m, method);
    let out = if order == 1 && method != Method::Qr && cost > 1e8 {
        // One long sum: pieces of it, so that Ctrl-C is noticed.
        let mut sum = Quadruples::new(m, method, Path::Best);
        let mut parts = vec![0.0; sum.parts()];
        let out = batch.array(py, &[])?;
        {
            let mut write = output::writable(&out)?;
            for (trial, out) in write.as_slice_mut()?.iter_mut().enumerate() {
                let weights = weights.map(|w| w.get(trial));
                sum.load(times.get(trial), bearings.get(trial), weights)
                    .map_err(|error| errors::input_at(&batch.place(trial), error))?;
                let part = 3.0 * cost / m as f64;
                run::in_pieces(py, sum.parts(), part, |range, threads| {
                    sum.run(range.clone(), threads, &mut parts[range]);
                    Ok(())
                })?;
                *out = sum.total(&parts);
            }
        }
        out
    } else {
        batch.fill(py, &[], cost, |range, threads, out| {
            let (times, bearings) = (times.skip(range.start), bearings.skip(range.start));
            let weights = weights.map(|w| w.skip(range.start));
            if order == 0 {
                batch::fixed_target_sum(times, bearings, weights, method, threads, out)
            } else {
                batch::discriminant_sum(times, bearings, weights, method, threads, out)
            }
        })?
    };
    errors::refuse_overflow(batch, 1, out.readonly().as_slice()?, "the sum of squares")?;
    Ok(out)
}

/// Indices and values (..., 5) of the quadruples with the largest |D|.
#[pyfunction]
fn bearing_best_quadruple<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyDict>> {
    let track = Track::new(times, bearings, None, 4, None)?;
    let batch = &track.batch;
    let (times, bearings) = (track.times.items()?, track.bearings.items()?);
    let cost = 4.0 * batch::discriminant_cost(track.m.min(200), Method::Direct);
    let records = batch.fill(py, &[5], cost, |range, threads, out| {
        batch::best_quadruples(
            times.skip(range.start),
            bearings.skip(range.start),
            threads,
            out,
        )
    })?;
    batch.named(&records, &[("indices", &[4]), ("value", &[])])
}

/// Gram matrices (..., 4, 4).
#[pyfunction]
#[pyo3(signature = (times, bearings, weights, out=None))]
fn bearing_gram<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    weights: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    Ok(gram(py, [times, bearings], weights, out, false)?.1)
}

/// Gram matrices (..., 4, 4) and their determinants (...), in one array (..., 17).
#[pyfunction]
#[pyo3(signature = (times, bearings, weights, out=None))]
fn bearing_gram_and_det<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    weights: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let (batch, both) = gram(py, [times, bearings], weights, out, true)?;
    batch.named(&both, &[("gram", &[4, 4]), ("det", &[])])
}

fn gram<'py>(
    py: Python<'py>,
    [times, bearings]: [&Bound<'py, PyAny>; 2],
    weights: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
    determinant: bool,
) -> PyResult<(Batch, Bound<'py, PyArrayDyn<f64>>)> {
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
        Some(weights) => Batch::into(&mut [&mut times, &mut bearings, weights], out)?,
        None => Batch::into(&mut [&mut times, &mut bearings], out)?,
    };
    let core: &[usize] = if determinant { &[17] } else { &[4, 4] };
    let size = core.iter().product();
    let mut finite = true;
    let (track, angles) = (times.items()?, bearings.items()?);
    let weights = weights.as_ref().map(Input::items).transpose()?;
    let out = batch.fill(py, core, 1.2 * m as f64, |range, threads, out| {
        batch::bearing_gram(
            track.skip(range.start),
            angles.skip(range.start),
            weights.map(|w| w.skip(range.start)),
            determinant,
            threads,
            Path::Best,
            out,
        );
        finite &= all_finite(out);
    })?;
    if !finite {
        bearings.check_finite()?;
        let read = out.readonly();
        errors::refuse_overflow(&batch, size, read.as_slice()?, "the Gram matrix")?;
    }
    Ok((batch, out))
}

/// Statistic, p-value and relative motion (..., 6).
#[pyfunction]
fn bearing_test<'py>(
    py: Python<'py>,
    times: &Bound<'py, PyAny>,
    bearings: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyDict>> {
    let Track {
        mut times,
        mut bearings,
        m,
        ..
    } = Track::new(times, bearings, None, 4, None)?;
    let mut sigma = Input::levels(sigma, "sigma [rad]")?;
    sigma.expect_one_or(m, "one standard deviation, or one for each bearing")?;
    sigma.expect_positive("rad")?;
    let batch = Batch::of(&mut [&mut times, &mut bearings, &mut sigma])?;
    let (times, bearings, sigma) = (times.items()?, bearings.items()?, sigma.items()?);
    let records = batch.fill(
        py,
        &[TEST_SIZE],
        300.0 + 25.0 * m as f64,
        |range, threads, out| {
            batch::observability_tests(
                times.skip(range.start),
                bearings.skip(range.start),
                sigma.skip(range.start),
                threads,
                Path::Best,
                out,
            )
        },
    )?;
    let parts: [(&str, &[usize]); 3] = [
        ("statistic", &[]),
        ("p_value", &[]),
        ("relative_motion", &[4]),
    ];
    batch.named(&records, &parts)
}

/// Observability while the bearings arrive.
#[pyclass(subclass, module = "gramian._core")]
struct BearingMonitor(Arc<Monitor<f64>>);

#[pymethods]
impl BearingMonitor {
    #[new]
    fn new() -> Self {
        Self(Arc::new(Monitor::new()))
    }

    /// Take in a bearing and return what all so far say.
    ///
    /// Parameters
    /// ----------
    /// time : float
    ///     Later than all before, seconds.
    /// bearing : float
    ///     Radians, wrapped or not.
    /// sigma : float
    ///     Its standard deviation, radians, > 0.
    /// distance : float, optional
    ///     The target's distance as far as it is known, metres, > 0; for all bearings
    ///     or for none. With it the information is Fisher's and bounds are in metres;
    ///     without, the range counts as 1.
    ///
    /// Returns
    /// -------
    /// MonitorAnswer
    ///
    /// Raises
    /// ------
    /// InputError
    ///     A time not later than the one before, a sigma or distance that is not positive,
    ///     a distance that only some bearings have, a number that is not finite. The
    ///     bearing is not taken in then.
    #[pyo3(signature = (time, bearing, sigma, distance=None))]
    #[allow(clippy::doc_markdown)] // The docstring is Python's.
    fn push<'py>(
        &mut self,
        py: Python<'py>,
        time: &Bound<'py, PyAny>,
        bearing: &Bound<'py, PyAny>,
        sigma: &Bound<'py, PyAny>,
        distance: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, MonitorAnswer>> {
        let distance = distance
            .map(|distance| real(distance, "distance"))
            .transpose()?;
        let (time, bearing) = (real(time, "time")?, real(bearing, "bearing")?);
        let sigma = real(sigma, "sigma [rad]")?;
        Arc::make_mut(&mut self.0)
            .push(time, bearing, sigma, distance)
            .map_err(|error| errors::input_at("", error))?;
        Bound::new(py, self.answer())
    }

    /// Return what the bearings so far say.
    fn answer(&self) -> MonitorAnswer {
        MonitorAnswer {
            monitor: Arc::clone(&self.0),
            found: OnceLock::new(),
        }
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __getstate__(&self) -> (Vec<f64>, [u32; 2], bool) {
        let kept = self.0.kept();
        (kept.numbers.to_vec(), kept.counts, kept.ranged)
    }

    fn __setstate__(&mut self, state: (Vec<f64>, [u32; 2], bool)) -> PyResult<()> {
        let (numbers, counts, ranged) = state;
        let numbers = numbers
            .try_into()
            .map_err(|_| InputError::new_err("the state of a monitor has 40 numbers"))?;
        let kept = Kept {
            numbers,
            counts,
            ranged,
        };
        let monitor = Monitor::from_kept(&kept).map_err(|error| errors::input_at("", error))?;
        self.0 = Arc::new(monitor);
        Ok(())
    }

    fn __repr__(&self) -> String {
        format!("Monitor(count={})", self.0.count())
    }
}

/// What the bearings so far say.
///
/// It keeps the sums of its moment and works the answer out when first asked, so that a
/// push costs little where nobody looks.
///
/// Attributes
/// ----------
/// count : int
///     How many bearings there are.
/// rank : int
///     Rank of the rows with unit columns, of 4.
/// det, logdet : float
///     Determinant of the information and its logarithm.
/// `singular_value` : float
///     Smallest singular value of the rows with unit columns, at the first time.
/// `crlb_std` : ndarray, shape (4,)
///     Bounds on x0, y0, vx, vy at the first time, `inf` where there is none: metres
///     where ranges were given, parts of the range where not.
/// statistic, dof, `p_value` : float
///     The test of `observability_test`, in its streaming form; 0, 0 and 1 below four
///     bearings.
/// `relative_motion` : ndarray, shape (4,)
///     The relative motion that fits best, at unit range at the first time.
#[pyclass(frozen, module = "gramian._core")]
struct MonitorAnswer {
    /// The monitor's own until it takes in another bearing: a push of which nobody keeps the
    /// answer copies nothing.
    monitor: Arc<Monitor<f64>>,
    /// Apart, since it is as large again, and few look.
    found: OnceLock<Box<Answer<f64>>>,
}

impl MonitorAnswer {
    fn found(&self) -> &Answer<f64> {
        self.found.get_or_init(|| Box::new(self.monitor.answer()))
    }
}

#[pymethods]
impl MonitorAnswer {
    #[getter]
    fn count(&self) -> u32 {
        self.monitor.count()
    }

    #[getter]
    fn rank(&self) -> usize {
        self.found().rank
    }

    #[getter]
    fn det(&self) -> f64 {
        self.found().determinant
    }

    #[getter]
    fn logdet(&self) -> f64 {
        self.found().log_determinant
    }

    #[getter]
    fn singular_value(&self) -> f64 {
        self.found().singular_value
    }

    #[getter]
    fn crlb_std<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.found().crlb_std)
    }

    #[getter]
    fn statistic(&self) -> f64 {
        self.found().statistic
    }

    #[getter]
    fn dof(&self) -> f64 {
        self.found().dof
    }

    #[getter]
    fn p_value(&self) -> f64 {
        self.found().p_value
    }

    #[getter]
    fn relative_motion<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.found().relative_motion)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.monitor == other.monitor
    }

    // As the answer of the monitor that kept the same.
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Py<BearingMonitor>,))> {
        let made = py.get_type::<BearingMonitor>().getattr("answer")?;
        Ok((
            made,
            (Py::new(py, BearingMonitor(Arc::clone(&self.monitor)))?,),
        ))
    }

    fn __str__(&self) -> String {
        let found = self.found();
        format!(
            "{} bearing{}: rank {} of 4, p {}",
            self.monitor.count(),
            if self.monitor.count() == 1 { "" } else { "s" },
            found.rank,
            number_text(found.p_value)
        )
    }

    fn __repr__(&self) -> String {
        let found = self.found();
        format!(
            "MonitorAnswer(count={}, rank={}, logdet={}, p_value={})",
            self.monitor.count(),
            found.rank,
            number_text(found.log_determinant),
            number_text(found.p_value)
        )
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(bearing_best_quadruple, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_discriminant, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_discriminant_sum, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_gram, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_gram_and_det, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_rows, module)?)?;
    module.add_function(wrap_pyfunction!(bearing_test, module)?)?;
    module.add_class::<BearingMonitor>()?;
    module.add_class::<MonitorAnswer>()
}
