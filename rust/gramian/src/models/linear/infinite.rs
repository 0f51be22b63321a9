//! Gramians over an infinite window, as factors: W = R^T R with R triangular.
//!
//! The sum of `Phi^kT` C^T C `Phi^k` is doubled: [R; R Phi] is triangularised, Phi squared.
//! No product C^T C is formed, so that small Hankel singular values keep their digits. A
//! continuous system is mapped to a discrete one with the same Gramian (bilinear
//! transform).
//!
//! # Source
//! Smith 1968, Matrix equation XA + BX = C, SIAM J. Applied Mathematics 16 (doubling);
//! Tombs & Postlethwaite 1987, Truncated balanced realization, Int. J. Control 46 (the
//! square-root algorithm).

use alloc::vec;
use alloc::vec::Vec;

use super::window::solve;
use super::{Error, scaling};
use crate::numbers::algebra::dot_slices as dot;
use crate::observability::singular_values;
use crate::scalar::{all_finite, check_finite, check_length};
use crate::square_root::rotate_in;

/// The triangular factor (n x n) of the observability Gramian over an infinite window, of
/// x' = A x or, with `discrete`, of `x[k+1]` = A x; C whitened (p x n).
///
/// # Errors
/// [`Error::Number`] for lengths that do not fit, [`Error::Unstable`].
///
/// ```
/// use gramian::linear::infinite::factor;
/// // The integral of e^(-2 t) is 1 / 2.
/// let r = factor(&[-1.0], &[1.0], 1, false)?;
/// assert!((r[0] * r[0] - 0.5).abs() < 1e-15);
/// # Ok::<(), gramian::linear::Error>(())
/// ```
pub fn factor(a: &[f64], c: &[f64], n: usize, discrete: bool) -> Result<Vec<f64>, Error> {
    let p = c.len().checked_div(n).unwrap_or(0);
    check_length("states", n, n.max(1))?;
    check_length("A", a.len(), n.saturating_mul(n))?;
    check_length("C", c.len(), p.saturating_mul(n))?;
    check_finite("A", a)?;
    check_finite("C", c)?;
    if n > 0 && lasts(a, c, n, discrete)? {
        return Err(Error::Unstable);
    }
    let (mut phi, mut rows) = (a.to_vec(), c.to_vec());
    if !discrete {
        // Phi = (A + s)(s - A)^-1 with s near the middle of the rates; the rows are
        // C (s - A)^-1 sqrt(2 s).
        let size = a.chunks_exact(n).fold(0.0_f64, |top, row| {
            top.max(row.iter().map(|x| x.abs()).sum())
        });
        if !(size > 0.0) {
            return Err(Error::Unstable);
        }
        let s = size;
        // X (s - A) = B by transposes.
        let mut shifted = vec![0.0; n * n];
        let mut right = vec![0.0; n * (n + p)];
        for i in 0..n {
            for j in 0..n {
                shifted[j * n + i] = if i == j { s } else { 0.0 } - a[i * n + j];
                right[j * (n + p) + i] = if i == j { s } else { 0.0 } + a[i * n + j];
            }
            for o in 0..p {
                right[i * (n + p) + n + o] = c[o * n + i];
            }
        }
        let Some(found) = solve(shifted, right, n, n + p) else {
            return Err(Error::Unstable);
        };
        let root = super::schur::root(2.0 * s);
        for j in 0..n {
            for i in 0..n {
                phi[i * n + j] = found[j * (n + p) + i];
            }
            for o in 0..p {
                rows[o * n + j] = root * found[j * (n + p) + n + o];
            }
        }
    }
    let mut r = vec![0.0; n * n];
    for row in rows.chunks_exact(n) {
        rotate_in(&mut r, &mut row.to_vec());
    }
    for _ in 0..64 {
        let later = multiply(&r, &phi, n);
        if !all_finite(&later) {
            return Err(Error::Unstable);
        }
        let (top, new) = (largest(&r), largest(&later));
        for row in later.chunks_exact(n) {
            rotate_in(&mut r, &mut row.to_vec());
        }
        if new <= 1e-18 * top {
            return Ok(r);
        }
        phi = multiply(&phi, &phi, n);
    }
    Err(Error::Unstable)
}

/// Whether a motion that is seen neither decays nor grows, but for rounding. Doubling would
/// take rounding for its decay.
fn lasts(a: &[f64], c: &[f64], n: usize, discrete: bool) -> Result<bool, Error> {
    let (mut a, mut c) = (a.to_vec(), c.to_vec());
    let scales = super::analysis::balance(&mut a, &mut c, n);
    let (time, center) = (scales.time, scales.centers[0]);
    let pencil = super::pencil::Pencil::new(&a, &c, n)?;
    let size = pencil.norm() / time + center.abs();
    for z in pencil.eigenvalues() {
        let physical = [z[0] / time + center, z[1] / time];
        let off = if discrete {
            super::schur::root(physical[0] * physical[0] + physical[1] * physical[1]) - 1.0
        } else {
            physical[0]
        };
        if off.abs() <= 64.0 * f64::EPSILON * size
            && pencil.sigma(z) > super::default_rtol::<f64>(n) * pencil.norm()
        {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Hankel singular values, descending: of the factors of the observability Gramian and
/// of the reachability Gramian, both n x n.
///
/// # Errors
/// [`Error::Number`].
pub fn hankel(observability: &[f64], reachability: &[f64], n: usize) -> Result<Vec<f64>, Error> {
    check_length("factor", observability.len(), n * n)?;
    check_length("factor", reachability.len(), n * n)?;
    // R S^T
    let mut product = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..n {
            let (r, s) = (
                &observability[i * n..(i + 1) * n],
                &reachability[j * n..(j + 1) * n],
            );
            product[i * n + j] = dot(r, s);
        }
    }
    Ok(singular_values(&product, n)?.0)
}

/// The two parts of a system that no motion connects.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts {
    /// Orthonormal rows that span the motions that decay, and the factor of the Gramian
    /// of their coefficients, over all time to come.
    pub stable: (Vec<f64>, Vec<f64>),
    /// Those that do not decay, and the factor over all time gone by.
    pub antistable: (Vec<f64>, Vec<f64>),
}

/// The Gramians of the stable and the antistable part of x' = A x apart: a state is the sum
/// of one vector in each of two invariant subspaces.
///
/// # Errors
/// [`Error::Unstable`] where an eigenvalue lies on the imaginary axis but for rounding;
/// [`Error::Pencil`] where eigenvalues are not found.
pub fn parts(a: &[f64], c: &[f64], n: usize) -> Result<Parts, Error> {
    check_length("A", a.len(), n.saturating_mul(n))?;
    check_finite("A", a)?;
    let [stable, antistable] = super::pencil::halves(a, n)?;
    let factor_of = |basis: Vec<f64>, sign: f64| -> Result<_, Error> {
        let m = basis.len() / n.max(1);
        if m == 0 {
            return Ok((basis, Vec::new()));
        }
        let inner: Vec<f64> = super::pencil::restricted(a, n, &basis)
            .iter()
            .map(|x| sign * x)
            .collect();
        let seen: Vec<f64> = c
            .chunks_exact(n)
            .flat_map(|row| basis.chunks_exact(n).map(move |v| dot(row, v)))
            .collect();
        let factor = factor(&inner, &seen, m, false)?;
        Ok((basis, factor))
    };
    Ok(Parts {
        stable: factor_of(stable, 1.0)?,
        antistable: factor_of(antistable, -1.0)?,
    })
}

fn multiply(a: &[f64], b: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    for (row, line) in out.chunks_exact_mut(n).zip(a.chunks_exact(n)) {
        for (&factor, b) in line.iter().zip(b.chunks_exact(n)) {
            scaling::add(row, factor, b);
        }
    }
    out
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |top: f64, x| top.max(x.abs()))
}
