//! What can be wrong with numbers, and the checks that find it.

use super::scalar::Real;

/// What can be wrong with numbers, whatever they stand for.
///
/// The errors of all modules hold one of these where a number is at fault. Numbers
/// are checked on the way in, and results on the way out: what would overflow is
/// an error too, unless the documentation says that `inf` is the answer.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NumberError {
    /// An input that is not finite.
    #[error("{name}[{index}] = {given}: must be finite")]
    NotFinite {
        /// The name of the input.
        name: &'static str,
        /// Which entry of it; 0 for a single number.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// An input outside its range.
    #[error("{name} = {given}: must be {allowed}")]
    OutOfRange {
        /// The name of the input.
        name: &'static str,
        /// The value given.
        given: f64,
        /// The values allowed, in words.
        allowed: &'static str,
    },
    /// An array whose length does not fit.
    #[error("{array} has {given} entries: must have {wanted}")]
    Length {
        /// Its name.
        array: &'static str,
        /// Its length.
        given: usize,
        /// A length that fits.
        wanted: usize,
    },
    /// A result that exceeds the numbers of this type, though all inputs are finite.
    #[error("{result}: out of the range of this number type; choose other units (or f64 for f32)")]
    Overflow {
        /// The name of the result.
        result: &'static str,
    },
}

impl NumberError {
    /// The same error at another entry.
    #[must_use]
    pub fn at(mut self, entry: usize) -> Self {
        if let Self::NotFinite { index, .. } = &mut self {
            *index = entry;
        }
        self
    }
}

/// Refuses an array of another length.
#[inline]
pub(crate) fn check_length(
    array: &'static str,
    given: usize,
    wanted: usize,
) -> Result<(), NumberError> {
    if given == wanted {
        return Ok(());
    }
    Err(NumberError::Length {
        array,
        given,
        wanted,
    })
}

/// Refuses the first entry that is not finite.
#[inline]
pub(crate) fn check_finite<T: Real>(name: &'static str, values: &[T]) -> Result<(), NumberError> {
    if all_finite(values) {
        return Ok(());
    }
    let index = values.iter().position(|x| !x.is_finite()).unwrap_or(0);
    Err(NumberError::NotFinite {
        name,
        index,
        given: values[index].double(),
    })
}

/// Refuses a number that is not positive and finite.
#[inline]
pub(crate) fn check_positive<T: Real>(name: &'static str, value: T) -> Result<(), NumberError> {
    if value > T::zero() && value.is_finite() {
        return Ok(());
    }
    Err(NumberError::OutOfRange {
        name,
        given: value.double(),
        allowed: "> 0 and finite",
    })
}

/// Hands on results that are finite.
#[inline]
pub(crate) fn finite<T: Real, const N: usize>(
    result: &'static str,
    values: [T; N],
) -> Result<[T; N], NumberError> {
    if all_finite(&values) {
        Ok(values)
    } else {
        Err(NumberError::Overflow { result })
    }
}

/// [`finite`] of one number.
#[inline]
pub(crate) fn finite_one<T: Real>(result: &'static str, value: T) -> Result<T, NumberError> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(NumberError::Overflow { result })
    }
}

#[inline]
pub(crate) fn all_finite<T: Real>(values: &[T]) -> bool {
    values.iter().all(nalgebra::ComplexField::is_finite)
}
