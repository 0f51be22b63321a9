//! Bounds that know of other solutions, and so of the noise at which the local bound
//! stops being true.
//!
//! # Source
//! Barankin 1949 in the form of R. `McAulay` and E. Hofstetter 1971, IEEE Trans. Inf. Theory 17;
//! Weiss & Weinstein 1988, IEEE Trans. Inf. Theory 34, with s = 1/2.

use alloc::vec;
use alloc::vec::Vec;

use crate::numbers::algebra::dot_slices as dot;
use crate::observability::Observability;
use crate::solve::Model;
use crate::solve::starts::Spread;

/// The Barankin bound on the covariance (n, n) of unbiased estimators.
///
/// `rows` are the whitened rows at x, row-major (m, n); `offsets` the test points less x
/// (k, n); `differences` their exact data less those of x, whitened (k, m). `None` where
/// the rows do not determine the states.
///
/// Nothing overflows: all is divided by exp(|d|^2 / 2) of its point, so that one that
/// noise never prefers does not matter.
pub fn barankin(rows: &[f64], n: usize, offsets: &[f64], differences: &[f64]) -> Option<Vec<f64>> {
    let m = rows.len() / n.max(1);
    let mut bound = Observability::new(rows, n, None).ok()?.crlb()?;
    let local = bound.clone();
    // Of each point: J^-1 A^T d, and what the offset has beside it.
    let mut weights = Vec::new();
    let mut vectors = Vec::new();
    let mut seen = Vec::new();
    for (offset, d) in offsets.chunks_exact(n).zip(differences.chunks_exact(m)) {
        let slope: Vec<f64> = (0..n)
            .map(|j| (0..m).map(|i| rows[i * n + j] * d[i]).sum())
            .collect();
        let taken: Vec<f64> = (0..n).map(|i| dot(&local[i * n..][..n], &slope)).collect();
        let damping = (-0.5 * dot(d, d)).exp();
        vectors.push(
            offset
                .iter()
                .zip(&taken)
                .map(|(o, t)| (o - t) * damping)
                .collect::<Vec<f64>>(),
        );
        weights.push((slope, taken));
        seen.push(d);
    }
    let k = seen.len();
    let mut gram = vec![0.0; k * k];
    for i in 0..k {
        for j in 0..k {
            let shared = dot(&weights[i].0, &weights[j].1);
            let (own_i, own_j) = (dot(seen[i], seen[i]), dot(seen[j], seen[j]));
            let product = dot(seen[i], seen[j]);
            gram[i * k + j] = if product.abs() < 1.0 {
                (product.exp_m1() - shared) * (-0.5 * (own_i + own_j)).exp()
            } else {
                let apart: f64 = seen[i]
                    .iter()
                    .zip(seen[j])
                    .map(|(a, b)| (a - b) * (a - b))
                    .sum();
                (-0.5 * apart).exp() - (1.0 + shared) * (-0.5 * (own_i + own_j)).exp()
            };
        }
    }
    add_inverse(&gram, &vectors, &mut bound);
    Some(bound)
}

/// The Weiss-Weinstein bound.
#[derive(Clone, Debug, PartialEq)]
pub struct WeissWeinstein {
    /// Bound on the mean square errors (n, n), row-major.
    pub bound: Vec<f64>,
    /// Standard error of its diagonal, by parts of the samples.
    pub standard_error: Vec<f64>,
    /// Which test vectors count: others reach where the prior or the data leave nothing.
    pub used: Vec<usize>,
}

/// The Weiss-Weinstein bound on the mean square error of any estimator, for independent
/// normal priors. `vectors` are the test vectors, steps of the states; `samples` points
/// of the prior, evenly spread, give the integrals.
///
/// For a normal prior rho depends on the difference of its two steps alone:
/// rho(d) = exp(-d^T P^-1 d / 8) E exp(-|h(x + d/2) - h(x - d/2)|^2 / 8).
///
/// # Errors
/// Where the model has no value at a point of the prior.
pub fn weiss_weinstein<M: Model + ?Sized>(
    model: &M,
    mean: &[f64],
    sigma: &[f64],
    vectors: &[Vec<f64>],
    samples: usize,
) -> Result<WeissWeinstein, M::Error> {
    let n = mean.len();
    let spread = Spread::Normal {
        mean: mean.to_vec(),
        sigma: sigma.to_vec(),
    };
    let points: Vec<Vec<f64>> = (0..samples.max(1)).map(|i| spread.point(i)).collect();
    let parts = points.len().min(8);
    // Of each part, one less rho: for close points rho itself has no digits left.
    let short_of_one = |step: &[f64]| -> Result<Vec<f64>, M::Error> {
        let far: f64 = step.iter().zip(sigma).map(|(d, s)| (d / s) * (d / s)).sum();
        let mut sums = vec![(0.0, 0.0); parts];
        let mut out = vec![0.0; model.measurements()];
        for (index, x) in points.iter().enumerate() {
            let at = |sign: f64| -> Vec<f64> {
                x.iter()
                    .zip(step)
                    .map(|(x, d)| x + sign * 0.5 * d)
                    .collect()
            };
            model.difference(&at(-1.0), &at(1.0), &mut out)?;
            let sum = &mut sums[index % parts];
            sum.0 -= (-0.125 * (dot(&out, &out) + far)).exp_m1();
            sum.1 += 1.0;
        }
        Ok(sums.iter().map(|s| s.0 / s.1).collect())
    };
    let single = vectors
        .iter()
        .map(|v| short_of_one(v))
        .collect::<Result<Vec<_>, _>>()?;
    let average = |parts: &[f64]| parts.iter().sum::<f64>() / parts.len() as f64;
    let used: Vec<usize> = (0..vectors.len())
        .filter(|&i| 1.0 - average(&single[i]) > 1e-8)
        .collect();
    let k = used.len();
    let mut pairs = Vec::with_capacity(k * k);
    for &i in &used {
        for &j in &used {
            let combine = |sign: f64| -> Vec<f64> {
                vectors[i]
                    .iter()
                    .zip(&vectors[j])
                    .map(|(a, b)| a + sign * b)
                    .collect()
            };
            pairs.push((short_of_one(&combine(-1.0))?, short_of_one(&combine(1.0))?));
        }
    }
    let taken: Vec<Vec<f64>> = used.iter().map(|&i| vectors[i].clone()).collect();
    let from = |value: &dyn Fn(&[f64]) -> f64| -> Vec<f64> {
        let mut gram = vec![0.0; k * k];
        for (a, &i) in used.iter().enumerate() {
            for (b, &j) in used.iter().enumerate() {
                let (apart, together) = &pairs[a * k + b];
                gram[a * k + b] = 2.0 * (value(together) - value(apart))
                    / ((1.0 - value(&single[i])) * (1.0 - value(&single[j])));
            }
        }
        let mut bound = vec![0.0; n * n];
        add_inverse(&gram, &taken, &mut bound);
        bound
    };
    let bound = from(&average);
    let each: Vec<Vec<f64>> = (0..parts).map(|p| from(&|v: &[f64]| v[p])).collect();
    let standard_error = (0..n)
        .map(|i| {
            let off = each
                .iter()
                .map(|b| (b[i * n + i] - bound[i * n + i]).powi(2));
            let count = parts.max(2) as f64;
            (off.sum::<f64>() / (count * (count - 1.0))).sqrt()
        })
        .collect();
    Ok(WeissWeinstein {
        bound,
        standard_error,
        used,
    })
}

/// Adds V^T G^-1 V, with the vectors as lines of V; those that depend on the others, or
/// without a positive pivot, are left out, which leaves a bound that holds.
fn add_inverse(gram: &[f64], vectors: &[Vec<f64>], bound: &mut [f64]) {
    let k = vectors.len();
    let n = vectors.first().map_or(0, Vec::len);
    let mut g = gram.to_vec();
    let mut v = vectors.to_vec();
    let diagonal: Vec<f64> = (0..k).map(|i| gram[i * k + i]).collect();
    let mut done = vec![false; k];
    for _ in 0..k {
        let share = |i: usize, g: &[f64]| g[i * k + i] / diagonal[i];
        let next = (0..k)
            .filter(|&i| !done[i] && diagonal[i] > 0.0)
            .max_by(|&a, &b| share(a, &g).total_cmp(&share(b, &g)));
        let Some(p) = next.filter(|&p| share(p, &g) > 1e-12) else {
            return;
        };
        done[p] = true;
        let pivot = g[p * k + p];
        let chosen = v[p].clone();
        for i in 0..n {
            for j in 0..n {
                bound[i * n + j] += chosen[i] / pivot * chosen[j];
            }
        }
        for i in (0..k).filter(|&i| !done[i]) {
            let factor = g[i * k + p] / pivot;
            for (to, from) in v[i].iter_mut().zip(&chosen) {
                *to -= factor * from;
            }
        }
        let column: Vec<f64> = (0..k).map(|i| g[i * k + p]).collect();
        for i in (0..k).filter(|&i| !done[i]) {
            for j in 0..k {
                g[i * k + j] -= column[i] / pivot * column[j];
            }
        }
    }
}
