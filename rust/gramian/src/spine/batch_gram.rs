//! sum of w row^T row, trial by trial.

use crate::batch::element::Element;
use crate::batch::simd::{Path, lane_sums, prefetch};
use crate::batch::{Items, Threads};
use crate::numbers::algebra::add_square;
use crate::scalar::Real;

/// Gram matrices (trials, n, n) of rows (trials, K, n), with a weight for each
/// row if given. `out` holds n x n entries for each trial.
pub fn gram<T: Element>(
    rows: Items<'_, T>,
    weights: Option<Items<'_, T>>,
    n: usize,
    threads: Threads,
    path: Path,
    out: &mut [T],
) {
    let count = rows.size().checked_div(n).unwrap_or(0);
    let cost = 0.3 * (count * n * n) as f64;
    let group = (GROUP / count.max(1)).clamp(1, 32);
    let each = |first: usize, out: &mut [T]| -> Result<(), core::convert::Infallible> {
        let rows = rows.skip(first);
        let weights = weights.map(|w| w.skip(first));
        match n {
            4 if weights.is_none() => path.run(Four { rows, out }),
            4 => path.run(Fixed::<T, 4> { rows, weights, out }),
            9 => path.run(Fixed::<T, 9> { rows, weights, out }),
            _ => {
                for (trial, out) in out.chunks_exact_mut(n * n).enumerate() {
                    any_size(rows.get(trial), weights.map(|w| w.get(trial)), n, out);
                }
            }
        }
        Ok(())
    };
    let Ok(()) = threads.over_groups(out, n * n, group, cost, each);
}

/// Rows of one call of a kernel, roughly: choosing a path takes as long as some of them.
const GROUP: usize = 4096;

/// Whether rows of `n` columns have a kernel of their own.
#[must_use]
pub fn is_fast(n: usize) -> bool {
    matches!(n, 4 | 9)
}

fn any_size<T: Real>(rows: &[T], weights: Option<&[T]>, n: usize, out: &mut [T]) {
    out.fill(T::zero());
    add(rows, weights, n, out);
}

/// Adds the squares of further rows, one after the other, to a matrix (n, n) that was
/// filled with zeros: the same to the last bit as all rows at once, but where [`is_fast`].
pub fn add<T: Real>(rows: &[T], weights: Option<&[T]>, n: usize, out: &mut [T]) {
    for (k, row) in rows.chunks_exact(n).enumerate() {
        add_square(row, weights.map_or(T::one(), |w| w[k]), out);
    }
}

/// Four columns, the commonest case: blocks of rows are turned into one vector a
/// column, and the ten sums run down the lanes.
struct Four<'a, T> {
    rows: Items<'a, T>,
    out: &'a mut [T],
}

impl<T: Element> pulp::WithSimd for Four<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        for (trial, out) in self.out.chunks_exact_mut(16).enumerate() {
            let rows = self.rows.get(trial);
            let (vectors, _) = T::registers::<S>(rows);
            let (blocks, _) = vectors.as_chunks::<4>();
            let mut sums = [T::lanes_splat(simd, T::zero()); 10];
            for (block, numbers) in blocks.iter().zip(rows.chunks_exact(4 * T::lanes::<S>())) {
                prefetch(numbers);
                let columns = T::lanes_of_fours(simd, *block);
                let mut k = 0;
                for i in 0..4 {
                    for j in i..4 {
                        sums[k] = T::lanes_mul_add(simd, columns[i], columns[j], sums[k]);
                        k += 1;
                    }
                }
            }
            let mut sums = lane_sums::<S, T, 10>(simd, &sums);
            let (rest, _) = rows[blocks.len() * 4 * T::lanes::<S>()..].as_chunks::<4>();
            for row in rest {
                let mut k = 0;
                for i in 0..4 {
                    for j in i..4 {
                        sums[k] += row[i] * row[j];
                        k += 1;
                    }
                }
            }
            let mut k = 0;
            for i in 0..4 {
                for j in i..4 {
                    out[4 * i + j] = sums[k];
                    out[4 * j + i] = sums[k];
                    k += 1;
                }
            }
        }
    }
}

struct Fixed<'a, T, const N: usize> {
    rows: Items<'a, T>,
    weights: Option<Items<'a, T>>,
    out: &'a mut [T],
}

impl<T: Element, const N: usize> pulp::WithSimd for Fixed<'_, T, N> {
    type Output = ();

    // The width comes from the target features of the path this is inlined
    // into: N is fixed, so the inner loops become vectors.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) {
        for (trial, out) in self.out.chunks_exact_mut(N * N).enumerate() {
            let mut sums = [[T::zero(); N]; N];
            let (rows, _) = self.rows.get(trial).as_chunks::<N>();
            match self.weights.map(|w| w.get(trial)) {
                None => {
                    for row in rows {
                        for i in 0..N {
                            for j in 0..N {
                                sums[i][j] += row[i] * row[j];
                            }
                        }
                    }
                }
                Some(weights) => {
                    for (row, &w) in rows.iter().zip(weights) {
                        for i in 0..N {
                            for j in 0..N {
                                sums[i][j] += w * row[i] * row[j];
                            }
                        }
                    }
                }
            }
            out.copy_from_slice(sums.as_flattened());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::Stream;

    /// Every path and size against the plain loop.
    #[test]
    fn all_paths_agree_with_the_plain_sum() {
        let mut random = Stream::new(1, 0);
        for n in [2, 4, 9] {
            for count in [0, 1, 7, 8, 33, 100] {
                let rows: alloc::vec::Vec<f64> = (0..count * n).map(|_| random.normal()).collect();
                let weights: alloc::vec::Vec<f64> = (0..count).map(|_| random.uniform()).collect();
                for weights in [None, Some(weights.as_slice())] {
                    let mut expected = alloc::vec![0.0; n * n];
                    any_size(&rows, weights, n, &mut expected);
                    for path in Path::available() {
                        let mut found = alloc::vec![f64::NAN; n * n];
                        gram(
                            Items::each(&rows, rows.len()),
                            weights.map(Items::shared),
                            n,
                            Threads::One,
                            path,
                            &mut found,
                        );
                        for (f, e) in found.iter().zip(&expected) {
                            assert!((f - e).abs() < 1e-12, "{path:?} {n} {count}: {f} {e}");
                        }
                    }
                }
            }
        }
    }

    /// In single precision each sum is off by what its products and additions round.
    #[test]
    fn single_precision_keeps_its_digits_on_every_path() {
        let mut random = Stream::new(2, 0);
        for n in [2, 4, 9] {
            for count in [1_u16, 15, 16, 33, 100] {
                let size = usize::from(count) * n;
                #[allow(clippy::cast_possible_truncation)]
                let rows: alloc::vec::Vec<f32> =
                    (0..size).map(|_| random.normal() as f32).collect();
                let double: alloc::vec::Vec<f64> = rows.iter().map(|&x| f64::from(x)).collect();
                let mut expected = alloc::vec![0.0; n * n];
                any_size(&double, None, n, &mut expected);
                for path in Path::available() {
                    let mut found = alloc::vec![f32::NAN; n * n];
                    let items = Items::each(&rows, size);
                    gram(items, None, n, Threads::One, path, &mut found);
                    for i in 0..n {
                        for j in 0..n {
                            let wanted = expected[i * n + j];
                            let scale = (expected[i * n + i] * expected[j * n + j]).sqrt();
                            let bound = (f64::from(count) + 2.0) * 0.5 * f64::from(f32::EPSILON);
                            let off = (f64::from(found[i * n + j]) - wanted).abs();
                            assert!(off <= bound * scale, "{path:?} {n} {count}: {off}");
                        }
                    }
                }
            }
        }
    }
}
