//! Many rows at once, column by column: their reduction to the triangular factor, in lanes.

use pulp::Simd;

use crate::batch::lanes::Lanes;
use crate::batch::simd::Path;
use crate::numbers::lane::Lane;
use crate::square_root::{SquareRootInformation, is_safe_square, rotate_in};

impl<const N: usize> SquareRootInformation<f64, N> {
    /// [`absorb_all`](Self::absorb_all) for `count` rows that lie column by column in N columns
    /// of one length, a multiple of the lanes of any path; what is beyond the rows is zero.
    pub(crate) fn absorb_columns(&mut self, path: Path, columns: &mut [f64], count: usize) {
        let length = columns.len() / N;
        if length == 0 {
            return;
        }
        let total = u32::try_from(count).unwrap_or(u32::MAX);
        let total = self.count().saturating_add(total);
        let done = path.run(Reflect {
            factor: self.factor_mut().as_flattened_mut(),
            columns,
            length,
            n: N,
        });
        if done < N {
            // Squares that overflow or vanish: rotations scale each pair.
            for i in 0..length {
                let mut row = [0.0; N];
                for j in done..N {
                    row[j] = columns[j * length + i];
                }
                rotate_in(self.factor_mut().as_flattened_mut(), &mut row);
            }
        }
        *self = self.with_count(total);
    }
}

/// Householder reflections of the factor and the columns below it; gives how many columns
/// are done, all unless a square overflows or vanishes.
struct Reflect<'a> {
    factor: &'a mut [f64],
    columns: &'a mut [f64],
    length: usize,
    n: usize,
}

impl pulp::WithSimd for Reflect<'_> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> usize {
        let (n, length) = (self.n, self.length);
        for k in 0..n {
            let (known, right) = self.columns.split_at_mut((k + 1) * length);
            let column = &known[k * length..];
            let line = &mut self.factor[k * n..(k + 1) * n];
            let pivot = line[k];
            let whole = product(simd, column, column) + pivot * pivot;
            if whole == 0.0 && column.iter().all(|&x| x == 0.0) {
                continue;
            }
            if !is_safe_square(whole) {
                return k;
            }
            let norm = whole.sqrt();
            let alpha = if pivot > 0.0 { -norm } else { norm };
            // H = I - v v^T / beta with v = (head, column), beta = -alpha head.
            let head = pivot - alpha;
            let inverse = 1.0 / (-alpha * head);
            line[k] = alpha;
            for (entry, other) in line[k + 1..].iter_mut().zip(right.chunks_exact_mut(length)) {
                let share = (head * *entry + product(simd, column, other)) * inverse;
                *entry -= share * head;
                let share = Lanes::splat(simd, share);
                for (other, column) in other
                    .chunks_exact_mut(S::F64_LANES)
                    .zip(column.chunks_exact(S::F64_LANES))
                {
                    let column = Lanes::of(simd, column);
                    share
                        .negate_mul_add(column, Lanes::of(simd, other))
                        .put(other);
                }
            }
        }
        n
    }
}

/// The scalar product, in four registers side by side.
#[inline(always)]
fn product<S: Simd>(simd: S, x: &[f64], y: &[f64]) -> f64 {
    let (x, _) = S::as_simd_f64s(x);
    let (y, _) = S::as_simd_f64s(y);
    let (fours, rest) = x.as_chunks::<4>();
    let (other_fours, other_rest) = y.as_chunks::<4>();
    let mut sums = [simd.splat_f64s(0.0); 4];
    for (x, y) in fours.iter().zip(other_fours) {
        for i in 0..4 {
            sums[i] = simd.mul_add_e_f64s(x[i], y[i], sums[i]);
        }
    }
    for (i, (&x, &y)) in rest.iter().zip(other_rest).enumerate() {
        sums[i] = simd.mul_add_e_f64s(x, y, sums[i]);
    }
    let pairs = [
        simd.add_f64s(sums[0], sums[2]),
        simd.add_f64s(sums[1], sums[3]),
    ];
    simd.reduce_sum_f64s(simd.add_f64s(pairs[0], pairs[1]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;

    #[test]
    fn columns_give_the_factor_of_the_rows() {
        let mut stream = crate::batch::Stream::new(8, 0);
        for (rows, length) in [(3, 8), (8, 8), (21, 24), (100, 104)] {
            for scale in [1.0, 1e-170, 1e160] {
                let mut plain = SquareRootInformation::<f64, 4>::new();
                plain.absorb(&[3.0 * scale, scale, 0.0, 0.0]);
                let start = plain;
                let mut columns = vec![0.0; 4 * length];
                for i in 0..rows {
                    // The third state is that of the first ten rows, the last is never seen.
                    let third = f64::from(u8::from(i < 10)) * stream.normal();
                    let row = [stream.normal(), 1e-6 * stream.normal(), third, 0.0];
                    let row = row.map(|x| x * scale);
                    plain.absorb(&row);
                    for j in 0..4 {
                        columns[j * length + i] = row[j];
                    }
                }
                for path in Path::available() {
                    let mut root = start;
                    root.absorb_columns(path, &mut columns.clone(), rows);
                    assert_eq!(root.count(), plain.count());
                    for k in 0..4 {
                        let sign = root.factor()[k][k].signum() * plain.factor()[k][k].signum();
                        for j in 0..4 {
                            let (a, b) = (root.factor()[k][j] * sign, plain.factor()[k][j]);
                            let size =
                                (0..4).fold(0.0_f64, |m, i| m.max(plain.factor()[i][j].abs()));
                            assert!(
                                (a - b).abs() <= 1e-14 * size,
                                "{path:?} {rows} {scale} {k} {j}: {a} {b}"
                            );
                        }
                    }
                }
            }
        }
    }
}
