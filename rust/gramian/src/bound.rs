//! Cramer-Rao bounds from a spectrum: `inf` for what cannot be determined.

use crate::scalar::{Real, hypot};
use crate::spectrum::{Spectrum, touch_tolerance};

/// Standard deviation of each state at the Cramer-Rao bound, from the scaled
/// spectrum (see [`decompose`](crate::spectrum::decompose)); infinite for every
/// state that an unobservable combination touches.
pub fn standard_deviations<T: Real>(
    s: &[T],
    v: &[T],
    scale: &[T],
    rank: usize,
    rtol: T,
    out: &mut [T],
) {
    let n = s.len();
    let touch = touch_tolerance(s, rank, rtol);
    for i in 0..n {
        let null = (rank..n).fold(T::zero(), |norm, k| hypot(norm, v[k * n + i]));
        out[i] = if null > touch {
            T::INFINITY
        } else {
            scale[i] * (0..rank).fold(T::zero(), |norm, k| hypot(norm, v[k * n + i] / s[k]))
        };
    }
}

/// The Cramer-Rao bound on the covariance, n x n; `false` and nothing written
/// where the rank is short, since no such matrix exists then.
pub fn covariance<T: Real>(s: &[T], v: &[T], scale: &[T], rank: usize, out: &mut [T]) -> bool {
    let n = s.len();
    if rank < n {
        return false;
    }
    for i in 0..n {
        for j in 0..=i {
            let sum = (0..n).fold(T::zero(), |sum, k| {
                sum + (v[k * n + i] / s[k]) * (v[k * n + j] / s[k])
            });
            let value = sum * scale[i] * scale[j];
            out[i * n + j] = value;
            out[j * n + i] = value;
        }
    }
    true
}

/// Standard deviations at the Cramer-Rao bound of a fixed-size problem.
///
/// ```
/// use gramian::{bound, rows::RowSink, spectrum::Spectrum, square_root::SquareRoot};
/// let mut root = SquareRoot::<f64, 2>::new();
/// root.push(&[2.0, 0.0]);
/// assert_eq!(bound::crlb_std(&Spectrum::new(&root)), [0.5, f64::INFINITY]);
/// ```
pub fn crlb_std<T: Real, const N: usize>(spectrum: &Spectrum<T, N>) -> [T; N] {
    let mut out = [T::zero(); N];
    standard_deviations(
        spectrum.singular_values(),
        spectrum.vectors().as_flattened(),
        spectrum.scale(),
        spectrum.rank(),
        spectrum.rtol(),
        &mut out,
    );
    out
}
