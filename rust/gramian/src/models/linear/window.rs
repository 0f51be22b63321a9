//! What a finite window of outputs tells of the state at its beginning: the
//! observability Gramian, of stable and unstable systems, with or without
//! process noise.
//!
//! A window is a map from the information J about the state at its end to that
//! at its beginning,
//!     J0 = H + Phi^T J (I + G J)^-1 Phi,
//! with Phi the transition, G the noise it gathers and H what its own outputs
//! tell. Two windows in a row are one; so a short one is doubled as often as it
//! takes, sums of positive terms only. Nothing is assumed of the eigenvalues.
//!
//! # Source
//! Van Loan 1978, Computing integrals involving the matrix exponential, IEEE
//! Trans. Automatic Control 23 (the short window); Anderson 1978, Second-order
//! convergent algorithms for the steady-state Riccati equation (doubling).

use alloc::vec;
use alloc::vec::Vec;

use super::Error;
use super::analysis::balance;
use super::scaling::add;
use crate::scalar::{Real, all_finite, check_finite, check_length, check_positive};

/// A window of a system of n states, matrices n x n row-major.
#[derive(Clone, Debug)]
pub struct Window<T> {
    n: usize,
    transition: Vec<T>,
    noise: Vec<T>,
    pub(crate) gramian: Vec<T>,
}

/// The window is too long: its transition or Gramian exceeds the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the Gramian is not a finite number: the window is too long for a system that grows this fast"
)]
pub struct Overflow;

impl<T: Real> Window<T> {
    /// The transition from the beginning to the end.
    pub fn transition(&self) -> &[T] {
        &self.transition
    }

    /// Covariance of the process noise gathered on the way.
    pub fn noise(&self) -> &[T] {
        &self.noise
    }

    /// Information of the outputs in the window about the state at its
    /// beginning: the Gramian.
    pub fn gramian(&self) -> &[T] {
        &self.gramian
    }

    /// One sample and the step after it: outputs `c` (whitened, p x n),
    /// `x[k+1] = phi x[k]` with noise covariance `q` if given.
    ///
    /// # Errors
    /// [`NumberError::Length`](crate::scalar::NumberError::Length) for matrices that do not fit n >= 1 states;
    /// [`Error::Number`]; [`Error::Window`] where the Gramian exceeds the numbers.
    pub fn sample(phi: &[T], c: &[T], q: Option<&[T]>, n: usize) -> Result<Self, Error> {
        check_system("transition", phi, c, q, n)?;
        Self::sampled(phi, c, q, n).whole()
    }

    pub(crate) fn sampled(phi: &[T], c: &[T], q: Option<&[T]>, n: usize) -> Self {
        Self {
            n,
            transition: phi.to_vec(),
            noise: q.map_or_else(|| vec![T::zero(); n * n], <[T]>::to_vec),
            gramian: information(c, n),
        }
    }

    /// The window of x' = A x with whitened outputs `c` (noise density 1) and
    /// process noise density `q` if given, over `duration`.
    ///
    /// # Errors
    /// [`NumberError::Length`](crate::scalar::NumberError::Length) for matrices that do not fit n >= 1 states; [`Error::Number`]
    /// for what is not finite, or a duration that is not positive; [`Error::Window`].
    pub fn continuous(
        a: &[T],
        c: &[T],
        q: Option<&[T]>,
        n: usize,
        duration: T,
    ) -> Result<Self, Error> {
        check_system("A", a, c, q, n)?;
        check_positive("duration", duration)?;
        Self::integrated(a, c, q, n, duration)?.whole()
    }

    pub(crate) fn integrated(
        a: &[T],
        c: &[T],
        q: Option<&[T]>,
        n: usize,
        duration: T,
    ) -> Result<Self, Overflow> {
        let (mut scaled_a, mut scaled_c) = (a.to_vec(), c.to_vec());
        let scale = balance(&mut scaled_a, &mut scaled_c, n).states;
        let v = information(c, n);
        let at = |i: usize, j: usize| a[i * n + j] * scale[j] / scale[i];
        let v_at = |i: usize, j: usize| v[i * n + j] * scale[i] * scale[j];
        let q_at = |i: usize, j: usize| q.map_or(T::zero(), |q| q[i * n + j] / scale[i] / scale[j]);
        let (norm_a, norm_v, norm_q) = (norm(n, at), norm(n, v_at), norm(n, q_at));
        // Information in units that make its part of the block as small as the
        // rest: x and J x are of different kinds.
        let unit = if norm_v == T::zero() {
            T::one()
        } else if norm_q > T::zero() {
            (norm_q / norm_v).sqrt()
        } else {
            norm_a.max(T::one() / duration) / norm_v
        };
        let rate = norm_a + (norm_v * unit).max(norm_q / unit);
        let mut halvings = 0;
        let mut step = duration;
        while rate * step > T::of(0.5) && halvings < 2000 {
            step /= T::of(2.0);
            halvings += 1;
        }
        let m = 2 * n;
        let mut block = vec![T::zero(); m * m];
        for i in 0..n {
            for j in 0..n {
                block[i * m + j] = -at(i, j) * step;
                block[i * m + n + j] = q_at(i, j) / unit * step;
                block[(n + i) * m + j] = v_at(i, j) * unit * step;
                block[(n + i) * m + n + j] = at(j, i) * step;
            }
        }
        let e = series(&block, m);
        let part = |top: usize, left: usize| -> Vec<T> {
            (0..n)
                .flat_map(|i| e[(top + i) * m + left..(top + i) * m + left + n].to_vec())
                .collect()
        };
        let (e11, e12, e21) = (part(0, 0), part(0, n), part(n, 0));
        let mut identity = vec![T::zero(); n * n];
        for i in 0..n {
            identity[i * n + i] = T::one();
        }
        let transition = solve(e11.clone(), identity, n, n).ok_or(Overflow)?;
        let noise = solve(e11, e12, n, n).ok_or(Overflow)?;
        let mut window = Self {
            n,
            gramian: multiply(&e21, &transition, n),
            transition,
            noise,
        };
        window.symmetrize();
        for _ in 0..halvings {
            window = window.joined(&window)?;
        }
        for i in 0..n {
            for j in 0..n {
                window.transition[i * n + j] *= scale[i] / scale[j];
                window.noise[i * n + j] *= scale[i] * scale[j] * unit;
                window.gramian[i * n + j] /= scale[i] * scale[j] * unit;
            }
        }
        window.checked()
    }

    /// This window and `next` after it, as one.
    ///
    /// # Errors
    /// [`NumberError::Length`](crate::scalar::NumberError::Length) for a window of other states, [`Error::Window`].
    pub fn then(&self, next: &Self) -> Result<Self, Error> {
        check_length("next", next.n, self.n)?;
        self.joined(next)?.whole()
    }

    fn joined(&self, next: &Self) -> Result<Self, Overflow> {
        let n = self.n;
        let (mut through, mut noise) = (self.transition.clone(), self.noise.clone());
        if noise.iter().any(|&x| x != T::zero()) {
            let mut m = multiply(&noise, &next.gramian, n);
            for i in 0..n {
                m[i * n + i] += T::one();
            }
            through = solve(m.clone(), through, n, n).ok_or(Overflow)?;
            noise = solve(m, noise, n, n).ok_or(Overflow)?;
        }
        let mut gramian = multiply(
            &transpose(&self.transition, n),
            &multiply(&next.gramian, &through, n),
            n,
        );
        add(&mut gramian, T::one(), &self.gramian);
        let turned = multiply(&next.transition, &noise, n);
        let mut noise = multiply(&turned, &transpose(&next.transition, n), n);
        add(&mut noise, T::one(), &next.noise);
        let mut window = Self {
            n,
            transition: multiply(&next.transition, &through, n),
            noise,
            gramian,
        };
        window.symmetrize();
        window.checked()
    }

    /// This window `count` times in a row.
    ///
    /// # Errors
    /// [`Error::Window`].
    pub fn repeated(&self, count: usize) -> Result<Option<Self>, Error> {
        self.many(count)?.map(Self::whole).transpose()
    }

    pub(crate) fn many(&self, mut count: usize) -> Result<Option<Self>, Overflow> {
        let mut doubled = self.clone();
        let mut all: Option<Self> = None;
        while count > 0 {
            if count % 2 == 1 {
                all = Some(match all {
                    None => doubled.clone(),
                    Some(all) => all.joined(&doubled)?,
                });
            }
            count /= 2;
            if count > 0 {
                doubled = doubled.joined(&doubled)?;
            }
        }
        Ok(all)
    }

    /// The window if all of it is finite; the Gramian alone may be where the
    /// transition is not.
    fn whole(self) -> Result<Self, Error> {
        if all_finite(&self.transition) {
            Ok(self.checked()?)
        } else {
            Err(Overflow.into())
        }
    }

    fn symmetrize(&mut self) {
        let (n, half) = (self.n, T::of(0.5));
        for matrix in [&mut self.gramian, &mut self.noise] {
            for i in 0..n {
                for j in 0..i {
                    let mean = (matrix[i * n + j] + matrix[j * n + i]) * half;
                    matrix[i * n + j] = mean;
                    matrix[j * n + i] = mean;
                }
            }
        }
    }

    fn checked(self) -> Result<Self, Overflow> {
        let finite = self
            .gramian
            .iter()
            .chain(&self.noise)
            .all(nalgebra::ComplexField::is_finite);
        if finite { Ok(self) } else { Err(Overflow) }
    }
}

fn check_system<T: Real>(
    name: &'static str,
    a: &[T],
    c: &[T],
    q: Option<&[T]>,
    n: usize,
) -> Result<(), Error> {
    let square = n.saturating_mul(n);
    check_length("states", n, n.max(1))?;
    check_length(name, a.len(), square)?;
    check_length("C", c.len(), c.len().next_multiple_of(n.max(1)))?;
    check_finite(name, a)?;
    check_finite("C", c)?;
    if let Some(q) = q {
        check_length("Q", q.len(), square)?;
        check_finite("Q", q)?;
    }
    Ok(())
}

/// e^(A duration), n x n.
///
/// # Errors
/// [`NumberError::Length`](crate::scalar::NumberError::Length), [`Error::Number`], [`Error::Window`].
///
/// ```
/// let e = gramian::linear::window::transition(&[0.0, 1.0, 0.0, 0.0], 2, 3.0).unwrap();
/// assert_eq!(e, [1.0, 3.0, 0.0, 1.0]);
/// ```
pub fn transition<T: Real>(a: &[T], n: usize, duration: T) -> Result<Vec<T>, Error> {
    check_system("A", a, &[], None, n)?;
    check_finite("duration", &[duration])?;
    Ok(exponential(a, n, duration)?)
}

pub(crate) fn exponential<T: Real>(a: &[T], n: usize, duration: T) -> Result<Vec<T>, Overflow> {
    let (mut scaled, mut none) = (a.to_vec(), Vec::new());
    let scale = balance(&mut scaled, &mut none, n).states;
    let at = |i: usize, j: usize| a[i * n + j] * scale[j] / scale[i];
    let rate = norm(n, at);
    let (mut halvings, mut step) = (0, duration);
    while rate * step.abs() > T::of(0.5) && halvings < 2000 {
        step /= T::of(2.0);
        halvings += 1;
    }
    let mut small = vec![T::zero(); n * n];
    for i in 0..n {
        for j in 0..n {
            small[i * n + j] = at(i, j) * step;
        }
    }
    let mut e = series(&small, n);
    for _ in 0..halvings {
        e = multiply(&e, &e, n);
    }
    for i in 0..n {
        for j in 0..n {
            e[i * n + j] *= scale[i] / scale[j];
        }
    }
    if e.iter().all(nalgebra::ComplexField::is_finite) {
        Ok(e)
    } else {
        Err(Overflow)
    }
}

/// The largest sum of magnitudes in a row or column, whichever is less.
fn norm<T: Real>(n: usize, at: impl Fn(usize, usize) -> T) -> T {
    let largest = |sum: &dyn Fn(usize) -> T| {
        (0..n)
            .map(sum)
            .fold(T::zero(), |x, y| if y > x { y } else { x })
    };
    let rows = largest(&|i| (0..n).fold(T::zero(), |sum, j| sum + at(i, j).abs()));
    let columns = largest(&|j| (0..n).fold(T::zero(), |sum, i| sum + at(i, j).abs()));
    rows.min(columns)
}

/// e^M for a norm up to about one: 24 terms of the series.
fn series<T: Real>(m: &[T], n: usize) -> Vec<T> {
    let mut e = vec![T::zero(); n * n];
    for i in 0..n {
        e[i * n + i] = T::one();
    }
    for k in (1..=24).rev() {
        e = multiply(m, &e, n);
        for x in &mut e {
            *x /= T::of(f64::from(k));
        }
        for i in 0..n {
            e[i * n + i] += T::one();
        }
    }
    e
}

/// c^T c
fn information<T: Real>(c: &[T], n: usize) -> Vec<T> {
    let mut v = vec![T::zero(); n * n];
    for row in c.chunks_exact(n) {
        for i in 0..n {
            add(&mut v[i * n..(i + 1) * n], row[i], row);
        }
    }
    v
}

fn multiply<T: Real>(a: &[T], b: &[T], n: usize) -> Vec<T> {
    let mut product = vec![T::zero(); n * n];
    for (row, out) in a.chunks_exact(n).zip(product.chunks_exact_mut(n)) {
        for (&factor, b) in row.iter().zip(b.chunks_exact(n)) {
            add(out, factor, b);
        }
    }
    product
}

fn transpose<T: Real>(a: &[T], n: usize) -> Vec<T> {
    (0..n * n).map(|k| a[k % n * n + k / n]).collect()
}

/// M^-1 B by elimination with row pivots, B n x `columns`; `None` where M is singular.
pub(crate) fn solve<T: Real>(
    mut m: Vec<T>,
    mut b: Vec<T>,
    n: usize,
    columns: usize,
) -> Option<Vec<T>> {
    for k in 0..n {
        let mut pivot = k;
        for i in k + 1..n {
            if m[i * n + k].abs() > m[pivot * n + k].abs() {
                pivot = i;
            }
        }
        if !(m[pivot * n + k].abs() > T::zero()) {
            return None;
        }
        if pivot != k {
            for j in 0..n {
                m.swap(k * n + j, pivot * n + j);
            }
            for j in 0..columns {
                b.swap(k * columns + j, pivot * columns + j);
            }
        }
        for i in 0..n {
            if i == k {
                continue;
            }
            let factor = m[i * n + k] / m[k * n + k];
            if factor == T::zero() {
                continue;
            }
            for j in k..n {
                let x = m[k * n + j];
                m[i * n + j] -= factor * x;
            }
            for j in 0..columns {
                let x = b[k * columns + j];
                b[i * columns + j] -= factor * x;
            }
        }
    }
    for i in 0..n {
        for j in 0..columns {
            b[i * columns + j] /= m[i * n + i];
        }
    }
    Some(b)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_moving_point_seen_for_a_while() {
        // Integral of (1, t)^T (1, t) over 0..3.
        let a = [0.0_f64, 1.0, 0.0, 0.0];
        let window = Window::continuous(&a, &[1.0, 0.0], None, 2, 3.0).unwrap();
        for (found, expected) in window.gramian.iter().zip([3.0, 4.5, 4.5, 9.0]) {
            assert!((found - expected).abs() < 1e-13);
        }
        assert!((window.transition[1] - 3.0).abs() < 1e-14);
    }

    #[test]
    fn a_window_is_two_halves() {
        let a = [0.3_f64, 1.0, -2.0, 0.1];
        let q = [0.2, 0.1, 0.1, 0.4];
        let c = [1.0, 0.5];
        let half = Window::continuous(&a, &c, Some(&q), 2, 0.8).unwrap();
        let whole = Window::continuous(&a, &c, Some(&q), 2, 1.6).unwrap();
        let joined = half.then(&half).unwrap();
        for (x, y) in joined.gramian.iter().zip(&whole.gramian) {
            assert!((x - y).abs() < 1e-12);
        }
        for (x, y) in joined.noise.iter().zip(&whole.noise) {
            assert!((x - y).abs() < 1e-12);
        }
    }

    #[test]
    fn growth_beyond_the_numbers_is_an_error() {
        let grows = [100.0_f64];
        assert_eq!(
            Window::continuous(&grows, &[1.0], None, 1, 100.0).map(|w| w.gramian),
            Err(Error::Window(Overflow))
        );
        assert_eq!(transition(&grows, 1, 100.0), Err(Error::Window(Overflow)));
    }
}
