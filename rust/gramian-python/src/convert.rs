//! Python values to slices and back. Shapes and finiteness are checked here,
//! once; behind this module there are only plain slices.

use gramian::batch::Items;
use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use crate::errors::InputError;

/// An array argument: float64, contiguous and finite. The last `core` axes are
/// one item, the axes before them the batch.
pub struct Input<'py> {
    name: &'static str,
    array: PyReadonlyArrayDyn<'py, f64>,
    core: usize,
    shared: bool,
}

impl<'py> Input<'py> {
    /// Takes anything that numpy can read as numbers. Copies only what is not
    /// float64 and contiguous already.
    pub fn new(value: &Bound<'py, PyAny>, name: &'static str, core: usize) -> PyResult<Self> {
        let input = Self::unchecked(value, name, core)?;
        input.check_finite()?;
        Ok(input)
    }

    /// The same where NaN and infinity have a meaning.
    pub fn unchecked(value: &Bound<'py, PyAny>, name: &'static str, core: usize) -> PyResult<Self> {
        let array = contiguous(value, name)?;
        if array.ndim() < core {
            return Err(InputError::new_err(format!(
                "{name} has shape {}: must have at least {core} {}",
                shape_text(array.shape()),
                if core == 1 { "axis" } else { "axes" },
            )));
        }
        Ok(Self {
            name,
            array,
            core,
            shared: false,
        })
    }

    /// The shape of one item.
    pub fn core_shape(&self) -> &[usize] {
        let shape = self.array.shape();
        &shape[shape.len() - self.core..]
    }

    /// The shape of the batch.
    pub fn batch_shape(&self) -> &[usize] {
        let shape = self.array.shape();
        &shape[..shape.len() - self.core]
    }

    /// All numbers, item after item.
    pub fn slice(&self) -> PyResult<&[f64]> {
        Ok(self.array.as_slice()?)
    }

    /// The items of a batch that [`Batch::of`] has matched.
    pub fn items(&self) -> PyResult<Items<'_>> {
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
            shape_text(self.array.shape()),
            wanted.join(", "),
        )))
    }

    /// Refuses an item without entries.
    pub fn expect_entries(&self) -> PyResult<()> {
        if self.core_shape().contains(&0) {
            return Err(InputError::new_err(format!(
                "{} has shape {}: must not be empty",
                self.name,
                shape_text(self.array.shape()),
            )));
        }
        Ok(())
    }

    /// Refuses numbers that are not above zero; `unit` goes into the message.
    pub fn expect_positive(&self, unit: &str) -> PyResult<()> {
        match self.slice()?.iter().position(|&x| x <= 0.0) {
            None => Ok(()),
            Some(flat) => Err(InputError::new_err(format!(
                "{}{} = {} {unit}: must be > 0",
                self.name,
                index_text(flat, self.array.shape()),
                self.slice()?[flat],
            ))),
        }
    }

    /// Refuses numbers below zero.
    pub fn expect_nonnegative(&self) -> PyResult<()> {
        match self.slice()?.iter().position(|&x| x < 0.0) {
            None => Ok(()),
            Some(flat) => Err(InputError::new_err(format!(
                "{}{} = {}: must be >= 0",
                self.name,
                index_text(flat, self.array.shape()),
                self.slice()?[flat],
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
                    index_text(line * length + i + 1, self.array.shape()),
                    values[i + 1],
                    values[i],
                )));
            }
        }
        Ok(())
    }

    /// Refuses NaN and infinity.
    pub fn check_finite(&self) -> PyResult<()> {
        let data = self.slice()?;
        // The sum of zero products is NaN iff an entry is NaN or infinite; by
        // lanes, so that it runs at the speed of memory.
        let (chunks, rest) = data.as_chunks::<16>();
        let mut lanes = [0.0; 16];
        for chunk in chunks {
            for (lane, x) in lanes.iter_mut().zip(chunk) {
                *lane += x * 0.0;
            }
        }
        let sum: f64 = lanes.iter().sum::<f64>() + rest.iter().map(|x| x * 0.0).sum::<f64>();
        if sum == 0.0 {
            return Ok(());
        }
        let flat = data.iter().position(|x| !x.is_finite()).unwrap_or(0);
        Err(InputError::new_err(format!(
            "{}{} = {}: must be finite",
            self.name,
            index_text(flat, self.array.shape()),
            data[flat],
        )))
    }

    fn broadcast(&mut self, shape: &[usize]) -> PyResult<()> {
        let py = self.array.py();
        let mut full = shape.to_vec();
        full.extend_from_slice(self.core_shape());
        let numpy = py.import("numpy")?;
        let view = numpy.call_method1("broadcast_to", (&*self.array, full))?;
        self.array = contiguous(&view, self.name)?;
        Ok(())
    }
}

/// The common batch of several inputs.
pub struct Batch {
    shape: Vec<usize>,
}

impl Batch {
    /// Broadcasts the leading axes of the inputs against each other as numpy
    /// does. An input that every trial shares is not copied.
    pub fn of(inputs: &mut [&mut Input<'_>]) -> PyResult<Self> {
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
                        .map(|i| format!("{} {}", i.name, shape_text(i.array.shape())))
                        .collect();
                    return Err(InputError::new_err(format!(
                        "leading axes do not match: {}",
                        all.join(", ")
                    )));
                }
            }
        }
        for input in inputs.iter_mut() {
            let length: usize = input.batch_shape().iter().product();
            if input.batch_shape() == shape && length != 1 {
                continue;
            }
            if length == 1 {
                input.shared = true;
            } else {
                input.broadcast(&shape)?;
            }
        }
        Ok(Self { shape })
    }

    /// Number of trials.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// A new array of zeros, `core` for each trial.
    pub fn zeros<'py>(&self, py: Python<'py>, core: &[usize]) -> Bound<'py, PyArrayDyn<f64>> {
        let mut shape = self.shape.clone();
        shape.extend_from_slice(core);
        PyArrayDyn::zeros(py, shape, false)
    }

    /// A new array that a kernel will write the whole of, `core` for each trial: what
    /// is in it before is left as it is, which saves a way over the memory.
    pub fn unset<'py>(
        &self,
        py: Python<'py>,
        core: &[usize],
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let mut shape = self.shape.clone();
        shape.extend_from_slice(core);
        let array = py.import("numpy")?.call_method1("empty", (shape,))?;
        Ok(array.cast_into::<PyArrayDyn<f64>>()?)
    }

    /// "at batch index (2, 5): ", or nothing where there is no batch.
    pub fn place(&self, trial: usize) -> String {
        if self.shape.is_empty() {
            return String::new();
        }
        let index = index_text(trial, &self.shape);
        format!("at batch index {index}: ")
    }
}

/// The data under a mask must not pass for measurements.
fn refuse_masked(value: &Bound<'_, PyAny>, name: &'static str) -> PyResult<()> {
    if value.is_exact_instance_of::<PyArrayDyn<f64>>() {
        return Ok(());
    }
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

fn contiguous<'py>(
    value: &Bound<'py, PyAny>,
    name: &'static str,
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let py = value.py();
    refuse_masked(value, name)?;
    if let Ok(array) = value.cast::<PyArrayDyn<f64>>()
        && array.is_c_contiguous()
    {
        let array = array.readonly();
        // A view into packed records may be at an odd address, and is copied then.
        if array.as_slice().is_ok() {
            return Ok(array);
        }
    }
    let numpy = py.import("numpy")?;
    let unreadable = |reason: String| {
        InputError::new_err(format!(
            "{name} cannot be read as an array of numbers: {reason}"
        ))
    };
    let array = numpy
        .call_method1("asarray", (value,))
        .map_err(|error| unreadable(error.value(py).to_string()))?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if !matches!(kind.as_str(), "f" | "i" | "u" | "b" | "O") {
        return Err(unreadable(format!(
            "its type is {}",
            array.getattr("dtype")?
        )));
    }
    let options: Bound<'py, PyDict> = [
        ("dtype", numpy.getattr("float64")?),
        ("requirements", "CA".into_pyobject(py)?.into_any()),
    ]
    .into_py_dict(py)?;
    let array = numpy
        .call_method("require", (array,), Some(&options))
        .map_err(|error| unreadable(error.value(py).to_string()))?;
    array.extract()
}

/// "(3, 4)", "(3,)" as Python writes a shape.
fn shape_text(shape: &[usize]) -> String {
    let parts: Vec<String> = shape.iter().map(ToString::to_string).collect();
    match parts.as_slice() {
        [one] => format!("({one},)"),
        _ => format!("({})", parts.join(", ")),
    }
}

/// "[0, 3, 1]" for the place of a flat index; nothing for a scalar.
fn index_text(flat: usize, shape: &[usize]) -> String {
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
