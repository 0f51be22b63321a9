//! What a window of outputs that slides along a trajectory tells of the state at its
//! beginning.

use alloc::vec;
use alloc::vec::Vec;

use crate::observability::Observability;
use crate::scalar::{NumberError, check_finite, check_length};

/// One window.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    /// How many combinations of the states are determined.
    pub rank: usize,
    /// The bound of the deviation of each state; infinite where there is none, or where the
    /// errors of the rows leave open whether there is.
    pub std: Vec<f64>,
    /// Singular values of the rows with unit columns, descending.
    pub singular_values: Vec<f64>,
    /// What is not determined, in the units of the states.
    pub null_space: Vec<Vec<f64>>,
}

/// What a trajectory of K samples, n states and p outputs leaves behind, outputs whitened.
#[derive(Clone, Copy, Debug)]
pub struct Path<'a> {
    /// K - 1 x n x n.
    pub transitions: &'a [f64],
    /// What steps twice as long would have changed in them; empty where they are exact.
    pub changes: &'a [f64],
    /// K x p x n.
    pub jacobians: &'a [f64],
    /// How wrong they may be; empty where they are exact.
    pub errors: &'a [f64],
    /// Number of states.
    pub n: usize,
    /// Number of outputs.
    pub p: usize,
}

/// Rows, and how wrong each entry may be.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// samples p x n.
    pub values: Vec<f64>,
    /// The same shape.
    pub errors: Vec<f64>,
}

impl Path<'_> {
    fn check(&self) -> Result<usize, NumberError> {
        let (n, p) = (self.n, self.p);
        let count = self.jacobians.len().checked_div(n * p).unwrap_or(0);
        let between = count.saturating_sub(1) * n * n;
        check_length("transitions", self.transitions.len(), between)?;
        if !self.changes.is_empty() {
            check_length("changes", self.changes.len(), between)?;
        }
        if !self.errors.is_empty() {
            check_length("errors", self.errors.len(), self.jacobians.len())?;
        }
        Ok(count)
    }

    /// Rows about the state at sample `first`: those of the samples before `last`.
    ///
    /// # Errors
    /// [`NumberError`] for lengths that do not fit.
    pub fn rows(&self, first: usize, last: usize) -> Result<Rows, NumberError> {
        let count = self.check()?;
        check_length("last", last, last.clamp(first, count))?;
        let (n, p) = (self.n, self.p);
        let mut phi = vec![0.0; n * n];
        for i in 0..n {
            phi[i * n + i] = 1.0;
        }
        // The same by longer steps, by products that round otherwise.
        let mut other = phi.clone();
        let mut found = Rows {
            values: Vec::with_capacity((last - first) * p * n),
            errors: Vec::with_capacity((last - first) * p * n),
        };
        let (mut next, mut moved) = (vec![0.0; n * n], vec![0.0; n]);
        for k in first..last {
            for o in k * p..(k + 1) * p {
                let line = &self.jacobians[o * n..(o + 1) * n];
                let from = found.values.len();
                found.values.resize(from + n, 0.0);
                through(line, &phi, &mut found.values[from..]);
                moved.fill(0.0);
                through(line, &other, &mut moved);
                for (j, (x, y)) in moved.iter().zip(&found.values[from..]).enumerate() {
                    let mut error = (x - y).abs();
                    for (i, value) in line.iter().enumerate() {
                        let off = self.errors.get(o * n + i).copied().unwrap_or(0.0);
                        error += (off + 4.0 * f64::EPSILON * value.abs()) * phi[i * n + j].abs();
                    }
                    found.errors.push(error);
                }
            }
            if k + 1 < last {
                let range = k * n * n..(k + 1) * n * n;
                let step = &self.transitions[range.clone()];
                advance(step, n, &mut phi, &mut next);
                if let Some(change) = self.changes.get(range) {
                    let longer: Vec<f64> = step.iter().zip(change).map(|(x, d)| x + d).collect();
                    advance(&longer, n, &mut other, &mut next);
                } else {
                    other.copy_from_slice(&phi);
                }
            }
        }
        Ok(found)
    }
}

/// phi = step phi.
fn advance(step: &[f64], n: usize, phi: &mut Vec<f64>, next: &mut Vec<f64>) {
    for (line, out) in step.chunks_exact(n).zip(next.chunks_exact_mut(n)) {
        out.fill(0.0);
        through(line, phi, out);
    }
    core::mem::swap(phi, next);
}

/// out += line M
fn through(line: &[f64], matrix: &[f64], out: &mut [f64]) {
    let n = line.len();
    for (&factor, row) in line.iter().zip(matrix.chunks_exact(n)) {
        if factor != 0.0 {
            for (y, x) in out.iter_mut().zip(row) {
                *y += factor * x;
            }
        }
    }
}

/// Windows of `width` samples that begin at each sample. `basis` (K x n x m), where given,
/// holds the directions that a constraint leaves free at each sample: answers are about
/// them. Without `rtol`, ranks are decided above the errors of the rows.
///
/// # Errors
/// [`NumberError`] for lengths that do not fit, or rows that exceed the numbers.
pub fn windows(
    path: &Path<'_>,
    width: usize,
    rtol: Option<f64>,
    basis: Option<(&[f64], usize)>,
) -> Result<Vec<Look>, NumberError> {
    let (count, n) = (path.check()?, path.n);
    check_length("width", width, width.clamp(1, count.max(1)))?;
    let mut out = Vec::with_capacity(count + 1 - width);
    for first in 0..=count - width {
        let seen = path.rows(first, first + width)?;
        let (mut rows, mut errors) = (seen.values, seen.errors);
        let mut m = n;
        if let Some((basis, columns)) = basis {
            m = columns;
            let here = &basis[first * n * m..(first + 1) * n * m];
            let turned = |rows: &[f64], of: &dyn Fn(f64) -> f64| -> Vec<f64> {
                rows.chunks_exact(n)
                    .flat_map(|row| {
                        let mut free = vec![0.0; m];
                        for (&factor, line) in row.iter().zip(here.chunks_exact(m)) {
                            for (y, &x) in free.iter_mut().zip(line) {
                                *y += factor * of(x);
                            }
                        }
                        free
                    })
                    .collect()
            };
            rows = turned(&rows, &|x| x);
            errors = turned(&errors, &f64::abs);
        }
        check_finite("rows", &rows)?;
        let found = if rtol.is_some() {
            Observability::new(&rows, m, rtol)?
        } else {
            let rtol = accuracy(&mut rows, &mut errors, m);
            Observability::inexact(&rows, &errors, &[], m, rtol)?
        };
        let lift = |v: Vec<f64>| match basis {
            None => v,
            Some((basis, m)) => basis[first * n * m..(first + 1) * n * m]
                .chunks_exact(m)
                .map(|line| line.iter().zip(&v).map(|(a, b)| a * b).sum())
                .collect(),
        };
        let std = match basis {
            None => found.crlb_std(),
            Some((basis, m)) => {
                let mut std = Vec::with_capacity(n);
                for line in basis[first * n * m..(first + 1) * n * m].chunks_exact(m) {
                    std.push(if line.iter().all(|x| *x == 0.0) {
                        0.0
                    } else {
                        found.combination_std(line)?
                    });
                }
                std
            }
        };
        out.push(Look {
            rank: found.rank(),
            std,
            singular_values: found.singular_values().to_vec(),
            null_space: found.null_space()?.into_iter().map(lift).collect(),
        });
    }
    Ok(out)
}

/// The relative accuracy of rows (k x m) with unit columns, where it is worse than rounding.
/// Columns that are no larger than their errors become zero.
fn accuracy(rows: &mut [f64], errors: &mut [f64], m: usize) -> Option<f64> {
    let mut total = 0.0;
    for j in 0..m {
        let length = |x: &[f64]| x.iter().skip(j).step_by(m).map(|x| x * x).sum::<f64>();
        let (size, off) = (length(rows), length(errors));
        if off <= 0.0 {
            continue;
        }
        if off < size / 9.0 {
            total += off / size;
        } else {
            for entries in [&mut *rows, &mut *errors] {
                entries.iter_mut().skip(j).step_by(m).for_each(|x| *x = 0.0);
            }
        }
    }
    let relative = nalgebra::ComplexField::sqrt(total);
    let longest = m.max(rows.len() / m.max(1)) as f64;
    let rounding = 32.0 * f64::EPSILON * nalgebra::ComplexField::sqrt(longest);
    (relative > rounding).then_some(relative.min(0.5))
}
