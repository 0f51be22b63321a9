//! What is wrong with a record of a magnetometer, before anything is fitted to it.
//!
//! A channel is one column of the record. Each check compares it with its own noise,
//! which is estimated from differences of neighbouring samples in the quiet parts of the
//! record.

use alloc::vec;
use alloc::vec::Vec;

use crate::scalar::{NumberError, check_length};

/// Runs, repeats and tones are reported where chance makes fewer than this many of them
/// in a record.
const CHANCE: f64 = 1e-6;

/// A spike is this many standard deviations off the median of its neighbours.
const SPIKE: f64 = 8.0;

/// Mains and traction power, Hz.
const MAINS: [f64; 3] = [50.0, 60.0, 50.0 / 3.0];

/// Something in a record that a fit would suffer from.
#[derive(Clone, Debug, PartialEq)]
pub enum Finding {
    /// A channel that has the same value throughout.
    Constant {
        /// The column.
        channel: usize,
        /// Its value.
        value: f64,
    },
    /// A run of equal samples that noise does not allow.
    Stuck {
        /// The column.
        channel: usize,
        /// The first sample of the longest such run.
        from: usize,
        /// How many samples it has.
        samples: usize,
        /// The value it is stuck at.
        value: f64,
    },
    /// Samples that stand at the largest or smallest value, cut off there.
    Saturated {
        /// The column.
        channel: usize,
        /// The limit.
        value: f64,
        /// How many samples stand there.
        samples: usize,
    },
    /// A channel that repeats another, noise included: `factor * other + offset`.
    Copy {
        /// The column.
        channel: usize,
        /// The column it repeats.
        of: usize,
        /// 1 for an exact copy, -1 for an inverted one.
        factor: f64,
        /// What is added.
        offset: f64,
    },
    /// A channel of a second sensor that follows another axis of the first, or its own
    /// with the opposite sign.
    Axes {
        /// The column, of the second sensor.
        channel: usize,
        /// The column of the first sensor that it follows.
        follows: usize,
        /// Whether it does so with the opposite sign.
        inverted: bool,
        /// The correlation with it.
        correlation: f64,
    },
    /// Single samples far off their neighbours.
    Spikes {
        /// The column.
        channel: usize,
        /// Which samples.
        samples: Vec<usize>,
    },
    /// A tone of the mains, or its alias.
    Hum {
        /// The column.
        channel: usize,
        /// Of the mains, Hz.
        frequency: f64,
        /// Half the swing, in the unit of the record.
        amplitude: f64,
    },
    /// The mean moves from the start to the end by more than the noise allows.
    Drift {
        /// The column.
        channel: usize,
        /// From the first to the last tenth of the record.
        change: f64,
    },
    /// A time that does not follow the rest.
    Clock {
        /// The sample after it.
        sample: usize,
        /// Seconds since the sample before.
        step: f64,
        /// The median of the steps, s.
        usual: f64,
    },
    /// Samples that are missing.
    Missing {
        /// The column.
        channel: usize,
        /// How many.
        samples: usize,
    },
}

/// The noise of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Its standard deviation, in the unit of the record.
    pub sigma: f64,
    /// The correlation of neighbouring samples.
    pub correlation: f64,
    /// The step of the recorder, 0 where there is none to be seen.
    pub step: f64,
}

/// What was found in a record.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// Each thing found, worst kinds first.
    pub findings: Vec<Finding>,
    /// The noise of each channel.
    pub noise: Vec<Noise>,
}

/// Looks through a record.
///
/// `field` is row-major (samples, channels), NaN for a missing sample. Three channels
/// in a row are the axes of one sensor.
///
/// # Units
/// s; the field in any one unit.
///
/// # Errors
/// [`NumberError::NotFinite`] for times, [`NumberError::Length`] for arrays that do not
/// fit.
///
/// ```
/// use gramian::dipole::record::{Finding, check};
///
/// let times: Vec<f64> = (0..200).map(|i| 0.01 * f64::from(i)).collect();
/// // Noise of two steps of the recorder; the second channel is dead.
/// let field: Vec<f64> = (0..200).flat_map(|i| [f64::from(i * i % 7), 3.0]).collect();
/// let found = check(&times, &field, 2)?;
/// assert_eq!(found.findings, [Finding::Constant { channel: 1, value: 3.0 }]);
/// # Ok::<(), gramian::scalar::NumberError>(())
/// ```
pub fn check(times: &[f64], field: &[f64], channels: usize) -> Result<Check, NumberError> {
    crate::scalar::check_finite("times", times)?;
    check_length("field", field.len(), times.len() * channels)?;
    let columns: Vec<Vec<f64>> = (0..channels)
        .map(|c| field.iter().skip(c).step_by(channels).copied().collect())
        .collect();
    let smooth: Vec<Vec<f64>> = columns.iter().map(|column| medians(column)).collect();
    let mut findings = Vec::new();
    let mut noise = Vec::with_capacity(channels);
    let mut constant = vec![false; channels];
    for (channel, column) in columns.iter().enumerate() {
        let known: Vec<f64> = column.iter().copied().filter(|x| x.is_finite()).collect();
        let first = known.first().copied().unwrap_or(f64::NAN);
        constant[channel] = known.iter().all(|x| *x == first);
        if constant[channel] && !known.is_empty() {
            findings.push(Finding::Constant {
                channel,
                value: first,
            });
        }
        noise.push(noise_of(&known));
    }
    for channel in 0..channels {
        if !constant[channel] {
            runs(channel, &columns, &smooth, &noise, &mut findings);
        }
    }
    for channel in 1..channels {
        if !constant[channel] {
            let copy = (0..channel).filter(|of| !constant[*of]).find_map(|of| {
                copied(
                    &columns[of],
                    &columns[channel],
                    &noise[channel],
                    of,
                    channel,
                )
            });
            findings.extend(copy);
        }
    }
    axes(&columns, &constant, &noise, &mut findings);
    for (channel, column) in columns.iter().enumerate() {
        if constant[channel] {
            continue;
        }
        let missing = column.iter().filter(|x| !x.is_finite()).count();
        if missing > 0 {
            findings.push(Finding::Missing {
                channel,
                samples: missing,
            });
        }
        let samples = spikes(column, &smooth[channel], &noise[channel]);
        if !samples.is_empty() {
            findings.push(Finding::Spikes { channel, samples });
        }
        findings.extend(hum(channel, times, column));
        findings.extend(drift(channel, column, &noise[channel]));
    }
    clock(times, &mut findings);
    Ok(Check { findings, noise })
}

/// The median of numbers, which it puts in order; NaN of none.
fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    if values.len() % 2 == 1 {
        values[half]
    } else {
        0.5 * (values[half - 1] + values[half])
    }
}

/// The standard deviation of numbers about 0, from the median of their size.
fn robust_sigma(values: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = values.map(f64::abs).collect();
    // Of a normal variable half the values are within 0.6745 standard deviations.
    median(&mut sizes) / 0.674_489_750_196_081_7
}

/// Noise of first order, variance s^2 and correlation r, has (x[t+k] - x[t])^2 / 2 of mean
/// s^2 (1 - r^k): k = 1 and 2 give both.
fn noise_of(known: &[f64]) -> Noise {
    let step = step_of(known);
    let spread = robust_sigma(known.windows(2).map(|w| w[1] - w[0]));
    let cut = 6.0 * spread + 2.0 * step;
    let block = (known.len() / 32).max(8);
    let mut sums: Vec<(f64, f64)> = known
        .windows(3)
        .collect::<Vec<_>>()
        .chunks_exact(block)
        .map(|part| {
            part.iter().fold((0.0, 0.0), |sum, w| {
                let (one, two) = (w[1] - w[0], w[2] - w[0]);
                // A spike is no noise.
                if one.abs() > cut || two.abs() > 1.5 * cut {
                    return sum;
                }
                (sum.0 + one * one, sum.1 + two * two)
            })
        })
        .collect();
    // A pass moves further in two samples than noise does: the quiet blocks alone.
    sums.sort_by(|a, b| a.1.total_cmp(&b.1));
    let most = 2.5 * sums.get(sums.len() / 4).map_or(0.0, |s| s.1);
    let kept = sums.iter().filter(|s| s.1 <= most);
    let count = kept.clone().count() as f64 * block as f64;
    let (one, two) = kept.fold((0.0, 0.0), |sum, s| (sum.0 + s.0, sum.1 + s.1));
    // A recorder that rounds has at least the noise of its rounding.
    let rounding = step / 12.0_f64.sqrt();
    if !(one > 0.0) {
        return Noise {
            sigma: rounding,
            correlation: 0.0,
            step,
        };
    }
    let correlation = (two / one - 1.0).clamp(-0.99, 0.99);
    Noise {
        sigma: (0.5 * one / count / (1.0 - correlation))
            .sqrt()
            .max(rounding),
        correlation,
        step,
    }
}

/// The step of a recorder: the smallest difference of two values, where all values are
/// whole multiples of it apart; 0 otherwise.
fn step_of(known: &[f64]) -> f64 {
    let mut sorted = known.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    // As many values as samples: none is rounded to a step that shows.
    if sorted.len() < 2 || sorted.len() * 2 > known.len() {
        return 0.0;
    }
    let size = sorted[0].abs().max(sorted[sorted.len() - 1].abs());
    let step = sorted
        .windows(2)
        .map(|w| w[1] - w[0])
        .filter(|d| *d > 64.0 * f64::EPSILON * size)
        .fold(f64::INFINITY, f64::min);
    // All but a few: a spike may stand between two steps.
    let middle = sorted[sorted.len() / 2];
    let fits = known.iter().filter(|x| {
        let count = (**x - middle) / step;
        (count - count.round()).abs() < 0.01
    });
    if step.is_finite() && fits.count() * 100 >= known.len() * 99 {
        step
    } else {
        0.0
    }
}

/// Runs of equal samples that noise does not allow, and cut-off extremes.
fn runs(
    channel: usize,
    columns: &[Vec<f64>],
    smooth: &[Vec<f64>],
    noise: &[Noise],
    findings: &mut Vec<Finding>,
) {
    let column = &columns[channel];
    let low = column.iter().copied().fold(f64::INFINITY, f64::min);
    let high = column.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut longest = (0, 0);
    let mut at_limit = [(0, 0); 2];
    let mut start = 0;
    for i in 1..=column.len() {
        if i < column.len() && column[i] == column[start] {
            continue;
        }
        let (length, value) = (i - start, column[start]);
        if value == low || value == high {
            let entry = &mut at_limit[usize::from(value == high)];
            entry.0 += length;
            entry.1 = entry.1.max(length);
        } else if length > longest.1 {
            longest = (start, length);
        }
        start = i;
    }
    // The share of equal neighbours, without the longest run.
    let equal = column.windows(2).filter(|w| w[0] == w[1]).count();
    let outside = column.len().saturating_sub(longest.1).max(1) as f64;
    let share = equal.saturating_sub(longest.1.saturating_sub(1)) as f64 / outside;
    let by_chance = |length: usize| {
        let length = i32::try_from(length).unwrap_or(i32::MAX);
        share.max(1.0 / column.len() as f64).powi(length - 1) * column.len() as f64 > CHANCE
    };
    // A recorder whose steps hide the noise repeats itself for long: there a channel is
    // stuck only while others see something pass, which a spike is not.
    let passing = || {
        let run = longest.0..longest.0 + longest.1;
        smooth
            .iter()
            .zip(noise)
            .enumerate()
            .any(|(other, (values, noise))| {
                let (low, high) = values[run.clone()]
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |r, x| {
                        (r.0.min(*x), r.1.max(*x))
                    });
                other != channel && high - low > 50.0 * noise.sigma.max(noise.step)
            })
    };
    if longest.1 >= 8 && !by_chance(longest.1) && (share < 0.5 || passing()) {
        findings.push(Finding::Stuck {
            channel,
            from: longest.0,
            samples: longest.1,
            value: column[longest.0],
        });
    }
    for ((samples, run), value) in at_limit.into_iter().zip([low, high]) {
        // The rest must reach far beyond its noise, or the limit is that of a quiet record.
        if run >= 4 && !by_chance(run) && high - low > 50.0 * noise[channel].sigma {
            findings.push(Finding::Saturated {
                channel,
                value,
                samples,
            });
        }
    }
}

/// Whether a column repeats another up to scale and offset: what is left is far below the
/// noise that two sensors would have apart.
fn copied(
    other: &[f64],
    column: &[f64],
    noise: &Noise,
    of: usize,
    channel: usize,
) -> Option<Finding> {
    let pairs: Vec<(f64, f64)> = other
        .iter()
        .zip(column)
        .filter(|(x, y)| x.is_finite() && y.is_finite())
        .map(|(x, y)| (*x, *y))
        .collect();
    let count = pairs.len() as f64;
    if count < 16.0 || noise.sigma == 0.0 {
        return None;
    }
    let (mean_x, mean_y) = pairs
        .iter()
        .fold((0.0, 0.0), |s, (x, y)| (s.0 + x / count, s.1 + y / count));
    let (mut xx, mut xy) = (0.0, 0.0);
    for (x, y) in &pairs {
        xx += (x - mean_x) * (x - mean_x);
        xy += (x - mean_x) * (y - mean_y);
    }
    let factor = xy / xx;
    let offset = mean_y - factor * mean_x;
    let left = pairs
        .iter()
        .map(|(x, y)| (y - factor * x - offset) * (y - factor * x - offset))
        .sum::<f64>();
    let left = (left / count).sqrt();
    // A copy that was rounded again differs by a step.
    (left < 0.2 * noise.sigma).then_some(Finding::Copy {
        channel,
        of,
        factor,
        offset,
    })
}

/// Axes of the second and further sensors that follow another axis of the first.
fn axes(columns: &[Vec<f64>], constant: &[bool], noise: &[Noise], findings: &mut Vec<Finding>) {
    let copies: Vec<usize> = findings
        .iter()
        .filter_map(|f| match f {
            Finding::Copy { channel, .. } => Some(*channel),
            _ => None,
        })
        .collect();
    for sensor in 1..columns.len() / 3 {
        let own = 3 * sensor..3 * sensor + 3;
        if own
            .clone()
            .chain(0..3)
            .any(|c| constant[c] || copies.contains(&c))
        {
            continue;
        }
        // Only signals far above the noise say which axis is which.
        let strong = |c: usize| {
            let mut known: Vec<f64> = columns[c]
                .iter()
                .copied()
                .filter(|x| x.is_finite())
                .collect();
            let middle = median(&mut known);
            known
                .iter()
                .any(|x| (x - middle).abs() > 30.0 * noise[c].sigma)
        };
        if !own.clone().chain(0..3).all(strong) {
            continue;
        }
        let (order, with, gain) = matched(&columns[..3], &columns[own.clone()]);
        for (axis, channel) in own.enumerate() {
            let (follows, correlation) = (order[axis], with[axis]);
            let moved = follows != axis && gain > 0.5;
            if correlation.abs() > 0.9 && (moved || (follows == axis && correlation < 0.0)) {
                findings.push(Finding::Axes {
                    channel,
                    follows,
                    inverted: correlation < 0.0,
                    correlation,
                });
            }
        }
    }
}

/// Which axis of the first sensor each axis of the second follows, its correlation with
/// it, and by how much this order explains more than that of the first: at the shift of up
/// to a twentieth of the record where the two sensors agree best, since they see a pass one
/// after the other.
fn matched(first: &[Vec<f64>], second: &[Vec<f64>]) -> ([usize; 3], [f64; 3], f64) {
    const ORDERS: [[usize; 3]; 6] = [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ];
    let n = first[0].len();
    let reach = n / 20;
    let stride = (reach / 50).max(1);
    let (mut order, mut with, mut best, mut plain) = (ORDERS[0], [0.0; 3], 0.0, 0.0_f64);
    for shift in (0..=reach).step_by(stride) {
        for late in [false, true] {
            let of = |a: &[f64], b: &[f64]| {
                if late {
                    correlation(&a[..n - shift], &b[shift..])
                } else {
                    correlation(&a[shift..], &b[..n - shift])
                }
            };
            let table = [0, 1, 2].map(|i| [0, 1, 2].map(|j| of(&first[j], &second[i])));
            for candidate in ORDERS {
                let picked = [0, 1, 2].map(|i| table[i][candidate[i]]);
                let score = picked.iter().map(|x| x.abs()).sum();
                if candidate == ORDERS[0] {
                    plain = plain.max(score);
                }
                if score > best {
                    (order, with, best) = (candidate, picked, score);
                }
            }
        }
    }
    (order, with, best - plain)
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let pairs = || {
        a.iter()
            .zip(b)
            .filter(|(x, y)| x.is_finite() && y.is_finite())
    };
    let count = pairs().count() as f64;
    let (mean_a, mean_b) = pairs().fold((0.0, 0.0), |s, (x, y)| (s.0 + x / count, s.1 + y / count));
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (x, y) in pairs() {
        aa += (x - mean_a) * (x - mean_a);
        bb += (y - mean_b) * (y - mean_b);
        ab += (x - mean_a) * (y - mean_b);
    }
    if aa > 0.0 && bb > 0.0 {
        ab / (aa * bb).sqrt()
    } else {
        0.0
    }
}

/// The median of the five samples about each, NaN where all are missing.
fn medians(column: &[f64]) -> Vec<f64> {
    (0..column.len())
        .map(|i| {
            let mut near: Vec<f64> = column[i.saturating_sub(2)..(i + 3).min(column.len())]
                .iter()
                .copied()
                .filter(|x| x.is_finite())
                .collect();
            median(&mut near)
        })
        .collect()
}

/// Samples far off the median of the five about them.
fn spikes(column: &[f64], smooth: &[f64], noise: &Noise) -> Vec<usize> {
    let limit = SPIKE * noise.sigma + 2.0 * noise.step;
    (0..column.len())
        .filter(|&i| column[i].is_finite() && limit > 0.0 && (column[i] - smooth[i]).abs() > limit)
        .collect()
}

/// A tone of the mains that stands above the spectrum around it.
fn hum(channel: usize, times: &[f64], column: &[f64]) -> Option<Finding> {
    let n = column.len();
    if n < 256 {
        return None;
    }
    let span = times[n - 1] - times[0];
    let rate = (n - 1) as f64 / span;
    // Second differences take off the pass, whose spectrum falls steeply; each tone is
    // magnified by a known factor.
    let second: Vec<(f64, f64)> = (1..n - 1)
        .filter(|i| column[i - 1..=i + 1].iter().all(|x| x.is_finite()))
        .map(|i| (times[i], column[i - 1] - 2.0 * column[i] + column[i + 1]))
        .collect();
    let spread = robust_sigma(second.iter().map(|s| s.1));
    let power = |frequency: f64| {
        let (mut real, mut imaginary) = (0.0, 0.0);
        for (t, x) in &second {
            if x.abs() <= 6.0 * spread {
                let (s, c) = (core::f64::consts::TAU * frequency * (t - times[0])).sin_cos();
                real += x * c;
                imaginary += x * s;
            }
        }
        real * real + imaginary * imaginary
    };
    for mains in MAINS {
        // Above half the sampling rate it appears at its alias.
        let seen = (mains - rate * (mains / rate).round()).abs();
        if seen < 20.0 / span || seen > 0.5 * rate - 20.0 / span {
            continue;
        }
        let peak = [-0.4, -0.2, 0.0, 0.2, 0.4].map(|d| power(seen + d / span));
        let tone = peak.into_iter().fold(0.0, f64::max);
        let mut around: Vec<f64> = (4..16)
            .flat_map(|k| {
                [
                    power(seen - f64::from(k) / span),
                    power(seen + f64::from(k) / span),
                ]
            })
            .collect();
        let floor = median(&mut around) / core::f64::consts::LN_2;
        // Noise alone exceeds k times its mean with probability exp(-k).
        if floor > 0.0 && tone / floor > -(CHANCE / 15.0).ln() {
            let gain = 2.0 - 2.0 * (core::f64::consts::TAU * seen / rate).cos();
            let amplitude = 2.0 * tone.sqrt() / (second.len() as f64 * gain);
            return Some(Finding::Hum {
                channel,
                frequency: mains,
                amplitude,
            });
        }
    }
    None
}

/// The change of the median from the first to the last tenth, where the level moves the
/// same way at both ends: the tails of a pass fall off again.
fn drift(channel: usize, column: &[f64], noise: &Noise) -> Option<Finding> {
    let tenth = column.len() / 10;
    if tenth < 8 {
        return None;
    }
    let level = |k: usize| {
        let mut known: Vec<f64> = column[k * tenth..(k + 1) * tenth]
            .iter()
            .copied()
            .filter(|x| x.is_finite())
            .collect();
        median(&mut known)
    };
    let [first, second, before, last] = [level(0), level(1), level(8), level(9)];
    let change = last - first;
    let r = noise.correlation.clamp(0.0, 0.99);
    // The variance of a median is pi / 2 times that of a mean.
    let sigma = noise.sigma * (3.2 / tenth as f64 * (1.0 + r) / (1.0 - r)).sqrt();
    let along = |slope: f64| {
        let part = slope / change * 9.0;
        (0.3..3.0).contains(&part)
    };
    let limit = 6.0 * sigma + noise.step;
    let moves = limit > 0.0 && change.abs() > limit;
    (moves && along(second - first) && along(last - before))
        .then_some(Finding::Drift { channel, change })
}

/// Steps of the clock that differ from the usual one by half and more.
fn clock(times: &[f64], findings: &mut Vec<Finding>) {
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let usual = median(&mut steps);
    for (i, w) in times.windows(2).enumerate() {
        let step = w[1] - w[0];
        if step <= 0.0 || step > 1.5 * usual {
            findings.push(Finding::Clock {
                sample: i + 1,
                step,
                usual,
            });
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::batch::Stream;

    const RATE: f64 = 200.0;

    /// A passing field in white noise of 1 on six channels, two sensors.
    fn record(seed: u64) -> (Vec<f64>, Vec<f64>) {
        let times: Vec<f64> = (0..2000).map(|i| f64::from(i) / RATE).collect();
        let mut noise = vec![0.0; 12_000];
        let mut stream = Stream::new(seed, 0);
        noise.fill_with(|| stream.normal());
        for (i, t) in times.iter().enumerate() {
            for sensor in 0..2 {
                let u = (t - 5.0 - 0.05 * sensor as f64) / 0.8;
                let fall = (1.0 + u * u).powf(-2.5);
                for (axis, shape) in [2.0 - u * u, 3.0 * u, 1.0 - 2.0 * u * u + 0.4 * u]
                    .into_iter()
                    .enumerate()
                {
                    noise[6 * i + 3 * sensor + axis] += 100.0 * shape * fall;
                }
            }
        }
        (times, noise)
    }

    #[test]
    fn a_sound_record_has_no_findings() {
        for seed in 0..20 {
            let (times, field) = record(seed);
            let found = check(&times, &field, 6).unwrap();
            assert_eq!(found.findings, [], "seed {seed}");
            for noise in found.noise {
                assert!((noise.sigma - 1.0).abs() < 0.15, "{noise:?}");
                // The estimate itself has a deviation of 0.05 from 2000 samples.
                assert!(noise.correlation.abs() < 0.2, "{noise:?}");
                assert_eq!(noise.step, 0.0);
            }
        }
    }

    #[test]
    fn a_rounded_record_has_no_findings_and_its_step() {
        for seed in 0..20 {
            let (times, mut field) = record(seed);
            for x in &mut field {
                *x = (*x / 0.5).round() * 0.5;
            }
            let found = check(&times, &field, 6).unwrap();
            assert_eq!(found.findings, [], "seed {seed}");
            assert!(found.noise.iter().all(|n| (n.step - 0.5).abs() < 1e-12));
        }
    }

    #[test]
    fn each_fault_is_named() {
        let (times, good) = record(7);
        let broken = |change: &dyn Fn(usize, &mut [f64])| {
            let mut field = good.clone();
            for (i, row) in field.chunks_mut(6).enumerate() {
                change(i, row);
            }
            check(&times, &field, 6).unwrap().findings
        };
        assert!(matches!(
            broken(&|_, row| row[2] = 4.0)[..],
            [Finding::Constant { channel: 2, .. }]
        ));
        assert!(matches!(
            broken(&|i, row| if (300..360).contains(&i) {
                row[1] = 0.25;
            })[0],
            Finding::Stuck {
                channel: 1,
                from: 300,
                samples: 60,
                ..
            }
        ));
        assert!(
            broken(&|_, row| row[0] = row[0].min(120.0))
                .iter()
                .any(|f| matches!(
                    f,
                    Finding::Saturated { channel: 0, value, .. } if *value == 120.0
                ))
        );
        assert!(matches!(
            broken(&|_, row| row[5] = -2.0 * row[3] + 1.0)[0],
            Finding::Copy { channel: 5, of: 3, factor, .. } if (factor + 2.0).abs() < 1e-12
        ));
        assert!(matches!(
            broken(&|_, row| row.swap(3, 4))[..],
            [
                Finding::Axes {
                    channel: 3,
                    follows: 1,
                    inverted: false,
                    ..
                },
                Finding::Axes {
                    channel: 4,
                    follows: 0,
                    inverted: false,
                    ..
                },
            ]
        ));
        assert!(matches!(
            broken(&|_, row| row[4] = -row[4])[..],
            [Finding::Axes {
                channel: 4,
                follows: 1,
                inverted: true,
                ..
            }]
        ));
        assert_eq!(
            broken(&|i, row| if i == 77 {
                row[0] += 300.0;
            }),
            [Finding::Spikes {
                channel: 0,
                samples: vec![77]
            }]
        );
        assert!(matches!(
            broken(&|i, row| row[2] += 0.5 * (core::f64::consts::TAU * 50.0 * i as f64 / RATE).sin())[..],
            [Finding::Hum { channel: 2, frequency: 50.0, amplitude }] if (amplitude - 0.5).abs() < 0.1
        ));
        assert!(matches!(
            broken(&|i, row| row[3] += i as f64 * 0.01)[..],
            [Finding::Drift { channel: 3, change }] if (change - 18.0).abs() < 1.0
        ));
        assert!(matches!(
            broken(&|i, row| if i == 9 {
                row[3] = f64::NAN;
            })[..],
            [Finding::Missing {
                channel: 3,
                samples: 1
            }]
        ));
    }

    #[test]
    fn clocks_that_jump_are_named() {
        let (mut times, field) = record(7);
        for t in &mut times[500..] {
            *t += 1.0;
        }
        assert!(matches!(
            check(&times, &field, 6).unwrap().findings[..],
            [Finding::Clock { sample: 500, .. }]
        ));
    }

    #[test]
    fn correlated_noise_is_measured() {
        let times: Vec<f64> = (0..20_000).map(|i| f64::from(i) / RATE).collect();
        for rho in [0.5, 0.9] {
            let mut noise = vec![0.0; times.len()];
            let mut stream = Stream::new(3, 0);
            noise.fill_with(|| stream.normal());
            for i in 1..noise.len() {
                noise[i] = rho * noise[i - 1] + (1.0_f64 - rho * rho).sqrt() * noise[i];
            }
            let found = check(&times, &noise, 1).unwrap().noise[0];
            assert!((found.correlation - rho).abs() < 0.05, "{found:?}");
            assert!((found.sigma - 1.0).abs() < 0.25, "{found:?}");
        }
    }
}
