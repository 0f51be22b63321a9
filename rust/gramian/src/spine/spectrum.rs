//! Scaling, singular values, rank and null space of a triangular factor.
//!
//! Rank is decided on columns scaled to unit length, from singular values of
//! the rows, never from the information matrix or its determinant: the decision
//! is then the same in metres and in kilometres, and keeps all digits.

use crate::numbers::algebra::dot_slices;
use crate::scalar::{NumberError, Real, hypot};
use crate::square_root::SquareRootInformation;

/// The relative tolerance below which a singular value of the scaled rows
/// counts as zero: 32 eps sqrt(max(rows, states)), the rounding that the rows
/// and their reduction carry.
pub fn default_rtol<T: Real>(rows: usize, states: usize) -> T {
    T::EPSILON * T::of(32.0) * T::of(rows.max(states).max(1) as f64).sqrt()
}

/// 1 / norm of each column of the n x n factor `r`; 1 where a column is zero, or
/// so small that the quotient overflows: a state which nothing measures.
pub(crate) fn unit_columns<T: Real>(r: &[T], n: usize, scale: &mut [T]) {
    for j in 0..n {
        let norm = (0..n).fold(T::zero(), |norm, i| hypot(norm, r[i * n + j]));
        let inverse = T::one() / norm;
        scale[j] = if inverse.is_finite() {
            inverse
        } else {
            T::one()
        };
    }
}

/// Singular values `s` (descending) and right singular vectors `v` of
/// R diag(scale). Vector j is `v[j*n..(j+1)*n]`. `work` has n*n entries.
///
/// # Source
/// One-sided Jacobi iteration, which finds small singular values of a scaled
/// matrix to high relative accuracy (Demmel & Veselic 1992).
pub(crate) fn decompose<T: Real>(
    r: &[T],
    n: usize,
    scale: &[T],
    s: &mut [T],
    v: &mut [T],
    work: &mut [T],
) {
    let mut largest = T::zero();
    for j in 0..n {
        for i in 0..n {
            let value = r[i * n + j] * scale[j];
            largest = largest.max(value.abs());
            work[j * n + i] = value;
            v[j * n + i] = if i == j { T::one() } else { T::zero() };
        }
    }
    if !(T::one() / largest).is_finite() {
        // Smaller than any normal number: nothing.
        s[..n].fill(T::zero());
        return;
    }
    // With entries up to 1 no square overflows, and what underflows is far
    // below rounding.
    for value in &mut work[..n * n] {
        *value /= largest;
    }
    orthogonalize(work, v, n);
    for j in 0..n {
        let column = &work[j * n..(j + 1) * n];
        s[j] = largest * dot_slices(column, column).sqrt();
    }
    sort_descending(s, v, n);
}

/// Rotates pairs of the n columns in `w` until all are orthogonal, and the
/// columns of `v` with them.
fn orthogonalize<T: Real>(w: &mut [T], v: &mut [T], n: usize) {
    // Convergence is quadratic: 6 to 10 sweeps in practice. The limit only
    // keeps the loop finite.
    for _ in 0..60 {
        let mut rotated = false;
        for p in 0..n {
            for q in p + 1..n {
                rotated |= rotate_pair(w, v, n, p, q);
            }
        }
        if !rotated {
            return;
        }
    }
}

fn rotate_pair<T: Real>(w: &mut [T], v: &mut [T], n: usize, p: usize, q: usize) -> bool {
    let (left, right) = w.split_at_mut(q * n);
    let (x, y) = (&mut left[p * n..(p + 1) * n], &mut right[..n]);
    let (alpha, beta, gamma) = (dot_slices(x, x), dot_slices(y, y), dot_slices(x, y));
    let size = alpha.sqrt() * beta.sqrt();
    // Also where a column is zero, or holds NaN.
    if !(gamma.abs() > T::EPSILON * size) {
        return false;
    }
    let zeta = (beta - alpha) / (gamma + gamma);
    let t = T::one() / (zeta.abs() + (T::one() + zeta * zeta).sqrt());
    let t = if zeta < T::zero() { -t } else { t };
    let c = T::one() / (T::one() + t * t).sqrt();
    let s = c * t;
    let rotate = |x: &mut [T], y: &mut [T]| {
        for (xi, yi) in x.iter_mut().zip(y.iter_mut()) {
            let (u, w) = (*xi, *yi);
            *xi = c * u - s * w;
            *yi = s * u + c * w;
        }
    };
    rotate(x, y);
    let (left, right) = v.split_at_mut(q * n);
    rotate(&mut left[p * n..(p + 1) * n], &mut right[..n]);
    // A rotation that changes nothing in working precision is the end.
    s.abs() > T::EPSILON
}

fn sort_descending<T: Real>(s: &mut [T], v: &mut [T], n: usize) {
    for i in 0..n {
        let mut top = i;
        for j in i + 1..n {
            if s[j] > s[top] {
                top = j;
            }
        }
        if top != i {
            s.swap(i, top);
            for k in 0..n {
                v.swap(i * n + k, top * n + k);
            }
        }
    }
}

/// How many of the descending singular values exceed `rtol` times the first.
pub(crate) fn rank<T: Real>(s: &[T], rtol: T) -> usize {
    match s.first() {
        Some(&first) if first > T::zero() => s.iter().take_while(|&&x| x > rtol * first).count(),
        _ => 0,
    }
}

/// Whether null vectors move what has the length `null` in them and the deviation `spread`
/// along the others, both of something of unit length in scaled states: to first order
/// errors of the rows turn the null vectors by no more than these times `spread`.
pub(crate) fn moves<T: Real>(null: T, spread: T, s: &[T], rank: usize, rtol: T) -> bool {
    let error = (T::of(4.0) * rtol * spread).max(T::EPSILON * T::of(4.0));
    null > touch_tolerance(s, rank, rtol).min(error)
}

/// A scaled singular vector component above this is part of the null space, whatever it
/// belongs to: the perturbation of the null vectors by errors of relative size
/// `rtol`, given the smallest singular value that counts.
pub(crate) fn touch_tolerance<T: Real>(s: &[T], rank: usize, rtol: T) -> T {
    if rank == 0 {
        return T::zero();
    }
    let four = T::of(4.0);
    let perturbation = four * rtol * s[0] / s[rank - 1];
    // Past a hundredth the estimate says nothing: the null space itself is
    // uncertain then, and the gap says so.
    perturbation.clamp(T::EPSILON * four, T::of(1e-2))
}

/// Refuses a rank tolerance that is not in [0, 1).
pub(crate) fn check_rtol<T: Real>(rtol: T) -> Result<(), NumberError> {
    if rtol >= T::zero() && rtol < T::one() {
        return Ok(());
    }
    Err(NumberError::OutOfRange {
        name: "rtol",
        given: rtol.double(),
        allowed: "in [0, 1)",
    })
}

/// Rank, singular values and null space of a [`SquareRootInformation`] of fixed size.
///
/// # Source
/// Columns of unit length: van der Sluis 1969, Numerische Mathematik 14. Singular values
/// by one-sided Jacobi rotations: Demmel & Veselic 1992.
///
/// ```
/// use gramian::{spectrum::Spectrum, square_root::SquareRootInformation};
/// let mut root = SquareRootInformation::<f64, 2>::new();
/// root.push(&[1.0, 1e6])?;
/// root.push(&[2.0, 2e6])?;
/// let spectrum = Spectrum::new(&root);
/// assert_eq!(spectrum.rank(), 1);
/// // x0 = 1e6 with x1 = -1 leaves every measurement as it is.
/// let null = spectrum.null_vector(0).unwrap();
/// assert!((null[0] / null[1] + 1e6).abs() < 1e-6);
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Spectrum<T, const N: usize> {
    scale: [T; N],
    singular_values: [T; N],
    vectors: [[T; N]; N],
    rank: usize,
    rtol: T,
}

impl<T: Real, const N: usize> Spectrum<T, N> {
    /// Decomposes the factor with its columns scaled to unit length.
    pub fn new(root: &SquareRootInformation<T, N>) -> Self {
        let count = usize::try_from(root.count()).unwrap_or(usize::MAX);
        Self::within(root, default_rtol(count, N))
    }

    /// The same with another rank tolerance, relative to the largest value.
    ///
    /// # Errors
    /// [`NumberError::OutOfRange`] for a tolerance that is not in [0, 1).
    pub fn with_rtol(root: &SquareRootInformation<T, N>, rtol: T) -> Result<Self, NumberError> {
        check_rtol(rtol)?;
        Ok(Self::within(root, rtol))
    }

    pub(crate) fn within(root: &SquareRootInformation<T, N>, rtol: T) -> Self {
        let r = root.factor().as_flattened();
        let mut scale = [T::one(); N];
        let mut singular_values = [T::zero(); N];
        let mut vectors = [[T::zero(); N]; N];
        let mut work = [[T::zero(); N]; N];
        unit_columns(r, N, &mut scale);
        decompose(
            r,
            N,
            &scale,
            &mut singular_values,
            vectors.as_flattened_mut(),
            work.as_flattened_mut(),
        );
        let rank = rank(&singular_values, rtol);
        Self {
            scale,
            singular_values,
            vectors,
            rank,
            rtol,
        }
    }

    /// Number of independent combinations of the states that are determined.
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// Singular values of the scaled rows, descending.
    pub fn singular_values(&self) -> &[T; N] {
        &self.singular_values
    }

    /// Right singular vectors of the scaled rows, one per singular value.
    pub fn vectors(&self) -> &[[T; N]; N] {
        &self.vectors
    }

    /// The scale that each column was multiplied by.
    pub fn scale(&self) -> &[T; N] {
        &self.scale
    }

    /// Tolerance of the rank decision, relative to the largest singular value.
    pub fn rtol(&self) -> T {
        self.rtol
    }

    /// The i-th unobservable combination in physical units, `None` from the
    /// nullity on.
    pub fn null_vector(&self, i: usize) -> Option<[T; N]> {
        let mut vector = *self.vectors.get(self.rank.checked_add(i)?)?;
        for (value, scale) in vector.iter_mut().zip(&self.scale) {
            *value *= *scale;
        }
        Some(vector)
    }
}
