//! The number types of the crate: `f32` and `f64`, with their elementary functions.
//!
//! The functions come from nalgebra's `RealField`: from `std` where that
//! feature is on, from `libm` otherwise. No call site has to choose.

use nalgebra::RealField;

pub use super::angle::wrap_angle;
pub(crate) use super::angle::wrapped;
pub use super::errors::NumberError;
pub(crate) use super::errors::{
    all_finite, check_finite, check_length, check_positive, finite, finite_one,
};

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

/// Whether neither a sum of squares nor its inverse overflows, and a square that vanishes
/// is nothing beside it.
#[inline(always)]
pub(crate) fn is_ordinary<T: Real>(squares: T) -> bool {
    let most = T::MAX * T::EPSILON;
    squares > T::one() / most && squares < most
}

/// sqrt(a^2 + b^2) without overflow or underflow on the way.
#[inline]
pub(crate) fn hypot<T: Real>(a: T, b: T) -> T {
    let squares = a * a + b * b;
    if is_ordinary(squares) {
        return squares.sqrt();
    }
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
