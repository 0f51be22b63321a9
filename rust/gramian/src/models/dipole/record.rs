//! What is wrong with a record of a magnetometer, before anything is fitted to it.
//!
//! A channel is one column of the record. Each check compares it with its own noise,
//! which is estimated from differences of neighbouring samples in the quiet parts of the
//! record.

use alloc::vec;
use alloc::vec::Vec;

use crate::scalar::{NumberError, check_length};
use crate::square_root::SquareRootInformation;

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
        first: usize,
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
        /// By how many samples it comes later than the other.
        late: isize,
        /// The first sample of the part in which it does.
        first: usize,
        /// How many samples this part has.
        samples: usize,
    },
    /// A channel whose steps are far coarser than the noise of the others.
    Coarse {
        /// The column.
        channel: usize,
        /// The step.
        step: f64,
        /// The median of the others' standard deviations.
        usual: f64,
    },
    /// A channel whose noise is far above that of the others.
    Noisy {
        /// The column.
        channel: usize,
        /// Its standard deviation.
        sigma: f64,
        /// The median of the others'.
        usual: f64,
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
    /// The level changes from one sample to the next, and stays.
    Step {
        /// The column.
        channel: usize,
        /// The first sample at the new level.
        sample: usize,
        /// The change.
        change: f64,
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
        /// How many such steps follow each other.
        count: usize,
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
    let mut spiked = Vec::with_capacity(channels);
    for (channel, column) in columns.iter().enumerate() {
        let known: Vec<f64> = column.iter().copied().filter(|x| x.is_finite()).collect();
        let first = known.first().copied().unwrap_or(f64::NAN);
        let own = noise_of(&known);
        let off = spikes(column, &smooth[channel], &own);
        // Spikes apart: a dead channel may have some.
        let mut rest = column.iter().enumerate();
        let value = smooth[channel].iter().copied().find(|x| x.is_finite());
        let value = value.unwrap_or(first);
        constant[channel] = known.iter().all(|x| *x == first)
            || rest.all(|(i, x)| !x.is_finite() || *x == value || off.binary_search(&i).is_ok());
        if constant[channel] && !known.is_empty() {
            findings.push(Finding::Constant { channel, value });
        }
        spiked.push(off);
        noise.push(own);
    }
    // What is looked at for all but single spikes.
    let clean: Vec<Vec<f64>> = columns
        .iter()
        .zip(&spiked)
        .map(|(column, off)| {
            let mut column = column.clone();
            for &i in off {
                column[i] = f64::NAN;
            }
            column
        })
        .collect();
    for channel in (0..channels).filter(|&c| !constant[c]) {
        runs(channel, &clean, &smooth, &noise, &constant, &mut findings);
    }
    let floors: Vec<f64> = clean.iter().map(|column| innovation(column)).collect();
    for channel in (1..channels).filter(|&c| !constant[c]) {
        let mut others = (0..channel).filter(|of| !constant[*of]);
        findings.extend(
            others.find_map(|of| copied(&clean, of, channel, floors[channel], &noise[channel])),
        );
    }
    axes(&clean, &constant, &noise, &mut findings);
    unlike(&constant, &noise, &floors, &mut findings);
    for (channel, column) in columns.iter().enumerate() {
        let missing = column.iter().filter(|x| !x.is_finite()).count();
        if missing > 0 {
            findings.push(Finding::Missing {
                channel,
                samples: missing,
            });
        }
        let samples = core::mem::take(&mut spiked[channel]);
        if !samples.is_empty() {
            findings.push(Finding::Spikes { channel, samples });
        }
        if !constant[channel] {
            findings.extend(hum(channel, times, &clean[channel]));
            findings.extend(jump(channel, times, &clean[channel], &noise[channel]));
            findings.extend(drift(channel, column, &noise[channel]));
        }
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
    constant: &[bool],
    findings: &mut Vec<Finding>,
) {
    let (column, own) = (&columns[channel], &noise[channel]);
    let (low, high) = range(column);
    let mut known: Vec<f64> = column.iter().copied().filter(|x| x.is_finite()).collect();
    let middle = median(&mut known);
    // First sample, length.
    let mut every: Vec<(usize, usize)> = Vec::new();
    let mut start = 0;
    for i in 1..=column.len() {
        if i == column.len() || column[i] != column[start] {
            if column[start].is_finite() {
                every.push((start, i - start));
            }
            start = i;
        }
    }
    let longest = every.iter().map(|r| r.1).max().unwrap_or(0);
    // The share of equal neighbours, without the longest run.
    let equal = column.windows(2).filter(|w| w[0] == w[1]).count();
    let outside = column.len().saturating_sub(longest).max(1) as f64;
    let share = equal.saturating_sub(longest.saturating_sub(1)) as f64 / outside;
    let by_chance = |length: usize| {
        let length = i32::try_from(length).unwrap_or(i32::MAX);
        share.max(1.0 / column.len() as f64).powi(length - 1) * column.len() as f64 > CHANCE
    };
    let grain = own.sigma.max(own.step);
    // A limit is far from where the channel usually is, and the channel leaves it on both sides
    // as a peak does not: that is at three times its half width no further down than eight times
    // what it is within the run.
    let limited = |&(from, length): &(usize, usize)| {
        let value = column[from];
        let far = (value - middle).abs() > 10.0 * grain && high - low > 50.0 * own.sigma;
        let half = length.div_ceil(2).max(4);
        let falls = |at: Option<usize>| {
            at.and_then(|i| smooth[channel].get(i))
                .is_none_or(|x| !((x - value).abs() <= 6.0 * own.step + 6.0 * own.sigma))
        };
        let rounded = own.step > 0.0;
        let leaves = falls(from.checked_sub(half)) && falls(Some(from + length - 1 + half));
        (value == low || value == high) && far && length >= 4 && {
            !by_chance(length) || (rounded && length >= 6 && leaves)
        }
    };
    for limit in [low, high] {
        let at: Vec<_> = every
            .iter()
            .filter(|r| column[r.0] == limit && limited(r))
            .collect();
        if !at.is_empty() {
            findings.push(Finding::Saturated {
                channel,
                value: limit,
                samples: at.iter().map(|r| r.1).sum(),
            });
        }
    }
    // A recorder whose steps hide the noise repeats itself for long: there a channel is
    // stuck only while others see a pass, and it does not where it otherwise moves.
    let others: Vec<usize> = (0..columns.len())
        .filter(|&c| c != channel && !constant[c])
        .collect();
    let passing = |&(from, length): &(usize, usize)| {
        let run = from..from + length;
        let mut rest = smooth[channel].clone();
        rest[run.clone()].fill(f64::NAN);
        let (low, high) = range(&rest);
        high - low > 10.0 * grain
            && others.iter().any(|&c| {
                let (low, high) = range(&smooth[c]);
                let (least, most) = range(&smooth[c][run.clone()]);
                most - least > 0.75 * (high - low)
                    && most - least > 10.0 * noise[c].sigma.max(noise[c].step)
            })
    };
    // What repeats least, of all the other channels, tells how long a sound one may.
    let usual = others
        .iter()
        .map(|&c| {
            let equal = columns[c].windows(2).filter(|w| w[0] == w[1]).count();
            equal as f64 / columns[c].len() as f64
        })
        .fold(share, f64::max);
    let never = |length: usize| {
        let length = i32::try_from(length).unwrap_or(i32::MAX);
        let trials = column.len() as f64;
        usual.max(1.0 / trials).powi(length - 1) * trials < CHANCE
    };
    let stuck = every
        .iter()
        .filter(|r| r.1 >= 8 && !by_chance(r.1) && !limited(r))
        .filter(|r| share < 0.5 || passing(r) || (usual < 0.7 && never(r.1)))
        .max_by_key(|r| r.1);
    if let Some(&(from, samples)) = stuck {
        findings.push(Finding::Stuck {
            channel,
            first: from,
            samples,
            value: column[from],
        });
    }
}

/// The smallest and the largest of the numbers that are there.
fn range(values: &[f64]) -> (f64, f64) {
    values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |r, x| {
            (r.0.min(*x), r.1.max(*x))
        })
}

/// The standard deviation of what the six samples before do not tell of one: of a channel with
/// a pass, a drift and hum what is its own.
fn innovation(column: &[f64]) -> f64 {
    const PAST: usize = 6;
    let (low, high) = range(column);
    let scale = (high - low).max(f64::MIN_POSITIVE);
    let mut rows = SquareRootInformation::<f64, { PAST + 2 }>::new();
    for w in column.windows(PAST + 1) {
        if w.iter().all(|x| x.is_finite()) {
            let mut row = [1.0; PAST + 2];
            for (out, x) in row[1..].iter_mut().zip(w) {
                *out = (x - low) / scale;
            }
            rows.absorb(&row);
        }
    }
    let count = f64::from(rows.count()) - (PAST + 1) as f64;
    let left = rows.factor()[PAST + 1][PAST + 1].abs();
    if count > 0.0 {
        scale * left / count.sqrt()
    } else {
        0.0
    }
}

/// Whether a column repeats another up to scale and offset, a few samples earlier or later and
/// at least for a quarter of the record: what is left is far below the noise that two sensors
/// would have apart (`floor`), or nowhere more than a rounding.
fn copied(
    columns: &[Vec<f64>],
    of: usize,
    channel: usize,
    floor: f64,
    noise: &Noise,
) -> Option<Finding> {
    const LATEST: isize = 5;
    let n = columns[channel].len();
    // A level that steps before the part that is a copy is not its noise.
    let quarter = |q: usize| (q * n / 4, (q + 1) * n / 4);
    let own = [0, 1, 2, 3].map(|q| {
        let (from, to) = quarter(q);
        innovation(&columns[channel][from..to])
    });
    let part = |from: usize, to: usize, floor: f64, late: isize| {
        let floor = floor.max(noise.step / 12.0_f64.sqrt());
        let pairs = || {
            (from..to).filter_map(move |i| {
                let x = *columns[of].get(i.checked_add_signed(-late)?)?;
                let y = columns[channel][i];
                (x.is_finite() && y.is_finite()).then_some((x, y))
            })
        };
        let count = pairs().count() as f64;
        let (mean_x, mean_y) =
            pairs().fold((0.0, 0.0), |s, (x, y)| (s.0 + x / count, s.1 + y / count));
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for (x, y) in pairs() {
            xx += (x - mean_x) * (x - mean_x);
            xy += (x - mean_x) * (y - mean_y);
            yy += (y - mean_y) * (y - mean_y);
        }
        let factor = xy / xx;
        let offset = mean_y - factor * mean_x;
        let left = |(x, y): (f64, f64)| (y - factor * x - offset).abs();
        let spread = (pairs().map(left).map(|l| l * l).sum::<f64>() / count).sqrt();
        let own = (yy / count).sqrt();
        // A copy that was rounded again differs by half a step.
        let rounded = own > 5.0 * noise.step && pairs().all(|p| left(p) < 0.51 * noise.step);
        let same = spread < 0.2 * floor && own > 0.5 * floor;
        (count >= 16.0 && (same || rounded)).then_some((factor, offset))
    };
    (0..=2 * LATEST).find_map(|k| {
        // 0, 1, -1, 2, ..
        let late = if k % 2 == 0 { -k / 2 } else { k / 2 + 1 };
        let found = |from: usize, to: usize, floor: f64| {
            part(from, to, floor, late).map(|(factor, offset)| Finding::Copy {
                channel,
                of,
                factor,
                offset,
                late,
                first: from,
                samples: to - from,
            })
        };
        found(0, n, floor).or_else(|| {
            let same = |q: &usize| part(quarter(*q).0, quarter(*q).1, own[*q], late).is_some();
            let quarters: Vec<usize> = (0..4).filter(same).collect();
            let (first, last) = (*quarters.first()?, *quarters.last()?);
            let (from, to) = quarter(first);
            found(from, quarter(last).1, own[first]).or_else(|| found(from, to, own[first]))
        })
    })
}

/// Channels that are far noisier, or rounded far more coarsely, than the others.
/// `floors` is what each has that its past does not tell, hum apart.
fn unlike(constant: &[bool], noise: &[Noise], floors: &[f64], findings: &mut Vec<Finding>) {
    for (channel, own) in noise.iter().enumerate().filter(|(c, _)| !constant[*c]) {
        let of = |values: &dyn Fn(usize) -> f64| {
            let mut others: Vec<f64> = (0..noise.len())
                .filter(|&c| c != channel && !constant[c] && noise[c].sigma > 0.0)
                .map(values)
                .collect();
            (others.len() > 1).then(|| median(&mut others))
        };
        let (Some(usual), Some(floor)) = (of(&|c| noise[c].sigma), of(&|c| floors[c])) else {
            continue;
        };
        if own.step > 10.0 * usual {
            let step = own.step;
            findings.push(Finding::Coarse {
                channel,
                step,
                usual,
            });
        } else if own.sigma > 8.0 * usual && floors[channel] > 8.0 * floor {
            let sigma = own.sigma;
            findings.push(Finding::Noisy {
                channel,
                sigma,
                usual,
            });
        }
    }
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
        // Only signals far above the noise say which axis is which: others count as 0.
        let strong = |c: usize| {
            let mut known: Vec<f64> = columns[c]
                .iter()
                .copied()
                .filter(|x| x.is_finite())
                .collect();
            let middle = median(&mut known);
            known
                .iter()
                .any(|x| (x - middle).abs() > 15.0 * noise[c].sigma)
        };
        let none: Vec<f64> = Vec::new();
        let told = |c: usize| if strong(c) { &columns[c] } else { &none };
        let (order, with, gain) = matched(
            [0, 1, 2].map(told),
            [own.start, own.start + 1, own.start + 2].map(told),
            columns[0].len(),
        );
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
fn matched(first: [&Vec<f64>; 3], second: [&Vec<f64>; 3], n: usize) -> ([usize; 3], [f64; 3], f64) {
    const ORDERS: [[usize; 3]; 6] = [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ];
    let reach = n / 20;
    let stride = (reach / 50).max(1);
    let (mut order, mut with, mut best, mut plain) = (ORDERS[0], [0.0; 3], 0.0, 0.0_f64);
    for shift in (0..=reach).step_by(stride) {
        for late in [false, true] {
            let of = |a: &[f64], b: &[f64]| {
                if a.is_empty() || b.is_empty() {
                    0.0
                } else if late {
                    correlation(&a[..n - shift], &b[shift..])
                } else {
                    correlation(&a[shift..], &b[..n - shift])
                }
            };
            let table = [0, 1, 2].map(|i| [0, 1, 2].map(|j| of(first[j], second[i])));
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

/// The median of the nine samples about each, NaN where all are missing.
fn medians(column: &[f64]) -> Vec<f64> {
    (0..column.len())
        .map(|i| {
            let mut near: Vec<f64> = column[i.saturating_sub(4)..(i + 5).min(column.len())]
                .iter()
                .copied()
                .filter(|x| x.is_finite())
                .collect();
            median(&mut near)
        })
        .collect()
}

/// Samples far off the median of the nine about them, and off what their neighbours lead to:
/// the top of a fast pass is the first alone.
fn spikes(column: &[f64], smooth: &[f64], noise: &Noise) -> Vec<usize> {
    let limit = SPIKE * noise.sigma + 2.0 * noise.step;
    let off = |i: usize| {
        let alone = i.checked_sub(2).and_then(|first| column.get(first..i + 3));
        let led = alone.map_or(f64::NAN, |w| (4.0 * (w[1] + w[3]) - w[0] - w[4]) / 6.0);
        (column[i] - smooth[i]).abs() > limit && !((column[i] - led).abs() <= limit)
    };
    (0..column.len())
        .filter(|&i| column[i].is_finite() && limit > 0.0 && off(i))
        .collect()
}

/// A change of level between two samples, both sides of it nearly at rest.
fn jump(channel: usize, times: &[f64], column: &[f64], noise: &Noise) -> Option<Finding> {
    const SIDE: usize = 4;
    let limit = SPIKE * noise.sigma + 2.0 * noise.step;
    let level = |w: &[f64]| {
        let mut known: Vec<f64> = w.iter().copied().filter(|x| x.is_finite()).collect();
        median(&mut known)
    };
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    // In a gap a level may well change.
    let longest = 1.5 * median(&mut steps);
    let mut best: Option<(usize, f64)> = None;
    for (k, w) in column.windows(2 * SIDE).enumerate() {
        if times[k + SIDE] - times[k + SIDE - 1] > longest {
            continue;
        }
        let change = w[SIDE] - w[SIDE - 1];
        let (before, after) = w.split_at(SIDE);
        let rest = |side: &[f64]| {
            let (low, high) = range(side);
            high - low < 0.25 * change.abs()
        };
        if limit > 0.0
            && change.abs() > limit
            && rest(before)
            && rest(after)
            && ((level(after) - level(before)) / change - 1.0).abs() < 0.3
            && best.is_none_or(|b| change.abs() > b.1.abs())
        {
            best = Some((k + SIDE, change));
        }
    }
    best.map(|(sample, change)| Finding::Step {
        channel,
        sample,
        change,
    })
}

/// A tone of the mains that stands above the spectrum around it.
fn hum(channel: usize, times: &[f64], column: &[f64]) -> Option<Finding> {
    let n = column.len();
    if n < 256 {
        return None;
    }
    // Without gaps and jumps of the clock.
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let usual = median(&mut steps);
    if !(usual > 0.0) {
        return None;
    }
    let mut at = 0.0;
    let times: Vec<f64> = core::iter::once(0.0)
        .chain(times.windows(2).map(|w| {
            let step = w[1] - w[0];
            let sound = step > 0.5 * usual && step < 1.5 * usual;
            at += if sound { step } else { usual };
            at
        }))
        .collect();
    let (span, rate) = (times[n - 1], 1.0 / usual);
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

/// Steps of the clock that differ from the usual one: single ones by a fifth and more than
/// its jitter, and rates that differ by a tenth for a while.
fn clock(times: &[f64], findings: &mut Vec<Finding>) {
    const WHILE: usize = 16;
    let steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let usual = median(&mut steps.clone());
    if steps.is_empty() || !usual.is_finite() {
        return;
    }
    let mut off: Vec<f64> = steps.iter().map(|s| (s - usual).abs()).collect();
    off.sort_by(f64::total_cmp);
    let jitter = off[off.len() * 9 / 10] / 1.645;
    // Above, below or at the usual step, and whether by more than jitter does.
    let side = |step: f64| {
        if (step - usual).abs() > 0.1 * usual.abs() {
            (step - usual).signum()
        } else {
            0.0
        }
    };
    let single =
        |step: f64| step <= 0.0 || (step - usual).abs() > (4.0 * jitter).max(0.2 * usual.abs());
    let mut from = 0;
    while from < steps.len() {
        let kind = side(steps[from]);
        let mut to = from + 1;
        while to < steps.len() && side(steps[to]) == kind {
            to += 1;
        }
        let told =
            kind != 0.0 && (to - from >= WHILE || steps[from..to].iter().any(|s| single(*s)));
        if told {
            let worst = steps[from..to]
                .iter()
                .copied()
                .max_by(|a, b| (a - usual).abs().total_cmp(&(b - usual).abs()))
                .unwrap_or(usual);
            let step = if to - from >= WHILE {
                median(&mut steps[from..to].to_vec())
            } else {
                worst
            };
            findings.push(Finding::Clock {
                sample: from + 1,
                step,
                usual,
                count: to - from,
            });
        }
        from = to;
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
                first: 300,
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

    /// What is found of a record that was changed row by row.
    fn changed(times: &[f64], field: &[f64], change: &dyn Fn(usize, &mut [f64])) -> Vec<Finding> {
        let mut field = field.to_vec();
        for (i, row) in field.chunks_mut(6).enumerate() {
            change(i, row);
        }
        check(times, &field, 6).unwrap().findings
    }

    #[test]
    fn copies_are_told_from_channels_with_the_same_hum() {
        let (times, good) = record(7);
        let copies = |found: &[Finding]| -> Vec<(usize, usize, isize, usize)> {
            let copy = |f: &Finding| match *f {
                Finding::Copy {
                    channel,
                    of,
                    late,
                    samples,
                    ..
                } => Some((channel, of, late, samples)),
                _ => None,
            };
            found.iter().filter_map(copy).collect()
        };
        // 50 Hz at 200 a second in all channels, fifty times the noise: none is a copy.
        let hum = changed(&times, &good, &|i, row| {
            let wave = 50.0 * (core::f64::consts::TAU * 50.02 * i as f64 / RATE + 1.0).sin();
            for x in row.iter_mut() {
                *x += wave;
            }
        });
        assert_eq!(copies(&hum), []);
        let hums = hum.iter().filter(|f| matches!(f, Finding::Hum { .. }));
        assert_eq!(hums.count(), 6);
        // Spikes of its own do not hide one, nor that it lasts a part of the record.
        let spiked = changed(&times, &good, &|i, row| {
            row[4] = row[0] + if i % 700 == 90 { 1e4 } else { 0.0 };
        });
        assert_eq!(copies(&spiked), [(4, 0, 0, 2000)]);
        let later = changed(&times, &good, &|i, row| {
            if i >= 500 {
                row[4] = row[0];
            }
        });
        assert_eq!(copies(&later), [(4, 0, 0, 1500)]);
        let late = changed(&times, &good, &|i, row| {
            if i >= 2 {
                row[4] = good[6 * (i - 2)];
            }
        });
        assert!(copies(&late).contains(&(4, 0, 2, 2000)), "{late:?}");
    }

    #[test]
    fn a_coarse_channel_is_stuck_or_cut_off() {
        // Steps of four deviations: sound channels repeat themselves for long.
        let (times, mut field) = record(3);
        let round = |x: f64| (x / 4.0).round() * 4.0;
        for x in &mut field {
            *x = round(*x);
        }
        assert_eq!(check(&times, &field, 6).unwrap().findings, []);
        let top = field.iter().step_by(6).copied().fold(0.0, f64::max);
        let limit = round(0.5 * top);
        let found = changed(&times, &field, &|_, row| row[0] = row[0].min(limit));
        assert!(
            matches!(found[..], [Finding::Saturated { channel: 0, value, .. }] if value == limit),
            "{found:?}"
        );
        let value = field[6 * 900 + 1];
        let found = changed(&times, &field, &|i, row| {
            if (900..1300).contains(&i) {
                row[1] = value;
            }
        });
        assert!(
            matches!(
                // And a step where it ends.
                found[..],
                [
                    Finding::Stuck {
                        channel: 1,
                        first: 890..=900,
                        ..
                    },
                    Finding::Step { sample: 1300, .. }
                ]
            ),
            "{found:?}"
        );
    }

    #[test]
    fn levels_that_step_and_unlike_channels_are_named() {
        let (times, good) = record(5);
        let step = changed(&times, &good, &|i, row| {
            row[1] += if i < 300 { 0.0 } else { 60.0 };
        });
        assert!(
            step.iter().any(|f| matches!(
                f,
                Finding::Step { channel: 1, sample: 300, change } if (change - 60.0).abs() < 8.0
            )),
            "{step:?}"
        );
        let coarse = changed(&times, &good, &|_, row| {
            row[2] = (row[2] / 30.0).round() * 30.0;
        });
        assert!(
            matches!(
                coarse[..],
                [Finding::Coarse { channel: 2, step, .. }] if (step - 30.0).abs() < 1e-9
            ),
            "{coarse:?}"
        );
        let mut stream = Stream::new(11, 0);
        let mut noise = vec![0.0; 2000];
        noise.fill_with(|| 40.0 * stream.normal());
        let noisy = changed(&times, &good, &|i, row| row[3] += noise[i]);
        assert!(
            matches!(noisy[..], [Finding::Noisy { channel: 3, .. }]),
            "{noisy:?}"
        );
        let lost = changed(&times, &good, &|_, row| row[5] = f64::NAN);
        let all = Finding::Missing {
            channel: 5,
            samples: 2000,
        };
        assert_eq!(lost, [all]);
    }

    #[test]
    fn a_fast_pass_is_no_spike() {
        // A thousand times the noise within a tenth of a second.
        let times: Vec<f64> = (0..800).map(|i| f64::from(i) / RATE).collect();
        let mut field = vec![0.0; 2400];
        let mut stream = Stream::new(2, 0);
        field.fill_with(|| stream.normal());
        for (row, t) in field.chunks_mut(3).zip(&times) {
            let u = (t - 2.0) / 0.08;
            let fall = 1e3 * (1.0 + u * u).powf(-2.5);
            row[0] += (2.0 - u * u) * fall;
            row[1] += 3.0 * u * fall;
            row[2] += (1.0 - 2.0 * u * u) * fall;
        }
        assert_eq!(check(&times, &field, 3).unwrap().findings, []);
        for x in field.iter_mut().skip(3 * 100).step_by(3).take(3) {
            *x += 5e3;
        }
        let spikes = Finding::Spikes {
            channel: 0,
            samples: vec![100, 101, 102],
        };
        assert_eq!(check(&times, &field, 3).unwrap().findings, [spikes]);
    }

    #[test]
    fn clocks_of_another_rate_are_named_once_and_jitter_is_not() {
        let (sound, field) = record(7);
        let mut times = sound.clone();
        for i in 900..2000 {
            times[i] = times[i - 1] + 1.3 / RATE;
        }
        let found = check(&times, &field, 6).unwrap().findings;
        // The usual step is that of most samples.
        assert!(
            matches!(
                found[..],
                [Finding::Clock {
                    sample: 1,
                    count: 899,
                    ..
                }]
            ),
            "{found:?}"
        );
        // Rounded to a millisecond and jittered.
        let mut stream = Stream::new(4, 0);
        let jittered: Vec<f64> = sound
            .iter()
            .map(|t| ((t + 3e-4 * stream.normal()) * 1e3).round() / 1e3)
            .collect();
        assert_eq!(check(&jittered, &field, 6).unwrap().findings, []);
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
