//! Sums and choices over all quadruples of bearings, at the speed of the vector
//! units.
//!
//! For two instants j < k, with `s_ab = sin(b_b - b_a)` and `tau_ab = t_b - t_a`,
//!
//! ```text
//!   D(i, j, k, l) = A_i P_l - B_i Q_l,
//!   A_i = tau_ik s_ij, B_i = tau_ij s_ik, P_l = tau_jl s_kl, Q_l = tau_kl s_jl,
//! ```
//!
//! so `D / B_i = a_i P_l - Q_l` with `a_i = A_i / B_i` costs one fused operation and
//! its square another: two for a quadruple, with `B_i^2` applied once for each
//! (i, j, k). The quotient `a_i` carries a few roundings like `A_i` itself, so no
//! digits are lost, however large it is. Where it overflows (two equal
//! bearings) the pair (j, k) is taken again in the form above, three operations.

use alloc::vec;
use alloc::vec::Vec;
use core::convert::Infallible;
use core::ops::Range;

use super::simd::{Path, sin_cos_slice};
use super::{Items, Threads};
use crate::bearings::{self, Form};
use crate::scalar::power_of_two;

/// The widest vector.
const WIDEST: usize = 8;
/// From this much work on one trial is shared among threads, nanoseconds.
pub(super) const SHARED: f64 = 4e5;

/// How a [`discriminant_sum`] is computed; all give the same number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Method {
    /// The sum of squares over all quadruples, O(m^4): the most accurate.
    #[default]
    Direct,
    /// The inner two sums as the norm of a 2 x 2 triangular factor, O(m^3):
    /// still a sum of squares.
    Factored,
    /// An orthogonal reduction of the rows, O(m).
    Qr,
}

/// Sums of `w_i w_j w_k w_l D^2` over all quadruples, one number for each trial:
/// the determinant of each trial's Gram matrix.
///
/// # Errors
/// As [`bearings::check_track`], with the trial.
pub fn discriminant_sum(
    times: Items<'_>,
    bearings: Items<'_>,
    weights: Option<Items<'_>>,
    method: Method,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    let m = times.get(0).len();
    let cost = cost(m, method);
    if method == Method::Qr {
        return threads.over(out, 1, cost, |trial, out| {
            let weights = weights.map(|w| w.get(trial));
            out[0] = bearings::discriminant_sum_qr(times.get(trial), bearings.get(trial), weights)
                .map_err(|error| (trial, error))?;
            Ok(())
        });
    }
    let load = |sum: &mut Quadruples, trial: usize| {
        sum.load(
            times.get(trial),
            bearings.get(trial),
            weights.map(|w| w.get(trial)),
        )
        .map_err(|error| (trial, error))
    };
    if cost > SHARED {
        let mut sum = Quadruples::new(m, method, Path::Best);
        let mut parts = vec![0.0; sum.parts()];
        for (trial, out) in out.iter_mut().enumerate() {
            load(&mut sum, trial)?;
            sum.run(0..sum.parts(), threads, &mut parts);
            *out = sum.total(&parts);
        }
        return Ok(());
    }
    let scratch = || {
        let sum = Quadruples::new(m, method, Path::Best);
        let parts = vec![0.0; sum.parts()];
        (sum, parts)
    };
    threads.over_with(out, 1, cost, scratch, |(sum, parts), trial, out| {
        load(sum, trial)?;
        sum.run(0..sum.parts(), Threads::One, parts);
        out[0] = sum.total(parts);
        Ok(())
    })
}

/// D of four bearings, one number for each trial, the instants in any order.
///
/// # Errors
/// As [`bearings::discriminant`], with the trial.
pub fn discriminants(
    times: Items<'_>,
    bearings: Items<'_>,
    form: Form,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    threads.over(out, 1, 60.0, |trial, out| {
        let (t, b) = (times.get(trial), bearings.get(trial));
        let four = |x: &[f64]| [x[0], x[1], x[2], x[3]];
        out[0] = bearings::discriminant(&four(t), &four(b), form).map_err(|e| (trial, e))?;
        Ok(())
    })
}

/// Sums of `w_i w_j sin^2(b_j - b_i)` over all pairs, one number for each trial:
/// the determinant for a target that does not move.
///
/// # Errors
/// As [`bearings::check_track`], with the trial.
pub fn fixed_target_sum(
    times: Items<'_>,
    bearings: Items<'_>,
    weights: Option<Items<'_>>,
    method: Method,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    let m = times.get(0).len() as f64;
    let cost = match method {
        Method::Direct => 7.0 * m * m,
        Method::Factored | Method::Qr => 40.0 * m,
    };
    threads.over(out, 1, cost, |trial, out| {
        let (times, bearings) = (times.get(trial), bearings.get(trial));
        let weights = weights.map(|w| w.get(trial));
        let sum = match method {
            Method::Direct => bearings::fixed_target_sum(times, bearings, weights),
            Method::Factored | Method::Qr => {
                bearings::fixed_target_sum_qr(times, bearings, weights)
            }
        };
        out[0] = sum.map_err(|error| (trial, error))?;
        Ok(())
    })
}

/// Roughly what one trial of `m` bearings costs, nanoseconds.
pub fn cost(m: usize, method: Method) -> f64 {
    let m = m as f64;
    match method {
        Method::Direct => 0.07 * m.powi(4) / 24.0 + m * m,
        Method::Factored => 0.5 * m.powi(3) / 6.0 + m * m,
        Method::Qr => 40.0 * m,
    }
}

/// The sum over the quadruples of one trial in parts that can be computed
/// apart, in any order and on any thread: part j holds the quadruples whose
/// second instant is j.
#[derive(Clone, Debug)]
pub struct Quadruples {
    m: usize,
    stride: usize,
    method: Method,
    path: Path,
    /// Times over a power of two, the last one repeated to the stride.
    times: Vec<f64>,
    /// `sqrt(w_b) sin(b_b - b_a)` at (a, b).
    sines: Vec<f64>,
    /// `sin(b_b - b_a) / tau_ab` and minus its inverse.
    rates: Vec<f64>,
    inverse: Vec<f64>,
    weights: Vec<f64>,
    unit: f64,
}

impl Quadruples {
    /// Room for a trial of `m` bearings.
    pub fn new(m: usize, method: Method, path: Path) -> Self {
        let stride = m.next_multiple_of(WIDEST) + WIDEST;
        let table = || vec![0.0; m * stride];
        Self {
            m,
            stride,
            method,
            path,
            times: vec![0.0; stride],
            sines: table(),
            rates: table(),
            inverse: table(),
            weights: vec![1.0; m],
            unit: 1.0,
        }
    }

    /// Takes in the bearings of a trial.
    ///
    /// # Errors
    /// As [`bearings::check_track`], with four bearings at least.
    pub fn load(
        &mut self,
        times: &[f64],
        bearings: &[f64],
        weights: Option<&[f64]>,
    ) -> Result<(), bearings::Error> {
        bearings::check_track(times, bearings, weights, 4)?;
        let (m, stride) = (self.m, self.stride);
        // Exact, and keeps all products far from overflow.
        self.unit = power_of_two(times[m - 1] - times[0]);
        for (scaled, &time) in self.times.iter_mut().zip(times) {
            *scaled = time / self.unit;
        }
        self.times[m..].fill(times[m - 1] / self.unit);
        match weights {
            Some(weights) => self.weights.copy_from_slice(weights),
            None => self.weights.fill(1.0),
        }
        // The differences, their sines in place of the rates, then both.
        let mut cosines = vec![0.0; stride];
        for a in 0..m {
            let row = a * stride..a * stride + m;
            let (angles, sines) = (&mut self.sines[row.clone()], &mut self.rates[row.clone()]);
            for (angle, &bearing) in angles.iter_mut().zip(bearings) {
                *angle = bearing - bearings[a];
            }
            sin_cos_slice(self.path, angles, sines, &mut cosines[..m]);
            for b in 0..m {
                let (sine, tau) = (self.rates[row.start + b], self.times[b] - self.times[a]);
                self.sines[row.start + b] = sine;
                self.rates[row.start + b] = sine / tau;
                self.inverse[row.start + b] = -tau / sine;
            }
            // Never used; finite for the kernel's masks.
            self.rates[row.start + a] = 0.0;
            self.inverse[row.start + a] = 0.0;
        }
        if weights.is_some() {
            let roots: Vec<f64> = self.weights.iter().map(|w| w.sqrt()).collect();
            for row in self.sines.chunks_exact_mut(stride) {
                for (sine, root) in row.iter_mut().zip(&roots) {
                    *sine *= root;
                }
            }
        }
        Ok(())
    }

    /// How many parts the sum has.
    pub fn parts(&self) -> usize {
        self.m
    }

    /// Computes the parts in `range` on as many threads as they are worth.
    pub fn run(&self, range: Range<usize>, threads: Threads, out: &mut [f64]) {
        // The heaviest part, so that tasks come out small and balance.
        let cost = 2.0 * cost(self.m, self.method) / self.m as f64;
        let scratch = || Scratch::new(self.stride);
        let each =
            |scratch: &mut Scratch, part: usize, out: &mut [f64]| -> Result<(), Infallible> {
                out[0] = self.part(range.start + part, scratch);
                Ok(())
            };
        let Ok(()) = threads.over_with(&mut out[..range.len()], 1, cost, scratch, each);
    }

    /// The sum of all parts, always in the same order.
    pub fn total(&self, parts: &[f64]) -> f64 {
        let sum: f64 = parts.iter().sum();
        let square = self.unit * self.unit;
        sum * square * square
    }

    /// The largest D^2 whose second instant is j, and its third instant.
    pub(super) fn largest(&self, j: usize, scratch: &mut Scratch) -> (f64, usize) {
        if j == 0 || j + 2 >= self.m {
            return (-1.0, 0);
        }
        let all = self;
        self.path.run(Maximum(Part { all, j, scratch }))
    }

    /// Space for one part.
    pub(super) fn scratch(&self) -> Scratch {
        Scratch::new(self.stride)
    }

    fn part(&self, j: usize, scratch: &mut Scratch) -> f64 {
        if j == 0 || j + 2 >= self.m {
            return 0.0;
        }
        let kernel = Part {
            all: self,
            j,
            scratch,
        };
        match self.method {
            Method::Direct => self.path.run(Sum(kernel)),
            Method::Factored | Method::Qr => self.path.run(Factored(kernel)),
        }
    }
}

/// Rows of one (j, k), the vectors over l aligned to cache lines.
pub(super) struct Scratch {
    p: Vec<f64>,
    q: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
}

impl Scratch {
    fn new(stride: usize) -> Self {
        let row = || vec![0.0; stride + WIDEST];
        Self {
            p: row(),
            q: row(),
            a: row(),
            b: row(),
        }
    }
}

/// `row` from its first cache line on.
#[inline(always)]
fn aligned(row: &mut [f64]) -> &mut [f64] {
    let offset = row.as_ptr().align_offset(64).min(WIDEST);
    &mut row[offset..]
}

/// All quadruples with the second instant j.
struct Part<'a> {
    all: &'a Quadruples,
    j: usize,
    scratch: &'a mut Scratch,
}

impl Part<'_> {
    /// `P_l` and `Q_l` for l > k, zero behind the last; their number of vectors.
    #[inline(always)]
    fn right<S: pulp::Simd>(&mut self, simd: S, k: usize) -> usize {
        let (all, j) = (self.all, self.j);
        let count = (all.m - k - 1).div_ceil(S::F64_LANES);
        let size = count * S::F64_LANES;
        let (times, _) = S::as_simd_f64s(&all.times[k + 1..k + 1 + size]);
        let (sk, _) = S::as_simd_f64s(&all.sines[k * all.stride + k + 1..][..size]);
        let (sj, _) = S::as_simd_f64s(&all.sines[j * all.stride + k + 1..][..size]);
        let (p, _) = S::as_mut_simd_f64s(&mut aligned(&mut self.scratch.p)[..size]);
        let (q, _) = S::as_mut_simd_f64s(&mut aligned(&mut self.scratch.q)[..size]);
        let (tj, tk) = (simd.splat_f64s(all.times[j]), simd.splat_f64s(all.times[k]));
        for v in 0..count {
            p[v] = simd.mul_f64s(simd.sub_f64s(times[v], tj), sk[v]);
            q[v] = simd.mul_f64s(simd.sub_f64s(times[v], tk), sj[v]);
        }
        count
    }

    /// `-a_i = -A_i / B_i` and `w_i B_i^2` for i < j, zero behind.
    #[inline(always)]
    fn left<S: pulp::Simd>(&mut self, simd: S, k: usize) {
        let (all, j) = (self.all, self.j);
        let size = j.next_multiple_of(S::F64_LANES);
        let (times, _) = S::as_simd_f64s(&all.times[..size]);
        let (rate, _) = S::as_simd_f64s(&all.rates[j * all.stride..][..size]);
        let (inverse, _) = S::as_simd_f64s(&all.inverse[k * all.stride..][..size]);
        let (sk, _) = S::as_simd_f64s(&all.sines[k * all.stride..][..size]);
        let (a, _) = S::as_mut_simd_f64s(&mut self.scratch.a[..size]);
        let (b, _) = S::as_mut_simd_f64s(&mut self.scratch.b[..size]);
        let (tj, zero) = (simd.splat_f64s(all.times[j]), simd.splat_f64s(0.0));
        for v in 0..size / S::F64_LANES {
            let tau = simd.sub_f64s(tj, times[v]);
            let before = simd.greater_than_f64s(tau, zero);
            let bi = simd.mul_f64s(tau, sk[v]);
            a[v] = simd.select_f64s(before, simd.mul_f64s(rate[v], inverse[v]), zero);
            b[v] = simd.select_f64s(before, simd.mul_f64s(bi, bi), zero);
        }
        self.scratch.a[size..size + WIDEST].fill(0.0);
        self.scratch.b[size..size + WIDEST].fill(0.0);
    }

    /// `A_i` and `-B_i` themselves, times `sqrt(w_i)`.
    #[inline(always)]
    fn left_apart<S: pulp::Simd>(&mut self, simd: S, k: usize) {
        let (all, j) = (self.all, self.j);
        let size = j.next_multiple_of(S::F64_LANES);
        let (times, _) = S::as_simd_f64s(&all.times[..size]);
        let (sj, _) = S::as_simd_f64s(&all.sines[j * all.stride..][..size]);
        let (sk, _) = S::as_simd_f64s(&all.sines[k * all.stride..][..size]);
        let (a, _) = S::as_mut_simd_f64s(&mut self.scratch.a[..size]);
        let (b, _) = S::as_mut_simd_f64s(&mut self.scratch.b[..size]);
        let zero = simd.splat_f64s(0.0);
        let (tj, tk) = (simd.splat_f64s(all.times[j]), simd.splat_f64s(all.times[k]));
        for v in 0..size / S::F64_LANES {
            let tau = simd.sub_f64s(times[v], tj);
            let before = simd.less_than_f64s(tau, zero);
            let ai = simd.mul_f64s(simd.sub_f64s(tk, times[v]), sj[v]);
            a[v] = simd.select_f64s(before, ai, zero);
            b[v] = simd.select_f64s(before, simd.mul_f64s(tau, sk[v]), zero);
        }
        self.scratch.a[size..size + WIDEST].fill(0.0);
        self.scratch.b[size..size + WIDEST].fill(0.0);
    }
}

/// Sum over b and l of `B_b^2 (Q_l - a_b P_l)^2`, added to `total` lane by lane.
#[inline(always)]
fn block<S: pulp::Simd, const N: usize>(
    simd: S,
    a: &[f64],
    b: &[f64],
    p: &[S::f64s],
    q: &[S::f64s],
    total: S::f64s,
) -> S::f64s {
    let zero = simd.splat_f64s(0.0);
    let mut factor = [zero; N];
    let mut sums = [zero; N];
    for n in 0..N {
        factor[n] = simd.splat_f64s(a[n]);
    }
    for (&p, &q) in p.iter().zip(q) {
        for n in 0..N {
            let d = simd.mul_add_e_f64s(factor[n], p, q);
            sums[n] = simd.mul_add_e_f64s(d, d, sums[n]);
        }
    }
    let mut total = total;
    for n in 0..N {
        total = simd.mul_add_e_f64s(simd.splat_f64s(b[n]), sums[n], total);
    }
    total
}

/// The sum (or, for the best quadruple, the maximum) of `(A_b P_l - B_b Q_l)^2`.
#[inline(always)]
fn block_apart<S: pulp::Simd, const MAXIMUM: bool>(
    simd: S,
    a: &[f64],
    b: &[f64],
    p: &[S::f64s],
    q: &[S::f64s],
    total: S::f64s,
) -> S::f64s {
    const N: usize = 4;
    let zero = simd.splat_f64s(0.0);
    let mut factors = [(zero, zero); N];
    let mut results = [zero; N];
    for n in 0..N {
        factors[n] = (simd.splat_f64s(a[n]), simd.splat_f64s(b[n]));
    }
    for (&p, &q) in p.iter().zip(q) {
        for n in 0..N {
            let (a, b) = factors[n];
            let d = simd.mul_add_e_f64s(b, q, simd.mul_f64s(a, p));
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

struct Sum<'a>(Part<'a>);

impl pulp::WithSimd for Sum<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> f64 {
        let mut part = self.0;
        let (all, j) = (part.all, part.j);
        let zero = simd.splat_f64s(0.0);
        let wide = S::REGISTER_COUNT >= 32;
        let mut sum = 0.0;
        for k in j + 1..all.m - 1 {
            let size = part.right(simd, k) * S::F64_LANES;
            part.left(simd, k);
            let scratch = &mut *part.scratch;
            let (p, _) = S::as_simd_f64s(&aligned(&mut scratch.p)[..size]);
            let (q, _) = S::as_simd_f64s(&aligned(&mut scratch.q)[..size]);
            let mut total = zero;
            let mut i = 0;
            while wide && i + 4 < j {
                let (a, b) = (&scratch.a[i..i + 8], &scratch.b[i..i + 8]);
                total = block::<S, 8>(simd, a, b, p, q, total);
                i += 8;
            }
            while i < j {
                let (a, b) = (&scratch.a[i..i + 4], &scratch.b[i..i + 4]);
                total = block::<S, 4>(simd, a, b, p, q, total);
                i += 4;
            }
            let mut inner = simd.reduce_sum_f64s(total);
            if !inner.is_finite() {
                inner = apart::<S, false>(simd, &mut part, k);
            }
            sum += all.weights[j] * all.weights[k] * inner;
        }
        sum
    }
}

/// The sum or maximum of D^2 over i < j and l > k by three operations each.
#[inline(always)]
fn apart<S: pulp::Simd, const MAXIMUM: bool>(simd: S, part: &mut Part<'_>, k: usize) -> f64 {
    let size = part.right(simd, k) * S::F64_LANES;
    part.left_apart(simd, k);
    let scratch = &mut *part.scratch;
    let (p, _) = S::as_simd_f64s(&aligned(&mut scratch.p)[..size]);
    let (q, _) = S::as_simd_f64s(&aligned(&mut scratch.q)[..size]);
    let mut total = simd.splat_f64s(0.0);
    let mut i = 0;
    while i < part.j {
        let (a, b) = (&scratch.a[i..i + 4], &scratch.b[i..i + 4]);
        total = block_apart::<S, MAXIMUM>(simd, a, b, p, q, total);
        i += 4;
    }
    if MAXIMUM {
        simd.reduce_max_f64s(total)
    } else {
        simd.reduce_sum_f64s(total)
    }
}

struct Factored<'a>(Part<'a>);

impl pulp::WithSimd for Factored<'_> {
    type Output = f64;

    /// The sum over i and l is that over i of `|R (A_i, -B_i)|^2`, R the triangular
    /// factor of the columns P and Q.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> f64 {
        let mut part = self.0;
        let (all, j) = (part.all, part.j);
        let zero = simd.splat_f64s(0.0);
        let mut sum = 0.0;
        for k in j + 1..all.m - 1 {
            let size = part.right(simd, k) * S::F64_LANES;
            part.left_apart(simd, k);
            let scratch = &mut *part.scratch;
            let (p, _) = S::as_simd_f64s(&aligned(&mut scratch.p)[..size]);
            let (q, _) = S::as_simd_f64s(&aligned(&mut scratch.q)[..size]);
            let (mut pp, mut pq) = (zero, zero);
            for (&p, &q) in p.iter().zip(q) {
                pp = simd.mul_add_e_f64s(p, p, pp);
                pq = simd.mul_add_e_f64s(p, q, pq);
            }
            let (pp, pq) = (simd.reduce_sum_f64s(pp), simd.reduce_sum_f64s(pq));
            let ratio = if pp > 0.0 { pq / pp } else { 0.0 };
            // What is left of Q, from its entries: a difference of norms would
            // lose half the digits where P and Q are nearly parallel.
            let (along, mut rest) = (simd.splat_f64s(ratio), zero);
            for (&p, &q) in p.iter().zip(q) {
                let d = simd.negate_mul_add_e_f64s(along, p, q);
                rest = simd.mul_add_e_f64s(d, d, rest);
            }
            let rest = simd.reduce_sum_f64s(rest);
            let left = j.next_multiple_of(S::F64_LANES);
            let (a, _) = S::as_simd_f64s(&scratch.a[..left]);
            let (b, _) = S::as_simd_f64s(&scratch.b[..left]);
            let (mut first, mut second) = (zero, zero);
            for (&a, &b) in a.iter().zip(b) {
                let d = simd.mul_add_e_f64s(along, b, a);
                first = simd.mul_add_e_f64s(d, d, first);
                second = simd.mul_add_e_f64s(b, b, second);
            }
            let inner = pp * simd.reduce_sum_f64s(first) + rest * simd.reduce_sum_f64s(second);
            sum += all.weights[j] * all.weights[k] * inner;
        }
        sum
    }
}

struct Maximum<'a>(Part<'a>);

impl pulp::WithSimd for Maximum<'_> {
    type Output = (f64, usize);

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> (f64, usize) {
        let mut part = self.0;
        let mut best = (-1.0, 0);
        for k in part.j + 1..part.all.m - 1 {
            let largest = apart::<S, true>(simd, &mut part, k);
            if largest > best.0 {
                best = (largest, k);
            }
        }
        best
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn track(m: usize, turn: f64) -> (Vec<f64>, Vec<f64>) {
        let (mut east, mut north) = (0.0, 0.0);
        let mut bearings = vec![];
        for k in 0..m {
            let time = 20.0 * k as f64;
            bearings.push((3.0 * time - east).atan2(10_000.0 - time - north));
            let heading: f64 = if k < m / 2 { 0.0 } else { turn };
            east += 100.0 * heading.sin();
            north += 100.0 * heading.cos();
        }
        ((0..m).map(|k| 20.0 * k as f64).collect(), bearings)
    }

    pub(in super::super) fn close(given: f64, wanted: f64, tolerance: f64, what: &str) {
        assert!(
            (given - wanted).abs() <= tolerance * wanted.abs(),
            "{what}: {given} not {wanted}"
        );
    }

    #[test]
    fn every_method_and_path_gives_the_plain_sum() {
        for m in [4, 5, 7, 8, 9, 12, 13, 16, 17, 23, 40] {
            let (times, mut bearings) = track(m, 1.2);
            let weights: Vec<f64> = (0..m).map(|i| 0.5 + (i % 3) as f64).collect();
            // Equal bearings take the other way through the kernel.
            bearings[m - 1] = bearings[0];
            for weights in [None, Some(&weights[..])] {
                let wanted = bearings::discriminant_sum(&times, &bearings, weights).unwrap();
                for path in Path::available() {
                    for method in [Method::Direct, Method::Factored] {
                        let mut all = Quadruples::new(m, method, path);
                        all.load(&times, &bearings, weights).unwrap();
                        let mut parts = vec![0.0; all.parts()];
                        all.run(0..m, Threads::One, &mut parts);
                        let what = alloc::format!("m = {m} {path:?} {method:?}");
                        close(all.total(&parts), wanted, 1e-12, &what);
                    }
                }
                let qr = bearings::discriminant_sum_qr(&times, &bearings, weights).unwrap();
                close(qr, wanted, 1e-11, "QR");
            }
        }
    }

    #[test]
    fn the_sum_does_not_depend_on_the_threads() {
        let (times, bearings) = track(150, 0.7);
        let mut all = Quadruples::new(150, Method::Direct, Path::Best);
        all.load(&times, &bearings, None).unwrap();
        let (mut one, mut many) = (vec![0.0; 150], vec![0.0; 150]);
        all.run(0..150, Threads::One, &mut one);
        all.run(0..150, Threads::Auto, &mut many);
        assert_eq!(one, many);
    }
}
