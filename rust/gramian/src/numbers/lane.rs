//! What a formula asks of a number, so that one text serves `f32`, `f64` and vectors
//! that hold one trial, or one sample, in each lane.

use core::ops::{Add, Div, Mul, Neg, Sub};

use super::scalar::{Real, hypot, is_ordinary};

/// A number, or a vector of independent numbers.
///
/// Lanes may differ in the outcome of a comparison: a formula computes both outcomes and
/// selects ([`select_greater`](Lane::select_greater)), and branches only to avoid what
/// no lane needs ([`any_greater`](Lane::any_greater)).
///
/// Vectors have elementary functions of their own, within 2.5 units in the last place,
/// and may fuse a product with a sum: their last bits differ from those of numbers.
pub trait Lane:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// `value` in every lane of a vector like this one.
    #[must_use]
    fn splat(self, value: f64) -> Self;
    /// self * factor + term, fused where the machine does it fast.
    #[must_use]
    fn mul_add(self, factor: Self, term: Self) -> Self;
    /// term - self * factor, likewise.
    #[must_use]
    fn negate_mul_add(self, factor: Self, term: Self) -> Self;
    /// self * factor.
    #[must_use]
    fn times(self, factor: f64) -> Self;
    /// Size without sign.
    #[must_use]
    fn abs(self) -> Self;
    /// The smaller of two numbers that are not NaN.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// The larger of two numbers that are not NaN.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// The square root of a number that is not below zero.
    #[must_use]
    fn sqrt(self) -> Self;
    /// sqrt(self^2 + other^2). A number neither overflows nor underflows on the way; of
    /// a vector the squares must not.
    #[must_use]
    fn hypot(self, other: Self) -> Self;
    /// The point over its squared distance from the origin and over `scale`; range of the
    /// squares as in [`hypot`](Lane::hypot).
    #[must_use]
    fn inverted(point: [Self; 2], scale: Self) -> [Self; 2];
    /// 1 / self of a number that is not zero.
    #[must_use]
    fn recip(self) -> Self;
    /// 1 / self of a number that is not below zero; 0 where that would overflow.
    #[must_use]
    fn recip_or_zero(self) -> Self;
    /// Sine and cosine.
    #[must_use]
    fn sin_cos(self) -> (Self, Self);
    /// The angle of the point (`x`, self) against the x axis, in (-pi, pi]: zero has no
    /// sign here, and the angle of (0, 0) is 0.
    #[must_use]
    fn atan2(self, x: Self) -> Self;
    /// The natural logarithm of a number above zero.
    #[must_use]
    fn ln(self) -> Self;
    /// The nearest whole number; which of two is not said. Below 2^51 in size.
    #[must_use]
    fn round(self) -> Self;
    /// What is left of self beside whole multiples of `divisor`, with the sign of self:
    /// exact, and slow in vectors.
    #[must_use]
    fn remainder(self, divisor: Self) -> Self;
    /// `yes` where self > other, `no` elsewhere.
    #[must_use]
    fn select_greater(self, other: Self, yes: Self, no: Self) -> Self;
    /// Whether self > other in any lane.
    #[must_use]
    fn any_greater(self, other: Self) -> bool;
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
    fn times(self, factor: f64) -> Self {
        self * T::of(factor)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        nalgebra::ComplexField::abs(self)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if other < self { other } else { self }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if other > self { other } else { self }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        nalgebra::ComplexField::sqrt(self)
    }
    #[inline(always)]
    fn hypot(self, other: Self) -> Self {
        hypot(self, other)
    }
    #[inline(always)]
    fn inverted([x, y]: [Self; 2], scale: Self) -> [Self; 2] {
        let squares = x * x + y * y;
        let product = squares * scale;
        if is_ordinary(squares) && is_ordinary(product) {
            let inverse = T::one() / product;
            return [x * inverse, y * inverse];
        }
        let range = hypot(x, y);
        let weight = T::one() / (range * scale);
        [x / range * weight, y / range * weight]
    }
    #[inline(always)]
    fn recip(self) -> Self {
        T::one() / self
    }
    #[inline(always)]
    fn recip_or_zero(self) -> Self {
        if self <= T::one() / T::MAX {
            T::zero()
        } else {
            T::one() / self
        }
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        nalgebra::ComplexField::sin_cos(self)
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        // Adding zero takes the sign from a zero.
        nalgebra::RealField::atan2(self + T::zero(), x + T::zero())
    }
    #[inline(always)]
    fn ln(self) -> Self {
        nalgebra::ComplexField::ln(self)
    }
    #[inline(always)]
    fn round(self) -> Self {
        nalgebra::ComplexField::round(self)
    }
    #[inline(always)]
    fn remainder(self, divisor: Self) -> Self {
        self % divisor
    }
    #[inline(always)]
    fn select_greater(self, other: Self, yes: Self, no: Self) -> Self {
        if self > other { yes } else { no }
    }
    #[inline(always)]
    fn any_greater(self, other: Self) -> bool {
        self > other
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_that_overflow_or_vanish_change_nothing() {
        for scale in [1e-300, 1e-200, 1e-150, 1.0, 1e150, 1e200, 1e300] {
            let near = |found: f64, wanted: f64| (found - wanted).abs() <= 1e-15 * wanted;
            assert!(near(Lane::hypot(3.0 * scale, 4.0 * scale), 5.0 * scale));
            assert!(near(Lane::hypot(scale, 0.0), scale));
            let [x, y] = Lane::inverted([3.0 * scale, 4.0 * scale], 1.0);
            assert!(
                near(x, 0.12 / scale) && near(y, 0.16 / scale),
                "{scale}: {x} {y}"
            );
        }
    }
}
