//! Small symmetric matrices, row-major: what a choice needs of them.

use alloc::vec;
use alloc::vec::Vec;

/// Adds `weight` times rows^T rows.
pub(super) fn add(information: &mut [f64], rows: &[f64], n: usize, weight: f64) {
    for row in rows.chunks_exact(n) {
        for i in 0..n {
            if row[i] != 0.0 {
                let factor = weight * row[i];
                for (out, x) in information[i * n..(i + 1) * n].iter_mut().zip(row) {
                    *out += factor * x;
                }
            }
        }
    }
}

/// The lower triangular factor; `None` where a pivot is lost in rounding.
fn factor(matrix: &[f64], n: usize) -> Option<Vec<f64>> {
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let product: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
            let left = matrix[i * n + j] - product;
            if i == j {
                let least = 16.0 * f64::EPSILON * n as f64 * matrix[i * n + i];
                if !(left > least) {
                    return None;
                }
                l[i * n + i] = left.sqrt();
            } else {
                l[i * n + j] = left / l[j * n + j];
            }
        }
    }
    Some(l)
}

/// Log determinant; `None` for a matrix that is singular to rounding.
pub(super) fn log_det(matrix: &[f64], n: usize) -> Option<f64> {
    let l = factor(matrix, n)?;
    Some(2.0 * (0..n).map(|i| l[i * n + i].ln()).sum::<f64>())
}

/// The inverse; `None` for a matrix that is singular to rounding.
pub(super) fn covariance(matrix: &[f64], n: usize) -> Option<Vec<f64>> {
    let l = factor(matrix, n)?;
    let mut inverse = vec![0.0; n * n];
    for j in 0..n {
        for i in j..n {
            let unit = if i == j { 1.0 } else { 0.0 };
            let product: f64 = (j..i).map(|k| l[i * n + k] * inverse[k * n + j]).sum();
            inverse[i * n + j] = (unit - product) / l[i * n + i];
        }
    }
    let mut answer = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (i..n)
                .map(|k| inverse[k * n + i] * inverse[k * n + j])
                .sum();
            answer[i * n + j] = sum;
            answer[j * n + i] = sum;
        }
    }
    Some(answer)
}

/// The largest eigenvalue of the covariance of states divided by `scale`: by powers of
/// the matrix, squared until one direction is left.
pub(super) fn largest(c: &[f64], scale: &[f64], n: usize) -> f64 {
    let mut power: Vec<f64> = (0..n * n)
        .map(|k| c[k] / (scale[k / n] * scale[k % n]))
        .collect();
    let trace = |m: &[f64]| (0..n).map(|i| m[i * n + i]).sum::<f64>();
    let mut log = 0.0;
    let mut share = 1.0;
    // After k squarings the trace is the sum of the 2^k-th powers.
    for _ in 0..30 {
        let size = trace(&power);
        log += size.ln() * share;
        for x in &mut power {
            *x /= size;
        }
        let old = power.clone();
        for i in 0..n {
            for j in 0..n {
                power[i * n + j] = (0..n).map(|k| old[i * n + k] * old[k * n + j]).sum();
            }
        }
        share *= 0.5;
    }
    log.exp()
}
