//! A recording on its way to the fit: background, spikes, noise.

use alloc::vec;
use alloc::vec::Vec;

use super::knowledge::Knowledge;
use super::separable::Record;
use super::starts::{Shape, Trace};
use super::{Background, Loss, Options};
use crate::dipole::Sensors;
use crate::solve::noise::Whitening;

/// A recording with what was done to it.
pub struct Data {
    /// Counted from the instant of the state.
    pub times: Vec<f64>,
    /// (K, S, components), what is beside the quiet reading; 0 where a number is missing.
    pub field: Vec<f64>,
    /// How often each number counts: 0 for a spike, and one that is missing.
    pub counts: Vec<f64>,
    channels: usize,
    /// Of one sensor.
    components: usize,
    /// Of each number `sigma` over its own deviation; empty where all have the same.
    precision: Vec<f64>,
    correlation: f64,
    /// The usual time between samples.
    spacing: f64,
}

impl Data {
    pub fn new(times: &[f64], field: &[f64], sensors: &Sensors<'_>, options: &Options<'_>) -> Self {
        let quiet = sensors.quiet();
        let origin = options.origin.unwrap_or(times[0]);
        let mut steps: Vec<f64> = times.windows(2).map(|t| t[1] - t[0]).collect();
        let mut data = Self {
            times: times.iter().map(|t| t - origin).collect(),
            field: field.iter().map(|y| y - quiet).collect(),
            counts: vec![1.0; field.len()],
            channels: sensors.channels(),
            components: sensors.components(),
            precision: options.levels.iter().map(|level| 1.0 / level).collect(),
            correlation: options.correlation,
            spacing: median(&mut steps),
        };
        for i in 0..data.field.len() {
            if data.field[i].is_nan() || data.precision(i) == 0.0 {
                (data.field[i], data.counts[i]) = (0.0, 0.0);
            }
        }
        if options.loss == Loss::Huber {
            reject_spikes(
                &data.field,
                data.channels,
                data.components,
                &mut data.counts,
            );
        }
        data
    }

    #[inline]
    fn precision(&self, number: usize) -> f64 {
        self.precision.get(number).copied().unwrap_or(1.0)
    }

    /// What whitens the numbers, for the weights that they would have were all as precise.
    pub fn noise(&self, weights: impl Iterator<Item = f64>) -> Whitening {
        let mut weights: Vec<f64> = weights.collect();
        for (weight, precision) in weights.iter_mut().zip(&self.precision) {
            *weight *= precision;
        }
        Whitening::first_order(
            &self.times,
            self.channels,
            weights,
            self.correlation,
            self.spacing,
        )
    }

    /// Residuals of which each channel's are uncorrelated and all as precise, T.
    fn innovations(&self, residuals: &[f64]) -> Vec<f64> {
        let mut left = residuals.to_vec();
        self.noise(self.counts.iter().map(|c| f64::from(*c > 0.0)))
            .apply(&mut left);
        left
    }

    /// How many numbers there are, and how many are fitted to them.
    fn sizes(&self, knowledge: &Knowledge, options: &Options<'_>) -> (f64, f64) {
        let count = self.counts.iter().filter(|c| **c > 0.0).count();
        let used = |c: &usize| {
            let own = self.counts.iter().skip(*c).step_by(self.channels);
            own.copied().fold(0.0, f64::max) > 0.0
        };
        let fitted = if options.background == Background::Fit {
            (0..self.channels).filter(used).count()
        } else {
            0
        };
        (count as f64, (knowledge.unknowns() + fitted) as f64)
    }

    pub fn record<'a>(&'a self, sensors: Sensors<'a>, options: &Options<'_>) -> Record<'a> {
        Record {
            times: &self.times,
            sensors,
            field: &self.field,
            offsets: options.background == Background::Fit,
        }
    }

    /// How much a number counts beside one of the deviation `sigma`.
    fn weight(&self, number: usize) -> f64 {
        self.counts[number] * self.precision(number).powi(2)
    }

    /// Means of groups of samples, so that there are some hundred: enough to
    /// search on. Their counts are weights.
    pub fn thinned(&self) -> Self {
        let group = self.times.len().div_ceil(super::starts::MOST);
        let channels = self.channels;
        let mut thin = Self {
            times: Vec::new(),
            field: Vec::new(),
            counts: Vec::new(),
            channels,
            components: self.components,
            precision: Vec::new(),
            correlation: 0.0,
            spacing: self.spacing,
        };
        for first in (0..self.times.len()).step_by(group) {
            let range = first..self.times.len().min(first + group);
            let times = &self.times[range.clone()];
            thin.times
                .push(times.iter().sum::<f64>() / times.len() as f64);
            for channel in 0..channels {
                let (mut count, mut sum) = (0.0, 0.0);
                for k in range.clone() {
                    let i = k * channels + channel;
                    count += self.weight(i);
                    sum += self.weight(i) * self.field[i];
                }
                thin.counts.push(count);
                thin.field.push(if count > 0.0 { sum / count } else { 0.0 });
            }
        }
        thin
    }

    /// For each sensor the shapes that its own field suggests.
    pub fn shapes(&self, options: &Options<'_>) -> Vec<(usize, Shape)> {
        let mut out = Vec::new();
        for s in 0..self.channels / self.components {
            let at = |k: usize, axis: usize| k * self.channels + self.components * s + axis;
            let trace = Trace::new(
                &self.times,
                self.components,
                |k, axis| self.field[at(k, axis)],
                |k, axis| self.counts[at(k, axis)] * self.precision(at(k, axis)),
                options.background == Background::Fit,
            );
            out.extend(trace.shapes(8).into_iter().map(|shape| (s, shape)));
        }
        out
    }

    /// The noise that the best shape leaves.
    pub fn first_sigma(&self, shapes: &[(usize, Shape)]) -> f64 {
        let least = shapes
            .iter()
            .map(|(_, s)| s.misfit)
            .fold(f64::INFINITY, f64::min);
        let size: f64 = self
            .field
            .iter()
            .zip(&self.counts)
            .map(|(y, c)| c * y * y)
            .sum();
        let sensors = (self.channels / self.components) as f64;
        let least = if shapes.is_empty() { size } else { least };
        let count = self.counts.iter().filter(|c| **c > 0.0).count().max(1);
        (least * sensors).max(1e-18 * size).sqrt() / (count as f64).sqrt()
    }

    /// The standard deviation of the residuals; under the robust loss 1.4826 times
    /// their median size where the field is strong (over a twentieth of its
    /// largest), which is where the model is tried.
    pub fn sigma(
        &self,
        residuals: &[f64],
        offsets: &[f64],
        knowledge: &Knowledge,
        options: &Options<'_>,
    ) -> f64 {
        let (count, fitted) = self.sizes(knowledge, options);
        let freedom = (count - fitted).max(1.0);
        let left = self.innovations(residuals);
        if options.loss == Loss::Gaussian {
            return (left.iter().map(|r| r * r).sum::<f64>() / freedom).sqrt();
        }
        let model: Vec<f64> = self
            .field
            .iter()
            .zip(residuals)
            .enumerate()
            .map(|(i, (y, r))| (y - r - offsets[i % self.channels]).abs())
            .collect();
        robust_sigma(&left, &model, &self.counts, fitted)
    }

    /// See [`huber`].
    pub fn huber(
        &self,
        residuals: &[f64],
        sigma: f64,
        knowledge: &Knowledge,
        options: &Options<'_>,
        weights: &mut [f64],
    ) -> f64 {
        let (_, fitted) = self.sizes(knowledge, options);
        let left = self.innovations(residuals);
        huber(&left, &self.counts, sigma, fitted, weights)
    }
}

/// The standard deviation of residuals, by the median of their size where the field of the
/// model is strong; with `fitted` states fitted to the numbers that count.
pub(in crate::models::dipole) fn robust_sigma(
    left: &[f64],
    strength: &[f64],
    counts: &[f64],
    fitted: f64,
) -> f64 {
    let strong = 0.05 * strength.iter().copied().fold(0.0, f64::max);
    let mut sizes: Vec<f64> = (0..left.len())
        .filter(|&i| counts[i] > 0.0 && strength[i] >= strong)
        .map(|i| left[i].abs())
        .collect();
    let count = counts.iter().filter(|c| **c > 0.0).count() as f64;
    // As many degrees of freedom as the fit left.
    1.4826 * median(&mut sizes) * (count / (count - fitted).max(1.0)).sqrt()
}

/// Writes the weights that residuals have under Huber's loss; returns what they are to be
/// multiplied by so that the curvature of the weighted squares is the inverse covariance of
/// the estimate, of `fitted` states.
///
/// # Source
/// Huber & Ronchetti 2009, Robust Statistics, eqs. (7.81)-(7.84).
pub(in crate::models::dipole) fn huber(
    left: &[f64],
    counts: &[f64],
    sigma: f64,
    fitted: f64,
    weights: &mut [f64],
) -> f64 {
    let limit = 1.345;
    let (mut count, mut near, mut squares, mut total) = (0.0, 0.0, 0.0, 0.0);
    for ((weight, residual), share) in weights.iter_mut().zip(left).zip(counts) {
        let size = residual.abs() / sigma;
        *weight = if size > limit {
            share * limit / size
        } else {
            *share
        };
        if *share > 0.0 {
            count += 1.0;
            near += f64::from(u8::from(size <= limit));
            squares += size.min(limit).powi(2);
            total += *weight;
        }
    }
    let slope = near / count;
    let correction = 1.0 + fitted / count * (1.0 - slope) / slope;
    let spread = squares / (count - fitted).max(1.0);
    let efficiency = slope * slope * count / (correction * correction * spread * total);
    if efficiency.is_finite() && efficiency > 0.0 {
        efficiency
    } else {
        1.0
    }
}

fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let (middle, odd) = (values.len() / 2, values.len() % 2 == 1);
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    if odd {
        return upper;
    }
    let lower = below.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    0.5 * (lower + upper)
}

/// Gives weight 0 to numbers that stand out from the median of the five around
/// them by more than a tenth of the range of those medians (and ten times their
/// usual distance from it).
fn reject_spikes(field: &[f64], channels: usize, components: usize, weights: &mut [f64]) {
    let given = weights.to_vec();
    for channel in 0..channels {
        // Those that are there.
        let there: Vec<usize> = (0..field.len() / channels)
            .map(|k| k * channels + channel)
            .filter(|&i| given[i] > 0.0)
            .collect();
        let count = there.len();
        if count < 15 {
            continue;
        }
        let at = |k: usize| field[there[k]];
        let smooth: Vec<f64> = (0..count)
            .map(|k| {
                let first = k.saturating_sub(2).min(count - 5);
                median(&mut [0, 1, 2, 3, 4].map(|i| at(first + i)))
            })
            .collect();
        let distance: Vec<f64> = (0..count).map(|k| (at(k) - smooth[k]).abs()).collect();
        let mut sorted = smooth.clone();
        sorted.sort_by(f64::total_cmp);
        let range = sorted[count - 1 - count / 500] - sorted[count / 500];
        let usual = median(&mut distance.clone());
        let limit = (10.0 * 1.4826 * usual).max(0.1 * range);
        let outside = distance.iter().filter(|&&d| d > limit).count();
        if outside == 0 || outside * 20 > count {
            continue;
        }
        for (&i, d) in there.iter().zip(&distance) {
            if *d > limit {
                // The sensor's other components of that sample are not trusted either.
                let first = i / components * components;
                weights[first..first + components].fill(0.0);
            }
        }
    }
}
