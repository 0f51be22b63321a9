//! Sparse problems. The arrays of a compressed matrix are read where they are.

use gramian::large::sparse::analysis::marginal_rows;
use gramian::large::sparse::{Index, Rows, Sparse, SparseError, graph};
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::{PyKeyboardInterrupt, PyMemoryError};
use pyo3::prelude::*;

use crate::errors::InputError;

/// The three arrays of a matrix in compressed rows.
struct Arrays<'py, I: Element> {
    start: PyReadonlyArray1<'py, I>,
    column: PyReadonlyArray1<'py, I>,
    value: PyReadonlyArray1<'py, f64>,
}

impl<'py, I: Element + Index> Arrays<'py, I> {
    fn new(
        start: &Bound<'py, PyAny>,
        column: &Bound<'py, PyAny>,
        value: &Bound<'py, PyAny>,
    ) -> PyResult<Self> {
        Ok(Self {
            start: start.extract()?,
            column: column.extract()?,
            value: value.extract()?,
        })
    }

    fn rows(&self, columns: usize) -> PyResult<Rows<'_, I>> {
        Rows::new(
            columns,
            self.start.as_slice()?,
            self.column.as_slice()?,
            self.value.as_slice()?,
        )
        .map_err(refused)
    }
}

/// By value, as `map_err` gives it.
#[allow(clippy::needless_pass_by_value)]
fn refused(error: SparseError) -> PyErr {
    match error {
        SparseError::Memory { .. } | SparseError::Size { .. } => {
            PyMemoryError::new_err(error.to_string())
        }
        SparseError::Interrupted => PyKeyboardInterrupt::new_err(()),
        _ => InputError::new_err(error.to_string()),
    }
}

/// As [`crate::run::interruptible`], with the errors of sparse problems.
fn interruptible<R: Send>(
    py: Python<'_>,
    work: impl FnOnce(&mut dyn FnMut() -> bool) -> Result<R, SparseError> + Send,
) -> PyResult<R> {
    crate::run::interruptible(py, work)?.map_err(refused)
}

/// Sparse rows, reduced: see `gramian::large::sparse::Sparse`.
#[pyclass(frozen, name = "SparseAnalysis", module = "gramian._core")]
struct SparseAnalysis(Sparse);

/// Numbers of columns, rows, edges or vertices.
type Places<'py> = Bound<'py, PyArray1<usize>>;

/// Start of each column, row of each entry, value of each entry.
type Columns<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
);

#[pymethods]
impl SparseAnalysis {
    #[new]
    #[pyo3(signature = (start, column, value, columns, rtol, available, unit=None))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        start: &Bound<'_, PyAny>,
        column: &Bound<'_, PyAny>,
        value: &Bound<'_, PyAny>,
        columns: usize,
        rtol: Option<f64>,
        available: usize,
        unit: Option<f64>,
    ) -> PyResult<Self> {
        fn run<I: Element + Index>(
            py: Python<'_>,
            arrays: &Arrays<'_, I>,
            columns: usize,
            rtol: Option<f64>,
            available: usize,
            unit: Option<f64>,
        ) -> PyResult<Sparse> {
            let rows = arrays.rows(columns)?;
            interruptible(py, |stop| match unit {
                Some(unit) => Sparse::with_unit(&rows, unit, rtol, available, stop),
                None => Sparse::new(&rows, rtol, available, stop),
            })
        }
        Ok(Self(
            if let Ok(arrays) = Arrays::<i32>::new(start, column, value) {
                run(py, &arrays, columns, rtol, available, unit)?
            } else {
                let arrays = Arrays::<i64>::new(start, column, value)?;
                run(py, &arrays, columns, rtol, available, unit)?
            },
        ))
    }

    #[getter]
    fn nullity(&self) -> usize {
        self.0.nullity()
    }

    #[getter]
    fn norm(&self) -> f64 {
        self.0.norm()
    }

    #[getter]
    fn rtol(&self) -> f64 {
        self.0.rtol()
    }

    #[getter]
    fn log_det(&self) -> f64 {
        self.0.log_det()
    }

    #[getter]
    fn smallest_counting(&self) -> f64 {
        self.0.smallest_counting()
    }

    #[getter]
    fn largest_dropped(&self) -> f64 {
        self.0.largest_dropped()
    }

    #[getter]
    fn converged(&self) -> bool {
        self.0.components().iter().all(|c| c.converged)
    }

    #[getter]
    fn factor_entries(&self) -> usize {
        self.0.factor_entries()
    }

    #[getter]
    fn peak_bytes(&self) -> usize {
        self.0.peak_bytes()
    }

    #[getter]
    fn structural_rank(&self) -> usize {
        self.0.structure().rank
    }

    #[getter]
    fn empty_rows(&self) -> usize {
        self.0.structure().empty_rows
    }

    fn component<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<usize>> {
        PyArray1::from_slice(py, &self.0.structure().component)
    }

    fn untouched<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<usize>> {
        PyArray1::from_slice(py, &self.0.structure().untouched)
    }

    /// Columns and rows of each underdetermined piece.
    fn shortages<'py>(&self, py: Python<'py>) -> Vec<(Places<'py>, Places<'py>)> {
        self.0
            .structure()
            .shortages
            .iter()
            .map(|s| {
                (
                    PyArray1::from_slice(py, &s.columns),
                    PyArray1::from_slice(py, &s.rows),
                )
            })
            .collect()
    }

    /// The null vectors in scaled units, orthonormal, by compressed columns: each has
    /// entries in one component only.
    fn null_vectors<'py>(&self, py: Python<'py>) -> Columns<'py> {
        let wanted: Vec<(usize, usize)> = self
            .0
            .components()
            .iter()
            .enumerate()
            .flat_map(|(c, component)| (0..component.nullity).map(move |k| (c, k)))
            .collect();
        self.vectors(py, &wanted)
    }

    /// The weakest directions above the gap: singular values, and vectors as before.
    fn weakest<'py>(
        &self,
        py: Python<'py>,
        count: usize,
    ) -> (Bound<'py, PyArray1<f64>>, Columns<'py>) {
        let list = self.0.weakest(count);
        let values: Vec<f64> = list.iter().map(|(value, ..)| *value).collect();
        let wanted: Vec<(usize, usize)> = list.iter().map(|&(_, c, k)| (c, k)).collect();
        (PyArray1::from_vec(py, values), self.vectors(py, &wanted))
    }

    fn scale<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.scale())
    }

    fn crlb_std<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let std = interruptible(py, |stop| self.0.crlb_std(stop))?;
        Ok(PyArray1::from_vec(py, std))
    }

    /// Variances of combinations, the lines of a matrix in compressed rows.
    fn variances<'py>(
        &self,
        py: Python<'py>,
        start: &Bound<'py, PyAny>,
        column: &Bound<'py, PyAny>,
        value: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let arrays = Arrays::<i64>::new(start, column, value)?;
        let rows = arrays.rows(self.0.states())?;
        let out = interruptible(py, |stop| {
            let mut work = vec![0.0; self.0.states()];
            (0..rows.len())
                .map(|i| {
                    if stop() {
                        return Err(SparseError::Interrupted);
                    }
                    let line: Vec<(usize, f64)> = rows.row(i).collect();
                    self.0.variance_with(&line, &mut work)
                })
                .collect::<Result<Vec<f64>, _>>()
        })?;
        Ok(PyArray1::from_vec(py, out))
    }

    /// Covariance of combinations, the lines of a matrix in compressed rows.
    fn covariance<'py>(
        &self,
        py: Python<'py>,
        start: &Bound<'py, PyAny>,
        column: &Bound<'py, PyAny>,
        value: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let arrays = Arrays::<i64>::new(start, column, value)?;
        let rows = arrays.rows(self.0.states())?;
        let lines: Vec<Vec<(usize, f64)>> =
            (0..rows.len()).map(|i| rows.row(i).collect()).collect();
        let out = py.detach(|| self.0.covariance(&lines)).map_err(refused)?;
        PyArray1::from_vec(py, out).reshape([lines.len(), lines.len()])
    }

    /// What rows see of each other, and the same weighted by `weights` of the states in
    /// `states` where those are given: square matrices.
    #[allow(clippy::too_many_arguments, clippy::type_complexity)]
    #[pyo3(signature = (start, column, value, states, weights, available))]
    fn gram<'py>(
        &self,
        py: Python<'py>,
        start: &Bound<'py, PyAny>,
        column: &Bound<'py, PyAny>,
        value: &Bound<'py, PyAny>,
        states: Option<Vec<usize>>,
        weights: Option<Vec<f64>>,
        available: usize,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Option<Bound<'py, PyArray2<f64>>>)> {
        let arrays = Arrays::<i64>::new(start, column, value)?;
        let rows = arrays.rows(self.0.states())?;
        let lines: Vec<Vec<(usize, f64)>> =
            (0..rows.len()).map(|i| rows.row(i).collect()).collect();
        let weighted: Option<Vec<(usize, f64)>> = states
            .zip(weights)
            .map(|(s, w)| s.into_iter().zip(w).collect());
        let (c, g) = interruptible(py, |stop| {
            self.0.gram(&lines, weighted.as_deref(), available, stop)
        })?;
        let square = |m| PyArray1::from_vec(py, m).reshape([lines.len(), lines.len()]);
        Ok((square(c)?, g.map(square).transpose()?))
    }

    /// How much rank rows would add together.
    fn rank_gain(
        &self,
        py: Python<'_>,
        start: &Bound<'_, PyAny>,
        column: &Bound<'_, PyAny>,
        value: &Bound<'_, PyAny>,
    ) -> PyResult<usize> {
        let arrays = Arrays::<i64>::new(start, column, value)?;
        let rows = arrays.rows(self.0.states())?;
        let lines: Vec<Vec<(usize, f64)>> =
            (0..rows.len()).map(|i| rows.row(i).collect()).collect();
        py.detach(|| self.0.rank_gain(&lines)).map_err(refused)
    }
}

impl SparseAnalysis {
    fn vectors<'py>(&self, py: Python<'py>, wanted: &[(usize, usize)]) -> Columns<'py> {
        let (mut start, mut index, mut value) = (vec![0], Vec::new(), Vec::new());
        let order = self.0.order();
        for &(c, k) in wanted {
            let component = &self.0.components()[c];
            let mut column: Vec<(usize, f64)> = component
                .vector(k)
                .enumerate()
                .map(|(p, x)| (order[component.begin + p], x))
                .collect();
            column.sort_unstable_by_key(|(j, _)| *j);
            index.extend(
                column
                    .iter()
                    .map(|(j, _)| i64::try_from(*j).unwrap_or(i64::MAX)),
            );
            value.extend(column.iter().map(|(_, x)| *x));
            start.push(i64::try_from(index.len()).unwrap_or(i64::MAX));
        }
        (
            PyArray1::from_vec(py, start),
            PyArray1::from_vec(py, index),
            PyArray1::from_vec(py, value),
        )
    }
}

/// The rows that are left where some columns are not known at all: starts, columns, values.
#[pyfunction]
fn sparse_marginal_rows<'py>(
    py: Python<'py>,
    start: &Bound<'py, PyAny>,
    column: &Bound<'py, PyAny>,
    value: &Bound<'py, PyAny>,
    eliminated: &Bound<'py, PyArray1<bool>>,
    available: usize,
) -> PyResult<Columns<'py>> {
    let arrays = Arrays::<i64>::new(start, column, value)?;
    let eliminated = eliminated.readonly();
    let eliminated = eliminated.as_slice()?;
    let rows = arrays.rows(eliminated.len())?;
    let left = interruptible(py, |stop| marginal_rows(&rows, eliminated, available, stop))?;
    Ok((
        PyArray1::from_vec(py, left.start),
        PyArray1::from_vec(py, left.column),
        PyArray1::from_vec(py, left.value),
    ))
}

/// Bridges (numbers of edges), vertices on the smaller side of each, cut vertices.
#[pyfunction]
fn weak_places<'py>(
    py: Python<'py>,
    vertices: usize,
    first: &Bound<'py, PyArray1<i64>>,
    second: &Bound<'py, PyArray1<i64>>,
) -> PyResult<(Places<'py>, Places<'py>, Places<'py>)> {
    let (first, second) = (first.readonly(), second.readonly());
    if first.as_slice()?.len() != second.as_slice()?.len() {
        return Err(InputError::new_err("an edge has two ends"));
    }
    let edges = first
        .as_slice()?
        .iter()
        .zip(second.as_slice()?)
        .map(|(&a, &b)| Some((usize::try_from(a).ok()?, usize::try_from(b).ok()?)))
        .collect::<Option<Vec<_>>>()
        .filter(|edges| edges.iter().all(|&(a, b)| a < vertices && b < vertices))
        .ok_or_else(|| InputError::new_err("an edge joins a vertex that does not exist"))?;
    let weak = py.detach(|| graph::weak_places(vertices, &edges));
    Ok((
        PyArray1::from_vec(py, weak.bridges),
        PyArray1::from_vec(py, weak.hanging),
        PyArray1::from_vec(py, weak.cut_vertices),
    ))
}

pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(weak_places, module)?)?;
    module.add_function(wrap_pyfunction!(sparse_marginal_rows, module)?)?;
    module.add_class::<SparseAnalysis>()
}
