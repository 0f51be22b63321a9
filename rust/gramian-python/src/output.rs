//! Results: the batch that several inputs make, its new arrays, the one runner that
//! fills them, and their parts by name.

use std::fmt::Display;
use std::ops::Range;
use std::sync::OnceLock;

use gramian::batch::Threads;
use numpy::ndarray::ArrayView;
use numpy::{
    PyArray1, PyArrayDyn, PyArrayMethods, PyReadwriteArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyEllipsis, PySlice};

use crate::convert::{Input, Number, all_finite, index_text, shape_text};
use crate::errors::InputError;
use crate::run;

/// Arrays up to this many bytes are made without asking how much memory is free.
const UNASKED: usize = 1 << 26;
/// Results of so many numbers are computed beside the array that they end in.
const FEW: usize = 32;

/// The trials of a call.
pub struct Batch {
    shape: Vec<usize>,
    /// The caller's array for the results.
    out: Option<Py<PyAny>>,
    /// For simulated trials the number of the first.
    first: Option<u64>,
    /// What the results are where they must be finite.
    finite: Option<&'static str>,
}

impl Batch {
    /// Broadcasts the leading axes of the inputs against each other as numpy
    /// does. An input that every trial shares is not copied.
    pub fn of<T: Number>(inputs: &mut [&mut Input<'_, T>]) -> PyResult<Self> {
        let rank = inputs
            .iter()
            .map(|i| i.batch_shape().len())
            .max()
            .unwrap_or(0);
        let mut shape = vec![1; rank];
        for input in inputs.iter() {
            let given = input.batch_shape();
            let offset = rank - given.len();
            for (axis, &length) in given.iter().enumerate() {
                let common = &mut shape[offset + axis];
                if *common == 1 {
                    *common = length;
                } else if length != 1 && length != *common {
                    let all: Vec<String> = inputs
                        .iter()
                        .map(|i| format!("{} {}", i.name(), shape_text(i.shape())))
                        .collect();
                    return Err(InputError::new_err(format!(
                        "leading axes do not match: {}",
                        all.join(", ")
                    )));
                }
            }
        }
        for input in inputs.iter_mut() {
            input.broadcast(&shape)?;
        }
        Ok(Self {
            shape,
            out: None,
            first: None,
            finite: None,
        })
    }

    /// The same, with the caller's array `out` for the results, if there is one. It may
    /// share memory with an input, which is copied then.
    pub fn into<T: Number>(
        inputs: &mut [&mut Input<'_, T>],
        out: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let batch = Self::of(inputs)?;
        let Some(out) = out else {
            return Ok(batch);
        };
        if let Ok(array) = out.cast::<PyArrayDyn<T>>()
            && array.is_c_contiguous()
        {
            let written = array.data() as usize;
            let written = written..written + array.len() * size_of::<T>();
            for input in inputs {
                input.keep_from(&written)?;
            }
        }
        Ok(Self {
            out: Some(out.clone().unbind()),
            ..batch
        })
    }

    /// Simulated trials `first..first + trials`.
    pub fn trials(first: u64, trials: usize) -> Self {
        Self {
            shape: vec![trials],
            out: None,
            first: Some(first),
            finite: None,
        }
    }

    /// The same batch, whose results must be finite: where one is not, it overflowed.
    pub fn finite(self, result: &'static str) -> Self {
        Self {
            finite: Some(result),
            ..self
        }
    }

    /// Number of trials.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// "at batch index [2, 5]: ", "in trial 7: ", or nothing where there is no batch.
    pub fn place(&self, trial: usize) -> String {
        match self.first {
            Some(first) => format!("in trial {}: ", first + trial as u64),
            None if self.shape.is_empty() => String::new(),
            None => format!("at batch index {}: ", index_text(trial, &self.shape)),
        }
    }

    /// An array, `core` for each trial, that `kernel` writes the whole of, one range
    /// of trials after the other: on the chosen threads, the interpreter lock released,
    /// in pieces between which Ctrl-C is noticed. `cost` is of one trial, nanoseconds.
    pub fn fill<'py, T: Number, O: Outcome + Send>(
        &self,
        py: Python<'py>,
        core: &[usize],
        cost: f64,
        kernel: impl FnMut(Range<usize>, Threads, &mut [T]) -> O + Send,
    ) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
        let size: usize = core.iter().product();
        let total = self.len().saturating_mul(size);
        if total <= FEW && self.out.is_none() {
            // An array made of numbers costs half of one that is written to.
            let mut few = [T::zero(); FEW];
            self.pieces(py, size, cost, &mut few[..total], kernel)?;
            return array_of(py, &self.shape_of(core), &few[..total]);
        }
        let out = self.array(py, core)?;
        {
            let mut write = writable(&out)?;
            self.pieces(py, size, cost, write.as_slice_mut()?, kernel)?;
        }
        Ok(out)
    }

    /// As `fill`, of one number for each trial: a number itself where there is one trial
    /// without axes, as numpy's functions give it.
    pub fn fill_numbers<'py, O: Outcome + Send>(
        &self,
        py: Python<'py>,
        cost: f64,
        kernel: impl FnMut(Range<usize>, Threads, &mut [f64]) -> O + Send,
    ) -> PyResult<Bound<'py, PyAny>> {
        if self.out.is_some() || !self.shape.is_empty() {
            return Ok(self.fill(py, &[], cost, kernel)?.into_any());
        }
        let mut one = [0.0];
        self.pieces(py, 1, cost, &mut one, kernel)?;
        number(py, one[0])
    }

    /// As `fill`, for trials that take long each and do not look for Ctrl-C: each kernel
    /// owns its inputs, and runs on a thread of its own.
    pub fn fill_apart<'py, O, K>(
        &self,
        py: Python<'py>,
        core: &[usize],
        cost: f64,
        mut kernel: impl FnMut(usize) -> K,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>>
    where
        O: Outcome + Send + 'static,
        K: FnOnce(Threads, &mut [f64]) -> O + Send + 'static,
    {
        let size: usize = core.iter().product();
        let out = self.array(py, core)?;
        {
            let mut write = writable(&out)?;
            let all = write.as_slice_mut()?;
            for trial in 0..self.len() {
                let kernel = kernel(trial);
                let (outcome, found) = run::apart(py, cost, move |threads| {
                    let mut found = vec![0.0; size];
                    (kernel(threads, &mut found), found)
                })?;
                outcome.result(|_| self.place(trial))?;
                self.expect_finite(&found, trial, size)?;
                all[trial * size..(trial + 1) * size].copy_from_slice(&found);
            }
        }
        Ok(out)
    }

    fn pieces<T: Number, O: Outcome + Send>(
        &self,
        py: Python<'_>,
        size: usize,
        cost: f64,
        out: &mut [T],
        mut kernel: impl FnMut(Range<usize>, Threads, &mut [T]) -> O + Send,
    ) -> PyResult<()> {
        run::in_pieces(py, self.len(), cost, |range, threads| {
            let first = range.start;
            let part = &mut out[first * size..range.end * size];
            kernel(range, threads, &mut *part).result(|trial| self.place(first + trial))?;
            self.expect_finite(part, first, size)
        })
    }

    /// Refuses results of `size` numbers each, from that of trial `first` on, that had to
    /// be finite and are not.
    fn expect_finite<T: Number>(&self, part: &[T], first: usize, size: usize) -> PyResult<()> {
        match self.finite {
            Some(result) if !all_finite(part) => {
                let bad = part.iter().position(|x| !x.is_finite()).unwrap_or(0);
                let place = self.place(first + bad / size.max(1));
                Err(InputError::new_err(format!(
                    "{place}{result} overflows {}: choose other units",
                    type_name::<T>()
                )))
            }
            _ => Ok(()),
        }
    }

    fn shape_of(&self, core: &[usize]) -> Vec<usize> {
        let mut shape = Vec::with_capacity(self.shape.len() + core.len());
        shape.extend_from_slice(&self.shape);
        shape.extend_from_slice(core);
        shape
    }

    /// The array of the results, `core` for each trial: the caller's, or a new one.
    pub fn array<'py, T: Number>(
        &self,
        py: Python<'py>,
        core: &[usize],
    ) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
        let shape = self.shape_of(core);
        match &self.out {
            Some(out) => callers(out.bind(py), &shape),
            None => array(py, &shape),
        }
    }

    /// The parts of records (..., size), in the order in which a kernel writes them, as
    /// arrays by name: views of the records, (..., shape) each.
    pub fn named<'py>(
        &self,
        records: &Bound<'py, PyArrayDyn<f64>>,
        parts: &[(&str, &[usize])],
    ) -> PyResult<Bound<'py, PyDict>> {
        let py = records.py();
        let (named, slice_type) = (PyDict::new(py), py.get_type::<PySlice>());
        let mut first = 0;
        for (name, core) in parts {
            let size: usize = core.iter().product();
            let slice = slice_type.call1((first, first + size))?;
            let part = records.get_item((PyEllipsis::get(py), slice))?;
            named.set_item(name, part.call_method1("reshape", (self.shape_of(core),))?)?;
            first += size;
        }
        Ok(named)
    }
}

/// What a kernel returns: nothing, or which trial of its range failed and why.
pub trait Outcome {
    fn result(self, place: impl Fn(usize) -> String) -> PyResult<()>;
}

impl Outcome for () {
    fn result(self, _: impl Fn(usize) -> String) -> PyResult<()> {
        Ok(())
    }
}

impl<E: Display> Outcome for Result<(), (usize, E)> {
    fn result(self, place: impl Fn(usize) -> String) -> PyResult<()> {
        self.map_err(|(trial, error)| InputError::new_err(format!("{}{error}", place(trial))))
    }
}

impl Outcome for PyResult<()> {
    fn result(self, _: impl Fn(usize) -> String) -> PyResult<()> {
        self
    }
}

/// A number as numpy's functions give it.
pub fn number(py: Python<'_>, value: f64) -> PyResult<Bound<'_, PyAny>> {
    static FLOAT64: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    FLOAT64.import(py, "numpy", "float64")?.call1((value,))
}

/// A new array of a few numbers.
fn array_of<'py, T: Number>(
    py: Python<'py>,
    shape: &[usize],
    numbers: &[T],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    if shape.len() == 1 {
        return Ok(line(py, numbers));
    }
    let view = ArrayView::from_shape(shape, numbers)
        .map_err(|error| InputError::new_err(error.to_string()))?;
    Ok(PyArrayDyn::from_array(py, &view))
}

/// A new array of one axis.
pub fn line<'py, T: Number>(py: Python<'py>, numbers: &[T]) -> Bound<'py, PyArrayDyn<T>> {
    PyArray1::from_slice(py, numbers).to_dyn().clone()
}

/// The type as numpy calls it.
pub fn type_name<T: Number>() -> &'static str {
    if size_of::<T>() == size_of::<f32>() {
        "float32"
    } else {
        "float64"
    }
}

/// The caller's array for results of this shape, refused where it cannot take them.
fn callers<'py, T: Number>(
    out: &Bound<'py, PyAny>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let wanted = format!(
        "must be a numpy.ndarray of {}, shape {}, C-contiguous and writable",
        type_name::<T>(),
        shape_text(shape)
    );
    let Ok(given) = out.cast_exact::<PyUntypedArray>() else {
        let kind = out.get_type().fully_qualified_name()?;
        return Err(InputError::new_err(format!("out is a {kind}: {wanted}")));
    };
    if let Ok(array) = given.cast::<PyArrayDyn<T>>()
        && array.shape() == shape
        && array.is_c_contiguous()
        && (array.data() as usize).is_multiple_of(align_of::<T>())
        && is_writable(given)?
    {
        return Ok(array.clone());
    }
    let layout = if given.is_c_contiguous() {
        "C-contiguous"
    } else {
        "not C-contiguous"
    };
    let kept = if is_writable(given)? {
        ""
    } else {
        ", read-only"
    };
    let dtype = given.dtype();
    let odd = if given.getattr("flags")?.getattr("aligned")?.is_truthy()? {
        ""
    } else {
        ", at an address that is not aligned"
    };
    Err(InputError::new_err(format!(
        "out is of {dtype}, shape {}, {layout}{kept}{odd}: {wanted}",
        shape_text(given.shape())
    )))
}

fn is_writable(array: &Bound<'_, PyUntypedArray>) -> PyResult<bool> {
    array.getattr("flags")?.getattr("writeable")?.is_truthy()
}

/// The numbers of an array of results, to write to.
pub fn writable<'py, T: Number>(
    out: &Bound<'py, PyArrayDyn<T>>,
) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    out.try_readwrite()
        .map_err(|_| InputError::new_err("out is in use by another call: give each its own"))
}

/// A new array, not written to yet where it is large.
pub fn array<'py, T: Number>(
    py: Python<'py>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let bytes = shape.iter().try_fold(size_of::<T>(), |product, &length| {
        product.checked_mul(length)
    });
    match bytes {
        Some(bytes) if bytes <= 1 << 16 => Ok(PyArrayDyn::zeros(py, shape, false)),
        bytes => {
            ask(bytes, &format!("the result, {}", shape_text(shape)))?;
            let array = py
                .import("numpy")?
                .call_method1("empty", (shape, numpy::dtype::<T>(py)))?;
            Ok(array.cast_into::<PyArrayDyn<T>>()?)
        }
    }
}

/// An empty vector with room for `count` numbers.
pub fn reserved<T>(count: usize, what: &str) -> PyResult<Vec<T>> {
    ask(count.checked_mul(size_of::<T>()), what)?;
    let mut numbers = Vec::new();
    numbers
        .try_reserve_exact(count)
        .map_err(|_| short_of_memory(count.checked_mul(size_of::<T>()), what, None))?;
    Ok(numbers)
}

/// Refuses what would take more memory than there is, before anything is allocated:
/// an allocation that a system grants and cannot back would end the process.
/// `bytes` is `None` where the count itself overflows.
pub fn ask(bytes: Option<usize>, what: &str) -> PyResult<()> {
    if bytes.is_some_and(|bytes| bytes <= UNASKED) {
        return Ok(());
    }
    let free = free_memory();
    match (bytes, free) {
        (Some(bytes), Some(free)) if (bytes as u64) < free => Ok(()),
        (Some(bytes), None) if bytes < 1 << 46 => Ok(()),
        _ => Err(short_of_memory(bytes, what, free)),
    }
}

fn short_of_memory(bytes: Option<usize>, what: &str, free: Option<u64>) -> PyErr {
    let wanted = bytes.map_or_else(
        || "more bytes than can be counted".to_owned(),
        |bytes| bytes_text(bytes as u64),
    );
    let free = free.map_or_else(String::new, |free| {
        format!(", {} are free", bytes_text(free))
    });
    PyMemoryError::new_err(format!("{what}, would take {wanted}{free}"))
}

fn bytes_text(bytes: u64) -> String {
    let mut size = bytes as f64;
    for unit in ["bytes", "KiB", "MiB", "GiB", "TiB", "PiB"] {
        if size < 1024.0 {
            return format!("{size:.1} {unit}");
        }
        size /= 1024.0;
    }
    format!("{size:.1} EiB")
}

/// Free memory in bytes, where the system says: that of the machine and that of the
/// group of processes (a container), whichever is less.
fn free_memory() -> Option<u64> {
    let machine = std::fs::read_to_string("/proc/meminfo")
        .ok()
        .and_then(|text| {
            let line = text
                .lines()
                .find(|line| line.starts_with("MemAvailable:"))?;
            let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
            Some(kilobytes * 1024)
        });
    let limit = *GROUP_LIMIT.get_or_init(|| {
        std::fs::read_to_string("/sys/fs/cgroup/memory.max")
            .or_else(|_| std::fs::read_to_string("/sys/fs/cgroup/memory/memory.limit_in_bytes"))
            .ok()
            .and_then(|text| text.trim().parse().ok())
    });
    match (machine, limit) {
        (Some(machine), Some(limit)) => Some(machine.min(limit)),
        (machine, limit) => machine.or(limit),
    }
}

static GROUP_LIMIT: OnceLock<Option<u64>> = OnceLock::new();

/// Bounds (n,), refused where float64 cannot represent one: see [`expect_representable`].
#[pyfunction]
pub fn representable<'py>(std: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let input = Input::unchecked(std, "bounds", 1)?;
    expect_representable(input.slice()?, &[], 0)?;
    Ok(std.clone())
}

/// Refuses a bound that float64 cannot represent, or rows whose squares it cannot:
/// one that only units far from the sizes of the states give, or none because all
/// entries for a state are too small. `std` is (..., n), `rows` (..., n) of any count.
pub fn expect_representable(std: &[f64], rows: &[f64], n: usize) -> PyResult<()> {
    let (mut least, mut most, mut all) = (f64::INFINITY, 0.0_f64, true);
    for &x in std {
        if x.is_finite() {
            least = least.min(x);
            most = most.max(x);
        } else {
            all = false;
        }
    }
    if least <= most && !(least > 1e-150 && most < 1e150) {
        return Err(InputError::new_err(format!(
            "rows are too small or too large for their squares in float64 (a bound would be \
             {least:.2e} to {most:.2e}): choose other units"
        )));
    }
    if all || n == 0 {
        return Ok(());
    }
    for j in 0..n {
        let largest = rows
            .iter()
            .skip(j)
            .step_by(n)
            .fold(0.0_f64, |largest, x| largest.max(x.abs()));
        if largest > 0.0 && largest < 1e-150 {
            return Err(InputError::new_err(format!(
                "rows are too small for their squares in float64 (the largest entry of column \
                 {j} is {largest:.2e}): choose other units"
            )));
        }
    }
    Ok(())
}
