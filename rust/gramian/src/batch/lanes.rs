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

    /// The part `part` of a block, in lanes like these.
    #[inline(always)]
    pub fn load_like(self, block: &Block, part: usize) -> Self {
        Self::load(self.simd, block, part)
    }

    /// Writes the part `part` of a block.
    #[inline(always)]
    pub fn store(self, block: &mut Block, part: usize) {
        S::as_mut_simd_f64s(block).0[part] = self.value;
    }

    #[inline(always)]
    fn with(self, value: S::f64s) -> Self {
        Self {
            simd: self.simd,
            value,
        }
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

impl<S: Simd> Lane for Lanes<S> {
    #[inline(always)]
    fn splat(self, value: f64) -> Self {
        Self::splat(self.simd, value)
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        let simd = self.simd;
        self.with(simd.mul_add_e_f64s(self.value, factor.value, term.value))
    }
    #[inline(always)]
    fn negate_mul_add(self, factor: Self, term: Self) -> Self {
        let simd = self.simd;
        self.with(simd.negate_mul_add_e_f64s(self.value, factor.value, term.value))
    }
    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        self * Self::splat(self.simd, factor)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.with(self.simd.abs_f64s(self.value))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.with(self.simd.min_f64s(self.value, other.value))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.with(self.simd.max_f64s(self.value, other.value))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.with(self.simd.sqrt_f64s(self.value))
    }
    #[inline(always)]
    fn hypot(self, other: Self) -> Self {
        self.mul_add(self, other * other).sqrt()
    }
    #[inline(always)]
    fn inverted([x, y]: [Self; 2], scale: Self) -> [Self; 2] {
        let inverse = (x.mul_add(x, y * y) * scale).recip();
        [x * inverse, y * inverse]
    }
    #[inline(always)]
    fn recip(self) -> Self {
        Self::splat(self.simd, 1.0) / self
    }
    #[inline(always)]
    fn recip_or_zero(self) -> Self {
        let simd = self.simd;
        let tiny = simd.less_than_or_equal_f64s(self.value, simd.splat_f64s(1.0 / f64::MAX));
        let inverse = simd.div_f64s(simd.splat_f64s(1.0), self.value);
        self.with(simd.select_f64s(tiny, simd.splat_f64s(0.0), inverse))
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sine, cosine) = simd::sin_cos(self.simd, self.value);
        (self.with(sine), self.with(cosine))
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        self.with(simd::atan2(self.simd, self.value, x.value))
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.with(simd::ln(self.simd, self.value))
    }
    #[inline(always)]
    fn round(self) -> Self {
        // Adding 1.5 * 2^52 leaves no digits behind the point.
        let shifter = Self::splat(self.simd, 6_755_399_441_055_744.0);
        self + shifter - shifter
    }
    #[inline(always)]
    fn remainder(self, divisor: Self) -> Self {
        self.with(simd::remainder(self.simd, self.value, divisor.value))
    }
    #[inline(always)]
    fn select_greater(self, other: Self, yes: Self, no: Self) -> Self {
        let mask = self.simd.greater_than_f64s(self.value, other.value);
        self.with(self.simd.select_f64s(mask, yes.value, no.value))
    }
    #[inline(always)]
    fn any_greater(self, other: Self) -> bool {
        let mask = self.simd.greater_than_f64s(self.value, other.value);
        self.simd.first_true_m64s(mask) < S::F64_LANES
    }
}

/// The sum of a block, in an order of its own.
#[inline(always)]
pub fn total(x: &Block) -> f64 {
    ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::simd::Path;
    use crate::numbers::angle::wrapped;

    /// Every function of a vector against that of a number, lane by lane.
    struct Functions<'a>(&'a [f64], &'a [f64]);

    impl pulp::WithSimd for Functions<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let near = |a: f64, b: f64| {
                a == b || a.is_nan() && b.is_nan() || (a - b).abs() <= 2.5 * f64::EPSILON * b.abs()
            };
            for &x in self.0 {
                for y in self.1.chunks_exact(LANES) {
                    let mut block = [0.0; LANES];
                    block.copy_from_slice(y);
                    for part in 0..Lanes::<S>::PARTS {
                        let (a, b) = (Lanes::splat(simd, x), Lanes::load(simd, &block, part));
                        let vectors = [
                            a.min(b),
                            a.max(b),
                            a.hypot(b),
                            a.atan2(b),
                            Lanes::inverted([b, a + b], b)[1],
                            b.round(),
                            b.abs(),
                            b.recip(),
                            a.select_greater(b, a + b, a - b),
                            b.abs().recip_or_zero(),
                            b.remainder(a),
                            wrapped(b),
                        ];
                        for (k, found) in vectors.into_iter().enumerate() {
                            let mut out = [0.0; LANES];
                            found.store(&mut out, part);
                            let lanes = part * S::F64_LANES..(part + 1) * S::F64_LANES;
                            for lane in lanes {
                                let b = block[lane];
                                let wanted = [
                                    Lane::min(x, b),
                                    Lane::max(x, b),
                                    Lane::hypot(x, b),
                                    Lane::atan2(x, b),
                                    Lane::inverted([b, x + b], b)[1],
                                    b.round(),
                                    b.abs(),
                                    b.recip(),
                                    x.select_greater(b, x + b, x - b),
                                    b.abs().recip_or_zero(),
                                    b.remainder(x),
                                    wrapped(b),
                                ][k];
                                assert!(
                                    near(out[lane], wanted),
                                    "{k}: {x} {b}: {} {wanted}",
                                    out[lane]
                                );
                            }
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn vectors_do_what_numbers_do() {
        let x = [0.0, -0.0, 1.0, -2.5, 3e5];
        let y = [
            1.0,
            -1.0,
            0.3,
            -7.25,
            1e-9,
            123_456.789,
            -3.0,
            1e9,
            0.0,
            -0.0,
            3.15,
            -3.2,
            1e4,
            -1e7,
            6.6,
            1e14,
        ];
        for path in Path::available() {
            path.run(Functions(&x, &y));
        }
    }
}
