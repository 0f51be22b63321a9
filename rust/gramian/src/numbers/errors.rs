//! What can be wrong with numbers, and the checks that find it.

use core::fmt::{self, Write};

use super::scalar::Real;

/// A number in a message: all its digits, with an exponent where it is very large or
/// small; a precision asks for that many digits after the point, and an exponent.
pub(crate) struct Shown(pub f64);

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = self.0.abs();
        if size.is_nan() {
            return f.write_str("nan");
        }
        if size.is_infinite() {
            // In as many digits as asked for: there is no exponent to take apart.
            return f.write_str(if self.0 > 0.0 { "inf" } else { "-inf" });
        }
        let plain = size == 0.0 || (1e-4..1e16).contains(&size);
        let mut text = Text::default();
        match f.precision() {
            None if plain => return write!(f, "{:?}", self.0),
            None => write!(text, "{:e}", self.0)?,
            Some(digits) => write!(text, "{:.digits$e}", self.0)?,
        }
        let (digits, exponent) = text.get().split_once('e').ok_or(fmt::Error)?;
        let (sign, exponent) = match exponent.strip_prefix('-') {
            Some(rest) => ('-', rest),
            None => ('+', exponent),
        };
        write!(f, "{digits}e{sign}{exponent:0>2}")
    }
}

/// What fits a number: nothing is allocated here.
#[derive(Default)]
struct Text {
    bytes: [u8; 32],
    length: usize,
}

impl Text {
    fn get(&self) -> &str {
        core::str::from_utf8(&self.bytes[..self.length]).unwrap_or_default()
    }
}

impl Write for Text {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let end = self.length + text.len();
        let space = self.bytes.get_mut(self.length..end).ok_or(fmt::Error)?;
        space.copy_from_slice(text.as_bytes());
        self.length = end;
        Ok(())
    }
}

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
    /// A result that overflows, though all inputs are finite.
    #[error("{result} overflows: choose other units")]
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

#[cfg(test)]
mod tests {
    use alloc::format;

    use super::Shown;

    #[test]
    fn numbers_as_they_are_written() {
        for (value, text) in [
            (-90.0, "-90.0"),
            (1e308, "1e+308"),
            (-1.5e-7, "-1.5e-07"),
            (0.0, "0.0"),
            (f64::NAN, "nan"),
            (f64::NEG_INFINITY, "-inf"),
            (-1.234_567_890_123_456_7e-300, "-1.2345678901234568e-300"),
        ] {
            assert_eq!(format!("{}", Shown(value)), text);
        }
        assert_eq!(format!("{:.2}", Shown(1.909_859e21)), "1.91e+21");
        for (value, text) in [
            (f64::INFINITY, "inf"),
            (f64::NEG_INFINITY, "-inf"),
            (f64::NAN, "nan"),
        ] {
            assert_eq!(format!("{:.2}", Shown(value)), text);
        }
    }
}
