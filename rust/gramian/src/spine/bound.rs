//! Cramer-Rao bounds from a spectrum: `inf` for what cannot be determined.

use crate::scalar::{Real, all_finite, hypot};
use crate::spectrum::{Spectrum, moves};

/// Standard deviation of each state at the Cramer-Rao bound, from the scaled
/// spectrum (see [`decompose`](crate::spectrum::decompose)); infinite for every
/// state that an unobservable combination touches.
pub(crate) fn standard_deviations<T: Real>(
    s: &[T],
    v: &[T],
    scale: &[T],
    rank: usize,
    rtol: T,
    out: &mut [T],
) {
    let n = s.len();
    for i in 0..n {
        let null = (rank..n).fold(T::zero(), |norm, k| hypot(norm, v[k * n + i]));
        let spread = (0..rank).fold(T::zero(), |norm, k| hypot(norm, v[k * n + i] / s[k]));
        out[i] = if moves(null, spread, s, rank, rtol) {
            T::INFINITY
        } else {
            scale[i] * spread
        };
    }
}

/// The Cramer-Rao bound on the covariance, n x n; `false` where the rank is short,
/// since no such matrix exists then, or an entry is not finite.
pub(crate) fn covariance<T: Real>(
    s: &[T],
    v: &[T],
    scale: &[T],
    rank: usize,
    out: &mut [T],
) -> bool {
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
    all_finite(&out[..n * n])
}

/// Standard deviations at the Cramer-Rao bound of a fixed-size problem; infinite
/// for what is not determined, or overflows.
///
/// # Source
/// The Cramer-Rao bound; none is finite for what a singular information does not
/// determine: Stoica & Marzetta 2001, IEEE Trans. Signal Processing 49.
///
/// ```
/// use gramian::{bound, spectrum::Spectrum, square_root::SquareRootInformation};
/// let mut root = SquareRootInformation::<f64, 2>::new();
/// root.push(&[2.0, 0.0])?;
/// assert_eq!(bound::crlb_std(&Spectrum::new(&root)), [0.5, f64::INFINITY]);
/// # Ok::<(), gramian::scalar::NumberError>(())
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

/// Standard deviation of a combination of the states; 0 for none, infinite for one that
/// is not determined, or overflows.
///
/// ```
/// use gramian::{bound, square_root::SquareRootInformation};
/// // The sum is known to 0.5, neither of the states.
/// let mut root = SquareRootInformation::<f64, 2>::new();
/// root.push(&[2.0, 2.0])?;
/// let spectrum = root.spectrum();
/// assert!((bound::combination_std(&spectrum, &[1.0, 1.0]) - 0.5).abs() < 1e-15);
/// assert!(bound::combination_std(&spectrum, &[1.0, 0.0]).is_infinite());
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
pub fn combination_std<T: Real, const N: usize>(
    spectrum: &Spectrum<T, N>,
    combination: &[T; N],
) -> T {
    let scale = spectrum.scale();
    let scaled: [T; N] = core::array::from_fn(|j| combination[j] * scale[j]);
    let size = scaled.iter().fold(T::zero(), |norm, &x| hypot(norm, x));
    if size == T::zero() {
        return size;
    }
    let (values, rank) = (spectrum.singular_values(), spectrum.rank());
    let along = |k: usize| {
        let each = spectrum.vectors()[k].iter().zip(&scaled);
        each.fold(T::zero(), |sum, (&v, &x)| sum + v * x)
    };
    let null = (rank..N).fold(T::zero(), |norm, k| hypot(norm, along(k)));
    let std = (0..rank).fold(T::zero(), |norm, k| hypot(norm, along(k) / values[k]));
    if moves(null / size, std / size, values, rank, spectrum.rtol()) {
        return T::INFINITY;
    }
    if std.is_finite() { std } else { T::INFINITY }
}

/// The Cramer-Rao bound on the covariance of a fixed-size problem; `None` where the
/// rank is short, since no such matrix exists then, or where an entry
/// overflows.
///
/// ```
/// use gramian::{bound, square_root::SquareRootInformation};
/// let mut root = SquareRootInformation::<f64, 2>::new();
/// root.push(&[2.0, 0.0])?;
/// assert_eq!(bound::crlb(&root.spectrum()), None);
/// root.push(&[0.0, 4.0])?;
/// assert_eq!(bound::crlb(&root.spectrum()), Some([[0.25, 0.0], [0.0, 0.0625]]));
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
pub fn crlb<T: Real, const N: usize>(spectrum: &Spectrum<T, N>) -> Option<[[T; N]; N]> {
    let mut out = [[T::zero(); N]; N];
    let exists = covariance(
        spectrum.singular_values(),
        spectrum.vectors().as_flattened(),
        spectrum.scale(),
        spectrum.rank(),
        out.as_flattened_mut(),
    );
    exists.then_some(out)
}
