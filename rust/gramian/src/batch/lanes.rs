//! One register of f64 lanes, written as a number: operators and the elementary
//! functions that kernels need, the same text on every vector path.
//!
//! Kernels that add up work on blocks of [`LANES`] samples whatever the width of
//! the registers, so that the order of their sums does not depend on the CPU.

use core::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;

use super::simd;
use crate::numbers::lane::Lane;

/// Samples in a block.
pub const LANES: usize = 8;
/// One block of samples.
pub type Block = [f64; LANES];

/// A register of lanes.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<S: Simd> {
    simd: S,
    value: S::f64s,
}

impl<S: Simd> Lanes<S> {
    /// A register as it is.
    #[inline(always)]
    pub fn new(simd: S, value: S::f64s) -> Self {
        Self { simd, value }
    }

    /// The sum of the lanes.
    #[inline(always)]
    pub fn sum(self) -> f64 {
        self.simd.reduce_sum_f64s(self.value)
    }

    /// How many registers make a block.
    pub const PARTS: usize = LANES / S::F64_LANES;

    /// The same number in all lanes.
    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        let value = simd.splat_f64s(value);
        Self { simd, value }
    }

    /// The next lanes of a slice that holds at least as many.
    #[inline(always)]
    pub fn of(simd: S, from: &[f64]) -> Self {
        let value = S::as_simd_f64s(from).0[0];
        Self { simd, value }
    }

    /// Writes to the next lanes of a slice that holds at least as many.
    #[inline(always)]
    pub fn put(self, to: &mut [f64]) {
        S::as_mut_simd_f64s(to).0[0] = self.value;
    }

    /// 1 where self is above `low` and below `high`, 0 elsewhere.
    #[inline(always)]
    pub fn inside(self, low: f64, high: f64) -> Self {
        let simd = self.simd;
        let above = simd.greater_than_f64s(self.value, simd.splat_f64s(low));
        let below = simd.less_than_f64s(self.value, simd.splat_f64s(high));
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        self.with(simd.select_f64s(above, simd.select_f64s(below, one, zero), zero))
    }

    /// The least of the lanes.
    #[inline(always)]
    pub fn least(self) -> f64 {
        self.simd.reduce_min_f64s(self.value)
    }

    /// The part `part` of a block.
    #[inline(always)]
    pub fn load(simd: S, block: &Block, part: usize) -> Self {
        let value = S::as_simd_f64s(block).0[part];
        Self { simd, value }
    }

    /// Writes the part `part` of a block.
    #[inline(always)]
    pub fn store(self, block: &mut Block, part: usize) {
        S::as_mut_simd_f64s(block).0[part] = self.value;
    }

    /// self * a + b.
    #[inline(always)]
    pub fn mul_add(self, a: Self, b: Self) -> Self {
        let value = self.simd.mul_add_e_f64s(self.value, a.value, b.value);
        self.with(value)
    }

    /// b - self * a.
    #[inline(always)]
    pub fn mul_from(self, a: Self, b: Self) -> Self {
        let value = self
            .simd
            .negate_mul_add_e_f64s(self.value, a.value, b.value);
        self.with(value)
    }

    /// self times a number.
    #[inline(always)]
    pub fn times(self, factor: f64) -> Self {
        self * Self::splat(self.simd, factor)
    }

    /// Square root.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.with(self.simd.sqrt_f64s(self.value))
    }

    /// `yes` where self > other, `no` elsewhere.
    #[inline(always)]
    pub fn choose_above(self, other: Self, yes: Self, no: Self) -> Self {
        let mask = self.simd.greater_than_f64s(self.value, other.value);
        self.with(self.simd.select_f64s(mask, yes.value, no.value))
    }

    #[inline(always)]
    fn with(self, value: S::f64s) -> Self {
        Self {
            simd: self.simd,
            value,
        }
    }

    /// The angle of the point (`x`, self); see [`simd::atan2`].
    #[inline(always)]
    pub fn atan2(self, x: Self) -> Self {
        self.with(simd::atan2(self.simd, self.value, x.value))
    }

    /// Sine and cosine; see [`simd::sin_cos`].
    #[inline(always)]
    pub fn sin_cos(self) -> (Self, Self) {
        let (sine, cosine) = simd::sin_cos(self.simd, self.value);
        (self.with(sine), self.with(cosine))
    }
}

impl<S: Simd> Add for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(self.simd.add_f64s(self.value, other.value))
    }
}

impl<S: Simd> Sub for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(self.simd.sub_f64s(self.value, other.value))
    }
}

impl<S: Simd> Mul for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(self.simd.mul_f64s(self.value, other.value))
    }
}

impl<S: Simd> Div for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(self.simd.div_f64s(self.value, other.value))
    }
}

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.with(self.simd.neg_f64s(self.value))
    }
}

// As those of its own above; a loop or a closure could be compiled apart.
impl<S: Simd> Lane for Lanes<S> {
    #[inline(always)]
    fn splat(self, value: f64) -> Self {
        Self::splat(self.simd, value)
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        Self::mul_add(self, factor, term)
    }
    #[inline(always)]
    fn negate_mul_add(self, factor: Self, term: Self) -> Self {
        self.mul_from(factor, term)
    }
    #[inline(always)]
    fn root(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn inverse(self) -> Self {
        Self::splat(self.simd, 1.0) / self
    }
    #[inline(always)]
    fn recip_or_zero(self) -> Self {
        let simd = self.simd;
        let tiny = simd.less_than_or_equal_f64s(self.value, simd.splat_f64s(1.0 / f64::MAX));
        let inverse = simd.div_f64s(simd.splat_f64s(1.0), self.value);
        self.with(simd.select_f64s(tiny, simd.splat_f64s(0.0), inverse))
    }
}

/// The sum of a block, in an order of its own.
#[inline(always)]
pub fn total(x: &Block) -> f64 {
    ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]))
}
