//! The posterior Cramer-Rao bound of a state that moves, as a recursion on
//! triangular factors.
//!
//! Textbooks write the recursion in information matrices and invert the process
//! noise, which loses every digit when that noise is small. Here neither the
//! information J nor the covariance P is formed. One factor is kept,
//! P = C^T C or J = R^T R, and everything is done to it by orthogonal
//! transformations; in a batch without square roots, as C = D^(1/2) V. Two primitives
//! serve both forms:
//!
//! | | `absorb`: rows are added | `update_inverse`: a row is measured |
//! |---|---|---|
//! | [`Form::Covariance`] | process noise: P + G G^T | measurement: (P^-1 + h h^T)^-1 |
//! | [`Form::Information`] | measurement: J + h h^T | process noise: (J^-1 + g g^T)^-1 |
//!
//! The covariance form needs a finite prior and takes any transition; the
//! information form needs a transition that can be inverted and takes any prior,
//! none included. Noise that is singular, or absent, is nothing special in either.
//!
//! # Source
//! Tichavsky, Muravchik & Nehorai 1998, "Posterior Cramer-Rao bounds for
//! discrete-time nonlinear filtering"; as eqs. (4) and (5) in Xu et al. 2009.
//! `update_inverse` is Carlson's triangular measurement update (1973).

use crate::bound::crlb_std;
use crate::constrained::{ConstrainedInformation, clean};
use crate::numbers::lane::Lane;
use crate::scalar::{NumberError, Real, check_finite, check_length};
use crate::spectrum::Spectrum;
use crate::square_root::SquareRootInformation;

/// Which matrix the factor is a root of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// P = C^T C.
    Covariance,
    /// J = R^T R.
    Information,
}

/// Replaces the upper triangular factor of M by that of (M^-1 + h h^T)^-1, that
/// is of M - M h h^T M / (1 + h^T M h), without a subtraction that cancels.
///
/// `work` holds at least n numbers.
///
/// # Source
/// Carlson 1973, "Fast triangular formulation of the square root filter". Rows
/// are rotated from the last to the first, which keeps the triangle.
#[inline(always)]
pub(crate) fn update_inverse<L: Lane>(root: &mut [L], n: usize, h: &[L], work: &mut [L]) {
    let zero = root[0].splat(0.0);
    let q = &mut work[..n];
    q.fill(zero);
    let mut sum = zero.splat(1.0);
    let mut before = sum;
    for i in (0..n).rev() {
        let mut a = root[i * n + i] * h[i];
        for j in i + 1..n {
            a = root[i * n + j].mul_add(h[j], a);
        }
        sum = a.mul_add(a, sum);
        // The square root is at least 1.
        let after = sum.sqrt();
        let inverse = after.recip();
        let (c, s) = (before * inverse, a * inverse);
        before = after;
        for j in i..n {
            let x = root[i * n + j];
            root[i * n + j] = s.negate_mul_add(q[j], c * x);
            q[j] = s.mul_add(x, c * q[j]);
        }
    }
}

/// The upper triangular factor of a covariance that may be singular:
/// covariance = out^T out, all n x n, row-major.
///
/// # Errors
/// [`Error::Asymmetric`] and [`Error::Indefinite`], with the place; [`Error::Number`]
/// for an entry that is not finite; [`NumberError::Length`] for slices that are not n x n.
pub fn semidefinite_root<T: Real>(covariance: &[T], n: usize, out: &mut [T]) -> Result<(), Error> {
    for (array, given) in [("covariance", covariance.len()), ("out", out.len())] {
        check_length(array, given, n.saturating_mul(n))?;
    }
    check_finite("covariance", covariance)?;
    for j in 0..n {
        for i in 0..j {
            let (above, below) = (covariance[i * n + j], covariance[j * n + i]);
            let size = above.abs().max(below.abs());
            // Symmetric to half the digits: what a product of matrices leaves.
            if (above - below).abs() > size * T::EPSILON.sqrt() {
                return Err(Error::Asymmetric { row: i, column: j });
            }
        }
        if covariance[j * n + j] < T::zero() {
            return Err(Error::Indefinite { index: j });
        }
    }
    let slack = T::EPSILON * T::of(16.0 * n as f64);
    if !definite_root(covariance, n, slack, out) {
        pivoted_root(covariance, n, slack, out)?;
    }
    Ok(())
}

/// The factor of a covariance whose every state has a variance of its own, given
/// those before it; false where one has none left.
fn definite_root<T: Real>(covariance: &[T], n: usize, slack: T, out: &mut [T]) -> bool {
    out[..n * n].fill(T::zero());
    for j in 0..n {
        let diagonal = covariance[j * n + j];
        let mut pivot = diagonal;
        for i in 0..j {
            pivot -= out[i * n + j] * out[i * n + j];
        }
        // NaN too: of an entry far larger than its variances allow.
        if !(pivot > slack * diagonal) {
            return false;
        }
        let root = pivot.sqrt();
        out[j * n + j] = root;
        for k in j + 1..n {
            let mut rest = covariance[j * n + k];
            for i in 0..j {
                rest -= out[i * n + j] * out[i * n + k];
            }
            out[j * n + k] = rest / root;
        }
    }
    true
}

/// The factor of any covariance: the state with the largest part of its variance
/// left goes next, so that rounding never grows into a variance below zero.
///
/// # Source
/// Higham, Accuracy and Stability of Numerical Algorithms, section 10.3.
fn pivoted_root<T: Real>(covariance: &[T], n: usize, slack: T, out: &mut [T]) -> Result<(), Error> {
    out[..n * n].fill(T::zero());
    // What the first `rank` rows leave of an entry.
    let rest = |out: &[T], rank: usize, i: usize, j: usize| {
        let mut left = covariance[i.min(j) * n + i.max(j)];
        for row in out[..rank * n].chunks_exact(n) {
            left -= row[i] * row[j];
        }
        left
    };
    let mut rank = 0;
    while rank < n {
        let mut next = (T::zero(), 0);
        for j in 0..n {
            let diagonal = covariance[j * n + j];
            if diagonal == T::zero() {
                continue;
            }
            let part = rest(out, rank, j, j) / diagonal;
            // NaN too: of an entry far larger than its variances allow.
            if !(part >= -slack) {
                return Err(Error::Indefinite { index: j });
            }
            if part > next.0 {
                next = (part, j);
            }
        }
        let (part, pivot) = next;
        if part <= slack {
            break;
        }
        let root = (part * covariance[pivot * n + pivot]).sqrt();
        for k in 0..n {
            out[rank * n + k] = rest(out, rank, pivot, k) / root;
        }
        out[rank * n + pivot] = root;
        rank += 1;
    }
    for k in 0..n {
        for j in 0..k {
            let (a, b) = (covariance[j * n + j], covariance[k * n + k]);
            let allowed = (slack + slack) * (a.sqrt() * b.sqrt());
            if !(rest(out, rank, j, k).abs() <= allowed) {
                return Err(Error::Indefinite { index: k });
            }
        }
    }
    // Rows in the order of the pivots: rotated into a triangle.
    for row in 1..n {
        let (triangle, tail) = out.split_at_mut(row * n);
        for (k, upper) in triangle.chunks_exact_mut(n).enumerate() {
            let (a, b) = (upper[k], tail[k]);
            if b == T::zero() {
                continue;
            }
            let h = crate::scalar::hypot(a, b);
            let (c, s) = (a / h, b / h);
            for j in k..n {
                let (x, y) = (upper[j], tail[j]);
                upper[j] = c * x + s * y;
                tail[j] = c * y - s * x;
            }
            tail[k] = T::zero();
        }
    }
    Ok(())
}

/// A state of fixed size and what is known of it: the recursion without
/// allocation, in information form.
///
/// # Source
/// Tichavsky, Muravchik & Nehorai 1998; Xu et al. 2009, eqs. (4) and (5).
///
/// ```
/// use gramian::posterior::Posterior;
/// // A position and a velocity; only the position is measured, to 1 m.
/// let mut bound = Posterior::<f64, 2>::unknown();
/// bound.update(&[1.0, 0.0])?;
/// assert!(bound.standard_deviations()[1].is_infinite());
/// // x' = x + v: the inverse transition, and no process noise.
/// bound.predict(&[[1.0, -1.0], [0.0, 1.0]], &[])?;
/// bound.update(&[1.0, 0.0])?;
/// let [position, velocity] = bound.standard_deviations();
/// assert!((position - 1.0).abs() < 1e-15 && (velocity - 2.0_f64.sqrt()).abs() < 1e-15);
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posterior<T: Real, const N: usize> {
    root: SquareRootInformation<T, N>,
}

impl<T: Real, const N: usize> Posterior<T, N> {
    /// Nothing is known.
    pub fn unknown() -> Self {
        Self {
            root: SquareRootInformation::new(),
        }
    }

    /// Takes in one whitened measurement row, or a row of prior knowledge.
    ///
    /// # Errors
    /// As [`SquareRootInformation::push`]; the row is not taken in then.
    pub fn update(&mut self, row: &[T; N]) -> Result<(), NumberError> {
        self.root.push(row)
    }

    /// Moves the state: x' = F x + sum of g w, with `inverse` = F^-1, `noise` the
    /// vectors g and w of unit variance.
    ///
    /// # Errors
    /// [`NumberError::NotFinite`] with the entry, row by row, of `inverse` or
    /// `noise`; [`NumberError::Overflow`] where the information moved
    /// overflows. The state is not moved then.
    pub fn predict(&mut self, inverse: &[[T; N]; N], noise: &[[T; N]]) -> Result<(), NumberError> {
        check_finite("inverse", inverse.as_flattened())?;
        check_finite("noise", noise.as_flattened())?;
        let mut work = [[T::zero(); N]; N];
        let mut moved = SquareRootInformation::new();
        for row in self.root.factor() {
            let mut out = [T::zero(); N];
            for j in 0..N {
                for k in 0..N {
                    out[k] += row[j] * inverse[j][k];
                }
            }
            moved.absorb(&out);
        }
        let mut factor = *moved.factor();
        for g in noise {
            update_inverse(factor.as_flattened_mut(), N, g, work.as_flattened_mut());
        }
        let mut root = SquareRootInformation::new();
        for row in &factor {
            root.absorb(row);
        }
        self.root = root.sound()?;
        Ok(())
    }

    /// The triangular factor of the information.
    pub fn root(&self) -> &SquareRootInformation<T, N> {
        &self.root
    }

    /// The bound on each state; infinite where it is not determined, or
    /// overflows.
    pub fn standard_deviations(&self) -> [T; N] {
        crlb_std(&Spectrum::new(&self.root))
    }
}

/// A [`Posterior`] beside exact knowledge: sigma 0, an equality constraint, the normal of a
/// surface. Process noise ends what it moves, and nothing else.
///
/// # Source
/// As [`Posterior`]; exact knowledge as in [`ConstrainedInformation`].
///
/// ```
/// use gramian::posterior::ConstrainedPosterior;
/// // A position and a velocity; the position is known exactly, twice.
/// let mut bound = ConstrainedPosterior::<f64, 2>::unknown();
/// let inverse = [[1.0, -1.0], [0.0, 1.0]];
/// bound.know(&[1.0, 0.0])?;
/// bound.predict(&inverse, &[])?;
/// assert!(bound.standard_deviations()[0].is_infinite());
/// bound.know(&[1.0, 0.0])?;
/// assert_eq!(bound.standard_deviations(), [0.0, 0.0]);
/// // The velocity is disturbed, and with it all that follows.
/// bound.predict(&inverse, &[[0.0, 0.5]])?;
/// assert_eq!(bound.standard_deviations(), [0.0, 0.5]);
/// bound.predict(&inverse, &[])?;
/// assert_eq!(bound.standard_deviations(), [0.5, 0.5]);
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConstrainedPosterior<T: Real, const N: usize> {
    information: ConstrainedInformation<T, N>,
}

impl<T: Real, const N: usize> ConstrainedPosterior<T, N> {
    /// Nothing is known.
    #[must_use]
    pub fn unknown() -> Self {
        Self {
            information: ConstrainedInformation::new(),
        }
    }

    /// Takes in one whitened measurement row, or a row of prior knowledge.
    ///
    /// # Errors
    /// As [`ConstrainedInformation::push`]; the row is not taken in then.
    pub fn update(&mut self, row: &[T; N]) -> Result<(), NumberError> {
        self.information.push(row)
    }

    /// Takes in a combination of the states that is known exactly.
    ///
    /// # Errors
    /// As [`ConstrainedInformation::know`]; nothing is taken in then.
    pub fn know(&mut self, combination: &[T; N]) -> Result<(), NumberError> {
        self.information.know(combination)
    }

    /// Moves the state: x' = F x + sum of g w, with `inverse` = F^-1, `noise` the
    /// vectors g and w of unit variance.
    ///
    /// # Errors
    /// As [`Posterior::predict`]. The state is not moved then.
    pub fn predict(&mut self, inverse: &[[T; N]; N], noise: &[[T; N]]) -> Result<(), NumberError> {
        check_finite("inverse", inverse.as_flattened())?;
        check_finite("noise", noise.as_flattened())?;
        let back = |row: &[T; N]| -> [T; N] {
            core::array::from_fn(|k| clean((0..N).map(|j| row[j] * inverse[j][k]), N))
        };
        let mut exact = [[T::zero(); N]; N];
        let mut count = 0;
        for combination in self.information.combinations() {
            exact[count] = back(&combination);
            count += 1;
        }
        let before = *self.information.root();
        let mut moved = SquareRootInformation::new();
        for (state, row) in before.factor().iter().enumerate() {
            if !self.information.is_held(state) {
                moved.absorb(&back(row));
            }
        }
        let mut work = [[T::zero(); N]; N];
        for g in noise {
            // The exact combination that this noise moves most, beside its terms.
            let along = |row: &[T; N]| clean((0..N).map(|j| row[j] * g[j]), N);
            let part = |row: &[T; N]| {
                let size = (0..N).fold(T::zero(), |sum, j| sum + (row[j] * g[j]).abs());
                let moved = along(row).abs();
                if moved > T::zero() {
                    moved / size
                } else {
                    moved
                }
            };
            let mut most = (T::zero(), count);
            for (q, row) in exact[..count].iter().enumerate() {
                if part(row) > most.0 {
                    most = (part(row), q);
                }
            }
            if most.1 == count {
                let mut factor = *moved.factor();
                update_inverse(factor.as_flattened_mut(), N, g, work.as_flattened_mut());
                moved = SquareRootInformation::new();
                for row in &factor {
                    moved.absorb(row);
                }
                continue;
            }
            // That combination told the noise: the others, and the rows, without it.
            let by = exact[most.1];
            let one = T::one() / along(&by);
            let without = |row: &[T; N]| -> [T; N] {
                let share = along(row) * one;
                core::array::from_fn(|j| clean([row[j], -(share * by[j])].into_iter(), 2))
            };
            count -= 1;
            exact[most.1] = exact[count];
            for row in &mut exact[..count] {
                *row = without(row);
            }
            let factor = *moved.factor();
            moved = SquareRootInformation::new();
            for row in &factor {
                moved.absorb(&without(row));
            }
            moved.absorb(&by.map(|c| c * one));
        }
        let moved = moved.with_count(before.count()).sound()?;
        let mut information = ConstrainedInformation::new();
        for combination in &exact[..count] {
            check_finite("combination", combination).map_err(|_| NumberError::Overflow {
                result: "information",
            })?;
            information.know(combination)?;
        }
        for row in moved.factor() {
            information.push(row)?;
        }
        self.information = information;
        Ok(())
    }

    /// The information on what is not known exactly, and what is.
    pub fn information(&self) -> &ConstrainedInformation<T, N> {
        &self.information
    }

    /// The bound on each state: 0 where it is known exactly, infinite where it is not
    /// determined, or overflows.
    pub fn standard_deviations(&self) -> [T; N] {
        self.information.crlb_std()
    }
}

/// What can be wrong with a covariance.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A number that is not finite.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// Two entries that should be equal are not.
    #[error("entries [{row}, {column}] and [{column}, {row}] differ: a covariance is symmetric")]
    Asymmetric {
        /// Row of the one above the diagonal.
        row: usize,
        /// Its column.
        column: usize,
    },
    /// A variance, given those before it, that is below zero.
    #[error(
        "not positive semidefinite: state {index} has a variance below zero, given those before it"
    )]
    Indefinite {
        /// Of which state.
        index: usize,
    },
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    type Square = [[f64; 3]; 3];

    fn product(a: &Square, b: &Square) -> Square {
        core::array::from_fn(|i| core::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
    }

    /// P - P h h^T P / (h^T P h + variance).
    fn measured(p: &Square, h: &[f64; 3], variance: f64) -> Square {
        let ph = p.map(|row| (0..3).map(|k| row[k] * h[k]).sum::<f64>());
        let s = (0..3).map(|k| h[k] * ph[k]).sum::<f64>() + variance;
        core::array::from_fn(|i| core::array::from_fn(|j| p[i][j] - ph[i] * ph[j] / s))
    }

    /// The recursion in covariances, which takes exact knowledge as it is.
    #[test]
    fn exact_knowledge_along_a_motion() {
        let mut seed = 3_u64;
        let mut number = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        for case in 0..100 {
            let mut row = || [number(), number(), number()];
            let (exact, h, g) = (row(), row(), row());
            let [a, b, c] = row();
            // A motion of determinant one, and its inverse.
            let forth: Square = [[1.0, a, b], [0.0, 1.0, c], [0.0, 0.0, 1.0]];
            let back: Square = [[1.0, -a, a * c - b], [0.0, 1.0, -c], [0.0, 0.0, 1.0]];
            let mut p: Square = [[4.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 9.0]];
            let mut bound = ConstrainedPosterior::<f64, 3>::unknown();
            for (i, weight) in [0.5, 1.0, 1.0 / 3.0].into_iter().enumerate() {
                let mut row = [0.0; 3];
                row[i] = weight;
                bound.update(&row).unwrap();
            }
            // The second noise is one that the combination does not see.
            let blind = [exact[1], -exact[0], 0.0];
            let noise = [g, blind];
            for step in 0..4 {
                if step != 2 {
                    p = measured(&p, &exact, 0.0);
                    bound.know(&exact).unwrap();
                }
                p = measured(&p, &h, 1.0);
                bound.update(&h).unwrap();
                for (i, found) in bound.standard_deviations().iter().enumerate() {
                    assert!(
                        (found - p[i][i].sqrt()).abs() < 1e-9,
                        "{case} {step} {found}"
                    );
                }
                let noise = &noise[..(case + step) % 3];
                let transpose = core::array::from_fn(|i| core::array::from_fn(|j| forth[j][i]));
                p = product(&product(&forth, &p), &transpose);
                for g in noise {
                    p = core::array::from_fn(|i| core::array::from_fn(|j| p[i][j] + g[i] * g[j]));
                }
                bound.predict(&back, noise).unwrap();
                for (i, found) in bound.standard_deviations().iter().enumerate() {
                    assert!(
                        (found - p[i][i].sqrt()).abs() < 1e-9,
                        "{case} {step} {found}"
                    );
                }
            }
        }
    }
}
