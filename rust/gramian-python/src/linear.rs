//! Linear systems.

use std::sync::Arc;

use gramian::batch::simd::Path;
use gramian::batch::{Items, Threads};
use gramian::linear::analysis::Analysis;
use gramian::linear::batch::{self, Span};
use gramian::linear::infinite;
use gramian::linear::pencil::Pencil;
use gramian::linear::piecewise;
use gramian::linear::unobservable::{self, Unobservable};
use gramian::linear::window;
use gramian::observability::singular_values;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;

use crate::convert::Input;
use crate::errors::InputError;
use crate::output::Batch;
use crate::{errors, run};

/// A (..., n, n) and C (..., p, n) that fit each other.
fn system<'py>(
    a: &Bound<'py, PyAny>,
    c: &Bound<'py, PyAny>,
) -> PyResult<(Input<'py>, Input<'py>, usize, usize)> {
    let a = Input::new(a, "A", 2)?;
    a.expect_entries()?;
    let n = a.core_shape()[1];
    a.expect(
        &[Some(n), Some(n)],
        "square, a row and a column for each state",
    )?;
    let c = Input::new(c, "C", 2)?;
    c.expect_entries()?;
    c.expect(&[None, Some(n)], "a column for each state of A")?;
    let p = c.core_shape()[0];
    Ok((a, c, n, p))
}

/// About what it takes to factorise `count` matrices (n, n), nanoseconds.
fn cubes(n: usize, count: usize) -> f64 {
    50.0 * (n * n) as f64 * (n * count) as f64
}

fn expect_rtol(rtol: Option<f64>) -> PyResult<()> {
    match rtol {
        Some(rtol) if !(rtol > 0.0 && rtol < 1.0) => Err(InputError::new_err(format!(
            "rtol = {rtol}: must be between 0 and 1"
        ))),
        _ => Ok(()),
    }
}

/// (..., (order + 1) p, n)
#[pyfunction]
#[pyo3(signature = (a, c, order, out=None))]
fn observability_matrix<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    c: &Bound<'py, PyAny>,
    order: Option<usize>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let (mut a, mut c, n, p) = system(a, c)?;
    let order = order.unwrap_or(n - 1);
    let batch = Batch::into(&mut [&mut a, &mut c], out)?;
    let (a, c) = (a.items()?, c.items()?);
    let lines = order.saturating_add(1).saturating_mul(p);
    batch.fill(
        py,
        &[lines, n],
        lines as f64 * (n * n) as f64,
        |range, threads, out| {
            let (a, c) = (a.skip(range.start), c.skip(range.start));
            batch::observability_matrix(a, c, n, order, threads, Path::Best, out).map_err(|trial| {
                let power = format!("C A^{order} is not finite: levels do without powers of A");
                (trial, power)
            })
        },
    )
}

/// (..., 2, n): ranks of `O_0` .. `O_{n-1}`; levels of the states.
#[pyfunction]
fn linear_levels<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    c: &Bound<'py, PyAny>,
    rtol: Option<f64>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let (mut a, mut c, n, p) = system(a, c)?;
    expect_rtol(rtol)?;
    let batch = Batch::of(&mut [&mut a, &mut c])?;
    let (a, c) = (a.items()?, c.items()?);
    batch.fill(
        py,
        &[2, n],
        batch::linear_cost(n, p),
        |range, threads, out| {
            let (a, c) = (a.skip(range.start), c.skip(range.start));
            batch::linear_levels(a, c, n, rtol, threads, Path::Best, out);
        },
    )
}

/// (..., n, n) of outputs whitened by the caller. `duration` is a time, or a
/// number of samples where `discrete`.
#[pyfunction]
#[pyo3(signature = (a, c, q, duration, samples, out=None))]
fn linear_gramian<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    c: &Bound<'py, PyAny>,
    q: Option<&Bound<'py, PyAny>>,
    duration: f64,
    samples: Option<usize>,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let (mut a, mut c, n, _) = system(a, c)?;
    let mut q = q.map(|q| Input::new(q, "Q", 2)).transpose()?;
    if let Some(q) = &q {
        q.expect(&[Some(n), Some(n)], "a covariance of the states")?;
    }
    let batch = match &mut q {
        Some(q) => Batch::into(&mut [&mut a, &mut c, q], out)?,
        None => Batch::into(&mut [&mut a, &mut c], out)?,
    };
    let span = samples.map_or(Span::Duration(duration), Span::Samples);
    let (a, c) = (a.items()?, c.items()?);
    let q = q.as_ref().map(Input::items).transpose()?;
    let cost = batch::gramian_cost(n);
    if cost > run::PIECE {
        return batch.fill_apart(py, &[n, n], cost, |trial| {
            let (a, c) = (a.get(trial).to_vec(), c.get(trial).to_vec());
            let q = q.map(|q| q.get(trial).to_vec());
            move |threads: Threads, out: &mut [f64]| {
                let (a, c) = (Items::shared(&a), Items::shared(&c));
                let q = q.as_deref().map(Items::shared);
                batch::linear_gramian(a, c, q, n, span, threads, Path::Best, out)
            }
        });
    }
    batch.fill(py, &[n, n], cost, |range, threads, out| {
        batch::linear_gramian(
            a.skip(range.start),
            c.skip(range.start),
            q.map(|q| q.skip(range.start)),
            n,
            span,
            threads,
            Path::Best,
            out,
        )
    })
}

/// e^(A duration), (n, n).
#[pyfunction]
fn linear_transition<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    duration: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let a = Input::new(a, "A", 2)?;
    let n = a.core_shape()[1];
    a.expect(
        &[Some(n), Some(n)],
        "square, a row and a column for each state",
    )?;
    let a = a.slice()?.to_vec();
    let e = run::apart(py, cubes(n, 1), move |_| {
        window::transition(&a, n, duration)
    })?
    .map_err(|error| errors::input_at("", error))?;
    PyArray1::from_vec(py, e).reshape([n, n])
}

/// Singular values (n,), descending, and right singular vectors (n, n) in rows.
#[pyfunction]
fn right_singular<'py>(
    py: Python<'py>,
    rows: &Bound<'py, PyAny>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Matrix<'py>)> {
    let rows = Input::new(rows, "rows", 2)?;
    rows.expect_entries()?;
    let (count, n) = (rows.core_shape()[0], rows.core_shape()[1]);
    rows.expect(&[Some(count), Some(n)], "one row for each measurement")?;
    let rows = rows.slice()?.to_vec();
    let cost = (20 * n * n) as f64 * (count + n) as f64;
    let (values, vectors) = run::apart(py, cost, move |_| singular_values(&rows, n))?
        .map_err(|error| errors::input_at("", error))?;
    Ok((
        PyArray1::from_vec(py, values),
        PyArray1::from_vec(py, vectors).reshape([n, n])?,
    ))
}

type Matrix<'py> = Bound<'py, PyArray2<f64>>;
type Ranks<'py> = Bound<'py, PyArray1<usize>>;

/// Piecewise constant A (segments, n, n), C (segments, p, n): ranks alone, of the
/// stripped and the total matrix, whether each kernel rests, the null space.
#[pyfunction]
#[allow(clippy::type_complexity)]
fn piecewise_ranks<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    c: &Bound<'py, PyAny>,
    durations: &Bound<'py, PyAny>,
    rtol: Option<f64>,
) -> PyResult<(
    Ranks<'py>,
    Ranks<'py>,
    Ranks<'py>,
    Vec<bool>,
    Vec<Vec<bool>>,
    Matrix<'py>,
)> {
    let (a, c, n, p) = system(a, c)?;
    expect_rtol(rtol)?;
    let durations = Input::new(durations, "durations", 1)?;
    durations.expect_entries()?;
    durations.expect_positive("s")?;
    let count = durations.core_shape()[0];
    if a.batch_shape() != [count]
        || c.batch_shape() != [count]
        || !durations.batch_shape().is_empty()
    {
        return Err(InputError::new_err(format!(
            "durations has {count} entries: A must be ({count}, {n}, {n}) and C ({count}, {p}, {n})"
        )));
    }
    let (a, c) = (a.slice()?.to_vec(), c.slice()?.to_vec());
    let durations = durations.slice()?.to_vec();
    let found = run::apart(py, cubes(n, count), move |_| {
        piecewise::Piecewise::new(&a, &c, &durations, n, rtol)
    })?
    .map_err(|error| errors::input_at("", error))?;
    let ranks = |ranks: Vec<usize>| PyArray1::from_vec(py, ranks);
    Ok((
        ranks(found.alone),
        ranks(found.stripped),
        ranks(found.total),
        found.kernel_rests,
        found.determined,
        columns(py, &found.null_space, n)?,
    ))
}

/// Vectors as the columns of an array (n, count).
fn columns<'py>(
    py: Python<'py>,
    vectors: &[Vec<f64>],
    n: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat: Vec<f64> = (0..n)
        .flat_map(|i| vectors.iter().map(move |vector| vector[i]))
        .collect();
    PyArray1::from_vec(py, flat).reshape([n, vectors.len()])
}

/// Levels of one system: see `gramian::linear::analysis::Analysis`.
#[pyclass(frozen)]
struct LinearAnalysis {
    inner: Analysis<f64>,
    n: usize,
}

#[pymethods]
impl LinearAnalysis {
    #[new]
    fn new(
        py: Python<'_>,
        a: &Bound<'_, PyAny>,
        c: &Bound<'_, PyAny>,
        rtol: Option<f64>,
    ) -> PyResult<Self> {
        let (a, c, n, p) = system(a, c)?;
        expect_rtol(rtol)?;
        a.expect(&[Some(n), Some(n)], "one system")?;
        let (a, c) = (a.slice()?.to_vec(), c.slice()?.to_vec());
        if a.len() != n * n || c.len() != p * n {
            return Err(InputError::new_err(
                "A and C have leading axes: must be one system",
            ));
        }
        let inner = run::apart(py, cubes(n, 1), move |_| Analysis::new(&a, &c, n, rtol))?
            .map_err(|error| errors::input_at("", error))?;
        Ok(Self { inner, n })
    }

    #[getter]
    fn rtol(&self) -> f64 {
        self.inner.rtol()
    }

    /// The weakest coupling that counted and the strongest that did not.
    #[getter]
    fn margins(&self) -> (f64, f64) {
        let found = self.inner.found();
        (found.weakest, found.rejected)
    }

    /// Whether the rank may be larger.
    #[getter]
    fn undecided(&self) -> bool {
        self.inner.undecided()
    }

    /// A bound on how much the steps magnify rounding.
    #[getter]
    fn growth(&self) -> f64 {
        self.inner.found().growth
    }

    /// None where they cannot be told.
    fn ranks(&self) -> Option<Vec<usize>> {
        self.inner.ranks().map(<[usize]>::to_vec)
    }

    #[getter]
    fn rank(&self) -> usize {
        self.inner.rank()
    }

    fn state_levels(&self) -> Option<Vec<Option<usize>>> {
        self.inner.state_levels()
    }

    fn level_of(
        &self,
        combination: &Bound<'_, PyAny>,
        tolerance: Option<f64>,
    ) -> PyResult<Option<usize>> {
        let combination = self.combination(combination)?;
        self.inner
            .level_of(combination.slice()?, tolerance)
            .map_err(|error| errors::input_at("", error))
    }

    fn residuals(&self, combination: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
        let combination = self.combination(combination)?;
        self.inner
            .residuals(combination.slice()?)
            .map_err(|error| errors::input_at("", error))
    }

    fn null_space<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let basis = self
            .inner
            .null_space()
            .map_err(|error| errors::input_at("", error))?;
        columns(py, &basis, self.n)
    }

    fn combinations<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        self.inner
            .combinations()
            .map_err(|error| errors::input_at("", error))?
            .iter()
            .map(|level| columns(py, level, self.n))
            .collect()
    }
}

impl LinearAnalysis {
    fn combination<'py>(&self, value: &Bound<'py, PyAny>) -> PyResult<Input<'py>> {
        let combination = Input::new(value, "combination", 1)?;
        combination.expect(&[Some(self.n)], "a coefficient for each state")?;
        if combination.slice()?.iter().all(|&x| x == 0.0) {
            return Err(InputError::new_err("combination is zero: it says nothing"));
        }
        Ok(combination)
    }
}

/// One system, contiguous.
fn one_system<'py>(
    a: &Bound<'py, PyAny>,
    c: &Bound<'py, PyAny>,
) -> PyResult<(Input<'py>, Input<'py>, usize)> {
    let (a, c, n, p) = system(a, c)?;
    if a.slice()?.len() != n * n || c.slice()?.len() != p * n {
        return Err(InputError::new_err(
            "A and C have leading axes: must be one system",
        ));
    }
    Ok((a, c, n))
}

/// The triangular factor (n, n) of the Gramian of an infinite window.
#[pyfunction]
fn linear_infinite<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    c: &Bound<'py, PyAny>,
    discrete: bool,
) -> PyResult<Matrix<'py>> {
    let (a, c, n) = one_system(a, c)?;
    let (a, c) = (a.slice()?.to_vec(), c.slice()?.to_vec());
    let factor = run::apart(py, cubes(n, 1), move |_| {
        infinite::factor(&a, &c, n, discrete)
    })?
    .map_err(|error| errors::input_at("", error))?;
    PyArray1::from_vec(py, factor).reshape([n, n])
}

/// Basis (n, k) and factor (k, k) of the stable and of the antistable part.
#[pyfunction]
fn linear_parts<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    c: &Bound<'py, PyAny>,
) -> PyResult<[(Matrix<'py>, Matrix<'py>); 2]> {
    let (a, c, n) = one_system(a, c)?;
    let (a, c) = (a.slice()?.to_vec(), c.slice()?.to_vec());
    let found = run::apart(py, cubes(n, 1), move |_| infinite::parts(&a, &c, n))?
        .map_err(|error| errors::input_at("", error))?;
    let part = |(basis, factor): (Vec<f64>, Vec<f64>)| -> PyResult<_> {
        let m = basis.len() / n;
        let vectors: Vec<Vec<f64>> = basis.chunks_exact(n).map(<[f64]>::to_vec).collect();
        Ok((
            columns(py, &vectors, n)?,
            PyArray1::from_vec(py, factor).reshape([m, m])?,
        ))
    };
    Ok([part(found.stable)?, part(found.antistable)?])
}

/// Hankel singular values from the factors of both Gramians.
#[pyfunction]
fn linear_hankel<'py>(
    py: Python<'py>,
    observability: &Bound<'py, PyAny>,
    reachability: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (r, s, n) = one_system(observability, reachability)?;
    let values =
        infinite::hankel(r.slice()?, s.slice()?, n).map_err(|error| errors::input_at("", error))?;
    Ok(PyArray1::from_vec(py, values))
}

/// A (n, n) and C (p, n), balanced.
#[pyfunction]
fn linear_balanced<'py>(
    py: Python<'py>,
    a: &Bound<'py, PyAny>,
    c: &Bound<'py, PyAny>,
) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
    let (a, c, n) = one_system(a, c)?;
    let (a, c) = (a.slice()?.to_vec(), c.slice()?.to_vec());
    let (a, c) = run::apart(py, cubes(n, 1), move |_| unobservable::balanced(&a, &c, n))?
        .map_err(|error| errors::input_at("", error))?;
    let outputs = c.len() / n;
    Ok((
        PyArray1::from_vec(py, a).reshape([n, n])?,
        PyArray1::from_vec(py, c).reshape([outputs, n])?,
    ))
}

/// The distance, real and imaginary part of z, and of the direction (2, n).
type Distance<'py> = (f64, (f64, f64), Matrix<'py>, usize);

/// The pencil of one system: see `gramian::linear::pencil`.
#[pyclass(frozen)]
struct LinearPencil {
    inner: Arc<Pencil>,
    n: usize,
}

#[pymethods]
impl LinearPencil {
    #[new]
    fn new(py: Python<'_>, a: &Bound<'_, PyAny>, c: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (a, c, n) = one_system(a, c)?;
        let (a, c) = (a.slice()?.to_vec(), c.slice()?.to_vec());
        let inner = run::apart(py, cubes(n, 1), move |_| Pencil::new(&a, &c, n))?
            .map_err(|error| errors::input_at("", error))?;
        let inner = Arc::new(inner);
        Ok(Self { inner, n })
    }

    #[getter]
    fn norm(&self) -> f64 {
        self.inner.norm()
    }

    /// (n, 2)
    fn eigenvalues<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        let flat = self.inner.eigenvalues().concat();
        PyArray1::from_vec(py, flat).reshape([self.n, 2])
    }

    fn sigma(&self, re: f64, im: f64) -> f64 {
        self.inner.sigma([re, im])
    }

    fn distance<'py>(&self, py: Python<'py>) -> PyResult<Distance<'py>> {
        let inner = Arc::clone(&self.inner);
        let found = run::apart(py, cubes(self.n, 1), move |_| inner.distance())?;
        self.packed(py, &found)
    }

    /// The distance, a lower bound proved, and whether that is as near as was asked.
    #[allow(clippy::redundant_closure_for_method_calls, clippy::redundant_closure)] // Of any lifetime.
    fn certify<'py>(
        &self,
        py: Python<'py>,
        slack: f64,
        most: usize,
    ) -> PyResult<(Distance<'py>, f64, bool)> {
        let mut raised = Ok(());
        let found = py
            .detach(|| {
                self.inner.certify_until(slack, most, &mut |_| {
                    raised = Python::attach(|here| Python::check_signals(here));
                    raised.is_err()
                })
            })
            .map_err(|error| errors::input_at("", error))?;
        raised?;
        let distance = self.packed(py, &found.found)?;
        Ok((distance, found.at_least, found.complete))
    }
}

impl LinearPencil {
    fn packed<'py>(
        &self,
        py: Python<'py>,
        found: &gramian::linear::pencil::Distance,
    ) -> PyResult<Distance<'py>> {
        let parts: Vec<f64> = (0..2)
            .flat_map(|k| found.direction.iter().map(move |z| z[k]))
            .collect();
        let direction = PyArray1::from_vec(py, parts).reshape([2, self.n])?;
        let z = (found.z[0], found.z[1]);
        Ok((found.distance, z, direction, found.evaluations))
    }
}

/// What no output shows: see `gramian::linear::unobservable`.
#[pyclass(frozen)]
struct LinearUnobservable {
    inner: Unobservable,
    n: usize,
}

#[pymethods]
impl LinearUnobservable {
    #[new]
    fn new(
        py: Python<'_>,
        a: &Bound<'_, PyAny>,
        c: &Bound<'_, PyAny>,
        rtol: Option<f64>,
    ) -> PyResult<Self> {
        let (a, c, n) = one_system(a, c)?;
        expect_rtol(rtol)?;
        let (a, c) = (a.slice()?.to_vec(), c.slice()?.to_vec());
        let inner = run::apart(py, cubes(n, 1), move |_| Unobservable::new(&a, &c, n, rtol))?
            .map_err(|error| errors::input_at("", error))?;
        Ok(Self { inner, n })
    }

    /// The largest singular value that counted as zero, the smallest that did not, and
    /// what was decided with, over the norm.
    #[getter]
    fn margins(&self) -> (f64, f64, f64) {
        let found = self.inner.found();
        (found.rejected, found.weakest, found.rtol)
    }

    /// Whether another tolerance would have found another dimension.
    #[getter]
    fn undecided(&self) -> bool {
        self.inner.found().undecided
    }

    /// What the states and the unit of time were multiplied by.
    #[getter]
    fn scales(&self) -> (Vec<f64>, f64) {
        (self.inner.state_scales().to_vec(), self.inner.time_scale())
    }

    fn null_space<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        columns(py, self.inner.null_space(), self.n)
    }

    /// Real and imaginary part of the eigenvalue, its error, combinations (n, k).
    fn modes<'py>(&self, py: Python<'py>) -> PyResult<Vec<(f64, f64, f64, Matrix<'py>)>> {
        self.inner
            .modes()
            .iter()
            .map(|mode| {
                let [re, im] = mode.eigenvalue;
                Ok((re, im, mode.error, columns(py, &mode.combinations, self.n)?))
            })
            .collect()
    }

    /// Rows (k, n) without what rounding says of the subspace.
    fn project<'py>(&self, py: Python<'py>, rows: &Bound<'py, PyAny>) -> PyResult<Matrix<'py>> {
        let rows = Input::new(rows, "rows", 2)?;
        rows.expect(&[None, Some(self.n)], "a column for each state")?;
        let mut out = rows.slice()?.to_vec();
        let count = out.len() / self.n;
        run::detached(py, |_| self.inner.project(&mut out))?;
        PyArray1::from_vec(py, out).reshape([count, self.n])
    }

    /// How many combinations stay unobservable with each row of `outputs` added.
    fn left_by(&self, py: Python<'_>, outputs: &Bound<'_, PyAny>) -> PyResult<Vec<usize>> {
        let outputs = Input::new(outputs, "outputs", 2)?;
        outputs.expect(&[None, Some(self.n)], "a column for each state")?;
        let outputs = outputs.slice()?;
        run::detached(py, |_| self.inner.left_by(outputs))?
            .map_err(|error| errors::input_at("", error))
    }
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(observability_matrix, module)?)?;
    module.add_function(wrap_pyfunction!(linear_levels, module)?)?;
    module.add_function(wrap_pyfunction!(linear_gramian, module)?)?;
    module.add_function(wrap_pyfunction!(linear_transition, module)?)?;
    module.add_function(wrap_pyfunction!(right_singular, module)?)?;
    module.add_function(wrap_pyfunction!(piecewise_ranks, module)?)?;
    module.add_function(wrap_pyfunction!(linear_balanced, module)?)?;
    module.add_function(wrap_pyfunction!(linear_infinite, module)?)?;
    module.add_function(wrap_pyfunction!(linear_hankel, module)?)?;
    module.add_function(wrap_pyfunction!(linear_parts, module)?)?;
    module.add_class::<LinearPencil>()?;
    module.add_class::<LinearUnobservable>()?;
    module.add_class::<LinearAnalysis>()
}
