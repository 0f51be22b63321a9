//! What a recursion needs of a number, so that one text serves `f32`, `f64` and
//! vectors that hold one trial in each lane.

use core::ops::{Add, Mul, Sub};

use crate::scalar::Real;

/// A number, or a vector of independent numbers.
///
/// There is no comparison: lanes may differ in its outcome. What must branch is
/// expressed by `recip_or_zero`.
pub trait Lane: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// `value` in every lane of a vector like this one.
    #[must_use]
    fn splat(self, value: f64) -> Self;
    /// self * factor + term, fused where the machine does it fast.
    #[must_use]
    fn mul_add(self, factor: Self, term: Self) -> Self;
    /// term - self * factor, likewise.
    #[must_use]
    fn negate_mul_add(self, factor: Self, term: Self) -> Self;
    /// The square root of a number that is not below zero.
    #[must_use]
    fn root(self) -> Self;
    /// 1 / self of a number that is not zero.
    #[must_use]
    fn inverse(self) -> Self;
    /// 1 / self of a number that is not below zero; 0 where that would overflow.
    #[cfg(feature = "std")]
    #[must_use]
    fn recip_or_zero(self) -> Self;
}

impl<T: Real> Lane for T {
    #[inline(always)]
    fn splat(self, value: f64) -> Self {
        T::of(value)
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        self * factor + term
    }
    #[inline(always)]
    fn negate_mul_add(self, factor: Self, term: Self) -> Self {
        term - self * factor
    }
    #[inline(always)]
    fn root(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn inverse(self) -> Self {
        T::one() / self
    }
    #[cfg(feature = "std")]
    #[inline(always)]
    fn recip_or_zero(self) -> Self {
        if self <= T::one() / T::MAX {
            T::zero()
        } else {
            T::one() / self
        }
    }
}
