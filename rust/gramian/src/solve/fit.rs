//! Does the model fit, what would explain that it does not, and what could be wrong
//! without being seen.

use alloc::vec;
use alloc::vec::Vec;

use super::Model;
use super::gauss_newton::norm;
use crate::chi_square;
use crate::numbers::algebra::dot_slices as dot;
use crate::spectrum::decompose;

/// Whitened residuals at an estimate, and the space that the columns of the model span.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Residuals, those of priors last.
    pub residuals: Vec<f64>,
    /// How many of them are of priors.
    pub priors: usize,
    /// How many places apart neighbours in time are.
    pub channels: usize,
    /// Orthonormal columns that span the columns of the model.
    basis: Vec<Vec<f64>>,
    /// Rows, row-major.
    rows: Vec<f64>,
    /// Rows = basis times this triangle, times the deviations inverse: `triangle[j]` is
    /// column j.
    triangle: Vec<Vec<f64>>,
}

/// A test of the order of residuals in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lag1 {
    /// Sum of the products of neighbours over the sum of squares.
    pub correlation: f64,
    /// Its mean under a true model, after this fit.
    pub mean: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// Probability of a larger one.
    pub p_value: f64,
}

/// [`Fit::lag1`] of many records: made in full only where the residuals alone leave it open
/// that neighbours are correlated.
#[derive(Clone, Copy, Debug)]
pub struct Lag1Test {
    /// In standard deviations; infinite for no test.
    critical: f64,
}

impl Lag1Test {
    /// Of this level; without a test where it is 0.
    pub fn new(level: f64) -> Self {
        let square = chi_square::critical((2.0 * level).min(1.0), 1.0);
        let tested = level > 0.0;
        Self {
            critical: square.map_or(
                f64::INFINITY,
                |z| if tested { z.sqrt() } else { f64::INFINITY },
            ),
        }
    }

    /// Whether anything is tested.
    pub fn is_made(self) -> bool {
        self.critical < f64::INFINITY
    }

    /// Whether the p of [`Fit::lag1`] may be below the level, by the whitened `residuals` of
    /// the measurements alone.
    pub fn leaves_open(
        self,
        residuals: &[f64],
        states: usize,
        priors: usize,
        channels: usize,
    ) -> bool {
        self.is_made() && Self::most(residuals, states, priors, channels) > self.critical
    }

    /// How many deviations above its mean the correlation can be at most, whatever the
    /// columns of the model. With Q an orthonormal basis of them and S the sums of
    /// neighbours, whose eigenvalues are within 1: `|tr(Q^T S Q)| <= n`, and
    /// `2 |S Q|^2 - |Q^T S Q|^2 <= 2 n`.
    fn most(residuals: &[f64], states: usize, priors: usize, channels: usize) -> f64 {
        let (m, lag) = (residuals.len(), channels.max(1));
        let later = residuals.get(lag..).unwrap_or_default();
        let neighbours = eightfold(residuals, later).max(0.0);
        let correlation = neighbours / eightfold(residuals, residuals);
        let (n, all) = (states as f64, (m + priors) as f64);
        let least = all - n;
        let square = 0.5 * m.saturating_sub(lag) as f64 - 2.0 * n - n * n / least;
        let sigma = (2.0 * square / (all * (all + 2.0))).sqrt();
        let most = (correlation + n / least) / sigma;
        // Few residuals bound nothing.
        if least > 0.0 && most >= 0.0 {
            most
        } else {
            f64::INFINITY
        }
    }
}

/// The sum of products of as many numbers as the shorter has, in eight sums that run side by
/// side.
fn eightfold(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len().min(b.len());
    let ((a, more), (b, others)) = (a[..count].as_chunks::<8>(), b[..count].as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum::<f64>() + dot(more, others)
}

/// What a test of one alternative says.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// By how much the alternative lowers chi2: chi-square with `dof` degrees of freedom where
    /// the model is true.
    pub statistic: f64,
    /// Columns that the model does not have.
    pub dof: usize,
    /// How rarely a true model looks as much like the alternative: of one parameter the
    /// probability of a larger statistic, of several see [`Fit::score`].
    pub p_value: f64,
    /// p of the fit with the alternative in the model.
    pub restored: f64,
    /// The parameters of the alternative that fit best.
    pub size: Vec<f64>,
    /// The smallest size that is seen with the power asked for, of several parameters the
    /// length in the direction seen worst; infinite where one leaves no trace.
    pub detectable: f64,
    /// The most that an alternative just seen does to each state, with its sign where it
    /// has one parameter: the external reliability.
    pub effect: Vec<f64>,
    /// The statistic's direction, for [`correlation`].
    direction: Vec<f64>,
}

/// The noncentrality at which a test of level `alpha` has this power, with one degree of
/// freedom.
///
/// # Source
/// Baarda 1968, A testing procedure for use in geodetic networks.
pub fn noncentrality(alpha: f64, power: f64) -> f64 {
    let quantile =
        |tails: f64| chi_square::critical(tails.clamp(1e-300, 1.0), 1.0).map_or(0.0, f64::sqrt);
    let beta = if power >= 0.5 {
        quantile(2.0 * (1.0 - power))
    } else {
        -quantile(2.0 * power)
    };
    (quantile(alpha) + beta).max(0.0).powi(2)
}

/// As [`noncentrality`], with more degrees of freedom: to three digits.
///
/// # Source
/// Sankaran 1963, Approximations to the non-central chi-square distribution.
pub fn noncentrality_of(alpha: f64, power: f64, dof: usize) -> f64 {
    if dof <= 1 {
        return noncentrality(alpha, power);
    }
    let k = dof as f64;
    let Ok(critical) = chi_square::critical(alpha.clamp(1e-300, 1.0), k) else {
        return f64::INFINITY;
    };
    let quantile = chi_square::critical((2.0 * (1.0 - power)).clamp(1e-300, 1.0), 1.0);
    let wanted = -quantile.map_or(0.0, f64::sqrt);
    let excess = |lambda: f64| {
        let (one, two) = (k + lambda, k + 2.0 * lambda);
        let h = 1.0 - 2.0 * one * (k + 3.0 * lambda) / (3.0 * two * two);
        let p = two / (one * one);
        let m = (h - 1.0) * (1.0 - 3.0 * h);
        let mean = 1.0 + h * p * (h - 1.0 - 0.5 * (2.0 - h) * m * p);
        ((critical / one).powf(h) - mean) / (h * (2.0 * p).sqrt() * (1.0 + 0.5 * m * p)) - wanted
    };
    let (mut low, mut high) = (0.0, 1.0);
    while excess(high) > 0.0 && high < 1e6 {
        (low, high) = (high, 2.0 * high);
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if excess(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

impl Fit {
    /// At the state `x`.
    ///
    /// # Errors
    /// Where the model has no value.
    pub fn new<M: Model + ?Sized>(model: &M, x: &[f64]) -> Result<Self, M::Error> {
        let (m, n) = (model.measurements(), model.states());
        let mut residuals = vec![0.0; m];
        let mut rows = vec![0.0; m * n];
        model.linearize(x, &mut residuals, Some(&mut rows))?;
        let mut basis: Vec<Vec<f64>> = Vec::with_capacity(n);
        let mut triangle = Vec::with_capacity(n);
        for j in 0..n {
            let mut column: Vec<f64> = (0..m).map(|i| rows[i * n + j]).collect();
            let length = norm(&column);
            let mut along = project(&mut column, &basis);
            let left = norm(&column);
            if left > 1e-12 * length {
                for v in &mut column {
                    *v /= left;
                }
                along.push(left);
            } else {
                // A combination of the others: it adds nothing.
                column.fill(0.0);
                along.push(0.0);
            }
            basis.push(column);
            triangle.push(along);
        }
        Ok(Self {
            residuals,
            priors: model.priors(),
            channels: model.channels().max(1),
            basis,
            rows,
            triangle,
        })
    }

    /// Sum of the squared residuals.
    pub fn chi2(&self) -> f64 {
        dot(&self.residuals, &self.residuals)
    }

    /// Measurements and priors less the rank of the model. A number that was not measured, of
    /// weight zero, has neither a residual nor a row, and is not counted.
    pub fn dof(&self) -> usize {
        let rank = self.basis.iter().filter(|b| norm(b) > 0.5).count();
        let n = self.basis.len();
        let row = |i: usize| &self.rows[i * n..][..n];
        let measured = |i: &usize| self.residuals[*i] != 0.0 || row(*i).iter().any(|&c| c != 0.0);
        let count = (0..self.residuals.len()).filter(measured).count();
        count.saturating_sub(rank)
    }

    /// Probability of a larger chi2 if the model is true; NaN without degrees of freedom.
    pub fn p_value(&self) -> f64 {
        match self.dof() {
            0 => f64::NAN,
            dof => chi_square::tail(self.chi2(), dof as f64),
        }
    }

    /// Whether neighbours in time resemble each other, against what a fit leaves of
    /// white noise: with P the projection off the model's columns and S the sums of
    /// neighbours, mean tr(P S) / k and variance 2 (tr(P S P S) - tr(P S)^2 / k) /
    /// (k (k + 2)), k degrees of freedom.
    ///
    /// # Source
    /// Durbin & Watson 1950, section 3, with moments in place of bounds.
    pub fn lag1(&self) -> Lag1 {
        let m = self.residuals.len() - self.priors;
        let k = self.dof() as f64;
        let lag = self.channels;
        let neighbours = |v: &[f64], w: &[f64]| -> f64 {
            (lag..m)
                .map(|i| 0.5 * (v[i - lag] * w[i] + v[i] * w[i - lag]))
                .sum()
        };
        let spread = |v: &[f64]| -> Vec<f64> {
            (0..v.len())
                .map(|i| {
                    let before = if i >= lag && i < m { v[i - lag] } else { 0.0 };
                    let after = if i + lag < m { v[i + lag] } else { 0.0 };
                    0.5 * (before + after)
                })
                .collect()
        };
        let trace: f64 = -self.basis.iter().map(|q| neighbours(q, q)).sum::<f64>();
        let mut square = 0.5 * m.saturating_sub(lag) as f64;
        for a in &self.basis {
            let moved = spread(a);
            square -= 2.0 * dot(&moved, &moved);
            square += self
                .basis
                .iter()
                .map(|b| dot(&moved, b).powi(2))
                .sum::<f64>();
        }
        let mean = trace / k;
        let variance = 2.0 * (square - trace * trace / k) / (k * (k + 2.0));
        let sigma = variance.max(0.0).sqrt();
        let correlation = neighbours(&self.residuals, &self.residuals) / self.chi2();
        let z = (correlation - mean) / sigma;
        let half = 0.5 * chi_square::tail(z * z, 1.0);
        Lag1 {
            correlation,
            mean,
            sigma,
            p_value: if !z.is_finite() {
                f64::NAN
            } else if z > 0.0 {
                half
            } else {
                1.0 - half
            },
        }
    }

    /// Tests an alternative: further parameters, of one unit, whose whitened columns at zero,
    /// row-major (m, parameters), are given. What a test of level `alpha` sees with this
    /// `power` counts as detectable.
    ///
    /// Several parameters are tested twice: by the score test, which looks for traces of one
    /// size in every direction, and by one that looks for parameters of one size, whose traces
    /// are larger in some directions than in others. The harmonic mean of the two p is small
    /// where either is.
    ///
    /// # Source
    /// The score test (Rao 1948); for parameters that are random with zero mean, Goeman, van de
    /// Geer & van Houwelingen 2006, Testing against a high dimensional alternative; the harmonic
    /// mean p: Wilson 2019; internal and external reliability: Baarda 1968.
    pub fn score(&self, columns: &[f64], parameters: usize, alpha: f64, power: f64) -> Score {
        let m = self.residuals.len();
        let n = self.basis.len();
        let mut left: Vec<Vec<f64>> = Vec::new();
        let mut lower: Vec<Vec<f64>> = Vec::new();
        let mut along_model = Vec::new();
        for p in 0..parameters {
            let given = |i: usize| columns.get(i * parameters + p).copied().unwrap_or(0.0);
            let mut column: Vec<f64> = (0..m).map(given).collect();
            let length = norm(&column);
            along_model.push(project(&mut column, &self.basis));
            let mut along = project(&mut column, &left);
            let size = norm(&column);
            if size > 1e-9 * length {
                for v in &mut column {
                    *v /= size;
                }
                along.push(size);
            } else {
                column.fill(0.0);
                along.push(0.0);
            }
            left.push(column);
            lower.push(along);
        }
        let parts: Vec<f64> = left.iter().map(|q| dot(q, &self.residuals)).collect();
        let statistic = dot(&parts, &parts);
        let dof = lower
            .iter()
            .enumerate()
            .filter(|(p, along)| along[*p] > 0.0)
            .count();
        let size = back(&lower, &parts);
        let mut direction = vec![0.0; m];
        for (q, part) in left.iter().zip(&parts) {
            for (d, q) in direction.iter_mut().zip(q) {
                *d += part * q;
            }
        }
        if parameters == 1 {
            direction.clone_from(&left[0]);
        }
        let (mut detectable, mut effect) = (f64::INFINITY, vec![f64::INFINITY; n]);
        if parameters > 0 && dof == parameters {
            // At half the level the first of two tests decides alone.
            let level = if dof > 1 { 0.5 * alpha } else { alpha };
            let root = noncentrality_of(level, power, dof).sqrt();
            // The fit takes what lies in its columns for a change of the states.
            let changes: Vec<Vec<f64>> = along_model
                .iter()
                .map(|along| back(&self.triangle, along))
                .collect();
            // Sizes just seen are root times unit vectors, over the triangle.
            let seen: Vec<Vec<f64>> = (0..parameters)
                .map(|p| {
                    let mut unit = vec![0.0; parameters];
                    unit[p] = 1.0;
                    back(&lower, &unit)
                })
                .collect();
            for (k, e) in effect.iter_mut().enumerate() {
                let along = |size: &Vec<f64>| -> f64 {
                    size.iter()
                        .zip(&changes)
                        .map(|(s, change)| s * change[k])
                        .sum()
                };
                *e = if parameters == 1 {
                    root * along(&seen[0])
                } else {
                    root * seen.iter().map(along).fold(0.0, f64::hypot)
                };
            }
            detectable = root * largest(&seen);
        }
        let rest = self.dof().saturating_sub(dof);
        let p = |value: f64, dof: usize| match dof {
            0 => f64::NAN,
            dof => chi_square::tail(value, dof as f64),
        };
        Score {
            statistic,
            dof,
            p_value: match dof {
                0 => 1.0,
                1 => p(statistic, dof),
                _ => {
                    let even = p(statistic, dof);
                    2.0 / (1.0 / even + 1.0 / of_equal_parameters(&lower, &parts, dof))
                }
            },
            restored: p(self.chi2() - statistic, rest),
            size,
            detectable,
            effect,
            direction,
        }
    }

    /// Whitened residuals over their own deviations, sqrt of the diagonal of the
    /// projection: standard normal each; 0 where a residual is 0 whatever was measured.
    pub fn standardized(&self) -> Vec<f64> {
        (0..self.residuals.len())
            .map(|i| {
                let taken: f64 = self.basis.iter().map(|q| q[i] * q[i]).sum();
                let left = 1.0 - taken;
                if left > 1e-9 {
                    self.residuals[i] / left.sqrt()
                } else {
                    0.0
                }
            })
            .collect()
    }

    /// The rows at the estimate, row-major.
    pub fn rows(&self) -> &[f64] {
        &self.rows
    }
}

/// How alike two alternatives of one parameter look in the residuals, -1 to 1.
pub fn correlation(a: &Score, b: &Score) -> f64 {
    let lengths = norm(&a.direction) * norm(&b.direction);
    if lengths > 0.0 {
        dot(&a.direction, &b.direction) / lengths
    } else {
        0.0
    }
}

/// What a channel of a recording looks like, beside what it measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Channel {
    /// Nothing is wrong with it.
    Sound,
    /// One value from the first to the last sample.
    Constant,
    /// One value from sample `first` to sample `last`, for longer than its noise lets it.
    Stuck {
        /// The first sample of the run.
        first: usize,
        /// The last one.
        last: usize,
    },
    /// An affine function of an earlier channel.
    Copy {
        /// Which one.
        of: usize,
    },
}

/// Looks for dead, stuck and doubled channels in a recording: `values` and the standard
/// deviation of each, one behind the other, and for each channel the places of its readings
/// there in the order of time. One that is NaN, or has no deviation above 0, does not count.
///
/// Fewer than five readings that count say nothing.
pub fn channels(values: &[f64], sigma: &[f64], places: &[&[usize]]) -> Vec<Channel> {
    let counts = |i: usize| !values[i].is_nan() && sigma[i] > 0.0;
    let mut found = Vec::with_capacity(places.len());
    // Where a copy is looked for: of those that are no constants.
    let mut centred: Vec<Vec<f64>> = Vec::with_capacity(places.len());
    for (c, own) in places.iter().enumerate() {
        // Nearly all are sound, and that no reading repeats the one before tells it.
        let mut before = f64::NAN;
        let mut repeats = false;
        for &i in own.iter().filter(|&&i| counts(i)) {
            repeats |= values[i] == before;
            before = values[i];
        }
        if places.len() == 1 && !repeats {
            found.push(Channel::Sound);
            continue;
        }
        let there: Vec<usize> = own.iter().copied().filter(|&i| counts(i)).collect();
        let readings: Vec<f64> = there.iter().map(|&i| values[i]).collect();
        let least = there
            .iter()
            .map(|&i| sigma[i])
            .fold(f64::INFINITY, f64::min);
        let mut kind = alone(&readings, least);
        if let Channel::Stuck { first, last } = &mut kind {
            // Samples of the channel, those that do not count among them.
            let sample = |k: usize| own.iter().position(|&i| i == there[k]).unwrap_or(k);
            (*first, *last) = (sample(*first), sample(*last));
        }
        if places.len() > 1 {
            let middle = readings.iter().sum::<f64>() / readings.len().max(1) as f64;
            let mine: Vec<f64> = own
                .iter()
                .map(|&i| {
                    if counts(i) {
                        values[i] - middle
                    } else {
                        f64::NAN
                    }
                })
                .collect();
            if kind == Channel::Sound && readings.len() >= FEWEST {
                let same = |other: &usize| alike(&centred[*other], &mine);
                kind = (0..c)
                    .find(same)
                    .map_or(Channel::Sound, |of| Channel::Copy { of });
            }
            centred.push(mine);
        }
        found.push(kind);
    }
    found
}

/// Readings that say something of their channel, at least.
const FEWEST: usize = 5;

/// What a channel looks like by itself.
fn alone(readings: &[f64], sigma: f64) -> Channel {
    if readings.len() < FEWEST {
        return Channel::Sound;
    }
    if readings.iter().all(|&v| v == readings[0]) {
        return Channel::Constant;
    }
    stuck(readings, sigma).map_or(Channel::Sound, |(first, last)| Channel::Stuck {
        first,
        last,
    })
}

/// Whether one channel is the other but for a factor: both less their means, NaN where a
/// reading does not count.
fn alike(a: &[f64], b: &[f64]) -> bool {
    if a.len() != b.len() || a.iter().zip(b).any(|(a, b)| a.is_nan() != b.is_nan()) {
        return false;
    }
    let sum = |a: &[f64], b: &[f64]| -> f64 {
        let products = a.iter().zip(b).map(|(a, b)| a * b);
        products.filter(|p| !p.is_nan()).sum()
    };
    let lengths = sum(a, a).sqrt() * sum(b, b).sqrt();
    lengths > 0.0 && sum(a, b).abs() >= (1.0 - 1e-12) * lengths
}

/// The longest run of one value, where noise of deviation `sigma` would have ended it.
///
/// A reading in the middle of a step of the converter (see [`step_of`]) keeps its value with a probability of at most step / (sigma sqrt(2 pi)).
/// A run is told where, over all its possible places, less than one in 10^4 records would
/// have it; one of fewer than five readings never. Where the readings around the run
/// scatter less than `sigma`, which may be what a poor fit left, that is the noise; where
/// they repeat each other as well, the steps are coarse and say nothing.
fn stuck(readings: &[f64], sigma: f64) -> Option<(usize, usize)> {
    let (mut first, mut longest, mut start) = (0, 0, 0);
    for k in 1..=readings.len() {
        if k == readings.len() || readings[k] != readings[start] {
            if k - start > longest {
                (first, longest) = (start, k - start);
            }
            start = k;
        }
    }
    if longest < FEWEST {
        return None;
    }
    let step = step_of(readings);
    let sigma = scatter(readings, first..first + longest).map_or(sigma, |own| own.min(sigma));
    let stays = (step / (sigma * core::f64::consts::TAU.sqrt())).min(1.0);
    let chance = readings.len() as f64 * stays.powf(longest as f64 - 1.0);
    (chance < 1e-4).then(|| (first, first + longest - 1))
}

/// At most so large are the steps of the converter: whole numbers of them are the differences
/// of readings, and the differences of those, where a signal passes quickly. What the rounding
/// of single precision may have made says nothing.
fn step_of(readings: &[f64]) -> f64 {
    let mut gaps = readings.to_vec();
    let largest = gaps.iter().fold(0.0_f64, |a, r| a.max(r.abs()));
    let mut step = f64::INFINITY;
    for _ in 0..2 {
        gaps.sort_by(f64::total_cmp);
        gaps = gaps.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let sound = gaps.iter().copied().filter(|&gap| gap > 1e-6 * largest);
        step = sound.fold(step, f64::min);
    }
    step
}

/// The deviation of the noise of readings outside a run, by the median of their second
/// differences; `None` for few.
fn scatter(readings: &[f64], run: core::ops::Range<usize>) -> Option<f64> {
    let mut sizes: Vec<f64> = readings
        .windows(3)
        .enumerate()
        .filter(|(k, _)| k + 2 < run.start || *k >= run.end)
        .map(|(_, w)| (w[0] - 2.0 * w[1] + w[2]).abs())
        .collect();
    if sizes.len() < 8 {
        return None;
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    // Of a normal distribution the median is 0.6745 deviations, and those of second
    // differences are larger by the root of 6.
    Some(*median / (0.674_489_75 * 6.0_f64.sqrt()))
}

/// p of the test for parameters of one size. With g the squared lengths of the traces of unit
/// parameters along the principal axes, and y the residuals along these traces, it is that of
/// the sum of y^2 g / (g + mean g): what tells best that parameters are normal, with a size at
/// which one of them moves the residuals by a deviation on the mean.
///
/// `lower` are the columns of the triangle of the projected columns, `parts` the residuals along
/// the orthonormal ones.
fn of_equal_parameters(lower: &[Vec<f64>], parts: &[f64], dof: usize) -> f64 {
    let n = parts.len();
    let mut triangle = vec![0.0; n * n];
    for (j, column) in lower.iter().enumerate() {
        for (i, &value) in column.iter().enumerate() {
            triangle[i * n + j] = value;
        }
    }
    let (mut lengths, mut axes) = (vec![0.0; n], vec![0.0; n * n]);
    let mut work = vec![0.0; n * n];
    let one = vec![1.0; n];
    decompose(&triangle, n, &one, &mut lengths, &mut axes, &mut work);
    let share = |length: f64| (length / lengths[0]).powi(2);
    let mean = lengths.iter().map(|&l| share(l)).sum::<f64>() / dof as f64;
    let mut sum = 0.0;
    let mut weights = Vec::with_capacity(n);
    // Shorter traces are rounding.
    for (k, &length) in lengths
        .iter()
        .enumerate()
        .filter(|(_, l)| share(**l) > 1e-18)
    {
        let axis = &axes[k * n..(k + 1) * n];
        let along: f64 = (0..n)
            .map(|i| parts[i] * dot(&triangle[i * n..(i + 1) * n], axis))
            .sum();
        let weight = share(length) / (share(length) + mean);
        sum += weight * (along / length).powi(2);
        weights.push(weight);
    }
    chi_square::weighted_tail(sum, &weights)
}

/// The largest singular value of a matrix given by its columns: powers of its square.
fn largest(columns: &[Vec<f64>]) -> f64 {
    if let [column] = columns {
        return norm(column);
    }
    let n = columns.len();
    // From the longest column: never across the direction looked for by accident alone.
    let mut v: Vec<f64> = columns.iter().map(|c| norm(c)).collect();
    let mut size = 0.0;
    for _ in 0..200 {
        let image: Vec<f64> = (0..n)
            .map(|i| columns.iter().zip(&v).map(|(c, v)| c[i] * v).sum())
            .collect();
        let back: Vec<f64> = columns.iter().map(|c| dot(c, &image)).collect();
        let length = norm(&back);
        if !(length > 0.0) {
            break;
        }
        size = (length / norm(&v)).sqrt();
        v = back.into_iter().map(|x| x / length).collect();
    }
    size
}

/// Takes off a vector what lies along orthonormal ones, twice; returns how much it was.
fn project(vector: &mut [f64], basis: &[Vec<f64>]) -> Vec<f64> {
    let mut along = vec![0.0; basis.len()];
    for _ in 0..2 {
        for (sum, q) in along.iter_mut().zip(basis) {
            let part = dot(vector, q);
            *sum += part;
            for (v, q) in vector.iter_mut().zip(q) {
                *v -= part * q;
            }
        }
    }
    along
}

/// Solves the triangle whose columns are given, shortest first; 0 where it has no pivot.
fn back(columns: &[Vec<f64>], right: &[f64]) -> Vec<f64> {
    let n = columns.len();
    let mut x = vec![0.0; n];
    for i in (0..n).rev() {
        let later: f64 = (i + 1..n).map(|j| columns[j][i] * x[j]).sum();
        let pivot = columns[i][i];
        if pivot > 0.0 {
            x[i] = (right[i] - later) / pivot;
        }
    }
    x
}
