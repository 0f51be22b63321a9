//! Dense rows of many states: blocked factorisations where plain loops take too long.

use alloc::vec;
use alloc::vec::Vec;

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::svd::{ComputeSvdVectors, SvdParams, svd, svd_scratch};
use faer::linalg::triangular_solve::solve_upper_triangular_in_place;
use faer::{Auto, Mat, MatRef, Par, Spec};

use super::NoConvergence;
use crate::observability::Observability;
use crate::scalar::{NumberError, check_finite, check_length};
use crate::spectrum::{check_rtol, default_rtol, unit_columns};
use crate::spine::parts::{GRADED, grade};

/// From so many states on, blocked factorisations are the faster.
pub const LEAST_STATES: usize = 48;

/// Why there is no answer.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A number at fault.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// The singular value iteration did not end.
    #[error(transparent)]
    NoConvergence(#[from] NoConvergence),
}

/// The triangular factor (n, n) of `rows`, row-major, and 1 / norm of its columns.
fn factor(rows: &[f64], n: usize) -> Result<(Vec<f64>, Vec<f64>), NumberError> {
    check_length("states", n, n.max(1))?;
    check_length("rows", rows.len(), rows.len().next_multiple_of(n))?;
    check_finite("rows", rows)?;
    let count = rows.len() / n;
    // As for the plain analysis: no column's norm overflows then.
    let limit = f64::MAX / (2.0 * n.max(count) as f64);
    if !rows.iter().all(|x| x.abs() <= limit) {
        return Err(NumberError::Overflow {
            result: "information",
        });
    }
    // Rows by decreasing size keep the digits of each.
    let size = |row: &[f64]| row.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let mut order: Vec<(f64, usize)> = rows.chunks_exact(n).map(size).zip(0..).collect();
    if order.windows(2).any(|w| w[0].0 < w[1].0) {
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    }
    // One power of two for all: squares neither overflow nor vanish.
    let unit = crate::scalar::power_of_two(order.first().map_or(1.0, |o| o.0));
    let a = MatRef::from_row_major_slice(rows, count, n);
    let sorted = Mat::from_fn(count.max(n), n, |i, j| {
        order.get(i).map_or(0.0, |&(_, row)| a[(row, j)] / unit)
    });
    let qr = sorted.qr();
    let r = qr.thin_R();
    let mut out = vec![0.0; n * n];
    for i in 0..n {
        for j in i..n {
            out[i * n + j] = r[(i, j)] * unit;
        }
    }
    let mut scale = vec![1.0; n];
    unit_columns(&out, n, &mut scale);
    Ok((out, scale))
}

/// Singular values of a square matrix, and the right singular vectors, one after the other.
/// The left ones would take as long, and nothing follows from them.
fn right_singular(matrix: MatRef<'_, f64>) -> Result<(Vec<f64>, Vec<f64>), NoConvergence> {
    let n = matrix.ncols();
    let mut s = Diag::<f64>::zeros(n);
    let mut v = Mat::<f64>::zeros(n, n);
    let (none, full) = (ComputeSvdVectors::No, ComputeSvdVectors::Full);
    let mut params = <SvdParams as Auto<f64>>::auto();
    // With faer's 128 the decomposition of a hundred states takes a sixth longer.
    params.recursion_threshold = 64;
    let params = Spec::new(params);
    let request = svd_scratch::<f64>(n, n, none, full, Par::Seq, params);
    svd(
        matrix,
        s.as_mut(),
        None,
        Some(v.as_mut()),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(request)),
        params,
    )
    .map_err(|_| NoConvergence)?;
    Ok((
        (0..n).map(|k| s[k]).collect(),
        (0..n * n).map(|k| v[(k % n, k / n)]).collect(),
    ))
}

/// The whole answer for `rows` of length `n`, as [`Observability::inexact`] gives it.
///
/// # Errors
/// [`Error`].
///
/// ```
/// let rows: Vec<f64> = (0..6400).map(|i| f64::from(i * i % 101) - 50.0).collect();
/// let found = gramian::large::dense::observability(&rows, &[], 64, None)?;
/// assert_eq!(found.rank(), 64);
/// # Ok::<(), gramian::large::dense::Error>(())
/// ```
pub fn observability(
    rows: &[f64],
    errors: &[f64],
    n: usize,
    rtol: Option<f64>,
) -> Result<Observability<f64>, Error> {
    if let Some(rtol) = rtol {
        check_rtol(rtol)?;
    }
    let (r, scale) = factor(rows, n)?;
    let rtol = rtol.unwrap_or_else(|| default_rtol(rows.len() / n, n));
    let unit = Mat::from_fn(n, n, |i, j| r[i * n + j] * scale[j]);
    let (s, vectors) = right_singular(unit.as_ref())?;
    let values = |rows: &[f64]| {
        let (r, _) = factor(rows, n).ok()?;
        let r = MatRef::from_row_major_slice(&r, n, n);
        r.singular_values().ok()
    };
    Ok(Observability::of_spectrum(
        rows,
        errors,
        rtol,
        &scale,
        (&s, &vectors),
        &values,
    )?)
}

/// Bounds on the standard deviation of each state, as the plain bound gives them.
///
/// Where the inverse of the triangular factor shows that the rank is full, no singular
/// value is needed: 1 over its norm is a lower bound of the smallest.
///
/// # Errors
/// [`Error`].
pub fn crlb_std(rows: &[f64], n: usize, rtol: Option<f64>) -> Result<Vec<f64>, Error> {
    if let Some(rtol) = rtol {
        check_rtol(rtol)?;
    }
    let (r, scale) = factor(rows, n)?;
    let tolerance = rtol.unwrap_or_else(|| default_rtol(rows.len() / n, n));
    let unit = Mat::from_fn(n, n, |i, j| r[i * n + j] * scale[j]);
    // Rows of very different size keep their digits only in the whole answer.
    let even = grade(rows, n) <= GRADED;
    if even && (0..n).all(|k| unit[(k, k)].abs() > f64::MIN_POSITIVE) {
        let mut inverse = Mat::<f64>::identity(n, n);
        solve_upper_triangular_in_place(unit.as_ref(), inverse.as_mut(), Par::Seq);
        let whole = inverse.norm_l2();
        // The columns are of unit length: no singular value exceeds sqrt n.
        if whole.is_finite() && 1.0 / whole > 4.0 * tolerance * (n as f64).sqrt() {
            return Ok((0..n)
                .map(|i| scale[i] * inverse.row(i).norm_l2())
                .collect());
        }
    }
    Ok(observability(rows, &[], n, rtol)?.crlb_std())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn rows(count: usize, n: usize, rank: usize) -> Vec<f64> {
        // Products of two thin factors.
        let entry = |i: usize, j: usize, salt: usize| {
            // Mixed, for steps of one size would make the factors dependent themselves.
            let mut x = (i * 7919 + j * 104_729 + salt * 31 + 1) as u64;
            x = x.wrapping_mul(0x9e37_79b9_7f4a_7c15);
            x = (x ^ (x >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            ((x ^ (x >> 32)) % 10_007) as f64 / 5003.0 - 1.0
        };
        (0..count * n)
            .map(|k| {
                (0..rank)
                    .map(|r| entry(k / n, r, 1) * entry(r, k % n, 2))
                    .sum()
            })
            .collect()
    }

    #[test]
    fn as_the_plain_analysis() {
        for (count, n, rank) in [(90, 60, 60), (90, 60, 50), (40, 60, 40)] {
            let a = rows(count, n, rank);
            let (blocked, plain) = (
                observability(&a, &[], n, None).unwrap(),
                Observability::new(&a, n, None).unwrap(),
            );
            assert_eq!(blocked.rank(), rank);
            assert_eq!(plain.rank(), rank);
            let bounds = crlb_std(&a, n, None).unwrap();
            for ((x, y), z) in blocked.crlb_std().iter().zip(plain.crlb_std()).zip(bounds) {
                assert!(*x == y || (x / y - 1.0).abs() < 1e-8, "{x} {y}");
                assert!(z == y || (z / y - 1.0).abs() < 1e-8, "{z} {y}");
            }
        }
    }
}
