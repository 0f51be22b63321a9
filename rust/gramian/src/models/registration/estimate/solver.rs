//! The solution of the reduced rows, and small triangles.

use alloc::vec;
use alloc::vec::Vec;

use crate::scalar::Real;
use crate::spectrum::{decompose, rank, unit_columns};

/// Solution of a triangular system through its spectrum.
#[derive(Clone, Debug)]
pub(super) struct Solver<T> {
    pub(super) n: usize,
    pub(super) rank: usize,
    pub(super) factor: Vec<T>,
    pub(super) scale: Vec<T>,
    pub(super) values: Vec<T>,
    pub(super) vectors: Vec<T>,
    pub(super) work: Vec<T>,
}

impl<T: Real> Solver<T> {
    pub(super) fn new(n: usize) -> Self {
        let square = || vec![T::zero(); n * n];
        let line = || vec![T::zero(); n];
        Self {
            n,
            rank: 0,
            factor: square(),
            scale: line(),
            values: line(),
            vectors: square(),
            work: square(),
        }
    }

    /// Takes the triangular factor from lines of length `c`.
    pub(super) fn load(&mut self, stack: &[T], c: usize, rtol: T) {
        let n = self.n;
        for (row, line) in self.factor.chunks_exact_mut(n).zip(stack.chunks_exact(c)) {
            row.copy_from_slice(&line[..n]);
        }
        unit_columns(&self.factor, n, &mut self.scale);
        decompose(
            &self.factor,
            n,
            &self.scale,
            &mut self.values,
            &mut self.vectors,
            &mut self.work,
        );
        self.rank = rank(&self.values, rtol);
    }

    /// The shortest solution of R x = y, with y in column n of `stack`.
    pub(super) fn solve(&self, stack: &[T], c: usize, out: &mut [T]) {
        let n = self.n;
        out.fill(T::zero());
        for k in 0..self.rank {
            let v = &self.vectors[k * n..(k + 1) * n];
            let mut along = T::zero();
            for i in 0..n {
                let u = (0..n).fold(T::zero(), |sum, j| {
                    sum + self.factor[i * n + j] * self.scale[j] * v[j]
                });
                along += u * stack[i * c + n];
            }
            let weight = along / self.values[k] / self.values[k];
            for i in 0..n {
                out[i] += self.scale[i] * v[i] * weight;
            }
        }
    }

    /// (R^T R)^-1 on what is determined.
    pub(super) fn inverse(&self, out: &mut [T]) {
        let n = self.n;
        for i in 0..n {
            for j in 0..n {
                let sum = (0..self.rank).fold(T::zero(), |sum, k| {
                    let v = &self.vectors[k * n..(k + 1) * n];
                    sum + (v[i] / self.values[k]) * (v[j] / self.values[k])
                });
                out[i * n + j] = sum * self.scale[i] * self.scale[j];
            }
        }
    }
}

/// Solves the d x d triangle at the start of `top`, lines of length `c`.
pub(super) fn back_substitute<T: Real>(top: &[T], c: usize, d: usize, right: [T; 3]) -> [T; 3] {
    let mut delta = [T::zero(); 3];
    for i in (0..d).rev() {
        let mut rest = right[i];
        for j in i + 1..d {
            rest -= top[i * c + j] * delta[j];
        }
        delta[i] = rest / top[i * c + i];
    }
    delta
}

pub(super) fn along<T: Real>(row: &[T], direction: &[T]) -> T {
    row.iter()
        .zip(direction)
        .fold(T::zero(), |sum, (&r, &x)| sum + r * x)
}
