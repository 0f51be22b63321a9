//! Noise of the channels of a record whose neighbours in time are correlated: how to whiten
//! it, and how large its correlation is.
//!
//! # Source
//! First-order (Ornstein-Uhlenbeck) noise, exact for uneven times and for numbers left out;
//! its parameters by restricted maximum likelihood, Patterson & Thompson 1971.

use alloc::vec;
use alloc::vec::Vec;

use crate::square_root::triangularize;

/// What whitens the numbers of a record: for each a factor, and the share of the number
/// before it, in its channel, that is taken off first.
///
/// ```
/// use gramian::solve::noise::Whitening;
/// // One channel, correlation 0.6 of neighbours: a record that decays so is no surprise.
/// let noise = Whitening::first_order(&[0.0, 1.0, 2.0], 1, vec![1.0; 3], 0.6, 1.0);
/// let mut z = [1.0, 0.6, 0.36];
/// noise.apply(&mut z);
/// assert!((z[0] - 1.0).abs() < 1e-15 && z[1].abs() < 1e-15 && z[2].abs() < 1e-15);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Whitening {
    channels: usize,
    /// 0 for a number that does not count.
    factors: Vec<f64>,
    /// Empty for white noise.
    shares: Vec<f64>,
}

impl Whitening {
    /// White noise: `weights` are 1 / sigma of each number, channels in turn, 0 for one that
    /// does not count.
    pub fn white(weights: Vec<f64>, channels: usize) -> Self {
        Self {
            channels,
            factors: weights,
            shares: Vec::new(),
        }
    }

    /// Noise of the standard deviation 1 / weight, whose correlation over a time d is
    /// `correlation`^(d / `spacing`): between 0 and 1.
    pub fn first_order(
        times: &[f64],
        channels: usize,
        weights: Vec<f64>,
        correlation: f64,
        spacing: f64,
    ) -> Self {
        let mut noise = Self::white(weights, channels);
        if !(correlation > 0.0) || channels == 0 {
            return noise;
        }
        noise.shares = vec![0.0; noise.factors.len()];
        for channel in 0..channels {
            let mut last: Option<f64> = None;
            for (k, &t) in times.iter().enumerate() {
                let i = k * channels + channel;
                if !(noise.factors.get(i).copied().unwrap_or(0.0) > 0.0) {
                    continue;
                }
                if let Some(before) = last {
                    let share = correlation.powf((t - before) / spacing);
                    noise.shares[i] = share;
                    noise.factors[i] /= (1.0 - share * share).max(f64::MIN_POSITIVE).sqrt();
                }
                last = Some(t);
            }
        }
        noise
    }

    /// Whether each number is whitened by its factor alone.
    pub fn is_white(&self) -> bool {
        self.shares.is_empty()
    }

    /// The factor of each number.
    pub fn factors(&self) -> &[f64] {
        &self.factors
    }

    /// Whitens the numbers of a record.
    pub fn apply(&self, values: &mut [f64]) {
        if self.is_white() {
            for (value, factor) in values.iter_mut().zip(&self.factors) {
                *value *= factor;
            }
        } else {
            self.apply_rows(values, 1);
        }
    }

    /// Whitens several columns at once: `rows` is row-major with `n` columns.
    pub fn apply_rows(&self, rows: &mut [f64], n: usize) {
        if n == 0 {
            return;
        }
        let mut last = vec![0.0; self.channels * n];
        for (i, row) in rows
            .chunks_exact_mut(n)
            .enumerate()
            .take(self.factors.len())
        {
            let factor = self.factors[i];
            if factor == 0.0 {
                row.fill(0.0);
                continue;
            }
            if self.is_white() {
                for x in row {
                    *x *= factor;
                }
                continue;
            }
            let channel = i % self.channels;
            let before = &mut last[channel * n..(channel + 1) * n];
            for (x, last) in row.iter_mut().zip(before) {
                let value = *x;
                *x = factor * (value - self.shares[i] * *last);
                *last = value;
            }
        }
    }

    /// Sum of the logarithms of the factors: half the log determinant of the information.
    fn log_factors(&self) -> f64 {
        self.factors
            .iter()
            .filter(|f| **f > 0.0)
            .map(|f| f.ln())
            .sum()
    }
}

/// A record of which the noise is asked: what a fit leaves, and the rows of that fit.
#[derive(Clone, Copy, Debug)]
pub struct Left<'a> {
    /// Ascending.
    pub times: &'a [f64],
    /// How many there are of each time.
    pub channels: usize,
    /// How much each number counts: 0 for one that does not.
    pub counts: &'a [f64],
    /// Measured less predicted, not whitened.
    pub residuals: &'a [f64],
    /// Derivatives of the prediction, row-major, not whitened.
    pub rows: &'a [f64],
    /// Of which the correlation is told.
    pub spacing: f64,
}

impl Left<'_> {
    /// The correlation of neighbours and the standard deviation of the noise by restricted
    /// maximum likelihood: what the fit took out of the noise is paid for. A `sigma` that is
    /// known is kept.
    pub fn estimate(&self, sigma: Option<f64>) -> (f64, f64) {
        // A grid in log(1 - correlation), then thirds of the best place.
        const STEPS: usize = 14;
        let at = |step: f64| 1.0 - (-0.5 * step).exp();
        let mut best = (f64::NEG_INFINITY, 0.0);
        let seen: Vec<f64> = (0..=STEPS)
            .map(|k| self.likelihood(at(k as f64), sigma).0)
            .collect();
        for (k, &value) in seen.iter().enumerate() {
            if value > best.0 {
                best = (value, k as f64);
            }
        }
        let (mut low, mut high) = ((best.1 - 1.0).max(0.0), best.1 + 1.0);
        for _ in 0..12 {
            let third = (high - low) / 3.0;
            let (a, b) = (low + third, high - third);
            if self.likelihood(at(a), sigma).0 >= self.likelihood(at(b), sigma).0 {
                high = b;
            } else {
                low = a;
            }
        }
        let middle = 0.5 * (low + high);
        // None at all is a corner of the search.
        let found = if seen[0] >= self.likelihood(at(middle), sigma).0 {
            0.0
        } else {
            at(middle)
        };
        (found, self.likelihood(found, sigma).1)
    }

    /// The log of the restricted likelihood, less a constant, and sigma.
    fn likelihood(&self, correlation: f64, sigma: Option<f64>) -> (f64, f64) {
        let (m, wide) = (
            self.residuals.len(),
            self.rows.len() / self.residuals.len().max(1) + 1,
        );
        let n = wide - 1;
        let weights: Vec<f64> = self.counts.iter().map(|c| c.max(0.0).sqrt()).collect();
        let noise = Whitening::first_order(
            self.times,
            self.channels,
            weights,
            correlation,
            self.spacing,
        );
        let mut system = vec![0.0; m * wide];
        for (i, row) in system.chunks_exact_mut(wide).enumerate() {
            row[..n].copy_from_slice(&self.rows[i * n..(i + 1) * n]);
            row[n] = self.residuals[i];
        }
        noise.apply_rows(&mut system, wide);
        triangularize(&mut system, wide, &mut vec![0.0; wide]);
        let (mut rank, mut log_rows) = (0, 0.0);
        for j in 0..n.min(m) {
            let length = (0..=j).fold(0.0_f64, |s, i| s.hypot(system[i * wide + j]));
            let pivot = system[j * wide + j].abs();
            if pivot > 1e-9 * length {
                rank += 1;
                log_rows += pivot.ln();
            }
        }
        let left = if n < m { system[n * wide + n] } else { 0.0 };
        let count = self.counts.iter().filter(|c| **c > 0.0).count();
        let freedom = count.saturating_sub(rank).max(1) as f64;
        let chi2 = (left * left).max(f64::MIN_POSITIVE);
        let likelihood = match sigma {
            Some(sigma) => -0.5 * chi2 / (sigma * sigma),
            None => -0.5 * freedom * chi2.ln(),
        };
        (
            likelihood + noise.log_factors() - log_rows,
            sigma.unwrap_or((chi2 / freedom).sqrt()),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::Stream;

    #[test]
    fn whitening_makes_first_order_noise_white_over_gaps() {
        // Covariance of the noise by its definition, whitened on both sides, is the identity.
        let times = [0.0, 1.0, 2.0, 4.0, 4.5, 7.0];
        let weights = vec![2.0, 2.0, 2.0, 0.0, 2.0, 2.0, 0.0, 2.0, 2.0, 2.0, 2.0, 2.0];
        let noise = Whitening::first_order(&times, 2, weights.clone(), 0.7, 1.0);
        let m = weights.len();
        let covariance = |i: usize, j: usize| -> f64 {
            if i % 2 == j % 2 {
                0.25 * 0.7_f64.powf((times[i / 2] - times[j / 2]).abs())
            } else {
                0.0
            }
        };
        let mut half: Vec<f64> = (0..m * m).map(|e| covariance(e / m, e % m)).collect();
        noise.apply_rows(&mut half, m);
        let mut whole: Vec<f64> = (0..m * m).map(|e| half[(e % m) * m + e / m]).collect();
        noise.apply_rows(&mut whole, m);
        for i in 0..m {
            for j in 0..m {
                let wanted = if i == j && weights[i] > 0.0 { 1.0 } else { 0.0 };
                assert!((whole[i * m + j] - wanted).abs() < 1e-12, "{i} {j}");
            }
        }
    }

    #[test]
    fn the_correlation_is_found_although_a_fit_took_its_slow_part() {
        // A cubic is fitted to each channel of correlated noise: seen plainly, what it leaves
        // is less correlated, and smaller, than the noise was.
        const TRIALS: u32 = 60;
        let (count, channels, n) = (60, 3, 12);
        let times: Vec<f64> = (0..count).map(f64::from).collect();
        let m = times.len() * channels;
        let mut rows = vec![0.0; m * n];
        for i in 0..m {
            let t = times[i / channels] / 30.0 - 1.0;
            for (power, term) in [1.0, t, t * t, t * t * t].into_iter().enumerate() {
                rows[i * n + 4 * (i % channels) + power] = term;
            }
        }
        let (mut mean, mut steps) = (0.0, 0.0);
        for trial in 0..TRIALS {
            let mut random = Stream::new(3, u64::from(trial));
            let mut residuals = vec![0.0; m];
            for i in 0..m {
                let new = random.normal();
                residuals[i] = if i < channels {
                    new
                } else {
                    0.8 * residuals[i - channels] + 0.6 * new
                };
            }
            let left = Left {
                times: &times,
                channels,
                counts: &vec![1.0; m],
                residuals: &residuals,
                rows: &rows,
                spacing: 1.0,
            };
            let (correlation, sigma) = left.estimate(None);
            mean += correlation / f64::from(TRIALS);
            // Of what is new in each sample: the level itself is hardly told from the cubic.
            steps += sigma * (1.0 - correlation * correlation).sqrt() / f64::from(TRIALS);
        }
        assert!((mean - 0.8).abs() < 0.04, "{mean}");
        assert!((steps - 0.6).abs() < 0.02, "{steps}");
    }
}
