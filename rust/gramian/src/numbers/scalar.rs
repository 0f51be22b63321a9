//! The number types of the crate: `f32` and `f64`, with their elementary functions.
//!
//! The functions come from nalgebra's `RealField`: from `std` where that
//! feature is on, from `libm` otherwise. No call site has to choose.

use nalgebra::RealField;

/// `f32` or `f64`.
pub trait Real: RealField + Copy {
    /// Distance from 1 to the next larger number.
    const EPSILON: Self;
    /// Positive infinity: the value of a bound that does not exist.
    const INFINITY: Self;
    /// The largest finite number.
    const MAX: Self;
    /// The nearest representable number; infinite past the largest.
    fn of(value: f64) -> Self;
    /// The same number in double precision.
    fn double(self) -> f64;
}

impl Real for f32 {
    const EPSILON: Self = f32::EPSILON;
    const INFINITY: Self = f32::INFINITY;
    const MAX: Self = f32::MAX;
    #[allow(clippy::cast_possible_truncation)]
    #[inline]
    fn of(value: f64) -> Self {
        value as f32
    }
    #[inline]
    fn double(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    const EPSILON: Self = f64::EPSILON;
    const INFINITY: Self = f64::INFINITY;
    const MAX: Self = f64::MAX;
    #[inline]
    fn of(value: f64) -> Self {
        value
    }
    #[inline]
    fn double(self) -> f64 {
        self
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

/// The angle in (-pi, pi] that differs from `angle` by whole turns.
///
/// A large angle is taken as it is, though the number next to it may be turns away.
///
/// # Units
/// rad.
///
/// # Errors
/// [`NumberError::NotFinite`].
///
/// ```
/// # use gramian::scalar::wrap_angle;
/// # use core::f64::consts::{PI, TAU};
/// assert!((wrap_angle(6.0)? - (6.0 - TAU)).abs() < 1e-15);
/// assert_eq!(wrap_angle(-PI)?, PI);
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
pub fn wrap_angle<T: Real>(angle: T) -> Result<T, NumberError> {
    check_finite("angle", &[angle])?;
    Ok(wrapped(angle))
}

/// [`wrap_angle`] of a number known to be finite.
#[inline]
pub(crate) fn wrapped<T: Real>(angle: T) -> T {
    let turn = T::two_pi();
    // Past this many turns the product below has no digits left; a remainder has
    // no rounding, but takes its time.
    let wrapped = if angle.abs() < T::of(1e4) {
        angle - turn * (angle / turn).round()
    } else {
        let rest = angle % turn;
        rest - turn * (rest / turn).round()
    };
    if wrapped <= -T::pi() {
        wrapped + turn
    } else if wrapped > T::pi() {
        wrapped - turn
    } else {
        wrapped
    }
}

/// sqrt(a^2 + b^2) without overflow or underflow on the way.
#[inline]
pub(crate) fn hypot<T: Real>(a: T, b: T) -> T {
    let (a, b) = (a.abs(), b.abs());
    let (large, small) = if a >= b { (a, b) } else { (b, a) };
    // What is infinite stays so, instead of becoming inf / inf.
    if small == T::zero() || large == T::INFINITY {
        return large;
    }
    let ratio = small / large;
    large * (T::one() + ratio * ratio).sqrt()
}

/// The power of two next below a positive number (1 for anything else): scaling
/// by it rounds nothing.
#[cfg(feature = "std")]
pub(crate) fn power_of_two(value: f64) -> f64 {
    if value > 0.0 && value.is_normal() {
        f64::from_bits(value.to_bits() & 0x7ff0_0000_0000_0000)
    } else {
        1.0
    }
}
