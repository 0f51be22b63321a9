//! Tall matrices by columns, and their reduction by reflections.

use alloc::vec;
use alloc::vec::Vec;

use crate::batch::simd::Path;

/// A matrix of few long columns.
#[derive(Clone, Debug)]
pub struct Columns {
    data: Vec<f64>,
    rows: usize,
    stride: usize,
}

impl Columns {
    /// `rows` is the most that there will be.
    pub fn new(rows: usize, columns: usize) -> Self {
        Self {
            data: vec![0.0; rows * columns],
            rows,
            stride: rows,
        }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Sets how many rows count.
    pub fn resize(&mut self, rows: usize) {
        self.rows = rows.min(self.stride);
    }

    pub fn column(&self, j: usize) -> &[f64] {
        &self.data[j * self.stride..j * self.stride + self.rows]
    }

    pub fn column_mut(&mut self, j: usize) -> &mut [f64] {
        &mut self.data[j * self.stride..j * self.stride + self.rows]
    }

    /// The first three, at once: what writes to all looks for none of them twice.
    pub fn first_three_mut(&mut self) -> [&mut [f64]; 3] {
        let rows = self.rows;
        let (a, rest) = self.data.split_at_mut(self.stride);
        let (b, rest) = rest.split_at_mut(self.stride);
        [&mut a[..rows], &mut b[..rows], &mut rest[..rows]]
    }

    /// Writes the sum of the first columns times `factors`.
    pub fn combine<const N: usize>(&self, factors: &[f64; N], out: &mut [f64]) {
        let mut terms = factors
            .iter()
            .enumerate()
            .filter(|(_, factor)| **factor != 0.0);
        let Some((j, factor)) = terms.next() else {
            out.fill(0.0);
            return;
        };
        for (x, y) in out.iter_mut().zip(self.column(j)) {
            *x = factor * y;
        }
        for (j, factor) in terms {
            for (x, y) in out.iter_mut().zip(self.column(j)) {
                *x += factor * y;
            }
        }
    }

    /// Makes the first `triangle` columns upper triangular by reflections that
    /// are applied to the first `columns`.
    pub fn reduce(&mut self, triangle: usize, columns: usize) {
        Path::Best.run(Reduce {
            data: &mut self.data,
            rows: self.rows,
            stride: self.stride,
            triangle,
            columns,
        });
    }
}

struct Reduce<'a> {
    data: &'a mut [f64],
    rows: usize,
    stride: usize,
    triangle: usize,
    columns: usize,
}

impl pulp::WithSimd for Reduce<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        for k in 0..self.triangle.min(self.rows) {
            let (head, tail) = self.data.split_at_mut((k + 1) * self.stride);
            let pivot = &mut head[k * self.stride + k..k * self.stride + self.rows];
            // The field in tesla squares to 1e-20 at most: no underflow to fear
            // before a field of 1e-150 T.
            let norm = dot(simd, pivot, pivot).sqrt();
            if !(norm > 0.0) {
                continue;
            }
            let alpha = if pivot[0] > 0.0 { -norm } else { norm };
            let beta = alpha * (alpha - pivot[0]);
            pivot[0] -= alpha;
            for j in 0..self.columns - k - 1 {
                let column = &mut tail[j * self.stride + k..j * self.stride + self.rows];
                let factor = -dot(simd, pivot, column) / beta;
                add(simd, factor, pivot, column);
            }
            pivot[0] = alpha;
            pivot[1..].fill(0.0);
        }
    }
}

#[inline(always)]
fn dot<S: pulp::Simd>(simd: S, a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = S::as_simd_f64s(a);
    let (b, b_rest) = S::as_simd_f64s(b);
    let mut sums = [simd.splat_f64s(0.0); 2];
    let (a, a_last) = a.as_chunks::<2>();
    let (b, b_last) = b.as_chunks::<2>();
    for (a, b) in a.iter().zip(b) {
        sums[0] = simd.mul_add_e_f64s(a[0], b[0], sums[0]);
        sums[1] = simd.mul_add_e_f64s(a[1], b[1], sums[1]);
    }
    for (&a, &b) in a_last.iter().zip(b_last) {
        sums[0] = simd.mul_add_e_f64s(a, b, sums[0]);
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum();
    rest + simd.reduce_sum_f64s(simd.add_f64s(sums[0], sums[1]))
}

/// `to` += `factor` * `from`.
#[inline(always)]
fn add<S: pulp::Simd>(simd: S, factor: f64, from: &[f64], to: &mut [f64]) {
    let (from, from_rest) = S::as_simd_f64s(from);
    let (to, to_rest) = S::as_mut_simd_f64s(to);
    let wide = simd.splat_f64s(factor);
    for (x, &y) in to.iter_mut().zip(from) {
        *x = simd.mul_add_e_f64s(wide, y, *x);
    }
    for (x, y) in to_rest.iter_mut().zip(from_rest) {
        *x += factor * y;
    }
}

/// Takes from a whitened column, channel by channel, what a constant of that channel
/// explains: `constant` is one of all channels, whitened, and `sums` of its squares.
/// Numbers of the channels follow each other in turn.
pub fn center(column: &mut [f64], constant: &[f64], sums: &[f64]) {
    let channels = sums.len();
    let mut means = vec![0.0; channels];
    for (x, w) in column
        .chunks_exact(channels)
        .zip(constant.chunks_exact(channels))
    {
        for i in 0..channels {
            means[i] += x[i] * w[i];
        }
    }
    for (mean, &sum) in means.iter_mut().zip(sums) {
        *mean = if sum > 0.0 { *mean / sum } else { 0.0 };
    }
    for (x, w) in column
        .chunks_exact_mut(channels)
        .zip(constant.chunks_exact(channels))
    {
        for i in 0..channels {
            x[i] -= means[i] * w[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::Stream;

    #[test]
    fn every_path_reduces_to_the_same_gram_matrix() {
        for rows in [4, 13, 63, 200] {
            let mut random = Stream::new(9, rows as u64);
            let data: Vec<f64> = (0..4 * rows).map(|_| random.normal()).collect();
            let gram = |data: &[f64], i: usize, j: usize| -> f64 {
                let column = |j: usize| &data[j * rows..(j + 1) * rows];
                column(i).iter().zip(column(j)).map(|(x, y)| x * y).sum()
            };
            for path in Path::available() {
                let mut reduced = data.clone();
                path.run(Reduce {
                    data: &mut reduced,
                    rows,
                    stride: rows,
                    triangle: 3,
                    columns: 4,
                });
                for i in 0..4 {
                    for j in 0..4 {
                        let size = gram(&data, i, i).max(gram(&data, j, j));
                        assert!((gram(&reduced, i, j) - gram(&data, i, j)).abs() < 1e-13 * size);
                    }
                }
                for j in 0..3 {
                    assert!(
                        reduced[j * rows + j + 1..(j + 1) * rows]
                            .iter()
                            .all(|&x| x == 0.0)
                    );
                }
            }
        }
    }

    #[test]
    fn centring_takes_off_what_a_constant_explains() {
        let weights = [1.0, 2.0, 0.0, 1.0, 3.0, 1.0];
        let sums = [1.0 + 0.0 + 9.0, 4.0 + 1.0 + 1.0];
        // Two channels of three numbers each: constants 5 and -2, weighted.
        let mut column = [5.0, -4.0, 0.0, -2.0, 15.0, -2.0];
        center(&mut column, &weights, &sums);
        assert!(column.iter().all(|x| x.abs() < 1e-14));
    }
}
