//! Dual numbers: a value with its derivatives, so that one text of a formula gives both.

use core::ops::{Add, Div, Mul, Neg, Sub};

use super::lane::Lane;
use super::scalar::hypot;

/// A number and its derivatives by `K` variables.
///
/// ```
/// use gramian::numbers::dual::Dual;
/// use gramian::numbers::lane::Lane;
/// let x = Dual::<1>::variable(0.5, 0);
/// let (sin, cos) = x.sin_cos();
/// assert_eq!(sin.by[0], cos.value);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<const K: usize> {
    /// The value.
    pub value: f64,
    /// Its derivatives.
    pub by: [f64; K],
}

impl<const K: usize> Dual<K> {
    /// A number that depends on no variable.
    #[inline(always)]
    pub fn constant(value: f64) -> Self {
        Self {
            value,
            by: [0.0; K],
        }
    }

    /// The variable of this index.
    #[inline(always)]
    pub fn variable(value: f64, index: usize) -> Self {
        Self {
            value,
            by: core::array::from_fn(|k| f64::from(u8::from(k == index))),
        }
    }

    /// A function of this number with this value and slope.
    #[inline(always)]
    fn chain(self, value: f64, slope: f64) -> Self {
        Self {
            value,
            by: self.by.map(|x| slope * x),
        }
    }

    /// A function of two numbers with this value and these slopes.
    #[inline(always)]
    fn chain2(self, other: Self, value: f64, slope: f64, other_slope: f64) -> Self {
        Self {
            value,
            by: core::array::from_fn(|k| slope * self.by[k] + other_slope * other.by[k]),
        }
    }
}

impl<const K: usize> Add for Dual<K> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.chain2(other, self.value + other.value, 1.0, 1.0)
    }
}

impl<const K: usize> Sub for Dual<K> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.chain2(other, self.value - other.value, 1.0, -1.0)
    }
}

impl<const K: usize> Mul for Dual<K> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.chain2(other, self.value * other.value, other.value, self.value)
    }
}

impl<const K: usize> Div for Dual<K> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let inverse = 1.0 / other.value;
        let value = self.value / other.value;
        self.chain2(other, value, inverse, -value * inverse)
    }
}

impl<const K: usize> Neg for Dual<K> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const K: usize> Lane for Dual<K> {
    #[inline(always)]
    fn splat(self, value: f64) -> Self {
        Self::constant(value)
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
        self.chain(self.value * factor, factor)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        if self.value < 0.0 { -self } else { self }
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if other.value < self.value {
            other
        } else {
            self
        }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if other.value > self.value {
            other
        } else {
            self
        }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, 0.5 / root)
    }
    #[inline(always)]
    fn hypot(self, other: Self) -> Self {
        let value = hypot(self.value, other.value);
        self.chain2(other, value, self.value / value, other.value / value)
    }
    #[inline(always)]
    fn inverted([x, y]: [Self; 2], scale: Self) -> [Self; 2] {
        let weight = (x.mul_add(x, y * y) * scale).recip();
        [x * weight, y * weight]
    }
    #[inline(always)]
    fn recip(self) -> Self {
        let value = 1.0 / self.value;
        self.chain(value, -value * value)
    }
    #[inline(always)]
    fn recip_or_zero(self) -> Self {
        if self.value <= 1.0 / f64::MAX {
            Self::constant(0.0)
        } else {
            self.recip()
        }
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        let square = self.value * self.value + x.value * x.value;
        self.chain2(
            x,
            self.value.atan2(x.value),
            x.value / square,
            -self.value / square,
        )
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(self.value.ln(), 1.0 / self.value)
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self::constant(self.value.round())
    }
    #[inline(always)]
    fn remainder(self, divisor: Self) -> Self {
        let whole = (self.value / divisor.value).trunc();
        self.chain2(divisor, self.value % divisor.value, 1.0, -whole)
    }
    #[inline(always)]
    fn select_greater(self, other: Self, yes: Self, no: Self) -> Self {
        if self.value > other.value { yes } else { no }
    }
    #[inline(always)]
    fn any_greater(self, other: Self) -> bool {
        self.value > other.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every operation once.
    fn everything<L: Lane>(x: L, y: L) -> L {
        let (sin, cos) = (x * y).sin_cos();
        let a = x.mul_add(y, sin).atan2(cos.negate_mul_add(y, x));
        let b = (x / y).abs().sqrt().ln() - y.hypot(x).recip() + (-x).times(0.3);
        let [c, d] = L::inverted([x, y], x.max(y));
        a * b + c.min(d) - d * x.remainder(y) + x.recip_or_zero()
    }

    #[test]
    fn derivatives_agree_with_differences() {
        for (x, y) in [(0.7, 1.9), (2.3, 0.4), (5.0, 3.1)] {
            let found = everything(Dual::<2>::variable(x, 0), Dual::variable(y, 1));
            assert!((found.value - everything(x, y)).abs() < 1e-14);
            let h = 1e-6;
            let by_x = (everything(x + h, y) - everything(x - h, y)) / (2.0 * h);
            let by_y = (everything(x, y + h) - everything(x, y - h)) / (2.0 * h);
            assert!((found.by[0] - by_x).abs() < 1e-8 * (1.0 + by_x.abs()));
            assert!((found.by[1] - by_y).abs() < 1e-8 * (1.0 + by_y.abs()));
        }
    }
}
