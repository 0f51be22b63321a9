//! Vectors and small matrices: what all modules do with them, once.

use super::lane::Lane;
use super::scalar::Real;

/// The scalar product of two vectors.
#[inline(always)]
pub(crate) fn dot<L: Lane, const N: usize>(a: &[L; N], b: &[L; N]) -> L {
    let mut sum = a[0] * b[0];
    for i in 1..N {
        sum = a[i].mul_add(b[i], sum);
    }
    sum
}

/// [`dot`] of slices, in eight sums side by side.
#[inline(always)]
pub(crate) fn dot_slices<T: Real>(x: &[T], y: &[T]) -> T {
    let (x, x_rest) = x.as_chunks::<8>();
    let (y, y_rest) = y.as_chunks::<8>();
    let mut sum = T::zero();
    if !x.is_empty() {
        let mut sums = [T::zero(); 8];
        for (x, y) in x.iter().zip(y) {
            for k in 0..8 {
                sums[k] += x[k] * y[k];
            }
        }
        sum = ((sums[0] + sums[4]) + (sums[2] + sums[6]))
            + ((sums[1] + sums[5]) + (sums[3] + sums[7]));
    }
    for (&x, &y) in x_rest.iter().zip(y_rest) {
        sum += x * y;
    }
    sum
}

/// A matrix times a vector.
#[inline(always)]
pub(crate) fn multiply<L: Lane, const N: usize, const M: usize>(
    matrix: &[[L; N]; M],
    vector: &[L; N],
) -> [L; M] {
    matrix.map(|row| dot(&row, vector))
}

/// a x b.
#[inline(always)]
pub(crate) fn cross<L: Lane>(a: &[L; 3], b: &[L; 3]) -> [L; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Where something at constant velocity is after `time`.
#[inline(always)]
pub(crate) fn advanced<L: Lane, const D: usize>(
    start: &[L; D],
    velocity: &[L; D],
    time: L,
) -> [L; D] {
    let mut place = *start;
    for axis in 0..D {
        place[axis] = time.mul_add(velocity[axis], start[axis]);
    }
    place
}

/// Adds weight row^T row to a matrix, row-major.
#[inline(always)]
pub(crate) fn add_square<T: Real>(row: &[T], weight: T, sum: &mut [T]) {
    for (&x, sums) in row.iter().zip(sum.chunks_exact_mut(row.len().max(1))) {
        let x = weight * x;
        for (sum, &y) in sums.iter_mut().zip(row) {
            *sum += x * y;
        }
    }
}

/// The lower triangular factor of a matrix, with inverse diagonal; `None` where it is not
/// positive definite.
#[inline(always)]
pub(crate) fn cholesky<T: Real, const N: usize>(a: &[[T; N]; N]) -> Option<[[T; N]; N]> {
    let mut l = [[T::zero(); N]; N];
    for j in 0..N {
        let mut pivot = a[j][j];
        for k in 0..j {
            pivot -= l[j][k] * l[j][k];
        }
        if !(pivot > T::zero()) {
            return None;
        }
        l[j][j] = T::one() / pivot.sqrt();
        for i in j + 1..N {
            let mut sum = a[i][j];
            for k in 0..j {
                sum -= l[i][k] * l[j][k];
            }
            l[i][j] = sum * l[j][j];
        }
    }
    Some(l)
}

/// The solution of L L^T x = b, with L as [`cholesky`] gives it.
#[inline(always)]
pub(crate) fn cholesky_solve<T: Real, const N: usize>(l: &[[T; N]; N], b: &[T; N]) -> [T; N] {
    let mut x = *b;
    for i in 0..N {
        for k in 0..i {
            x[i] -= l[i][k] * x[k];
        }
        x[i] *= l[i][i];
    }
    for i in (0..N).rev() {
        for k in i + 1..N {
            x[i] -= l[k][i] * x[k];
        }
        x[i] *= l[i][i];
    }
    x
}
