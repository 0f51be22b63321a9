//! The estimators that are linearised at the reports.

use alloc::vec;

use super::solver::along;
use super::{Estimator, Method, Question};
use crate::numbers::algebra::{cross, dot};
use crate::registration::Error;
use crate::registration::look::{unchecked_linearise, unchecked_place, width};
use crate::scalar::Real;
use crate::square_root::reflect;

impl<T: Real> Estimator<T> {
    /// Least squares, linearised at the reports as corrected so far.
    pub(super) fn linear(
        &mut self,
        question: &Question<'_, T>,
        reports: &[T],
    ) -> Result<(usize, bool), Error> {
        let layout = self.layout;
        let (d, n, c) = (layout.size(), layout.states(), width(&layout));
        let measured = layout.sensors * d;
        let weighted = question.method == Method::Generalised;
        let wide = if weighted { c } else { c + measured };
        let mut spread = vec![T::zero(); n * n];
        for iteration in 0..question.iterations.max(1) {
            self.mean_positions(question, reports);
            spread.fill(T::zero());
            let mut used = 0;
            for k in 0..self.looks {
                self.linear_look(question, reports, k, wide)?;
                let (lines, work) = self.lines.split_at_mut(measured * wide);
                for column in 0..d {
                    reflect(lines, wide, column, column, work);
                }
                let rest = &lines[d * wide..];
                for line in rest.chunks_exact(wide) {
                    self.stack[used * (n + 1)..(used + 1) * (n + 1)].copy_from_slice(&line[d..c]);
                    used += 1;
                }
                if !weighted {
                    add_spread(rest, wide, d, n, &mut spread);
                }
            }
            let _ = self.push_prior(question, &mut used);
            self.reduce(used);
            self.spectrum.solve(&self.stack, n + 1, &mut self.step);
            for (x, s) in self.biases.iter_mut().zip(&self.step) {
                *x += *s;
            }
            let small = (0..n).all(|i| {
                (self.step[i] * self.spectrum.values[self.spectrum.rank.saturating_sub(1)]).abs()
                    < question.tolerance * self.spectrum.scale[i]
            });
            if weighted && small && iteration > 0 {
                self.mean_positions(question, reports);
                return Ok((iteration + 1, true));
            }
        }
        if !weighted {
            self.unweighted_covariance(&spread);
        }
        self.mean_positions(question, reports);
        Ok((question.iterations.max(1), true))
    }

    /// The lines of look `k`, each sensor linearised where its own report puts
    /// the target; of length `wide`, in metres and with their noise if that has
    /// room for it, whitened otherwise.
    fn linear_look(
        &mut self,
        question: &Question<'_, T>,
        reports: &[T],
        k: usize,
        wide: usize,
    ) -> Result<(), Error> {
        let layout = self.layout;
        let (d, c) = (layout.size(), width(&layout));
        let (per, m) = (layout.per_sensor(), layout.sensors);
        let lines = &mut self.lines[..m * d * wide];
        let weighted = wide == c;
        let sensors = layout.at_look(question.sensors, k);
        lines.fill(T::zero());
        for s in 0..m {
            let own = s * d..(s + 1) * d;
            let bias = &self.biases[s * per..(s + 1) * per];
            let mut at = [T::zero(); 3];
            let report = &reports[(k * m + s) * d..(k * m + s + 1) * d];
            unchecked_place(&layout, &sensors[own.clone()], bias, report, &mut at);
            let (sensor, sigma) = (&sensors[own.clone()], &question.sigma[own]);
            let linear = unchecked_linearise(&layout, sensor, sigma, bias, &at[..d])
                .map_err(|error| error.at(k))?;
            let inverse = inverse(&linear.position, d);
            let mut apart = [T::zero(); 3];
            for i in 0..d {
                apart[i] = at[i] - self.positions[k * d + i];
            }
            for q in 0..d {
                let line = &mut lines[(s * d + q) * wide..(s * d + q + 1) * wide];
                if weighted {
                    line[..d].copy_from_slice(&linear.position[q][..d]);
                    line[d + s * per..d + (s + 1) * per].copy_from_slice(&linear.bias[q][..per]);
                    line[c - 1] = dot(&linear.position[q], &apart);
                } else {
                    line[q] = T::one();
                    for j in 0..per {
                        let column = core::array::from_fn(|i| linear.bias[i][j]);
                        line[d + s * per + j] = dot(&inverse[q], &column);
                    }
                    line[c - 1] = apart[q];
                    line[c + s * d..c + (s + 1) * d].copy_from_slice(&inverse[q][..d]);
                }
            }
        }
        Ok(())
    }

    /// N^-1 (sum of H^T R H) N^-1: unweighted squares do not reach J^-1.
    fn unweighted_covariance(&mut self, spread: &[T]) {
        let n = self.layout.states();
        let mut normal = vec![T::zero(); n * n];
        self.spectrum.inverse(&mut normal);
        for i in 0..n {
            for j in 0..n {
                let mut sum = T::zero();
                for a in 0..n {
                    for b in 0..n {
                        sum += normal[i * n + a] * spread[a * n + b] * normal[b * n + j];
                    }
                }
                self.covariance[i * n + j] = sum;
            }
        }
    }
}

/// Adds H^T R H of lines that carry their noise behind the right-hand side.
fn add_spread<T: Real>(lines: &[T], wide: usize, d: usize, n: usize, spread: &mut [T]) {
    for one in lines.chunks_exact(wide) {
        for two in lines.chunks_exact(wide) {
            let noise = along(&one[d + n + 1..], &two[d + n + 1..]);
            for i in 0..n {
                for j in 0..n {
                    spread[i * n + j] += one[d + i] * noise * two[d + j];
                }
            }
        }
    }
}

/// The inverse of the leading d x d block.
fn inverse<T: Real>(m: &[[T; 3]; 3], d: usize) -> [[T; 3]; 3] {
    let mut out = [[T::zero(); 3]; 3];
    if d == 2 {
        let det = m[0][0] * m[1][1] - m[0][1] * m[1][0];
        out[0] = [m[1][1] / det, -m[0][1] / det, T::zero()];
        out[1] = [-m[1][0] / det, m[0][0] / det, T::zero()];
        return out;
    }
    let columns = [
        cross(&m[1], &m[2]),
        cross(&m[2], &m[0]),
        cross(&m[0], &m[1]),
    ];
    let det = dot(&m[0], &columns[0]);
    for i in 0..3 {
        for j in 0..3 {
            out[i][j] = columns[j][i] / det;
        }
    }
    out
}
