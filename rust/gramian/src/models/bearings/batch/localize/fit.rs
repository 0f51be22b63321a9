//! Where the steps ended, and what to say of it.

use super::Status;
use super::algebra::decompose;
use super::kernels::MAX;
use super::solver::Solver;
use crate::scalar::hypot;
use crate::spectrum;

/// Reciprocal ranges above this, in units of the observer's path: the target would be at
/// the observer's first place, where its first bearing fits whatever it is.
pub const AT_THE_OBSERVER: f64 = 1e5;

/// Where the steps ended.
#[derive(Clone, Copy)]
pub struct Fit<const N: usize> {
    /// (u, w1, w2, .., s).
    pub model: [f64; MAX],
    /// Triangular factor of the information on (direction, w.., s).
    pub root: [[f64; N]; N],
    pub chi2: f64,
    pub cost: f64,
    pub iterations: u32,
    pub converged: bool,
    /// Independent combinations that no bearing sees; see [`ranked`](Self::ranked).
    pub nullity: usize,
    /// The first of them.
    pub null: [f64; N],
}

impl<const N: usize> Fit<N> {
    /// The same with its nullity and null vector.
    pub fn ranked(self, rtol: f64) -> Self {
        let (nullity, null) = self.unseen(rtol);
        Self {
            nullity,
            null,
            ..self
        }
    }

    /// Whether the steps came to rest at a state, at a finite range, with full rank.
    pub fn regular(&self) -> bool {
        let s = self.model[N];
        self.converged && self.nullity == 0 && s > 0.0 && s < AT_THE_OBSERVER
    }

    /// The nullity and, if it is not zero, the first null vector.
    fn unseen(&self, rtol: f64) -> (usize, [f64; N]) {
        let mut scale = [1.0; N];
        spectrum::unit_columns(self.root.as_flattened(), N, &mut scale);
        if let Some(inverse) = self.inverse() {
            // 1 / |R^-1| is a lower bound of the smallest singular value, the
            // root of N an upper one of the largest.
            let square = (0..N).fold(0.0, |sum, i| {
                (i..N).fold(sum, |sum, j| {
                    let x = inverse[i][j] / scale[i];
                    sum + x * x
                })
            });
            if square * rtol * rtol * (N as f64) < 1.0 {
                return (0, [0.0; N]);
            }
        }
        let (s, v) = decompose(&self.root, &scale);
        let rank = spectrum::rank(&s, rtol);
        let mut null = v.get(rank).copied().unwrap_or([0.0; N]);
        for (x, scale) in null.iter_mut().zip(&scale) {
            *x *= scale;
        }
        (N - rank, null)
    }

    /// The inverse of the factor, upper triangular; `None` with a zero diagonal.
    fn inverse(&self) -> Option<[[f64; N]; N]> {
        let r = &self.root;
        if (0..N).any(|k| r[k][k] == 0.0) {
            return None;
        }
        let mut inverse = [[0.0; N]; N];
        for j in 0..N {
            inverse[j][j] = 1.0 / r[j][j];
            for i in (0..j).rev() {
                let sum = (i + 1..=j).fold(0.0, |sum, k| sum + r[i][k] * inverse[k][j]);
                inverse[i][j] = -sum / r[i][i];
            }
        }
        Some(inverse)
    }

    fn judge(&self, solver: &Solver<N>) -> Status {
        let s = self.model[N];
        if self.nullity > 0 {
            Status::Unobservable
        } else if !(s > 0.0) {
            Status::Unbounded
        } else if !self.converged {
            Status::NotConverged
        } else if 1.0 / (self.root[N - 1][N - 1] * s) > solver.options.weak_ratio {
            Status::Weak
        } else {
            Status::Converged
        }
    }

    /// Columns of a square root of the covariance of the states.
    fn spread(&self, solver: &Solver<N>) -> Option<[[f64; N]; N]> {
        let inverse = self.inverse()?;
        let per_square = 1.0 / (self.model[N] * self.model[N]);
        Some(core::array::from_fn(|k| {
            let change = core::array::from_fn(|i| inverse[i][k] * per_square);
            solver.move_states(&self.model, &change)
        }))
    }

    pub fn write(&self, solver: &Solver<N>, out: &mut [f64]) {
        let status = self.judge(solver);
        let (estimate, out) = out.split_at_mut(N);
        let (direction, out) = out.split_at_mut(N);
        let (covariance, tail) = out.split_at_mut(N * N);
        direction.fill(0.0);
        let spread = match status {
            Status::Unobservable | Status::Unbounded => None,
            _ => self.spread(solver),
        };
        if let Some(spread) = spread {
            estimate.copy_from_slice(&solver.state(&self.model));
            for i in 0..N {
                for j in 0..N {
                    covariance[i * N + j] = spread.iter().fold(0.0, |sum, x| sum + x[i] * x[j]);
                }
            }
        } else {
            estimate.fill(f64::NAN);
            covariance.fill(f64::INFINITY);
        }
        if self.nullity > 0 {
            let moved = solver.move_states(&self.model, &self.null);
            let length = hypot(moved[0], moved[1]);
            let size = moved.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
            // In metres of position, where the position moves at all.
            let unit = if length > 1e-9 * size { length } else { size };
            // Coordinates near the end of the range leave no direction that is a number.
            if unit > 0.0 && moved.iter().all(|x| (x / unit).is_finite()) {
                for (out, x) in direction.iter_mut().zip(&moved) {
                    *out = x / unit;
                }
            }
        }
        tail.copy_from_slice(&[
            status.code(),
            self.nullity as f64,
            f64::from(self.iterations),
            self.cost,
            1.0,
        ]);
    }

    pub fn write_error(&self, solver: &Solver<N>, truth: &[f64; N], out: &mut [f64]) {
        let status = self.judge(solver);
        let (error, out) = out.split_at_mut(N);
        let (deviation, tail) = out.split_at_mut(N);
        let spread = match status {
            Status::Unobservable | Status::Unbounded => None,
            _ => self.spread(solver),
        };
        let mut square = f64::NAN;
        if let Some(spread) = spread {
            let estimate = solver.state(&self.model);
            let moved: [f64; N] = core::array::from_fn(|i| estimate[i] - truth[i]);
            error.copy_from_slice(&moved);
            for i in 0..N {
                deviation[i] = spread.iter().fold(0.0, |sum, x| sum + x[i] * x[i]).sqrt();
            }
            let change = solver.change_of(&self.model, &moved);
            square = (0..N).fold(0.0, |sum, i| {
                let x = (i..N).fold(0.0, |x, j| x + self.root[i][j] * change[j]);
                sum + x * x
            });
        } else {
            error.fill(f64::NAN);
            deviation.fill(f64::INFINITY);
        }
        tail.copy_from_slice(&[square, self.cost, status.code(), f64::from(self.iterations)]);
    }
}
