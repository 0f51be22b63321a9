//! The sum over i < j and l > k for two instants j < k.
//!
//! With `s_ab = sin(b_b - b_a)` and `tau_ab = t_b - t_a`, a bearing n on either
//! side has the two numbers
//!
//! ```text
//!   U_n = tau_kn s_jn,  V_n = tau_jn s_kn,  and  D(i, j, k, l) = U_i V_l - V_i U_l.
//! ```
//!
//! One side, x, lies along the lanes and keeps its vectors in registers; the
//! other, y, runs by, one bearing at a time. `D / V_x = r_x V_y - U_y` with
//! `r_x = U_x / V_x` costs one fused operation and its square another: two for
//! a quadruple, with `V_x^2` applied once to each sum. The quotient carries a few
//! roundings like `U_x` itself, so no digits are lost, however large it is. Where
//! it overflows (two equal bearings) the pair (j, k) is taken again without
//! it, three operations.

use alloc::vec;
use alloc::vec::Vec;
use core::ops::Range;

use super::{Quadruples, WIDEST};
use crate::batch::simd::sin_cos;

/// Fills the tables of a [`Quadruples`]; the rows end behind the last bearing.
pub(super) struct Tables<'a> {
    pub m: usize,
    pub times: &'a [f64],
    pub bearings: &'a [f64],
    pub roots: &'a [f64],
    pub sines: &'a mut [f64],
    pub rates: &'a mut [f64],
    pub inverse: &'a mut [f64],
}

impl pulp::WithSimd for Tables<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let stride = self.times.len();
        let (times, _) = S::as_simd_f64s(self.times);
        let (bearings, _) = S::as_simd_f64s(self.bearings);
        let (roots, _) = S::as_simd_f64s(self.roots);
        for a in 0..self.m {
            let row = a * stride..(a + 1) * stride;
            let (sines, _) = S::as_mut_simd_f64s(&mut self.sines[row.clone()]);
            let (rates, _) = S::as_mut_simd_f64s(&mut self.rates[row.clone()]);
            let (inverse, _) = S::as_mut_simd_f64s(&mut self.inverse[row.clone()]);
            let time = simd.splat_f64s(self.times[a]);
            let bearing = simd.splat_f64s(self.bearings[a]);
            for n in 0..self.m.div_ceil(S::F64_LANES) {
                let (sine, _) = sin_cos(simd, simd.sub_f64s(bearings[n], bearing));
                let tau = simd.sub_f64s(times[n], time);
                sines[n] = simd.mul_f64s(roots[n], sine);
                rates[n] = simd.div_f64s(sine, tau);
                inverse[n] = simd.div_f64s(tau, sine);
            }
            for table in [&mut *self.sines, self.rates, self.inverse] {
                let row = &mut table[row.clone()];
                row[self.m..].fill(0.0);
                row[a] = 0.0;
            }
        }
    }
}

/// `U` and `V` of the bearings that run by.
pub(in super::super) struct Scratch {
    u: Vec<f64>,
    v: Vec<f64>,
}

impl Scratch {
    pub(super) fn new(stride: usize) -> Self {
        let row = || vec![0.0; stride + WIDEST];
        Self { u: row(), v: row() }
    }
}

/// `row` from its first cache line on.
#[inline(always)]
fn aligned(row: &mut [f64]) -> &mut [f64] {
    let offset = row.as_ptr().align_offset(64).min(WIDEST);
    &mut row[offset..]
}

/// All quadruples with the second instant j.
pub(super) struct Part<'a> {
    pub all: &'a Quadruples,
    pub j: usize,
    pub scratch: &'a mut Scratch,
}

/// The bearings of one side of (j, k) in vectors, read from the tables.
struct Along<'a, S: pulp::Simd> {
    simd: S,
    len: usize,
    tj: S::f64s,
    tk: S::f64s,
    times: &'a [S::f64s],
    sj: &'a [S::f64s],
    sk: &'a [S::f64s],
    rate: &'a [S::f64s],
    inverse: &'a [S::f64s],
}

impl<'a, S: pulp::Simd> Along<'a, S> {
    #[inline(always)]
    fn new(simd: S, all: &'a Quadruples, (j, k): (usize, usize), range: Range<usize>) -> Self {
        let size = range.len().next_multiple_of(S::F64_LANES);
        let row = range.start..range.start + size;
        Self {
            simd,
            len: range.len(),
            tj: simd.splat_f64s(all.times[j]),
            tk: simd.splat_f64s(all.times[k]),
            times: S::as_simd_f64s(&all.times[row.clone()]).0,
            sj: S::as_simd_f64s(&all.sines(j)[row.clone()]).0,
            sk: S::as_simd_f64s(&all.sines(k)[row.clone()]).0,
            rate: S::as_simd_f64s(&all.rates(j)[row.clone()]).0,
            inverse: S::as_simd_f64s(&all.inverse(k)[row]).0,
        }
    }

    /// How many vectors there are.
    #[inline(always)]
    fn count(&self) -> usize {
        self.times.len()
    }

    #[inline(always)]
    fn u(&self, n: usize) -> S::f64s {
        let tau = self.simd.sub_f64s(self.times[n], self.tk);
        self.simd.mul_f64s(tau, self.sj[n])
    }

    #[inline(always)]
    fn v(&self, n: usize) -> S::f64s {
        let tau = self.simd.sub_f64s(self.times[n], self.tj);
        self.simd.mul_f64s(tau, self.sk[n])
    }

    #[inline(always)]
    fn ratio(&self, n: usize) -> S::f64s {
        self.simd.mul_f64s(self.rate[n], self.inverse[n])
    }

    /// x, zero in lanes behind the last bearing, where others stand that do not
    /// belong here.
    #[inline(always)]
    fn inside(&self, n: usize, x: S::f64s) -> S::f64s {
        let simd = self.simd;
        let (lanes, _) = S::as_simd_f64s(&LANE[..S::F64_LANES]);
        let inside = simd.splat_f64s(self.len as f64 - (n * S::F64_LANES) as f64);
        let inside = simd.less_than_f64s(lanes[0], inside);
        simd.select_f64s(inside, x, simd.splat_f64s(0.0))
    }

    /// U and V of each bearing, in vectors and one by one.
    #[inline(always)]
    fn fill<'b>(&self, scratch: &'b mut Scratch) -> (&'b [f64], &'b [f64]) {
        let size = self.count() * S::F64_LANES;
        let (us, vs) = (
            &mut aligned(&mut scratch.u)[..size],
            &mut aligned(&mut scratch.v)[..size],
        );
        let (u, _) = S::as_mut_simd_f64s(us);
        let (v, _) = S::as_mut_simd_f64s(vs);
        for n in 0..self.count() {
            (u[n], v[n]) = (self.u(n), self.v(n));
        }
        (&us[..self.len], &vs[..self.len])
    }
}

/// The number of each lane.
const LANE: [f64; WIDEST] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

/// Sum over x and y of `V_x^2 (r_x V_y - U_y)^2`, added to `total` lane by lane:
/// N vectors of x from `first` on, Y bearings y at a time to fill the pipes.
#[inline(always)]
fn strip<S: pulp::Simd, const N: usize, const Y: usize>(
    x: &Along<'_, S>,
    first: usize,
    y: (&[f64], &[f64]),
    total: S::f64s,
) -> S::f64s {
    let simd = x.simd;
    let zero = simd.splat_f64s(0.0);
    let mut ratio = [zero; N];
    for n in 0..N {
        ratio[n] = x.ratio(first + n);
    }
    let mut sums = [[zero; N]; Y];
    let ((us, u_rest), (vs, v_rest)) = (y.0.as_chunks::<Y>(), y.1.as_chunks::<Y>());
    for (u, v) in us.iter().zip(vs) {
        for i in 0..Y {
            add(simd, &ratio, u[i], v[i], &mut sums[i]);
        }
    }
    for (&u, &v) in u_rest.iter().zip(v_rest) {
        add(simd, &ratio, u, v, &mut sums[0]);
    }
    let mut total = total;
    for n in 0..N {
        let mut sum = sums[0][n];
        for other in &sums[1..] {
            sum = simd.add_f64s(sum, other[n]);
        }
        let mut v = x.v(first + n);
        if n + 1 == N {
            v = x.inside(first + n, v);
        }
        total = simd.mul_add_e_f64s(simd.mul_f64s(v, v), sum, total);
    }
    total
}

#[inline(always)]
fn add<S: pulp::Simd, const N: usize>(
    simd: S,
    ratio: &[S::f64s; N],
    u: f64,
    v: f64,
    sums: &mut [S::f64s; N],
) {
    let (u, v) = (simd.splat_f64s(u), simd.splat_f64s(v));
    for n in 0..N {
        let d = simd.negate_mul_add_e_f64s(ratio[n], v, u);
        sums[n] = simd.mul_add_e_f64s(d, d, sums[n]);
    }
}

/// The same for all vectors of x, in strips of as many as there are registers for.
#[inline(always)]
fn strips<S: pulp::Simd>(x: &Along<'_, S>, y: (&[f64], &[f64])) -> S::f64s {
    let most = if S::REGISTER_COUNT >= 32 { 8 } else { 6 };
    let mut total = x.simd.splat_f64s(0.0);
    let mut first = 0;
    while first < x.count() {
        let left = x.count() - first;
        // Two strips of middling width keep the pipes fuller than a whole one
        // and a narrow one.
        let width = match left {
            _ if left <= most => left,
            _ if 2 * left >= 3 * most => most,
            _ => left / 2,
        };
        total = match width {
            1 => strip::<S, 1, 4>(x, first, y, total),
            2 => strip::<S, 2, 4>(x, first, y, total),
            3 => strip::<S, 3, 2>(x, first, y, total),
            4 => strip::<S, 4, 1>(x, first, y, total),
            5 => strip::<S, 5, 1>(x, first, y, total),
            6 => strip::<S, 6, 1>(x, first, y, total),
            7 => strip::<S, 7, 1>(x, first, y, total),
            _ => strip::<S, 8, 1>(x, first, y, total),
        };
        first += width;
    }
    total
}

/// The sum over all pairs (j, k) of a part.
pub(super) struct Sum<'a>(pub Part<'a>);

impl pulp::WithSimd for Sum<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> f64 {
        let Part { all, j, scratch } = self.0;
        let infinity = simd.splat_f64s(f64::INFINITY);
        let mut sum = simd.splat_f64s(0.0);
        for k in j + 1..all.m - 1 {
            let before = Along::new(simd, all, (j, k), 0..j);
            let after = Along::new(simd, all, (j, k), k + 1..all.m);
            // The side that fills its vectors better lies along the lanes.
            let mut inner = if after.count() * before.len <= before.count() * after.len {
                strips(&after, before.fill(scratch))
            } else {
                strips(&before, after.fill(scratch))
            };
            let finite = simd.less_than_f64s(inner, infinity);
            if simd.first_true_m64s(simd.not_m64s(finite)) < S::F64_LANES {
                inner = apart::<S, false>(&after, before.fill(scratch));
            }
            let weight = simd.splat_f64s(all.weights[j] * all.weights[k]);
            sum = simd.mul_add_e_f64s(weight, inner, sum);
        }
        simd.reduce_sum_f64s(sum)
    }
}

/// The sum or maximum of D^2 over x and y without a quotient, lane by lane.
#[inline(always)]
fn apart<S: pulp::Simd, const MAXIMUM: bool>(x: &Along<'_, S>, y: (&[f64], &[f64])) -> S::f64s {
    let mut total = x.simd.splat_f64s(0.0);
    let mut first = 0;
    while first + 4 <= x.count() {
        total = strip_apart::<S, 4, MAXIMUM>(x, first, y, total);
        first += 4;
    }
    while first < x.count() {
        total = strip_apart::<S, 1, MAXIMUM>(x, first, y, total);
        first += 1;
    }
    total
}

#[inline(always)]
fn strip_apart<S: pulp::Simd, const N: usize, const MAXIMUM: bool>(
    x: &Along<'_, S>,
    first: usize,
    y: (&[f64], &[f64]),
    total: S::f64s,
) -> S::f64s {
    let simd = x.simd;
    let zero = simd.splat_f64s(0.0);
    let (mut ux, mut vx) = ([zero; N], [zero; N]);
    for n in 0..N {
        ux[n] = x.inside(first + n, x.u(first + n));
        vx[n] = x.inside(first + n, x.v(first + n));
    }
    let mut results = [zero; N];
    for (&u, &v) in y.0.iter().zip(y.1) {
        let (u, v) = (simd.splat_f64s(u), simd.splat_f64s(v));
        for n in 0..N {
            let d = simd.negate_mul_add_e_f64s(v, ux[n], simd.mul_f64s(u, vx[n]));
            results[n] = if MAXIMUM {
                simd.max_f64s(results[n], simd.mul_f64s(d, d))
            } else {
                simd.mul_add_e_f64s(d, d, results[n])
            };
        }
    }
    let mut total = total;
    for result in results {
        total = if MAXIMUM {
            simd.max_f64s(total, result)
        } else {
            simd.add_f64s(total, result)
        };
    }
    total
}

/// The same sum in O(m^3).
pub(super) struct Factored<'a>(pub Part<'a>);

impl pulp::WithSimd for Factored<'_> {
    type Output = f64;

    /// The sum over i and l is that over i of `|R (U_i, -V_i)|^2`, R the triangular
    /// factor of the columns `V_l` and `U_l`.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> f64 {
        let Part { all, j, .. } = self.0;
        let zero = simd.splat_f64s(0.0);
        let mut sum = 0.0;
        for k in j + 1..all.m - 1 {
            let before = Along::new(simd, all, (j, k), 0..j);
            let after = Along::new(simd, all, (j, k), k + 1..all.m);
            let (mut vv, mut uv) = (zero, zero);
            for n in 0..after.count() {
                let (u, v) = (after.u(n), after.v(n));
                vv = simd.mul_add_e_f64s(v, v, vv);
                uv = simd.mul_add_e_f64s(u, v, uv);
            }
            let (vv, uv) = (simd.reduce_sum_f64s(vv), simd.reduce_sum_f64s(uv));
            let ratio = if vv > 0.0 { uv / vv } else { 0.0 };
            // What is left of U, from its entries: a difference of norms would
            // lose half the digits where U and V are nearly parallel.
            let (along, mut rest) = (simd.splat_f64s(ratio), zero);
            for n in 0..after.count() {
                let d = simd.negate_mul_add_e_f64s(along, after.v(n), after.u(n));
                rest = simd.mul_add_e_f64s(d, d, rest);
            }
            let rest = simd.reduce_sum_f64s(rest);
            let (mut first, mut second) = (zero, zero);
            for n in 0..before.count() {
                let v = before.inside(n, before.v(n));
                let u = before.inside(n, before.u(n));
                let d = simd.negate_mul_add_e_f64s(along, v, u);
                first = simd.mul_add_e_f64s(d, d, first);
                second = simd.mul_add_e_f64s(v, v, second);
            }
            let inner = vv * simd.reduce_sum_f64s(first) + rest * simd.reduce_sum_f64s(second);
            sum += all.weights[j] * all.weights[k] * inner;
        }
        sum
    }
}

/// The largest D^2 of a part and its third instant.
pub(super) struct Maximum<'a>(pub Part<'a>);

impl pulp::WithSimd for Maximum<'_> {
    type Output = (f64, usize);

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> (f64, usize) {
        let Part { all, j, scratch } = self.0;
        let mut best = (-1.0, 0);
        for k in j + 1..all.m - 1 {
            let before = Along::new(simd, all, (j, k), 0..j);
            let after = Along::new(simd, all, (j, k), k + 1..all.m);
            let largest = apart::<S, true>(&after, before.fill(scratch));
            let largest = simd.reduce_max_f64s(largest);
            if largest > best.0 {
                best = (largest, k);
            }
        }
        best
    }
}
