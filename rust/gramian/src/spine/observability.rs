//! The whole answer for a problem whose size is known only at run time.
//!
//! [`Observability`] reduces rows once and keeps the triangular factor and its
//! spectrum; bounds, null space and the effect of further knowledge follow from
//! these without touching the rows again.

use alloc::vec;
use alloc::vec::Vec;

use crate::bound;
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length};
use crate::spectrum;
use crate::square_root::{eliminate, triangularize};

/// Rank, spectrum, null space and bounds of rows (K, n).
///
/// # Source
/// As [`Spectrum`](crate::spectrum::Spectrum), the bound as
/// [`crlb_std`](crate::bound::crlb_std), by Householder reflections (Golub & Van Loan,
/// section 5.2).
#[derive(Clone, Debug)]
pub struct Observability<T> {
    n: usize,
    rtol: T,
    factor: Vec<T>,
    scale: Vec<T>,
    singular_values: Vec<T>,
    vectors: Vec<T>,
    rank: usize,
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
        check_rows(rows, n)?;
        if let Some(rtol) = rtol {
            spectrum::check_rtol(rtol)?;
        }
        let reduced = Self::reduced(rows, n, rtol);
        // As for `SquareRootInformation`: no column's norm overflows then.
        let limit = T::MAX / T::of(2.0 * n as f64);
        if reduced.factor.iter().all(|x| x.abs() <= limit) {
            return Ok(reduced);
        }
        Err(NumberError::Overflow {
            result: "information",
        })
    }

    fn reduced(rows: &[T], n: usize, rtol: Option<T>) -> Self {
        let count = rows.len().checked_div(n).unwrap_or(0);
        let mut padded = rows.to_vec();
        padded.resize(count.max(n) * n, T::zero());
        let mut work = vec![T::zero(); n];
        triangularize(&mut padded, n, &mut work);
        padded.truncate(n * n);
        let rtol = rtol.unwrap_or_else(|| spectrum::default_rtol(count, n));
        Self::from_factor(padded, n, rtol)
    }

    fn from_factor(factor: Vec<T>, n: usize, rtol: T) -> Self {
        let mut scale = vec![T::one(); n];
        let mut singular_values = vec![T::zero(); n];
        let mut vectors = vec![T::zero(); n * n];
        let mut work = vec![T::zero(); n * n];
        spectrum::unit_columns(&factor, n, &mut scale);
        spectrum::decompose(
            &factor,
            n,
            &scale,
            &mut singular_values,
            &mut vectors,
            &mut work,
        );
        let rank = spectrum::rank(&singular_values, rtol);
        Self {
            n,
            rtol,
            factor,
            scale,
            singular_values,
            vectors,
            rank,
        }
    }

    /// Number of states.
    pub fn states(&self) -> usize {
        self.n
    }

    /// Number of independent combinations that are determined.
    pub fn rank(&self) -> usize {
        self.rank
    }

    /// Tolerance of the rank decision.
    pub fn rtol(&self) -> T {
        self.rtol
    }

    /// Upper triangular factor of the information, n x n.
    pub fn factor(&self) -> &[T] {
        &self.factor
    }

    /// 1 / norm of each column.
    pub fn scale(&self) -> &[T] {
        &self.scale
    }

    /// Singular values of the rows with unit columns, descending.
    pub fn singular_values(&self) -> &[T] {
        &self.singular_values
    }

    /// Right singular vectors in scaled states, vector j at `j*n..(j+1)*n`.
    pub fn vectors(&self) -> &[T] {
        &self.vectors
    }

    /// Singular values of the rows with column j multiplied by `scale[j]`: with
    /// prior deviations as scale, how much more the data know than the prior.
    ///
    /// # Errors
    /// [`NumberError::Length`], [`NumberError`].
    pub fn singular_values_scaled(&self, scale: &[T]) -> Result<Vec<T>, NumberError> {
        let n = self.n;
        check_length("scale", scale.len(), n)?;
        check_finite("scale", scale)?;
        let mut values = vec![T::zero(); n];
        let (mut vectors, mut work) = (vec![T::zero(); n * n], vec![T::zero(); n * n]);
        spectrum::decompose(&self.factor, n, scale, &mut values, &mut vectors, &mut work);
        finite("singular values", values)
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
        let mut basis: Vec<Vec<T>> = (self.rank..n)
            .map(|k| self.vectors[k * n..(k + 1) * n].to_vec())
            .collect();
        // Dividing by a lead of a tenth makes the rounding ten times larger.
        let touch = spectrum::touch_tolerance(&self.singular_values, self.rank, self.rtol);
        let noise = (touch * T::of(10.0)).min(T::of(1e-2));
        let mut pivots = Vec::new();
        for k in 0..basis.len() {
            // The first state that has a fair share leads: the combination then
            // reads in the order of the states, and rounding does not decide.
            let largest = basis[k..]
                .iter()
                .flat_map(|vector| {
                    (0..n)
                        .filter(|i| !pivots.contains(i))
                        .map(|i| vector[i].abs())
                })
                .fold(T::zero(), |a, b| if b > a { b } else { a });
            let fair = largest * T::of(0.1);
            let pivot = (0..n).find(|i| {
                !pivots.contains(i) && basis[k..].iter().any(|vector| vector[*i].abs() >= fair)
            });
            let Some(pivot) = pivot else { continue };
            let mut r = k;
            for row in k..basis.len() {
                if basis[row][pivot].abs() > basis[r][pivot].abs() {
                    r = row;
                }
            }
            basis.swap(k, r);
            pivots.push(pivot);
            let lead = basis[k][pivot];
            if lead == T::zero() {
                continue;
            }
            for value in &mut basis[k] {
                *value /= lead;
            }
            let leader = basis[k].clone();
            for (other, vector) in basis.iter_mut().enumerate() {
                if other != k {
                    let factor = vector[pivot];
                    for (value, &l) in vector.iter_mut().zip(&leader) {
                        *value -= factor * l;
                    }
                }
            }
        }
        for (vector, &pivot) in basis.iter_mut().zip(&pivots) {
            for (i, value) in vector.iter_mut().enumerate() {
                *value = if value.abs() <= noise && i != pivot {
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
        let Some(k) = self.rank.checked_sub(1) else {
            return Ok(vec![T::zero(); n]);
        };
        let direction = (0..n)
            .map(|i| self.scale[i] * self.vectors[k * n + i] / self.singular_values[k])
            .collect();
        finite("weakest direction", direction)
    }

    /// Standard deviation of each state at the bound, infinite where an
    /// unobservable combination touches it, or it overflows.
    pub fn crlb_std(&self) -> Vec<T> {
        let mut out = vec![T::zero(); self.n];
        bound::standard_deviations(
            &self.singular_values,
            &self.vectors,
            &self.scale,
            self.rank,
            self.rtol,
            &mut out,
        );
        out
    }

    /// The bound on the covariance, `None` where the rank is short, or an entry
    /// overflows.
    pub fn crlb(&self) -> Option<Vec<T>> {
        let mut out = vec![T::zero(); self.n * self.n];
        bound::covariance(
            &self.singular_values,
            &self.vectors,
            &self.scale,
            self.rank,
            &mut out,
        )
        .then_some(out)
    }

    /// log det of the information; minus infinity where the rank is short.
    pub fn log_det(&self) -> T {
        if self.rank < self.n {
            return -T::INFINITY;
        }
        let log = (0..self.n).fold(T::zero(), |sum, i| {
            sum + self.factor[i * self.n + i].abs().ln()
        });
        log + log
    }

    /// The bound on the standard deviation of the combination c^T x; infinite where
    /// there is none.
    ///
    /// # Errors
    /// [`NumberError::Length`], [`NumberError`].
    pub fn combination_std(&self, combination: &[T]) -> Result<T, NumberError> {
        check_length("combination", combination.len(), self.n)?;
        check_finite("combination", combination)?;
        let std = self.deviation(combination);
        // Not NaN.
        if std >= T::zero() {
            return Ok(std);
        }
        Err(NumberError::Overflow {
            result: "combination",
        })
    }

    fn deviation(&self, combination: &[T]) -> T {
        let n = self.n;
        let scaled: Vec<T> = combination
            .iter()
            .zip(&self.scale)
            .map(|(&c, &d)| c * d)
            .collect();
        let length = scaled
            .iter()
            .fold(T::zero(), |norm, &c| crate::scalar::hypot(norm, c));
        if length == T::zero() {
            return T::zero();
        }
        let touch = spectrum::touch_tolerance(&self.singular_values, self.rank, self.rtol);
        let (mut null, mut std) = (T::zero(), T::zero());
        for k in 0..n {
            let along = self.vectors[k * n..(k + 1) * n]
                .iter()
                .zip(&scaled)
                .fold(T::zero(), |sum, (&v, &c)| sum + v * (c / length));
            if k < self.rank {
                std = crate::scalar::hypot(std, along / self.singular_values[k]);
            } else {
                null = crate::scalar::hypot(null, along);
            }
        }
        if null > touch {
            T::INFINITY
        } else {
            std * length
        }
    }

    /// The answer once the combination c^T x is also known to `sigma`; with
    /// `sigma` 0, exactly. Gives rank (of n) and standard deviations then.
    ///
    /// # Errors
    /// [`NumberError::Length`]; [`NumberError`] for what is not finite, a deviation below
    /// zero, or information that overflows.
    pub fn knowing(&self, combination: &[T], sigma: T) -> Result<(usize, Vec<T>), NumberError> {
        let n = self.n;
        check_length("combination", combination.len(), n)?;
        check_finite("combination", combination)?;
        if !(sigma >= T::zero() && sigma.is_finite()) {
            return Err(NumberError::OutOfRange {
                name: "sigma",
                given: sigma.double(),
                allowed: ">= 0 and finite",
            });
        }
        if combination.iter().all(|&c| c == T::zero()) {
            return Ok((self.rank, self.crlb_std()));
        }
        if sigma > T::zero() {
            let mut rows = self.factor.clone();
            let row = combination.iter().map(|&c| c / sigma).collect();
            rows.extend(finite("combination / sigma", row)?);
            let known = Self::new(&rows, n, Some(self.rtol))?;
            return Ok((known.rank, known.crlb_std()));
        }
        // Exact knowledge leaves the states orthogonal to c (in scaled states):
        // a reflection takes c to the first axis, whose column then falls away.
        let scaled: Vec<T> = combination
            .iter()
            .zip(&self.scale)
            .map(|(&c, &d)| c * d)
            .collect();
        let reflection = reflection_to_first_axis(&finite("combination", scaled)?);
        let reflection = finite("combination", reflection)?;
        let m = n - 1;
        let mut rows = vec![T::zero(); n * m];
        for i in 0..n {
            for j in 0..m {
                rows[i * m + j] = (0..n).fold(T::zero(), |sum, k| {
                    sum + self.factor[i * n + k] * self.scale[k] * reflection[k * n + j + 1]
                });
            }
        }
        let rest = Self::reduced(&rows, m, Some(self.rtol));
        let std = (0..n)
            .map(|i| {
                let coordinates: Vec<T> = (0..m).map(|j| reflection[i * n + j + 1]).collect();
                self.scale[i] * rest.deviation(&coordinates)
            })
            .collect();
        Ok((rest.rank + 1, std))
    }
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
    let factor = Observability::new(rows, n, None)?.factor;
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
    let rank = eliminate(&mut a, n, eliminated, rtol, &mut work);
    a.chunks_exact(n)
        .skip(rank)
        .map(|row| finite("rows", row[eliminated..].to_vec()))
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
