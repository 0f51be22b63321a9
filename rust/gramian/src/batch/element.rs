//! The numbers that fill vectors, and what a register of them can do: f64, and f32 in
//! twice as many lanes.

use core::fmt::Debug;

use pulp::Simd;

use super::simd;
use crate::scalar::Real;

/// The most lanes that a register of any CPU has.
pub(crate) const MOST_LANES: usize = 16;

/// Declares operations that take registers and give one.
macro_rules! operations {
    ($($(#[$about:meta])* $name:ident($($x:ident),*);)*) => {
        $(
            $(#[$about])*
            fn $name<S: Simd>(simd: S, $($x: Self::Register<S>),*) -> Self::Register<S>;
        )*
    };
}

/// A number that fills the lanes of registers.
pub trait Element: Real {
    /// A register of them.
    type Register<S: Simd>: Copy + Debug;
    /// Zeros, then ones: as many of each as the pairs of two registers have numbers.
    const NEW: [Self; 4 * MOST_LANES];

    /// Lanes of a register.
    fn lanes<S: Simd>() -> usize;
    /// Registers from a slice, and the numbers left over.
    fn registers<S: Simd>(slice: &[Self]) -> (&[Self::Register<S>], &[Self]);
    /// The same number in all lanes.
    fn lanes_splat<S: Simd>(simd: S, value: Self) -> Self::Register<S>;
    /// The sum of the lanes.
    fn lanes_sum<S: Simd>(simd: S, a: Self::Register<S>) -> Self;
    /// First and second numbers of pairs that follow each other.
    fn lanes_of_pairs<S: Simd>(simd: S, pairs: [Self::Register<S>; 2]) -> [Self::Register<S>; 2];
    /// The columns of rows of four that follow each other.
    fn lanes_of_fours<S: Simd>(simd: S, rows: [Self::Register<S>; 4]) -> [Self::Register<S>; 4];
    /// `yes` where a > b, `no` elsewhere.
    fn lanes_select_greater<S: Simd>(
        simd: S,
        a: Self::Register<S>,
        b: Self::Register<S>,
        yes: Self::Register<S>,
        no: Self::Register<S>,
    ) -> Self::Register<S>;
    /// `yes` where a <= b, `no` elsewhere.
    fn lanes_select_at_most<S: Simd>(
        simd: S,
        a: Self::Register<S>,
        b: Self::Register<S>,
        yes: Self::Register<S>,
        no: Self::Register<S>,
    ) -> Self::Register<S>;
    /// Whether a > b in any lane.
    fn lanes_any_greater<S: Simd>(simd: S, a: Self::Register<S>, b: Self::Register<S>) -> bool;
    /// A function of the standard library, lane by lane; the lanes of `b` are 1 where there
    /// are none.
    fn lane_by_lane<S: Simd>(
        simd: S,
        a: Self::Register<S>,
        b: Self::Register<S>,
        function: impl Fn(Self, Self) -> Self,
    ) -> Self::Register<S>;
    /// Sine and cosine.
    fn lanes_sin_cos<S: Simd>(
        simd: S,
        a: Self::Register<S>,
    ) -> (Self::Register<S>, Self::Register<S>);
    /// The angle of (x, y) against the x axis.
    fn lanes_atan2<S: Simd>(
        simd: S,
        y: Self::Register<S>,
        x: Self::Register<S>,
    ) -> Self::Register<S>;

    /// The natural logarithm.
    #[inline(always)]
    fn lanes_ln<S: Simd>(simd: S, a: Self::Register<S>) -> Self::Register<S> {
        Self::lane_by_lane(simd, a, a, |a, _| a.ln())
    }
    /// What is left of a beside whole multiples of b, with the sign of a.
    #[inline(always)]
    fn lanes_remainder<S: Simd>(
        simd: S,
        a: Self::Register<S>,
        b: Self::Register<S>,
    ) -> Self::Register<S> {
        Self::lane_by_lane(simd, a, b, |a, b| a % b)
    }

    operations! {
        /// a + b.
        lanes_add(a, b);
        /// a - b.
        lanes_sub(a, b);
        /// a b.
        lanes_mul(a, b);
        /// a / b.
        lanes_div(a, b);
        /// a b + c.
        lanes_mul_add(a, b, c);
        /// c - a b.
        lanes_negate_mul_add(a, b, c);
        /// The less of both.
        lanes_min(a, b);
        /// The greater of both.
        lanes_max(a, b);
        /// -a.
        lanes_neg(a);
        /// The size of a.
        lanes_abs(a);
        /// The root of a.
        lanes_sqrt(a);
    }
}

/// Implements [`Element`] by the operations of the type's registers.
macro_rules! element {
    (
        $number:ident, $register:ident, $lanes:ident, $registers:ident, $splat:ident, $sum:ident,
        $deinterleave:ident, $greater:ident, $at_most:ident, $select:ident, $first_true:ident,
        $load:ident, $store:ident, $sin_cos:expr, $atan2:expr,
        $($name:ident($($x:ident),*) = $operation:ident;)*
    ) => {
        impl Element for $number {
            type Register<S: Simd> = S::$register;
            const NEW: [Self; 4 * MOST_LANES] = {
                let mut new = [0.0; 4 * MOST_LANES];
                let mut i = 2 * MOST_LANES;
                while i < new.len() {
                    new[i] = 1.0;
                    i += 1;
                }
                new
            };

            #[inline(always)]
            fn lanes<S: Simd>() -> usize {
                S::$lanes
            }
            #[inline(always)]
            fn registers<S: Simd>(slice: &[Self]) -> (&[S::$register], &[Self]) {
                S::$registers(slice)
            }
            #[inline(always)]
            fn lanes_splat<S: Simd>(simd: S, value: Self) -> S::$register {
                simd.$splat(value)
            }
            #[inline(always)]
            fn lanes_sum<S: Simd>(simd: S, a: S::$register) -> Self {
                simd.$sum(a)
            }
            #[inline(always)]
            fn lanes_of_pairs<S: Simd>(simd: S, pairs: [S::$register; 2]) -> [S::$register; 2] {
                simd.$deinterleave(pairs)
            }
            #[inline(always)]
            fn lanes_of_fours<S: Simd>(simd: S, rows: [S::$register; 4]) -> [S::$register; 4] {
                simd.$deinterleave(rows)
            }
            #[inline(always)]
            fn lanes_select_greater<S: Simd>(
                simd: S,
                a: S::$register,
                b: S::$register,
                yes: S::$register,
                no: S::$register,
            ) -> S::$register {
                simd.$select(simd.$greater(a, b), yes, no)
            }
            #[inline(always)]
            fn lanes_select_at_most<S: Simd>(
                simd: S,
                a: S::$register,
                b: S::$register,
                yes: S::$register,
                no: S::$register,
            ) -> S::$register {
                simd.$select(simd.$at_most(a, b), yes, no)
            }
            #[inline(always)]
            fn lanes_any_greater<S: Simd>(simd: S, a: S::$register, b: S::$register) -> bool {
                simd.$first_true(simd.$greater(a, b)) < S::$lanes
            }
            #[inline(never)]
            fn lane_by_lane<S: Simd>(
                simd: S,
                a: S::$register,
                b: S::$register,
                function: impl Fn(Self, Self) -> Self,
            ) -> S::$register {
                let (mut left, mut right) = ([1.0; MOST_LANES], [1.0; MOST_LANES]);
                let lanes = S::$lanes.min(MOST_LANES);
                simd.$store(&mut left[..lanes], a);
                simd.$store(&mut right[..lanes], b);
                for (a, b) in left[..lanes].iter_mut().zip(&right) {
                    *a = function(*a, *b);
                }
                simd.$load(&left[..lanes])
            }
            #[inline(always)]
            fn lanes_sin_cos<S: Simd>(simd: S, a: S::$register) -> (S::$register, S::$register) {
                $sin_cos(simd, a)
            }
            #[inline(always)]
            fn lanes_atan2<S: Simd>(simd: S, y: S::$register, x: S::$register) -> S::$register {
                $atan2(simd, y, x)
            }
            $(
                #[inline(always)]
                fn $name<S: Simd>(simd: S, $($x: S::$register),*) -> S::$register {
                    simd.$operation($($x),*)
                }
            )*
        }
    };
}

element! {
    f64, f64s, F64_LANES, as_simd_f64s, splat_f64s, reduce_sum_f64s,
    deinterleave_shfl_f64s, greater_than_f64s, less_than_or_equal_f64s, select_f64s,
    first_true_m64s, partial_load_f64s, partial_store_f64s, simd::sin_cos, simd::atan2,
    lanes_add(a, b) = add_f64s;
    lanes_sub(a, b) = sub_f64s;
    lanes_mul(a, b) = mul_f64s;
    lanes_div(a, b) = div_f64s;
    lanes_mul_add(a, b, c) = mul_add_e_f64s;
    lanes_negate_mul_add(a, b, c) = negate_mul_add_e_f64s;
    lanes_min(a, b) = min_f64s;
    lanes_max(a, b) = max_f64s;
    lanes_neg(a) = neg_f64s;
    lanes_abs(a) = abs_f64s;
    lanes_sqrt(a) = sqrt_f64s;
}

// Sines and arc tangents of f32 have no vectors of their own: no kernel of them takes f32.
element! {
    f32, f32s, F32_LANES, as_simd_f32s, splat_f32s, reduce_sum_f32s,
    deinterleave_shfl_f32s, greater_than_f32s, less_than_or_equal_f32s, select_f32s,
    first_true_m32s, partial_load_f32s, partial_store_f32s,
    |simd, a| (
        f32::lane_by_lane(simd, a, a, |a, _| a.sin()),
        f32::lane_by_lane(simd, a, a, |a, _| a.cos()),
    ),
    |simd, y, x| f32::lane_by_lane(simd, y, x, f32::atan2),
    lanes_add(a, b) = add_f32s;
    lanes_sub(a, b) = sub_f32s;
    lanes_mul(a, b) = mul_f32s;
    lanes_div(a, b) = div_f32s;
    lanes_mul_add(a, b, c) = mul_add_e_f32s;
    lanes_negate_mul_add(a, b, c) = negate_mul_add_e_f32s;
    lanes_min(a, b) = min_f32s;
    lanes_max(a, b) = max_f32s;
    lanes_neg(a) = neg_f32s;
    lanes_abs(a) = abs_f32s;
    lanes_sqrt(a) = sqrt_f32s;
}
