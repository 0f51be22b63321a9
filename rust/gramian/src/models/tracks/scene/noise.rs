//! Noise of a sensor's samples, and how residuals and rows are made independent of unit
//! deviation.

use alloc::vec;
use alloc::vec::Vec;

use crate::models::tracks::Error;

/// The noise as it is given.
#[derive(Clone, Debug, PartialEq)]
pub enum Noise {
    /// Independent; one standard deviation, or one for each number.
    Sigma(Vec<f64>),
    /// A covariance matrix of blocks of so many numbers that follow each other, all
    /// alike: of one sample, or of all.
    Covariance {
        /// Numbers in a block.
        size: usize,
        /// Row-major.
        matrix: Vec<f64>,
    },
    /// First-order Gauss-Markov: correlation exp(-dt / time) between samples.
    Correlated {
        /// One standard deviation, or one for each number.
        sigma: Vec<f64>,
        /// Correlation time, s.
        time: f64,
    },
}

/// What whitens: divides by the deviations, or by the Cholesky factor.
#[derive(Clone, Debug)]
pub enum Whitener {
    Weights(Vec<f64>),
    Factor { size: usize, factor: Vec<f64> },
    Markov { sigma: Vec<f64>, rho: Vec<f64> },
}

impl Noise {
    /// Checks, for `count` samples of `width` numbers at `times`; angles have sigma <= pi.
    pub(super) fn whitener(
        &self,
        times: &[f64],
        width: usize,
        angle: bool,
    ) -> Result<Whitener, Error> {
        let total = times.len() * width;
        match self {
            Self::Sigma(sigma) => {
                let sigma = spread(sigma, total, angle)?;
                Ok(Whitener::Weights(sigma.iter().map(|s| 1.0 / s).collect()))
            }
            Self::Correlated { sigma, time } => {
                let sigma = spread(sigma, total, angle)?;
                if !(*time > 0.0 && time.is_finite()) {
                    return Err(Error::CorrelationTime { given: *time });
                }
                for i in 1..times.len() {
                    if !(times[i] >= times[i - 1]) {
                        return Err(Error::Times {
                            index: i,
                            given: times[i],
                            before: times[i - 1],
                        });
                    }
                    // Two at one time would be one sample.
                    if times[i] == times[i - 1] {
                        return Err(Error::Repeated {
                            index: i,
                            given: times[i],
                        });
                    }
                }
                let rho = (0..times.len())
                    .map(|i| match i {
                        0 => 0.0,
                        _ => (-(times[i] - times[i - 1]) / time).exp(),
                    })
                    .collect();
                Ok(Whitener::Markov { sigma, rho })
            }
            Self::Covariance { size, matrix } => {
                let size = *size;
                if size == 0 || matrix.len() != size * size || !total.is_multiple_of(size) {
                    return Err(Error::CovarianceShape {
                        given: size,
                        width,
                        total,
                    });
                }
                Ok(Whitener::Factor {
                    size,
                    factor: cholesky(matrix, size)?,
                })
            }
        }
    }
}

fn spread(sigma: &[f64], total: usize, angle: bool) -> Result<Vec<f64>, Error> {
    if sigma.len() != 1 && sigma.len() != total {
        crate::scalar::check_length("sigma", sigma.len(), total)?;
    }
    for (index, &given) in sigma.iter().enumerate() {
        if !(given > 0.0 && given.is_finite()) {
            return Err(Error::Sigma { index, given });
        }
        if angle && given > core::f64::consts::PI {
            return Err(Error::SigmaAngle { index, given });
        }
    }
    Ok(if sigma.len() == 1 {
        vec![sigma[0]; total]
    } else {
        sigma.to_vec()
    })
}

/// The lower factor of a covariance.
fn cholesky(matrix: &[f64], n: usize) -> Result<Vec<f64>, Error> {
    for i in 0..n {
        for j in 0..i {
            let (a, b) = (matrix[i * n + j], matrix[j * n + i]);
            let size = (matrix[i * n + i] * matrix[j * n + j]).abs().sqrt();
            if !((a - b).abs() <= 1e-9 * size) {
                return Err(Error::NotSymmetric {
                    row: i,
                    column: j,
                    given: a,
                    other: b,
                });
            }
        }
    }
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let sum = (0..j).fold(matrix[i * n + j], |sum, k| {
                sum - l[i * n + k] * l[j * n + k]
            });
            if i == j {
                let rounding = 1e-14 * n as f64 * matrix[i * n + i].abs();
                if !(sum > rounding && sum.is_finite()) {
                    return Err(Error::NotPositive { row: i });
                }
                l[i * n + i] = sum.sqrt();
            } else {
                l[i * n + j] = sum / l[j * n + j];
            }
        }
    }
    Ok(l)
}

impl Whitener {
    /// Whitens the numbers of one sensor in place: `values` (samples x width) and, if
    /// not empty, as many `rows` of length `n`. What is not `present` becomes zero.
    pub fn apply(
        &self,
        width: usize,
        values: &mut [f64],
        rows: &mut [f64],
        n: usize,
        present: Option<&[bool]>,
    ) {
        let with_rows = !rows.is_empty();
        match self {
            Self::Weights(weights) => {
                for (i, (value, &weight)) in values.iter_mut().zip(weights).enumerate() {
                    let there = present.is_none_or(|p| p[i]);
                    *value = if there { *value * weight } else { 0.0 };
                }
                if with_rows {
                    for (i, (row, &weight)) in rows.chunks_exact_mut(n).zip(weights).enumerate() {
                        let there = present.is_none_or(|p| p[i]);
                        let weight = if there { weight } else { 0.0 };
                        for x in row {
                            *x *= weight;
                        }
                    }
                }
            }
            Self::Factor { size, factor } => {
                let size = *size;
                for start in (0..values.len()).step_by(size) {
                    // A block that is not whole counts for nothing.
                    if present.is_some_and(|p| !p[start..start + size].iter().all(|&p| p)) {
                        values[start..start + size].fill(0.0);
                        if with_rows {
                            rows[start * n..(start + size) * n].fill(0.0);
                        }
                        continue;
                    }
                    for i in 0..size {
                        let inverse = 1.0 / factor[i * size + i];
                        for j in 0..i {
                            let part = factor[i * size + j];
                            values[start + i] -= part * values[start + j];
                            if with_rows {
                                let (head, tail) = rows.split_at_mut((start + i) * n);
                                let above = &head[(start + j) * n..][..n];
                                for (x, a) in tail[..n].iter_mut().zip(above) {
                                    *x -= part * a;
                                }
                            }
                        }
                        values[start + i] *= inverse;
                        if with_rows {
                            for x in &mut rows[(start + i) * n..][..n] {
                                *x *= inverse;
                            }
                        }
                    }
                }
            }
            Self::Markov { sigma, rho } => {
                Self::Weights(sigma.iter().map(|s| 1.0 / s).collect())
                    .apply(width, values, rows, n, present);
                let samples = values.len() / width;
                // From the last on, so that each finds the one before as it was.
                for axis in 0..width {
                    let mut i = samples;
                    while i > 1 {
                        i -= 1;
                        let at = i * width + axis;
                        if present.is_some_and(|p| !p[at]) {
                            continue;
                        }
                        // The last one present before, and the correlation over the gap.
                        let mut before = i;
                        let mut correlation = 1.0;
                        let mut found = None;
                        while before > 0 {
                            correlation *= rho[before];
                            before -= 1;
                            if present.is_none_or(|p| p[before * width + axis]) {
                                found = Some(before * width + axis);
                                break;
                            }
                        }
                        let Some(before) = found else { continue };
                        let scale = 1.0 / (1.0 - correlation * correlation).sqrt();
                        values[at] = (values[at] - correlation * values[before]) * scale;
                        if with_rows {
                            let (head, tail) = rows.split_at_mut(at * n);
                            let above = &head[before * n..][..n];
                            for (x, a) in tail[..n].iter_mut().zip(above) {
                                *x = (*x - correlation * a) * scale;
                            }
                        }
                    }
                }
            }
        }
    }

    /// Makes noise of independent standard normal numbers, in place.
    pub fn color(&self, width: usize, values: &mut [f64]) {
        match self {
            Self::Weights(weights) => {
                for (value, weight) in values.iter_mut().zip(weights) {
                    *value /= weight;
                }
            }
            Self::Factor { size, factor } => {
                for block in values.chunks_exact_mut(*size) {
                    for i in (0..*size).rev() {
                        block[i] =
                            (0..=i).fold(0.0, |sum, j| sum + factor[i * size + j] * block[j]);
                    }
                }
            }
            Self::Markov { sigma, rho } => {
                for i in width..values.len() {
                    let r = rho[i / width];
                    values[i] = r * values[i - width] + (1.0 - r * r).sqrt() * values[i];
                }
                for (value, sigma) in values.iter_mut().zip(sigma) {
                    *value *= sigma;
                }
            }
        }
    }
}
