//! `gram`, `crlb_std`, and the analysis of one problem.
// Arguments come from Python by value.
#![allow(clippy::needless_pass_by_value)]

use gramian::batch::{self, simd::Path};
use gramian::numbers::words;
use gramian::spine::verdict::{self, Findings};
use gramian::{chi_square, rounding};

use gramian::observability::{Observability, marginal_rows as marginal};

use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::convert::{self, Input, Number, all_finite};
use crate::dense;
use crate::errors::{InputError, input_at};
use crate::output::{self, Batch, expect_representable};
use crate::run;

#[pyfunction]
#[pyo3(signature = (rows, weights, out=None))]
fn gram<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
    weights: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let single = match weights {
        Some(weights) => convert::is_single(&[rows, weights]),
        None => convert::is_single(&[rows]),
    };
    Ok(if single {
        gram_of::<f32>(py, rows, weights, out)?.into_any()
    } else {
        gram_of::<f64>(py, rows, weights, out)?.into_any()
    })
}

fn gram_of<'py, T: Number>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
    weights: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let mut rows = Input::<T>::of(rows, "rows", 2)?;
    rows.expect_entries()?;
    let (count, n) = (rows.core_shape()[0], rows.core_shape()[1]);
    let mut weights = weights
        .map(|w| Input::<T>::of(w, "weights", 1))
        .transpose()?;
    if let Some(weights) = &weights {
        weights.check_finite()?;
        weights.expect(&[Some(count)], "one weight for each row")?;
        weights.expect_nonnegative()?;
    }
    let batch = match &mut weights {
        Some(weights) => Batch::into(&mut [&mut rows, weights], out)?,
        None => Batch::into(&mut [&mut rows], out)?,
    };
    let items = rows.items()?;
    let weights = weights.as_ref().map(Input::items).transpose()?;
    let cost = (count * n * n) as f64;
    let mut finite = true;
    if cost > run::PIECE && !gramian::spine::batch_gram::is_fast(n) {
        // One trial takes long: its rows are added in pieces, in the same order.
        let out = batch.array(py, &[n, n])?;
        {
            let mut write = output::writable(&out)?;
            let squares = write.as_slice_mut()?.chunks_exact_mut(n * n);
            for (trial, square) in squares.enumerate() {
                let rows = items.get(trial);
                let weights = weights.map(|w| w.get(trial));
                square.fill(T::zero());
                run::in_pieces(py, count, (n * n) as f64, |range, _| {
                    let weights = weights.map(|w| &w[range.clone()]);
                    let rows = &rows[range.start * n..range.end * n];
                    gramian::spine::batch_gram::add(rows, weights, n, square);
                    Ok(())
                })?;
                finite &= all_finite(square);
            }
        }
        return finite_gram(out, finite, &mut rows);
    }
    let out = batch.fill(py, &[n, n], cost, |range, threads, out| {
        gramian::spine::batch_gram::gram(
            items.skip(range.start),
            weights.map(|w| w.skip(range.start)),
            n,
            threads,
            Path::Best,
            out,
        );
        finite &= all_finite(out);
    })?;
    finite_gram(out, finite, &mut rows)
}

/// A row that is not finite makes a square that is not: the rows, many more numbers,
/// need a look only then.
fn finite_gram<'py, T: Number>(
    out: Bound<'py, PyArrayDyn<T>>,
    finite: bool,
    rows: &mut Input<'py, T>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    if !finite {
        rows.check_finite()?;
        return Err(InputError::new_err(format!(
            "the Gram matrix overflows {}: choose other units",
            output::type_name::<T>()
        )));
    }
    Ok(out)
}

#[pyfunction]
#[pyo3(signature = (rows, rtol, out=None))]
fn crlb_std<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
    rtol: Option<f64>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let mut rows = Input::new(rows, "rows", 2)?;
    rows.expect_entries()?;
    let (count, n) = (rows.core_shape()[0], rows.core_shape()[1]);
    let batch = Batch::into(&mut [&mut rows], out)?;
    let rows = rows.items()?;
    let cost = (count * n * n + 100 * n * n * n) as f64;
    if dense::is_large(n) {
        return batch.fill_apart(py, &[n], cost, |trial| {
            let rows = rows.get(trial).to_vec();
            move |_, out: &mut [f64]| -> PyResult<()> {
                let found = dense::crlb_std(&rows, n, rtol).map_err(|e| input_at("", e))?;
                out.copy_from_slice(&found);
                expect_representable(out, &rows, n)
            }
        });
    }
    let mut refused = None;
    let out = batch.fill(py, &[n], cost, |range, threads, out| {
        let rows = rows.skip(range.start);
        gramian::bounds::batch::crlb_std(rows, n, rtol, threads, Path::Best, out);
        for (trial, std) in out.chunks_exact(n).enumerate() {
            if refused.is_none() {
                refused = expect_representable(std, rows.get(trial), n).err();
            }
        }
    })?;
    refused.map_or(Ok(out), Err)
}

/// The probability that a chi-square variable of `dof` exceeds `value`; NaN for NaN.
#[pyfunction]
fn chi_square_survival<'py>(
    py: Python<'py>,
    value: &Bound<'py, PyAny>,
    dof: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let mut value = Input::unchecked(value, "value", 0)?;
    let mut dof = Input::new(dof, "dof", 0)?;
    dof.expect_positive("")?;
    let batch = Batch::of(&mut [&mut value, &mut dof])?;
    let (value, dof) = (value.items()?, dof.items()?);
    batch.fill(py, &[], 100.0, |range, _, out| {
        for (trial, p) in range.zip(out) {
            let value = value.get(trial)[0];
            *p = if value.is_nan() {
                f64::NAN
            } else if value == f64::INFINITY {
                0.0
            } else {
                chi_square::survival(value.max(0.0), dof.get(trial)[0]).unwrap_or(f64::NAN)
            };
        }
    })
}

/// What a chi-square variable of `dof` exceeds with probability `alpha`.
#[pyfunction]
fn chi_square_critical(alpha: f64, dof: f64) -> PyResult<f64> {
    chi_square::critical(alpha, dof).map_err(|error| input_at("", error))
}

/// Standard normal numbers (trials, count) of the streams `first..first + trials`.
#[pyfunction]
fn normals(
    py: Python<'_>,
    seed: u64,
    first: u64,
    trials: usize,
    count: usize,
) -> PyResult<Bound<'_, PyArrayDyn<f64>>> {
    let cost = 10.0 * count as f64;
    Batch::trials(first, trials).fill(py, &[count], cost, |range, threads, out| {
        batch::normals(seed, first + range.start as u64, count, threads, out);
    })
}

/// The rows that are left for the columns from `eliminated` on.
#[pyfunction]
fn marginal_rows<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
    eliminated: usize,
    rtol: Option<f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows = Input::new(rows, "rows", 2)?;
    rows.expect(&[None, None], "one row for each measurement")?;
    let n = rows.core_shape()[1];
    let data = rows.slice()?;
    let left = run::detached(py, |_| marginal(data, n, eliminated, rtol))?
        .map_err(|error| input_at("", error))?;
    if left.is_empty() {
        return Ok(PyArray2::zeros(py, [0, n - eliminated], false));
    }
    Ok(PyArray2::from_vec2(py, &left)?)
}

/// How much of each column (n,) of rows is rounding: see `gramian::rounding::of_columns`.
#[pyfunction]
fn rounding_of_columns<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
    accuracy: &Bound<'py, PyAny>,
    width: usize,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let rows = Input::new(rows, "rows", 2)?;
    let n = rows.core_shape()[1];
    let accuracy = Input::new(accuracy, "accuracy", 1)?;
    accuracy.expect(&[Some(rows.core_shape()[0])], "one for each row")?;
    let noise = rounding::of_columns(rows.slice()?, n, accuracy.slice()?, width);
    Ok(PyArray1::from_vec(py, noise))
}

/// Rows (K, n) without columns that are rounding alone, and the relative accuracy of
/// the others: see `gramian::rounding::remove`.
#[pyfunction]
fn above_rounding<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
    noise: &Bound<'py, PyAny>,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Option<f64>)> {
    let rows = Input::new(rows, "rows", 2)?;
    rows.expect_single("one problem")?;
    let shape = [rows.core_shape()[0], rows.core_shape()[1]];
    let noise = Input::new(noise, "noise", 1)?;
    noise.expect(&[Some(shape[1])], "one for each column")?;
    let mut left = rows.slice()?.to_vec();
    let rtol = rounding::remove(&mut left, shape[1], noise.slice()?);
    Ok((PyArray1::from_vec(py, left).reshape(shape)?, rtol))
}

/// Does nothing: what a call costs in itself, for `benches/bench_small_calls.py`.
#[pyfunction]
fn empty_call() {}

/// One problem, reduced: see `gramian::observability::Observability`.
#[pyclass(frozen, name = "Analysis", module = "gramian._core")]
struct Analysis(Observability<f64>);

#[pymethods]
impl Analysis {
    #[new]
    #[pyo3(signature = (rows, rtol, exact=None, errors=None))]
    fn new(
        py: Python<'_>,
        rows: &Bound<'_, PyAny>,
        rtol: Option<f64>,
        exact: Option<&Bound<'_, PyAny>>,
        errors: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let rows = Input::new(rows, "rows", 2)?;
        rows.expect_entries()?;
        rows.expect_single("one array (rows, states)")?;
        let n = rows.core_shape()[1];
        let exact = exact.map(|e| Input::new(e, "constraints", 2)).transpose()?;
        if let Some(exact) = &exact {
            exact.expect(&[None, Some(n)], "one row for each constraint")?;
        }
        let known = exact.as_ref().map_or(Ok(&[][..]), Input::slice)?;
        let errors = errors.map(|e| Input::new(e, "row_error", 2)).transpose()?;
        let doubt = errors.as_ref().map_or(Ok(&[][..]), Input::slice)?;
        let data = rows.slice()?;
        let found = if n < 16 {
            // One factorisation uses one thread: it does not enter the pool.
            py.detach(|| Observability::inexact(data, doubt, known, n, rtol))
                .map_err(|error| input_at("", error))?
        } else if known.is_empty() && dense::is_large(n) {
            let (data, doubt) = (data.to_vec(), doubt.to_vec());
            run::apart(py, f64::INFINITY, move |_| {
                dense::observability(&data, &doubt, n, rtol)
            })?
            .map_err(|error| input_at("", error))?
        } else {
            let (data, doubt, known) = (data.to_vec(), doubt.to_vec(), known.to_vec());
            run::apart(py, f64::INFINITY, move |_| {
                Observability::inexact(&data, &doubt, &known, n, rtol)
            })?
            .map_err(|error| input_at("", error))?
        };
        // What is known exactly has the bound 0.
        if known.is_empty() {
            expect_representable(&found.crlb_std(), data, n)?;
        }
        Ok(Self(found))
    }

    #[getter]
    fn rank(&self) -> usize {
        self.0.rank()
    }

    #[getter]
    fn rtol(&self) -> f64 {
        self.0.rtol()
    }

    #[getter]
    fn log_det(&self) -> f64 {
        self.0.log_det()
    }

    fn singular_values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.singular_values())
    }

    fn null_space<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let basis = self.0.null_space().map_err(|error| input_at("", error))?;
        let n = self.0.states();
        let columns: Vec<Vec<f64>> = (0..n)
            .map(|i| basis.iter().map(|vector| vector[i]).collect())
            .collect();
        Ok(PyArray2::from_vec2(py, &columns)?)
    }

    fn weakest_direction<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let direction = self
            .0
            .weakest_direction()
            .map_err(|error| input_at("", error))?;
        Ok(PyArray1::from_vec(py, direction))
    }

    fn crlb_std<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.0.crlb_std())
    }

    /// Which states the accuracy of the rows leaves open.
    fn undecided(&self) -> Vec<usize> {
        self.0.undecided()
    }

    fn crlb<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let n = self.0.states();
        self.0
            .crlb()
            .map(|c| PyArray1::from_vec(py, c).reshape([n, n]))
            .transpose()
    }

    fn crlb_root<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let n = self.0.states();
        self.0
            .crlb_root()
            .map(|w| {
                let count = w.len() / n;
                PyArray1::from_vec(py, w).reshape([count, n])
            })
            .transpose()
    }

    fn combination_std(&self, combination: &Bound<'_, PyAny>) -> PyResult<f64> {
        let combination = self.vector(combination, "combination")?;
        self.0
            .combination_std(&combination)
            .map_err(|error| input_at("", error))
    }

    fn knowing<'py>(
        &self,
        py: Python<'py>,
        combination: &Bound<'py, PyAny>,
        sigma: f64,
    ) -> PyResult<(usize, Bound<'py, PyArray1<f64>>)> {
        let combination = self.vector(combination, "combination")?;
        let (rank, std) = self
            .0
            .knowing(&combination, sigma)
            .map_err(|error| input_at("", error))?;
        Ok((rank, PyArray1::from_vec(py, std)))
    }

    /// Leverage of each of the rows that were analysed.
    fn leverage<'py>(
        &self,
        py: Python<'py>,
        rows: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let rows = Input::new(rows, "rows", 2)?;
        rows.expect(&[None, Some(self.0.states())], "one number for each state")?;
        let found = self
            .0
            .leverage(rows.slice()?)
            .map_err(|error| input_at("", error))?;
        Ok(PyArray1::from_vec(py, found))
    }

    /// Bounds without one of the rows that were analysed; None where the rank falls.
    fn without<'py>(
        &self,
        py: Python<'py>,
        row: &Bound<'py, PyAny>,
    ) -> PyResult<Option<Bound<'py, PyArray1<f64>>>> {
        let row = self.vector(row, "row")?;
        let found = self.0.without(&row).map_err(|error| input_at("", error))?;
        Ok(found.map(|std| PyArray1::from_vec(py, std)))
    }
}

/// Singular values of rows as they are, descending.
#[pyfunction]
fn singular_values<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let rows = Input::new(rows, "rows", 2)?;
    rows.expect(&[None, None], "one row for each measurement")?;
    let n = rows.core_shape()[1];
    let data = rows.slice()?.to_vec();
    let mut values = if dense::is_large(n) {
        run::apart(py, f64::INFINITY, move |_| dense::singular_values(&data, n))?
            .map_err(|error| input_at("", error))?
    } else {
        gramian::observability::singular_values(&data, n)
            .map_err(|error| input_at("", error))?
            .0
    };
    values.resize(n, 0.0);
    Ok(PyArray1::from_vec(py, values))
}

/// What the bound of each state is compared with.
#[pyfunction]
fn references<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
    scale: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let rows = Input::unchecked(rows, "rows", 2)?;
    let scale = Input::unchecked(scale, "scale", 1)?;
    let found = verdict::references(rows.slice()?, scale.slice()?);
    Ok(PyArray1::from_vec(py, found))
}

/// A number in so many digits, for a sentence.
#[pyfunction]
fn brief(value: f64, digits: usize) -> String {
    words::brief(value, digits)
}

/// How states move together, in words.
#[pyfunction]
fn moves(change: &Bound<'_, PyAny>, names: Vec<String>) -> PyResult<String> {
    let change = Input::unchecked(change, "change", 1)?;
    Ok(words::moves(change.slice()?, &names))
}

/// (status, reason, the states that decided it): see `gramian::spine::verdict`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn judge(
    rank: usize,
    touched: PyReadonlyArray1<'_, bool>,
    data_std: &Bound<'_, PyAny>,
    scale: &Bound<'_, PyAny>,
    prior: &Bound<'_, PyAny>,
    condition: f64,
    hardness: &Bound<'_, PyAny>,
    weak_ratio: f64,
    weak_condition: f64,
    names: &Bound<'_, PyAny>,
    units: &Bound<'_, PyAny>,
) -> PyResult<(&'static str, String, Vec<usize>)> {
    let (data_std, scale) = (
        Input::unchecked(data_std, "data_std", 1)?,
        Input::unchecked(scale, "scale", 1)?,
    );
    let (prior, hardness) = (
        Input::unchecked(prior, "prior", 1)?,
        Input::unchecked(hardness, "hardness", 1)?,
    );
    let found = verdict::judge(&Findings {
        rank,
        open: touched.as_slice()?,
        data_std: data_std.slice()?,
        scale: scale.slice()?,
        prior: prior.slice()?,
        condition,
        hardness: hardness.slice()?,
        weak_ratio,
        weak_condition,
    });
    let text = |all: &Bound<'_, PyAny>, i: usize| {
        let one = all.get_item(i).and_then(|one| one.extract::<String>());
        one.unwrap_or_default()
    };
    let reason = found.reason.words(|i| text(names, i), |i| text(units, i));
    Ok((found.status.name(), reason, found.decided_by))
}

/// Rows with the information that random errors of their entries leave.
#[pyfunction]
fn rows_without_noise<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
    sigma: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows = Input::new(rows, "rows", 2)?;
    rows.expect(&[None, None], "one row for each measurement")?;
    let n = rows.core_shape()[1];
    let sigma = Input::new(sigma, "row_sigma", 1)?;
    let (data, each) = (rows.slice()?.to_vec(), sigma.slice()?.to_vec());
    let found = run::apart(py, f64::INFINITY, move |_| {
        gramian::observability::without_noise(&data, n, &each)
    })?
    .map_err(|error| input_at("", error))?;
    let count = found.len() / n;
    PyArray1::from_vec(py, found).reshape([count, n])
}

impl Analysis {
    fn vector(&self, value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Vec<f64>> {
        let vector = Input::new(value, name, 1)?;
        vector.expect(&[Some(self.0.states())], "one number for each state")?;
        Ok(vector.slice()?.to_vec())
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(gram, module)?)?;
    module.add_function(wrap_pyfunction!(crlb_std, module)?)?;
    module.add_function(wrap_pyfunction!(above_rounding, module)?)?;
    module.add_function(wrap_pyfunction!(empty_call, module)?)?;
    module.add_function(wrap_pyfunction!(chi_square_critical, module)?)?;
    module.add_function(wrap_pyfunction!(chi_square_survival, module)?)?;
    module.add_function(wrap_pyfunction!(normals, module)?)?;
    module.add_function(wrap_pyfunction!(output::representable, module)?)?;
    module.add_function(wrap_pyfunction!(rounding_of_columns, module)?)?;
    module.add_function(wrap_pyfunction!(convert::as_finite_array, module)?)?;
    module.add_function(wrap_pyfunction!(convert::as_float_array, module)?)?;
    module.add_function(wrap_pyfunction!(convert::are_single, module)?)?;
    module.add_function(wrap_pyfunction!(convert::require_finite, module)?)?;
    module.add_function(wrap_pyfunction!(marginal_rows, module)?)?;
    module.add_function(wrap_pyfunction!(rows_without_noise, module)?)?;
    module.add_function(wrap_pyfunction!(brief, module)?)?;
    module.add_function(wrap_pyfunction!(moves, module)?)?;
    module.add_function(wrap_pyfunction!(judge, module)?)?;
    module.add_function(wrap_pyfunction!(references, module)?)?;
    module.add_function(wrap_pyfunction!(singular_values, module)?)?;
    module.add_function(wrap_pyfunction!(run::set_threads, module)?)?;
    module.add_function(wrap_pyfunction!(run::threads, module)?)?;
    module.add_function(wrap_pyfunction!(run::be_worker, module)?)?;
    module.add_class::<Analysis>()
}
