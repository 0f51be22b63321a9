//! sum of w row^T row, trial by trial.

use super::simd::Path;
use super::{Items, Threads};

/// Gram matrices (trials, n, n) of rows (trials, K, n), with a weight for each
/// row if given. `out` holds n x n entries for each trial.
pub fn gram(
    rows: Items<'_>,
    weights: Option<Items<'_>>,
    n: usize,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) {
    let count = rows.get(0).len().checked_div(n).unwrap_or(0);
    let cost = 0.3 * (count * n * n) as f64;
    let each = |trial: usize, out: &mut [f64]| -> Result<(), core::convert::Infallible> {
        let rows = rows.get(trial);
        let weights = weights.map(|w| w.get(trial));
        match n {
            4 => path.run(Fixed::<4> { rows, weights, out }),
            9 => path.run(Fixed::<9> { rows, weights, out }),
            _ => any_size(rows, weights, n, out),
        }
        Ok(())
    };
    let Ok(()) = threads.over(out, n * n, cost, each);
}

fn any_size(rows: &[f64], weights: Option<&[f64]>, n: usize, out: &mut [f64]) {
    out.fill(0.0);
    for (k, row) in rows.chunks_exact(n).enumerate() {
        let w = weights.map_or(1.0, |w| w[k]);
        for i in 0..n {
            let x = w * row[i];
            for j in 0..n {
                out[i * n + j] += x * row[j];
            }
        }
    }
}

struct Fixed<'a, const N: usize> {
    rows: &'a [f64],
    weights: Option<&'a [f64]>,
    out: &'a mut [f64],
}

impl<const N: usize> pulp::WithSimd for Fixed<'_, N> {
    type Output = ();

    // The width comes from the target features of the path this is inlined
    // into: N is fixed, so the inner loops become vectors.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) {
        let mut sums = [[0.0_f64; N]; N];
        let (rows, _) = self.rows.as_chunks::<N>();
        match self.weights {
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
        self.out.copy_from_slice(sums.as_flattened());
    }
}
