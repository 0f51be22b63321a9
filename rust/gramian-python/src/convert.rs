//! Python values to slices: the one gate for numbers. Types, masks, shapes and
//! finiteness are checked here, once; behind this module there are only plain slices.
//!
//! Arrays of at most [`SMALL`] numbers are copied, so that another thread that writes
//! to one cannot change it between the check and the kernel. Larger ones are read in
//! place with the interpreter lock released: they must not be written to while the call
//! runs, as with numpy's own functions.

use std::ops::Range;

use gramian::batch::Items;
use gramian::batch::element::Element;
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict, PyFloat, PyInt, PyList, PyTuple};

use crate::errors::InputError;
use crate::output;

/// Arrays up to this many numbers are copied.
const SMALL: usize = 4096;

/// The numbers of arrays: float64, and float32 where a function has vectors of it.
pub trait Number: numpy::Element + Element {}
impl Number for f64 {}
impl Number for f32 {}

/// Whether float32 is what all arrays among the arguments have, and one at least. Numbers, lists
/// and tuples go along with the arrays, as numbers do in numpy.
pub fn is_single(values: &[&Bound<'_, PyAny>]) -> bool {
    let mut single = false;
    for value in values {
        if value.cast_exact::<PyArrayDyn<f32>>().is_ok() {
            single = true;
        } else if !(value.is_none()
            || value.is_exact_instance_of::<PyFloat>()
            || value.is_exact_instance_of::<PyInt>()
            || value.is_exact_instance_of::<PyList>()
            || value.is_exact_instance_of::<PyTuple>())
        {
            return false;
        }
    }
    single
}

/// The same, for functions that look at their arguments in Python first.
#[pyfunction]
#[pyo3(name = "is_single", signature = (*values))]
pub fn are_single(values: &Bound<'_, PyTuple>) -> bool {
    let values: Vec<Bound<'_, PyAny>> = values.iter().collect();
    is_single(&values.iter().collect::<Vec<_>>())
}

enum Numbers<'py, T: Number> {
    Own(Vec<T>),
    Array(PyReadonlyArrayDyn<'py, T>),
}

/// An array argument: of one type, contiguous and finite. The last `core` axes are
/// one item, the axes before them the batch.
pub struct Input<'py, T: Number = f64> {
    name: &'static str,
    numbers: Numbers<'py, T>,
    shape: Vec<usize>,
    core: usize,
    shared: bool,
}

impl<'py> Input<'py> {
    /// Takes anything that numpy can read as real numbers.
    pub fn new(value: &Bound<'py, PyAny>, name: &'static str, core: usize) -> PyResult<Self> {
        let input = Self::unchecked(value, name, core)?;
        input.check_finite()?;
        Ok(input)
    }

    /// The same where NaN and infinity have a meaning.
    pub fn unchecked(value: &Bound<'py, PyAny>, name: &'static str, core: usize) -> PyResult<Self> {
        Self::of(value, name, core)
    }

    /// One number, or a line of them: a standard deviation for all or for each.
    pub fn levels(value: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Self> {
        let input = Self::levels_unchecked(value, name)?;
        input.check_finite()?;
        Ok(input)
    }

    /// The same where NaN and infinity have a meaning.
    pub fn levels_unchecked(value: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Self> {
        Self::levels_of(value, name)
    }
}

impl<'py, T: Number> Input<'py, T> {
    /// [`unchecked`](Input::unchecked) of either type.
    pub fn of(value: &Bound<'py, PyAny>, name: &'static str, core: usize) -> PyResult<Self> {
        let (numbers, shape) = read(value, name)?;
        let name = shown(name);
        if shape.len() < core {
            return Err(InputError::new_err(format!(
                "{name} has shape {}: must have at least {core} {}",
                shape_text(&shape),
                if core == 1 { "axis" } else { "axes" },
            )));
        }
        Ok(Self {
            name,
            numbers,
            shape,
            core,
            shared: false,
        })
    }

    /// What a function goes by where an optional argument is absent: no numbers.
    pub fn absent(name: &'static str) -> Self {
        Self {
            name,
            numbers: Numbers::Own(Vec::new()),
            shape: vec![0],
            core: 1,
            shared: false,
        }
    }

    /// [`levels_unchecked`](Input::levels_unchecked) of either type.
    pub fn levels_of(value: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Self> {
        let mut input = Self::of(value, name, 0)?;
        if input.shape.is_empty() {
            input.shape.push(1);
        }
        input.core = 1;
        Ok(input)
    }

    pub fn name(&self) -> &'static str {
        self.name
    }

    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// The shape of one item.
    pub fn core_shape(&self) -> &[usize] {
        &self.shape[self.shape.len() - self.core..]
    }

    /// The shape of the batch.
    pub fn batch_shape(&self) -> &[usize] {
        &self.shape[..self.shape.len() - self.core]
    }

    /// Copies what is read in place of memory that is written to while it is read.
    pub fn keep_from(&mut self, written: &Range<usize>) -> PyResult<()> {
        if let Numbers::Array(array) = &self.numbers {
            let read = array.as_slice()?.as_ptr_range();
            if (read.start as usize) < written.end && written.start < read.end as usize {
                let mut copy = output::reserved(array.len(), self.name)?;
                copy.extend_from_slice(array.as_slice()?);
                self.numbers = Numbers::Own(copy);
            }
        }
        Ok(())
    }

    /// All numbers, item after item.
    pub fn slice(&self) -> PyResult<&[T]> {
        Ok(match &self.numbers {
            Numbers::Own(numbers) => numbers,
            Numbers::Array(array) => array.as_slice()?,
        })
    }

    /// The items of a batch that [`output::Batch::of`] has matched.
    pub fn items(&self) -> PyResult<Items<'_, T>> {
        let data = self.slice()?;
        Ok(if self.shared {
            Items::shared(data)
        } else {
            Items::each(data, self.core_shape().iter().product())
        })
    }

    /// Checks the shape of one item against `wanted` (`None`: any length).
    pub fn expect(&self, wanted: &[Option<usize>], meaning: &str) -> PyResult<()> {
        let given = self.core_shape();
        let fits = given.len() == wanted.len()
            && given
                .iter()
                .zip(wanted)
                .all(|(g, w)| w.is_none_or(|w| *g == w));
        if fits {
            return Ok(());
        }
        let wanted: Vec<String> = wanted
            .iter()
            .map(|w| w.map_or_else(|| "any".to_owned(), |w| w.to_string()))
            .collect();
        Err(InputError::new_err(format!(
            "{} has shape {}: must be (..., {}): {meaning}",
            self.name,
            shape_text(&self.shape),
            wanted.join(", "),
        )))
    }

    /// One number for all of `count`, or one for each.
    pub fn expect_one_or(&self, count: usize, meaning: &str) -> PyResult<()> {
        if self.core_shape() == [1] {
            return Ok(());
        }
        self.expect(&[Some(count)], meaning)
    }

    /// Refuses an item without entries.
    pub fn expect_entries(&self) -> PyResult<()> {
        if self.core_shape().contains(&0) {
            return Err(InputError::new_err(format!(
                "{} has shape {}: must not be empty",
                self.name,
                shape_text(&self.shape),
            )));
        }
        Ok(())
    }

    /// Refuses leading axes; `meaning` says why there are none.
    pub fn expect_single(&self, meaning: &str) -> PyResult<()> {
        if self.batch_shape().is_empty() {
            return Ok(());
        }
        Err(InputError::new_err(format!(
            "{} has shape {}: must have no leading axes: {meaning}",
            self.name,
            shape_text(&self.shape),
        )))
    }

    /// Refuses numbers that are not above zero; `unit` goes into the message.
    pub fn expect_positive(&self, unit: &str) -> PyResult<()> {
        self.refuse(|x| x <= T::zero(), unit, "must be > 0")
    }

    /// Refuses numbers below zero.
    pub fn expect_nonnegative(&self) -> PyResult<()> {
        self.refuse(|x| x < T::zero(), "", "must be >= 0")
    }

    /// Refuses NaN and infinity.
    pub fn check_finite(&self) -> PyResult<()> {
        if all_finite(self.slice()?) {
            return Ok(());
        }
        self.refuse(|x| !x.is_finite(), "", "must be finite")
    }

    /// Refuses the first number that is `bad`.
    pub fn refuse(&self, bad: impl Fn(T) -> bool, unit: &str, wanted: &str) -> PyResult<()> {
        let data = self.slice()?;
        match data.iter().position(|&x| bad(x)) {
            None => Ok(()),
            Some(flat) => Err(InputError::new_err(format!(
                "{}{} = {}{}{unit}: {wanted}",
                self.name,
                index_text(flat, &self.shape),
                number_text(data[flat].double()),
                if unit.is_empty() { "" } else { " " },
            ))),
        }
    }

    /// Refuses numbers along the last axis that do not increase.
    pub fn expect_increasing(&self, unit: &str) -> PyResult<()> {
        let length = self.core_shape().last().copied().unwrap_or(1).max(1);
        let data = self.slice()?;
        for (line, values) in data.chunks_exact(length).enumerate() {
            if let Some(i) = values.windows(2).position(|pair| pair[1] <= pair[0]) {
                return Err(InputError::new_err(format!(
                    "{}{} = {} {unit}: must be later than the one before, {} {unit}",
                    self.name,
                    index_text(line * length + i + 1, &self.shape),
                    number_text(values[i + 1].double()),
                    number_text(values[i].double()),
                )));
            }
        }
        Ok(())
    }

    /// Fits the leading axes to `shape`; what every trial shares is not copied.
    pub fn broadcast(&mut self, shape: &[usize]) -> PyResult<()> {
        let length: usize = self.batch_shape().iter().product();
        if length == 1 {
            self.shared = true;
            return Ok(());
        }
        if self.batch_shape() == shape {
            return Ok(());
        }
        let size: usize = self.core_shape().iter().product();
        let trials: usize = shape.iter().product();
        let mut wide = output::reserved(trials.saturating_mul(size), self.name)?;
        let own = self.batch_shape();
        let first = shape.len() - own.len();
        let data = self.slice()?;
        for trial in 0..trials {
            let (mut rest, mut step, mut source) = (trial, 1, 0);
            for axis in (0..shape.len()).rev() {
                let index = rest % shape[axis];
                rest /= shape[axis];
                if axis >= first {
                    let length = own[axis - first];
                    source += if length == 1 { 0 } else { index * step };
                    step *= length;
                }
            }
            wide.extend_from_slice(&data[source * size..(source + 1) * size]);
        }
        let mut full = shape.to_vec();
        full.extend_from_slice(self.core_shape());
        (self.numbers, self.shape) = (Numbers::Own(wide), full);
        Ok(())
    }
}

/// A number argument, finite; `name` is the argument's.
pub fn real(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<f64> {
    if let Some(number) = plain_number(value) {
        return Ok(number);
    }
    let input = Input::new(value, name, 0)?;
    input.expect_single("one number")?;
    Ok(input.slice()?[0])
}

/// Numbers that are plain and finite, for calls so short that the way through [`Input`] takes
/// most of their time. What is `None` here goes that way, and is read or refused there.
pub fn plain_numbers<const N: usize>(values: [&Bound<'_, PyAny>; N]) -> Option<[f64; N]> {
    let mut numbers = [0.0; N];
    for (number, value) in numbers.iter_mut().zip(values) {
        *number = plain_number(value)?;
    }
    Some(numbers)
}

/// A plain array, list or tuple of `N` finite numbers, for the same calls.
pub fn plain_vector<const N: usize>(value: &Bound<'_, PyAny>) -> Option<[f64; N]> {
    let mut numbers = [0.0; N];
    if let Ok(array) = value.cast_exact::<PyArray1<f64>>() {
        if array.len() != N {
            return None;
        }
        for (i, number) in numbers.iter_mut().enumerate() {
            *number = array.get_owned(i).filter(|x| x.is_finite())?;
        }
    } else if let Ok(list) = value.cast_exact::<PyList>() {
        if list.len() != N {
            return None;
        }
        for (i, number) in numbers.iter_mut().enumerate() {
            *number = plain_number(&list.get_item(i).ok()?)?;
        }
    } else {
        let tuple = value.cast_exact::<PyTuple>().ok()?;
        if tuple.len() != N {
            return None;
        }
        for (i, number) in numbers.iter_mut().enumerate() {
            *number = plain_number(&tuple.get_item(i).ok()?)?;
        }
    }
    Some(numbers)
}

fn plain_number(value: &Bound<'_, PyAny>) -> Option<f64> {
    let number = if let Ok(number) = value.cast_exact::<PyFloat>() {
        number.value()
    } else if value.is_exact_instance_of::<PyInt>() {
        value.extract().ok()?
    } else {
        return None;
    };
    number.is_finite().then_some(number)
}

/// Whether no number is NaN or infinite, at the speed of memory.
pub fn all_finite<T: Number>(data: &[T]) -> bool {
    // The sum of zero products is NaN iff an entry is NaN or infinite.
    let (chunks, rest) = data.as_chunks::<16>();
    let mut lanes = [T::zero(); 16];
    for chunk in chunks {
        for (lane, x) in lanes.iter_mut().zip(chunk) {
            *lane += *x * T::zero();
        }
    }
    let sum = |all: &[T]| all.iter().fold(T::zero(), |sum, &x| sum + x * T::zero());
    sum(&lanes) + sum(rest) == T::zero()
}

/// The numbers of a value and their shape.
fn read<'py, T: Number>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<(Numbers<'py, T>, Vec<usize>)> {
    if let Some(array) = plain::<T>(value) {
        let shape = array.shape().to_vec();
        // A view into packed records may be at an odd address, and is copied below.
        if array.is_c_contiguous() {
            if array.len() > SMALL {
                if let Ok(array) = array.try_readonly()
                    && array.as_slice().is_ok()
                {
                    return Ok((Numbers::Array(array), shape));
                }
            } else if let Ok(numbers) = array.to_vec() {
                return Ok((Numbers::Own(numbers), shape));
            }
        }
    } else {
        let (mut numbers, mut shape) = (Vec::new(), Vec::new());
        if nested(value, 0, &mut numbers, &mut shape).is_some() {
            return Ok((Numbers::Own(numbers), shape));
        }
    }
    let array = converted::<T>(value, name)?;
    let py = value.py();
    let options: Bound<'py, PyDict> =
        [("requirements", "CA".into_pyobject(py)?.into_any())].into_py_dict(py)?;
    let array = py
        .import("numpy")?
        .call_method("require", (array,), Some(&options))?
        .cast_into::<PyArrayDyn<T>>()?;
    let shape = array.shape().to_vec();
    let array = array
        .try_readonly()
        .map_err(|error| unreadable(shown(name), &error.to_string()))?;
    Ok((Numbers::Array(array), shape))
}

/// An argument's name without its unit: "sigma" of "sigma [rad]".
fn shown(name: &str) -> &str {
    if name.ends_with(']')
        && let Some(at) = name.rfind(" [")
    {
        return &name[..at];
    }
    name
}

/// An array that has the type, of no subclass.
fn plain<'a, 'py, T: Number>(
    value: &'a Bound<'py, PyAny>,
) -> Option<&'a Bound<'py, PyArrayDyn<T>>> {
    value.cast_exact::<PyArrayDyn<T>>().ok()
}

/// A number, or a short nest of lists of them, without numpy, which takes a microsecond.
fn nested<T: Number>(
    value: &Bound<'_, PyAny>,
    depth: usize,
    numbers: &mut Vec<T>,
    shape: &mut Vec<usize>,
) -> Option<()> {
    if let Ok(number) = value.cast::<PyFloat>() {
        numbers.push(T::of(number.value()));
        return (shape.len() == depth).then_some(());
    }
    if value.is_exact_instance_of::<PyInt>() {
        numbers.push(T::of(value.extract().ok()?));
        return (shape.len() == depth).then_some(());
    }
    if depth == 3 {
        return None;
    }
    let length = if let Ok(list) = value.cast_exact::<PyList>() {
        list.len()
    } else {
        value.cast_exact::<PyTuple>().ok()?.len()
    };
    if length == 0 || numbers.len() + length > 256 {
        return None;
    }
    if shape.len() == depth {
        // The first at this depth says how long all are; none may follow a number.
        if !numbers.is_empty() {
            return None;
        }
        shape.push(length);
    } else if shape[depth] != length {
        return None;
    }
    if let Ok(list) = value.cast_exact::<PyList>() {
        for item in list {
            nested(&item, depth + 1, numbers, shape)?;
        }
    } else if let Ok(tuple) = value.cast_exact::<PyTuple>() {
        for item in tuple {
            nested(&item, depth + 1, numbers, shape)?;
        }
    }
    Some(())
}

fn unreadable(name: &str, reason: &str) -> PyErr {
    InputError::new_err(format!(
        "{name} cannot be read as an array of numbers: {reason}"
    ))
}

/// The data under a mask must not pass for measurements.
fn refuse_masked(value: &Bound<'_, PyAny>, name: &str) -> PyResult<()> {
    let Ok(mask) = value.getattr("_mask") else {
        return Ok(());
    };
    let count: usize = value
        .py()
        .import("numpy")?
        .call_method1("count_nonzero", (mask,))?
        .extract()?;
    if count == 0 {
        return Ok(());
    }
    Err(InputError::new_err(format!(
        "{name} has {count} masked entries: drop or fill them first"
    )))
}

/// What numpy makes of a value, refused where it would convert at a loss.
fn converted<'py, T: Number>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let py = value.py();
    // Units are converted to those of the argument, dates to seconds.
    let value = &py
        .import("gramian._units")?
        .call_method1("bare", (value, name))?;
    let name = shown(name);
    refuse_masked(value, name)?;
    let refused = |error: PyErr| {
        // What the value itself raises on Ctrl-C or a full memory is not its fault.
        if error.is_instance_of::<pyo3::exceptions::PyException>(py)
            && !error.is_instance_of::<pyo3::exceptions::PyMemoryError>(py)
        {
            unreadable(name, &error.value(py).to_string())
        } else {
            error
        }
    };
    let numpy = py.import("numpy")?;
    let array = numpy.call_method1("asarray", (value,)).map_err(refused)?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    match kind.as_str() {
        "f" | "i" | "u" | "b" => {}
        "O" => {
            for item in array.getattr("flat")?.try_iter()? {
                let item = item?;
                if item.is_none() {
                    return Err(unreadable(name, "it holds None"));
                }
                if item.is_instance_of::<pyo3::types::PyString>()
                    || item.is_instance_of::<pyo3::types::PyBytes>()
                {
                    return Err(unreadable(name, "it holds text"));
                }
            }
        }
        _ => {
            let kind = array.getattr("dtype")?;
            return Err(unreadable(name, &format!("its type is {kind}")));
        }
    }
    let array = numpy
        .call_method1("asarray", (array, numpy::dtype::<T>(py)))
        .map_err(refused)?;
    Ok(array.cast_into::<PyArrayDyn<T>>()?)
}

/// A value as an array of float64, the argument itself where it is one.
#[pyfunction]
pub fn as_float_array<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    match plain(value) {
        Some(array) => Ok(array.clone()),
        None => converted(value, name),
    }
}

/// The same, refused where a number is not finite.
#[pyfunction]
pub fn as_finite_array<'py>(
    value: &Bound<'py, PyAny>,
    name: &str,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let array = as_float_array(value, name)?;
    let name = shown(name);
    match first_bad(&array, name)? {
        None => Ok(array),
        Some((index, number)) => Err(InputError::new_err(format!(
            "{name}{index} = {}: must be finite",
            number_text(number)
        ))),
    }
}

/// Computed numbers, refused where one is not finite: they overflowed on the way.
#[pyfunction]
pub fn require_finite<'py>(values: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let array = as_float_array(values, name)?;
    match first_bad(&array, name)? {
        None => Ok(values.clone()),
        Some((index, _)) => Err(InputError::new_err(format!(
            "{name}{index} overflows float64: choose other units"
        ))),
    }
}

/// The place and value of the first number that is not finite.
fn first_bad(array: &Bound<'_, PyArrayDyn<f64>>, name: &str) -> PyResult<Option<(String, f64)>> {
    let (numbers, shape) = read::<f64>(array.as_any(), name)?;
    let data = match &numbers {
        Numbers::Own(numbers) => numbers,
        Numbers::Array(array) => array.as_slice()?,
    };
    if all_finite(data) {
        return Ok(None);
    }
    let bad = data.iter().position(|x| !x.is_finite()).unwrap_or(0);
    Ok(Some((index_text(bad, &shape), data[bad])))
}

/// A value as a message shows it: at most a line of it.
pub fn value_text(value: &Bound<'_, PyAny>) -> String {
    let text = value.repr().map_or_else(
        |_| "what has no representation".to_owned(),
        |text| text.to_string_lossy().into_owned(),
    );
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= 80 {
        return line;
    }
    line.chars().take(77).chain("...".chars()).collect()
}

/// A number as Python writes it, without the 300 digits of a large one.
pub fn number_text(x: f64) -> String {
    if x.is_nan() {
        "nan".to_owned()
    } else if x != 0.0 && x.is_finite() && !(1e-5..1e17).contains(&x.abs()) {
        format!("{x:e}")
    } else {
        format!("{x}")
    }
}

/// "(3, 4)", "(3,)" as Python writes a shape.
pub fn shape_text(shape: &[usize]) -> String {
    let parts: Vec<String> = shape.iter().map(ToString::to_string).collect();
    match parts.as_slice() {
        [one] => format!("({one},)"),
        _ => format!("({})", parts.join(", ")),
    }
}

/// "[0, 3, 1]" for the place of a flat index; nothing for a scalar.
pub fn index_text(flat: usize, shape: &[usize]) -> String {
    if shape.is_empty() {
        return String::new();
    }
    let mut rest = flat;
    let mut parts: Vec<String> = shape
        .iter()
        .rev()
        .map(|&length| {
            let index = rest % length.max(1);
            rest /= length.max(1);
            index.to_string()
        })
        .collect();
    parts.reverse();
    format!("[{}]", parts.join(", "))
}
