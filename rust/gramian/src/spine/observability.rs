//! The whole answer for a problem whose size is known only at run time.
//!
//! [`Observability`] reduces rows once and keeps the triangular factor and its
//! spectrum; bounds, null space and the effect of further knowledge follow from
//! these without touching the rows again.

use alloc::vec;
use alloc::vec::Vec;

use crate::numbers::algebra::dot_slices as dot;
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length};
use crate::spectrum;
use crate::square_root::{eliminate, triangularize};

use super::balance::inverse;
use super::parts::{Parts, Rows, column_norms, determined, norm, sort_rows, with_exact};
use super::touch::{self, Touch};
#[cfg(feature = "large")]
use super::{light_rows, parts::First};

/// Rank, spectrum, null space and bounds of rows (K, n).
///
/// What is determined is kept as a root W of the covariance, Cov = W W^T, and what is not
/// as a basis N of the null space, both in states scaled to columns of unit length. Bounds
/// and the effect of further knowledge follow from these two.
///
/// Rows may differ in weight by more than the digits of the number type: a constraint
/// beside measurements. What light rows show that rounding of the heavy ones hides is
/// decided by the rows at one size, so that a row never costs rank.
///
/// # Source
/// As [`Spectrum`](crate::spectrum::Spectrum), the bound as
/// [`crlb_std`](crate::bound::crlb_std), by Householder reflections (Golub & Van Loan,
/// section 5.2) on rows sorted by size (Cox & Higham 1998, "Stability of Householder QR
/// factorization for weighted least squares problems").
#[derive(Clone, Debug)]
pub struct Observability<T> {
    n: usize,
    rtol: T,
    scale: Vec<T>,
    singular_values: Vec<T>,
    parts: Parts<T>,
    touch: Touch<T>,
}

impl<T: Real> Observability<T> {
    /// Analyses `rows` of length `n`, row-major. `rtol` is the relative rank
    /// tolerance on the scaled singular values; by default
    /// [`default_rtol`](spectrum::default_rtol).
    ///
    /// # Errors
    /// [`NumberError::Length`] for rows that are not of length `n` >= 1, [`NumberError`]
    /// for what is not finite, a tolerance that is not in [0, 1), or information that
    /// overflows.
    pub fn new(rows: &[T], n: usize, rtol: Option<T>) -> Result<Self, NumberError> {
        Self::constrained(rows, &[], n, rtol)
    }

    /// The same where the combinations `exact` of the states, rows of length `n`, are
    /// known exactly: a unit quaternion moves only in its tangent.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    ///
    /// ```
    /// use gramian::observability::Observability;
    /// // The sum is measured, the difference known.
    /// let found = Observability::constrained(&[1.0, 1.0], &[1.0, -1.0], 2, None)?;
    /// assert_eq!(found.rank(), 2);
    /// assert!((found.crlb_std()[0] - 0.5_f64).abs() < 1e-15);
    /// # Ok::<(), gramian::scalar::NumberError>(())
    /// ```
    pub fn constrained(
        rows: &[T],
        exact: &[T],
        n: usize,
        rtol: Option<T>,
    ) -> Result<Self, NumberError> {
        Self::inexact(rows, &[], exact, n, rtol)
    }

    /// The same for rows of which no entry is off by more than its place in `errors`, empty
    /// where they are exact: light rows count where they are above their errors.
    ///
    /// # Errors
    /// As [`new`](Self::new); [`NumberError::Length`] for another number of errors.
    ///
    /// ```
    /// use gramian::observability::Observability;
    /// // The second row, far lighter than the first, is an error alone.
    /// let (rows, errors) = ([1e9, 1e9, 1e-3, 2e-3], [1.0, 1.0, 4e-3, 4e-3]);
    /// assert_eq!(Observability::new(&rows, 2, None)?.rank(), 2);
    /// assert_eq!(Observability::inexact(&rows, &errors, &[], 2, Some(1e-9))?.rank(), 1);
    /// # Ok::<(), gramian::scalar::NumberError>(())
    /// ```
    pub fn inexact(
        rows: &[T],
        errors: &[T],
        exact: &[T],
        n: usize,
        rtol: Option<T>,
    ) -> Result<Self, NumberError> {
        check_rows(rows, n)?;
        check_rows(exact, n)?;
        check_errors(errors, rows)?;
        if let Some(rtol) = rtol {
            spectrum::check_rtol(rtol)?;
        }
        let count = rows.len() / n;
        let rtol = rtol.unwrap_or_else(|| spectrum::default_rtol(count, n));
        // As for `SquareRootInformation`: no column's norm overflows then.
        let limit = T::MAX / T::of(2.0 * (n.max(count) as f64));
        if !rows.iter().chain(exact).all(|x| x.abs() <= limit) {
            return Err(OVERFLOW);
        }
        let mut scale = column_norms(rows, n);
        for norm in &mut scale {
            *norm = inverse(*norm);
        }
        let scaled = |rows: &[T]| -> Vec<T> {
            let mut a = rows.to_vec();
            for row in a.chunks_exact_mut(n) {
                for (x, &d) in row.iter_mut().zip(&scale) {
                    *x *= d;
                }
            }
            a
        };
        let (a, errors) = (scaled(rows), scaled(errors));
        let exact = scaled(exact);
        let rows = Rows {
            a: &a,
            errors: &errors,
            exact: &exact,
            n,
            rtol,
            units: &scale,
        };
        let parts = if exact.is_empty() {
            determined(&rows)
        } else {
            with_exact(&rows)
        };
        Self::of_parts(&rows, scale.clone(), parts)
    }

    /// From the spectrum of `rows` with columns multiplied by `scale`, found elsewhere:
    /// singular values `s`, descending, and right vectors `v`, one after the other. `values`
    /// gives singular values of other rows.
    #[cfg(feature = "large")]
    pub(crate) fn of_spectrum(
        rows: &[T],
        errors: &[T],
        rtol: T,
        scale: &[T],
        (s, v): (&[T], &[T]),
        values: &light_rows::Values<'_, T>,
    ) -> Result<Self, NumberError> {
        let n = scale.len();
        check_errors(errors, rows)?;
        let rank = spectrum::rank(s, rtol);
        let scaled = |rows: &[T]| -> Vec<T> {
            let each = |(&x, &d): (&T, &T)| x * d;
            rows.chunks_exact(n)
                .flat_map(|row| row.iter().zip(scale).map(each))
                .collect()
        };
        let (a, errors) = if rank == n {
            (Vec::new(), Vec::new())
        } else {
            (scaled(rows), scaled(errors))
        };
        let rows = Rows {
            a: &a,
            errors: &errors,
            exact: &[],
            n,
            rtol,
            units: scale,
        };
        let ones = vec![T::one(); n];
        let first = First {
            scale: &ones,
            s,
            v,
            rank,
        };
        let parts = if rank == n {
            first.parts(n, rtol)
        } else {
            light_rows::parts(&rows, &first, values)
        };
        Self::of_parts(&rows, scale.to_vec(), parts)
    }

    fn of_parts(
        rows: &Rows<'_, T>,
        scale: Vec<T>,
        mut parts: Parts<T>,
    ) -> Result<Self, NumberError> {
        let (n, rtol) = (rows.n, rows.rtol);
        let touch = touch::decide(rows, &mut parts);
        if !all_finite(&parts.root) || !all_finite(&parts.null) {
            return Err(OVERFLOW);
        }
        let mut singular_values = parts.values.clone();
        singular_values.sort_by(|a, b| b.partial_cmp(a).unwrap_or(core::cmp::Ordering::Equal));
        singular_values.resize(n, T::zero());
        Ok(Self {
            n,
            rtol,
            scale,
            singular_values,
            parts,
            touch,
        })
    }

    /// Number of states.
    pub fn states(&self) -> usize {
        self.n
    }

    /// Number of independent combinations that are determined.
    pub fn rank(&self) -> usize {
        self.parts.rank
    }

    /// Tolerance of the rank decision.
    pub fn rtol(&self) -> T {
        self.rtol
    }

    /// 1 / norm of each column.
    pub fn scale(&self) -> &[T] {
        &self.scale
    }

    /// Singular values of the rows with unit columns, descending; infinite for what is
    /// known exactly. Where light rows show more than they do beside the heavy ones, those
    /// of the rows at one size.
    pub fn singular_values(&self) -> &[T] {
        &self.singular_values
    }

    /// Condition number of the rows with unit columns, among what is not known exactly;
    /// infinite where the rank is short.
    pub fn condition(&self) -> T {
        if self.parts.rank < self.n {
            return T::INFINITY;
        }
        let mut known = self.singular_values.iter().filter(|s| s.is_finite());
        match (known.next(), known.next_back()) {
            (Some(&first), Some(&last)) => first / last,
            _ => T::one(),
        }
    }

    /// Basis of the unobservable combinations in physical units, one after the
    /// other: reduced so that each has a leading state with coefficient 1 which
    /// the others do not contain. Rounding noise is set to zero.
    ///
    /// # Errors
    /// [`NumberError`] where the units of two states differ so much that their
    /// ratio overflows.
    pub fn null_space(&self) -> Result<Vec<Vec<T>>, NumberError> {
        let n = self.n;
        let mut basis: Vec<Vec<T>> = self.parts.null.chunks_exact(n).map(<[T]>::to_vec).collect();
        // Dividing by a lead of a tenth makes the rounding ten times larger.
        let noise = |i: usize| (self.touch.error[i] * T::of(10.0)).min(T::of(1e-2));
        let moved = column_norms(&self.parts.null, n);
        let mut pivots = Vec::new();
        let mut taken = vec![false; n];
        for k in 0..basis.len() {
            // The first state that has a fair share leads: the combination then
            // reads in the order of the states, and rounding does not decide.
            let mut share = vec![T::zero(); n];
            for vector in &basis[k..] {
                for (s, x) in share.iter_mut().zip(vector) {
                    *s = (*s).max(x.abs());
                }
            }
            let largest = (0..n)
                .filter(|&i| !taken[i])
                .fold(T::zero(), |a, i| a.max(share[i]));
            let fair = largest * T::of(0.1);
            let Some(pivot) = (0..n).find(|&i| !taken[i] && share[i] >= fair) else {
                continue;
            };
            let mut r = k;
            for row in k..basis.len() {
                if basis[row][pivot].abs() > basis[r][pivot].abs() {
                    r = row;
                }
            }
            basis.swap(k, r);
            pivots.push(pivot);
            taken[pivot] = true;
            let lead = basis[k][pivot];
            if lead == T::zero() {
                continue;
            }
            for value in &mut basis[k] {
                *value /= lead;
            }
            let leader = basis[k].clone();
            for (other, vector) in basis.iter_mut().enumerate() {
                let factor = vector[pivot];
                if other != k && factor != T::zero() {
                    for (value, &l) in vector.iter_mut().zip(&leader) {
                        *value -= factor * l;
                    }
                }
            }
        }
        // A state that moves stays in at least one of them.
        let largest = |i: usize| basis.iter().fold(T::zero(), |m: T, v| m.max(v[i].abs()));
        let kept: Vec<T> = (0..n)
            .map(|i| match largest(i) {
                most if most <= noise(i) && moved[i] > T::zero() => most * T::of(0.5),
                _ => noise(i),
            })
            .collect();
        for (vector, &pivot) in basis.iter_mut().zip(&pivots) {
            for (i, value) in vector.iter_mut().enumerate() {
                *value = if value.abs() <= kept[i] && i != pivot {
                    T::zero()
                } else {
                    *value * self.scale[i] / self.scale[pivot]
                };
            }
        }
        basis
            .into_iter()
            .map(|vector| finite("null space", vector))
            .collect()
    }

    /// The longest axis of the error ellipsoid in scaled states, among what is
    /// determined: how far each state moves along it at one standard deviation.
    ///
    /// # Errors
    /// [`NumberError`] where that overflows.
    pub fn weakest_direction(&self) -> Result<Vec<T>, NumberError> {
        let n = self.n;
        let Some(axis) = self.parts.root.chunks_exact(n).nth(self.parts.weakest) else {
            return Ok(vec![T::zero(); n]);
        };
        let direction = axis.iter().zip(&self.scale).map(|(&w, &d)| w * d).collect();
        finite("weakest direction", direction)
    }

    /// The `count` longest axes of the error ellipsoid in physical units, the longest
    /// first; one that is not determined at all has the length that a singular value of
    /// 1e-12 of the largest would give it.
    pub fn longest_axes(&self, count: usize) -> Vec<Vec<T>> {
        let n = self.n;
        let largest = self
            .singular_values
            .iter()
            .find(|s| s.is_finite())
            .copied()
            .unwrap_or_else(T::one);
        let open = T::of(1e12) / largest.max(T::EPSILON);
        let null = self.parts.null.chunks_exact(n).map(|v| (open, v));
        let mut known: Vec<(T, &[T])> = self
            .parts
            .root
            .chunks_exact(n)
            .map(|axis| (T::one(), axis))
            .collect();
        known.sort_by(|a, b| {
            norm(b.1)
                .partial_cmp(&norm(a.1))
                .unwrap_or(core::cmp::Ordering::Equal)
        });
        null.chain(known)
            .take(count)
            .map(|(length, axis)| {
                let physical = axis.iter().zip(&self.scale).map(|(&x, &d)| length * x * d);
                physical.collect()
            })
            .collect()
    }

    /// States of which the accuracy of the rows leaves open whether an unobservable
    /// combination moves them; their bounds are infinite. Empty for rows without errors.
    pub fn undecided(&self) -> Vec<usize> {
        let flags = self.touch.undecided.iter().enumerate();
        flags.filter_map(|(i, &open)| open.then_some(i)).collect()
    }

    /// Standard deviation of each state at the bound, infinite where an
    /// unobservable combination touches it, or may do so, or it overflows.
    pub fn crlb_std(&self) -> Vec<T> {
        self.deviations(&self.parts.root, &self.parts.null)
    }

    /// Deviations of each state from the root of a covariance and a null space, in physical
    /// units.
    fn deviations(&self, root: &[T], null: &[T]) -> Vec<T> {
        let (spread, open) = (column_norms(root, self.n), column_norms(null, self.n));
        let unknown = |i: usize| {
            open[i] > self.touch.error[i] || (self.touch.undecided[i] && !null.is_empty())
        };
        (0..self.n)
            .map(|i| {
                let std = self.scale[i] * spread[i];
                // Not NaN, where what is hardly open was tied by a number too large.
                if unknown(i) || !(std >= T::zero()) {
                    T::INFINITY
                } else {
                    std
                }
            })
            .collect()
    }

    /// Whether a combination of unit length, of which the null space sees `open`, moves with
    /// what is not determined.
    fn moves(&self, unit: &[T], open: &[T]) -> bool {
        norm(open) > self.off(unit, &|_| true).min(self.parts.touch)
    }

    /// Whether the accuracy of the rows leaves open if a combination moves, of which the root
    /// of the covariance sees `along`.
    fn may_move(&self, unit: &[T], along: &[T]) -> bool {
        let undecided = |i: usize| self.touch.undecided[i];
        self.off(unit, &undecided) > norm(along) * T::of(touch::ACCURATE)
    }

    /// By how much the part of a combination in the null space may be off, of some states.
    fn off(&self, unit: &[T], of: &dyn Fn(usize) -> bool) -> T {
        let each = unit.iter().zip(&self.touch.error).enumerate();
        each.filter(|(i, _)| of(*i))
            .fold(T::zero(), |sum, (_, (c, &error))| sum + c.abs() * error)
    }

    /// The bound on the covariance, `None` where the rank is short, or an entry
    /// overflows.
    pub fn crlb(&self) -> Option<Vec<T>> {
        let n = self.n;
        if self.parts.rank < n {
            return None;
        }
        let mut out = vec![T::zero(); n * n];
        for axis in self.parts.root.chunks_exact(n) {
            for i in 0..n {
                for j in 0..=i {
                    out[i * n + j] += axis[i] * axis[j];
                }
            }
        }
        for i in 0..n {
            for j in 0..=i {
                let value = out[i * n + j] * self.scale[i] * self.scale[j];
                out[i * n + j] = value;
                out[j * n + i] = value;
            }
        }
        all_finite(&out).then_some(out)
    }

    /// Vectors whose squares w w^T sum to the bound on the covariance, one after the other,
    /// the longest first: its root without a square, so that short axes beside long ones
    /// keep their digits. `None` where the rank is short, or an entry overflows.
    pub fn crlb_root(&self) -> Option<Vec<T>> {
        if self.parts.rank < self.n {
            return None;
        }
        let mut axes: Vec<&[T]> = self.parts.root.chunks_exact(self.n).collect();
        axes.sort_by(|a, b| {
            norm(b)
                .partial_cmp(&norm(a))
                .unwrap_or(core::cmp::Ordering::Equal)
        });
        let scaled = |axis: &&[T]| -> Vec<T> {
            let each = axis.iter().zip(&self.scale);
            each.map(|(&x, &d)| x * d).collect()
        };
        let out: Vec<T> = axes.iter().flat_map(scaled).collect();
        all_finite(&out).then_some(out)
    }

    /// log det of the information; minus infinity where the rank is short, plus infinity
    /// where something is known exactly.
    pub fn log_det(&self) -> T {
        if self.parts.rank < self.n {
            return -T::INFINITY;
        }
        let log = self
            .scale
            .iter()
            .fold(self.parts.log, |sum, &d| sum - d.ln());
        log + log
    }

    /// The bound on the standard deviation of the combination c^T x; infinite where
    /// there is none.
    ///
    /// # Errors
    /// [`NumberError::Length`], [`NumberError`].
    pub fn combination_std(&self, combination: &[T]) -> Result<T, NumberError> {
        let (unit, along, open, length) = self.seen(combination)?;
        if self.moves(&unit, &open) || self.may_move(&unit, &along) {
            return Ok(T::INFINITY);
        }
        let std = norm(&along) * length;
        // Not NaN.
        if std >= T::zero() {
            return Ok(std);
        }
        Err(NumberError::Overflow {
            result: "combination",
        })
    }

    /// A combination in scaled states, c of unit length, with W^T c, N^T c and its length.
    #[allow(clippy::type_complexity)]
    fn seen(&self, combination: &[T]) -> Result<(Vec<T>, Vec<T>, Vec<T>, T), NumberError> {
        let n = self.n;
        check_length("combination", combination.len(), n)?;
        check_finite("combination", combination)?;
        let scaled: Vec<T> = combination
            .iter()
            .zip(&self.scale)
            .map(|(&c, &d)| c * d)
            .collect();
        let scaled = finite("combination", scaled)?;
        let length = norm(&scaled);
        if length == T::zero() {
            return Ok((Vec::new(), Vec::new(), Vec::new(), length));
        }
        let unit: Vec<T> = scaled.iter().map(|&c| c / length).collect();
        let along = self.parts.root.chunks_exact(n).map(|w| dot(w, &unit));
        let open = self.parts.null.chunks_exact(n).map(|v| dot(v, &unit));
        let (along, open) = (along.collect(), open.collect());
        Ok((unit, along, open, length))
    }

    /// The answer once the combination c^T x is also known to `sigma`; with
    /// `sigma` 0, exactly. Gives rank (of n) and standard deviations then.
    ///
    /// # Errors
    /// [`NumberError::Length`]; [`NumberError`] for what is not finite, a deviation below
    /// zero, or information that overflows.
    ///
    /// # Source
    /// Potter's square root of the measurement update (Bierman 1977, chapter II).
    pub fn knowing(&self, combination: &[T], sigma: T) -> Result<(usize, Vec<T>), NumberError> {
        let n = self.n;
        if !(sigma >= T::zero() && sigma.is_finite()) {
            return Err(NumberError::OutOfRange {
                name: "sigma",
                given: sigma.double(),
                allowed: ">= 0 and finite",
            });
        }
        let (unit, along, open, length) = self.seen(combination)?;
        if length == T::zero() {
            return Ok((self.parts.rank, self.crlb_std()));
        }
        let sigma = finite("sigma", vec![sigma / length])?[0];
        let free = norm(&open);
        let (mut root, mut null) = (self.parts.root.clone(), self.parts.null.clone());
        if self.moves(&unit, &open) {
            // What was open along c is now tied to it: c^T x = sigma e.
            let unit: Vec<T> = open.iter().map(|&a| a / free).collect();
            let mut direction = vec![T::zero(); n];
            for (vector, &u) in null.chunks_exact(n).zip(&unit) {
                for (d, &x) in direction.iter_mut().zip(vector) {
                    *d += u * x;
                }
            }
            for (axis, &a) in root.chunks_exact_mut(n).zip(&along) {
                for (w, &d) in axis.iter_mut().zip(&direction) {
                    *w -= a / free * d;
                }
            }
            if sigma > T::zero() {
                root.extend(direction.iter().map(|&d| d * sigma / free));
            }
            // The rest of the null space: orthogonal to that direction.
            let reflection = reflection_to_first_axis(&unit);
            let p = unit.len();
            let mut rest = vec![T::zero(); (p - 1) * n];
            for (k, out) in rest.chunks_exact_mut(n).enumerate() {
                for (j, vector) in null.chunks_exact(n).enumerate() {
                    let h = reflection[j * p + k + 1];
                    for (o, &x) in out.iter_mut().zip(vector) {
                        *o += h * x;
                    }
                }
            }
            null = rest;
            let mut std = self.deviations(&root, &null);
            if sigma == T::zero() {
                // What is known exactly leaves rounding of what cancels.
                let before = column_norms(&self.parts.root, n);
                let tied = norm(&along) / free;
                for i in 0..n {
                    let size = before[i] + tied * direction[i].abs();
                    if std[i] <= self.scale[i] * size * T::EPSILON * T::of(32.0) {
                        std[i] = T::zero();
                    }
                }
            }
            return Ok((self.parts.rank + 1, std));
        }
        let spread = norm(&along);
        if spread > T::zero() {
            let unit: Vec<T> = along.iter().map(|&a| a / spread).collect();
            let share = crate::scalar::hypot(spread, sigma);
            // 1 - sqrt(sigma^2 / (spread^2 + sigma^2)), without cancelling.
            let factor = (spread / share) * (spread / (share + sigma));
            let mut moved = vec![T::zero(); n];
            for (axis, &u) in root.chunks_exact(n).zip(&unit) {
                for (m, &w) in moved.iter_mut().zip(axis) {
                    *m += u * w;
                }
            }
            for (axis, &u) in root.chunks_exact_mut(n).zip(&unit) {
                for (w, &m) in axis.iter_mut().zip(&moved) {
                    *w -= factor * u * m;
                }
            }
        }
        let mut std = self.deviations(&root, &null);
        if sigma == T::zero() {
            // What is known exactly leaves rounding.
            for (out, &before) in std.iter_mut().zip(&self.crlb_std()) {
                if *out < before * T::EPSILON * T::of(32.0) {
                    *out = T::zero();
                }
            }
        }
        Ok((self.parts.rank, std))
    }

    /// Leverage a Cov a^T of each of `rows`: 1 for a row without which the rank falls,
    /// near 0 for one that others repeat.
    ///
    /// # Errors
    /// [`NumberError::Length`], [`NumberError`].
    ///
    /// # Source
    /// Hoaglin & Welsch 1978, "The hat matrix in regression and ANOVA", Am. Stat. 32.
    pub fn leverage(&self, rows: &[T]) -> Result<Vec<T>, NumberError> {
        check_rows(rows, self.n)?;
        rows.chunks_exact(self.n)
            .map(|row| {
                let (_, along, _, length) = self.seen(row)?;
                let lever = norm(&along) * length;
                Ok((lever * lever).min(T::one()))
            })
            .collect()
    }

    /// Standard deviations without one of the rows that were analysed; `None` where the
    /// rank falls without it.
    ///
    /// # Errors
    /// [`NumberError::Length`], [`NumberError`].
    ///
    /// # Source
    /// Sherman & Morrison 1950; Ann. Math. Stat. 21.
    pub fn without(&self, row: &[T]) -> Result<Option<Vec<T>>, NumberError> {
        let n = self.n;
        let (_, along, _, length) = self.seen(row)?;
        let spread = norm(&along);
        let lever = spread * length;
        let left = T::one() - lever * lever;
        if left <= self.rtol.sqrt() * T::of(1e-2) {
            return Ok(None);
        }
        let mut moved = vec![T::zero(); n];
        for (axis, &a) in self.parts.root.chunks_exact(n).zip(&along) {
            for (m, &w) in moved.iter_mut().zip(axis) {
                *m += a * length * w;
            }
        }
        let std = self.crlb_std();
        let grown = std
            .iter()
            .zip(&moved)
            .zip(&self.scale)
            .map(|((&s, &m), &d)| {
                if s.is_finite() {
                    crate::scalar::hypot(s, m * d / left.sqrt())
                } else {
                    s
                }
            });
        Ok(Some(grown.collect()))
    }
}

const OVERFLOW: NumberError = NumberError::Overflow {
    result: "information",
};

/// As many errors as rows have entries, or none, each finite and not negative.
fn check_errors<T: Real>(errors: &[T], rows: &[T]) -> Result<(), NumberError> {
    if !errors.is_empty() {
        check_length("errors", errors.len(), rows.len())?;
        check_finite("errors", errors)?;
    }
    Ok(())
}

/// Rows with the information that is left once random errors of their entries, of
/// deviation `sigma` in each column, are taken out: nothing along directions that such
/// errors alone would show.
///
/// # Errors
/// [`NumberError`], [`NumberError::Length`].
///
/// # Source
/// Errors in variables: Fuller 1987, Measurement Error Models, section 2.2. The largest
/// singular value of noise: Davidson & Szarek 2001.
pub fn without_noise<T: Real>(rows: &[T], n: usize, sigma: &[T]) -> Result<Vec<T>, NumberError> {
    check_rows(rows, n)?;
    check_length("row_sigma", sigma.len(), n)?;
    check_finite("row_sigma", sigma)?;
    let count = rows.len() / n;
    let norms = column_norms(rows, n);
    // A column without errors counts as one with hardly any.
    let unit: Vec<T> = sigma
        .iter()
        .zip(&norms)
        .map(|(&sigma, &norm)| {
            let least = norm * T::EPSILON;
            if sigma > least {
                sigma
            } else if least > T::zero() {
                least
            } else {
                T::one()
            }
        })
        .collect();
    let mut a = rows.to_vec();
    for row in a.chunks_exact_mut(n) {
        for (x, &u) in row.iter_mut().zip(&unit) {
            *x /= u;
        }
    }
    let (s, v) = singular_values(&a, n)?;
    let many = T::of(count as f64);
    // Exceeded by noise alone once in three thousand times.
    let edge = many.sqrt() + T::of(n as f64).sqrt() + T::of(4.0);
    let mut out = Vec::new();
    let short = s.iter().any(|&s| s <= edge);
    for (k, &s) in s.iter().enumerate() {
        if s > edge {
            let left = (s - many.sqrt()) * (s + many.sqrt());
            let left = left.sqrt();
            // By so much the noise turns a direction towards those that are dropped.
            let turned = if short { edge / s } else { T::zero() };
            out.extend(v[k * n..(k + 1) * n].iter().zip(&unit).map(|(&x, &u)| {
                if x.abs() <= turned {
                    T::zero()
                } else {
                    x * u * left
                }
            }));
        }
    }
    finite("rows", out)
}

/// Singular values (descending) of `rows` of length `n` as they are, without a scale,
/// and their right singular vectors, vector j at `j*n..(j+1)*n`.
///
/// # Errors
/// As [`Observability::new`].
///
/// ```
/// let (values, _) = gramian::observability::singular_values(&[3.0, 0.0, 0.0, 4.0], 2).unwrap();
/// assert_eq!(values, [4.0, 3.0]);
/// ```
pub fn singular_values<T: Real>(rows: &[T], n: usize) -> Result<(Vec<T>, Vec<T>), NumberError> {
    check_rows(rows, n)?;
    let limit = T::MAX / T::of(2.0 * (n.max(rows.len() / n) as f64));
    if !rows.iter().all(|x| x.abs() <= limit) {
        return Err(OVERFLOW);
    }
    let mut factor = sort_rows(rows, n);
    factor.resize((rows.len() / n).max(n) * n, T::zero());
    triangularize(&mut factor, n, &mut vec![T::zero(); n]);
    factor.truncate(n * n);
    let (mut values, mut vectors) = (vec![T::zero(); n], vec![T::zero(); n * n]);
    let (ones, mut work) = (vec![T::one(); n], vec![T::zero(); n * n]);
    spectrum::decompose(&factor, n, &ones, &mut values, &mut vectors, &mut work);
    Ok((finite("singular values", values)?, vectors))
}

/// The rows on the states from `eliminated` on, when nothing is known of those
/// before: the Schur complement of the information, found without forming it. States
/// that are not determined at all take no information with them.
///
/// # Errors
/// As [`Observability::new`]; [`NumberError::Length`] where no state would be left.
///
/// ```
/// // Two rows on (x, y): without x one is left, on y alone.
/// let left = gramian::observability::marginal_rows(&[1.0, 1.0, 1.0, -1.0_f64], 2, 1, None);
/// assert!((left.unwrap()[0][0].abs() - 2.0_f64.sqrt()).abs() < 1e-15);
/// ```
pub fn marginal_rows<T: Real>(
    rows: &[T],
    n: usize,
    eliminated: usize,
    rtol: Option<T>,
) -> Result<Vec<Vec<T>>, NumberError> {
    check_rows(rows, n)?;
    if eliminated > n {
        check_length("eliminated", eliminated, n)?;
    }
    let rtol = rtol.unwrap_or_else(|| spectrum::default_rtol(rows.len() / n, n));
    spectrum::check_rtol(rtol)?;
    let (mut a, mut work) = (rows.to_vec(), vec![T::zero(); n + eliminated]);
    // Rounding of a column must not pass for a light row.
    let rounding: Vec<T> = column_norms(rows, n)
        .iter()
        .map(|&norm| norm * T::EPSILON * T::of(64.0))
        .collect();
    let rank = eliminate(&mut a, n, eliminated, rtol, &mut work);
    a.chunks_exact(n)
        .skip(rank)
        .map(|row| {
            let left = row[eliminated..].iter().zip(&rounding[eliminated..]);
            let left = left.map(|(&x, &r)| if x.abs() <= r { T::zero() } else { x });
            finite("rows", left.collect())
        })
        .collect()
}

fn finite<T: Real>(result: &'static str, values: Vec<T>) -> Result<Vec<T>, NumberError> {
    if all_finite(&values) {
        Ok(values)
    } else {
        Err(NumberError::Overflow { result })
    }
}

fn check_rows<T: Real>(rows: &[T], n: usize) -> Result<(), NumberError> {
    let length = n.max(1);
    check_length("states", n, length)?;
    check_length("rows", rows.len(), rows.len().next_multiple_of(length))?;
    check_finite("rows", rows)
}

/// The symmetric orthogonal matrix that takes `c` to the first axis.
fn reflection_to_first_axis<T: Real>(c: &[T]) -> Vec<T> {
    let n = c.len();
    let length = c
        .iter()
        .fold(T::zero(), |norm, &x| crate::scalar::hypot(norm, x));
    let mut h = vec![T::zero(); n * n];
    for i in 0..n {
        h[i * n + i] = T::one();
    }
    if length == T::zero() {
        return h;
    }
    let mut u: Vec<T> = c.iter().map(|&x| x / length).collect();
    let sign = if u[0] < T::zero() {
        -T::one()
    } else {
        T::one()
    };
    u[0] += sign;
    let squared = u.iter().fold(T::zero(), |sum, &x| sum + x * x);
    let two = T::one() + T::one();
    for i in 0..n {
        for j in 0..n {
            h[i * n + j] -= two * u[i] * u[j] / squared;
        }
    }
    h
}
