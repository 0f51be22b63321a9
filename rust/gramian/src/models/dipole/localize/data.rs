//! A recording on its way to the fit: background, spikes, noise.

use alloc::vec;
use alloc::vec::Vec;

use super::knowledge::Knowledge;
use super::separable::Record;
use super::starts::{Shape, Trace};
use super::{Background, Loss, Options};

/// A recording with what was done to it.
pub struct Data {
    /// Counted from the instant of the state.
    pub times: Vec<f64>,
    /// (K, S, 3), less the background that was taken off.
    pub field: Vec<f64>,
    /// What was taken off.
    pub background: Vec<f64>,
    /// How often each number counts: 0 for a spike.
    pub counts: Vec<f64>,
    channels: usize,
}

impl Data {
    pub fn new(times: &[f64], field: &[f64], channels: usize, options: &Options) -> Self {
        let origin = options.origin.unwrap_or(times[0]);
        let mut data = Self {
            times: times.iter().map(|t| t - origin).collect(),
            field: field.to_vec(),
            background: vec![0.0; channels],
            counts: vec![1.0; field.len()],
            channels,
        };
        if options.background == Background::Median {
            for (channel, level) in data.background.iter_mut().enumerate() {
                let values = data.field.iter().skip(channel).step_by(channels);
                *level = median(&mut values.copied().collect::<Vec<f64>>());
            }
            for (i, value) in data.field.iter_mut().enumerate() {
                *value -= data.background[i % channels];
            }
        }
        if options.loss == Loss::Huber {
            reject_spikes(&data.field, channels, &mut data.counts);
        }
        data
    }

    pub fn record<'a>(&'a self, sensors: &'a [[f64; 3]], options: &Options) -> Record<'a> {
        Record {
            times: &self.times,
            sensors,
            field: &self.field,
            offsets: options.background == Background::Fit,
        }
    }

    /// Means of groups of samples, so that there are some hundred: enough to
    /// search on.
    pub fn thinned(&self) -> Self {
        let group = self.times.len().div_ceil(super::starts::MOST);
        let channels = self.channels;
        let mut thin = Self {
            times: Vec::new(),
            field: Vec::new(),
            background: self.background.clone(),
            counts: Vec::new(),
            channels,
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
                    count += self.counts[i];
                    sum += self.counts[i] * self.field[i];
                }
                thin.counts.push(count);
                thin.field.push(if count > 0.0 { sum / count } else { 0.0 });
            }
        }
        thin
    }

    /// For each sensor the shapes that its own field suggests.
    pub fn shapes(&self, sensors: &[[f64; 3]], options: &Options) -> Vec<(usize, Shape)> {
        let mut out = Vec::new();
        for s in 0..sensors.len() {
            let at = |k: usize, axis: usize| k * self.channels + 3 * s + axis;
            let trace = Trace::new(
                &self.times,
                |k, axis| self.field[at(k, axis)],
                |k, axis| self.counts[at(k, axis)],
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
        let sensors = self.channels as f64 / 3.0;
        let least = if shapes.is_empty() { size } else { least };
        (least * sensors).max(1e-18 * size).sqrt() / (self.field.len() as f64).sqrt()
    }

    /// The standard deviation of the residuals; under the robust loss 1.4826 times
    /// their median size where the field is strong (over a twentieth of its
    /// largest), which is where the model is tried.
    pub fn sigma(
        &self,
        residuals: &[f64],
        offsets: &[f64],
        knowledge: &Knowledge,
        options: &Options,
    ) -> f64 {
        if options.loss == Loss::Gaussian {
            let fitted = if options.background == Background::Fit {
                self.channels
            } else {
                0
            };
            let unknowns = knowledge.unknowns() + fitted;
            let freedom = self.field.len().saturating_sub(unknowns).max(1) as f64;
            return (residuals.iter().map(|r| r * r).sum::<f64>() / freedom).sqrt();
        }
        let model: Vec<f64> = self
            .field
            .iter()
            .zip(residuals)
            .enumerate()
            .map(|(i, (y, r))| (y - r - offsets[i % self.channels]).abs())
            .collect();
        let strong = 0.05 * model.iter().copied().fold(0.0, f64::max);
        let mut sizes: Vec<f64> = (0..residuals.len())
            .filter(|&i| self.counts[i] > 0.0 && model[i] >= strong)
            .map(|i| residuals[i].abs())
            .collect();
        1.4826 * median(&mut sizes)
    }

    /// The weights that residuals have under Huber's loss.
    pub fn huber(&self, residuals: &[f64], sigma: f64, weights: &mut [f64]) {
        for ((weight, residual), count) in weights.iter_mut().zip(residuals).zip(&self.counts) {
            let size = residual.abs() / (1.345 * sigma);
            *weight = if size > 1.0 { count / size } else { *count };
        }
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
fn reject_spikes(field: &[f64], channels: usize, weights: &mut [f64]) {
    let count = field.len() / channels;
    if count < 15 {
        return;
    }
    for channel in 0..channels {
        let at = |k: usize| field[k * channels + channel];
        let smooth: Vec<f64> = (0..count)
            .map(|k| {
                let first = k.saturating_sub(2).min(count - 5);
                median(&mut [0, 1, 2, 3, 4].map(|i| at(first + i)))
            })
            .collect();
        let mut distance: Vec<f64> = (0..count).map(|k| (at(k) - smooth[k]).abs()).collect();
        let mut sorted = smooth.clone();
        sorted.sort_by(f64::total_cmp);
        let range = sorted[count - 1 - count / 500] - sorted[count / 500];
        let usual = median(&mut distance.clone());
        let limit = (10.0 * 1.4826 * usual).max(0.1 * range);
        let outside = distance.iter().filter(|&&d| d > limit).count();
        if outside == 0 || outside * 20 > count {
            continue;
        }
        for (k, d) in distance.drain(..).enumerate() {
            if d > limit {
                // The sensor's other components of that sample are not trusted either.
                let first = k * channels + channel / 3 * 3;
                weights[first..first + 3].fill(0.0);
            }
        }
    }
}
