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
    /// The bound of the deviation of each state; infinite where there is none.
    pub std: Vec<f64>,
    /// Singular values of the rows with unit columns, descending.
    pub singular_values: Vec<f64>,
    /// What is not determined, in the units of the states.
    pub null_space: Vec<Vec<f64>>,
}

/// Rows about the state at sample `first`: those of the samples up to `last`.
pub fn rows(
    transitions: &[f64],
    white: &[f64],
    n: usize,
    p: usize,
    first: usize,
    last: usize,
) -> Vec<f64> {
    let mut phi = vec![0.0; n * n];
    for i in 0..n {
        phi[i * n + i] = 1.0;
    }
    let mut rows = Vec::with_capacity((last - first) * p * n);
    let mut next = vec![0.0; n * n];
    for k in first..last {
        for line in white[k * p * n..(k + 1) * p * n].chunks_exact(n) {
            let from = rows.len();
            rows.resize(from + n, 0.0);
            through(line, &phi, &mut rows[from..]);
        }
        if k + 1 < last {
            let step = &transitions[k * n * n..(k + 1) * n * n];
            for (line, out) in step.chunks_exact(n).zip(next.chunks_exact_mut(n)) {
                out.fill(0.0);
                through(line, &phi, out);
            }
            core::mem::swap(&mut phi, &mut next);
        }
    }
    rows
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

/// Windows of `width` samples that begin at each sample, from K transitions (K - 1 x n x n)
/// and whitened output Jacobians (K x p x n). `basis` (K x n x m), where given, holds the
/// directions that a constraint leaves free at each sample: answers are about them.
///
/// # Errors
/// [`NumberError`] for lengths that do not fit, or rows that exceed the numbers.
pub fn windows(
    transitions: &[f64],
    white: &[f64],
    n: usize,
    p: usize,
    width: usize,
    rtol: Option<f64>,
    basis: Option<(&[f64], usize)>,
) -> Result<Vec<Look>, NumberError> {
    let count = white.len().checked_div(n * p).unwrap_or(0);
    check_length(
        "transitions",
        transitions.len(),
        count.saturating_sub(1) * n * n,
    )?;
    check_length("width", width, width.clamp(1, count.max(1)))?;
    let mut out = Vec::with_capacity(count + 1 - width);
    for first in 0..=count - width {
        let mut rows = rows(transitions, white, n, p, first, first + width);
        let mut m = n;
        if let Some((basis, columns)) = basis {
            m = columns;
            let here = &basis[first * n * m..(first + 1) * n * m];
            rows = rows
                .chunks_exact(n)
                .flat_map(|row| {
                    let mut free = vec![0.0; m];
                    for (&factor, line) in row.iter().zip(here.chunks_exact(m)) {
                        for (y, x) in free.iter_mut().zip(line) {
                            *y += factor * x;
                        }
                    }
                    free
                })
                .collect();
        }
        check_finite("rows", &rows)?;
        let found = Observability::new(&rows, m, rtol)?;
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
