//! The most likely state of a scene, trial by trial: from several starts, with priors and
//! robust losses, by the steps of [`solve::side_by_side`](crate::solve::side_by_side).
//!
//! # Algorithm
//! Starts are compared by their loss and the best of them followed. The covariance is the
//! inverse of the information, from the triangular factor at the solution; with a robust
//! loss it is that of the sandwich formula (Huber 1981, section 7.6).

use alloc::borrow::Cow;
use alloc::format;
use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;

use super::images::anchor;
use super::trials::Trials;
use super::{InSensor, Measured, Scene};
use crate::batch::{Items, Threads};
use crate::numbers::chi_square::Goodness;
use crate::numbers::words::{brief, moves};
use crate::rounding;
pub use crate::solve::Loss;
use crate::solve::fit::{Fit, Lag1Test};
use crate::solve::side_by_side::{Arrived, losses, minimize_all};
use crate::solve::unbounded::within_reach;
use crate::solve::{Model, WithPrior};
use crate::spectrum;
use crate::square_root::triangularize;

/// How to estimate.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Steps at most from each start.
    pub max_iterations: u32,
    /// How residuals count; priors always by their squares.
    pub loss: Loss,
    /// How many of the starts are followed to their end.
    pub polish: usize,
    /// Relative rank tolerance on rows with unit columns; by default that of
    /// [`default_rtol`](spectrum::default_rtol).
    pub rtol: Option<f64>,
    /// Level at which neighbouring residuals are tested for correlation; 0 for no test, as
    /// with a robust loss.
    pub correlation: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            max_iterations: 60,
            loss: Loss::Squares,
            polish: 4,
            rtol: None,
            correlation: 0.0,
        }
    }
}

/// What the rows at a solution say.
#[derive(Clone, Debug)]
struct Spread {
    /// Rank of the rows and priors.
    rank: usize,
    /// The first direction that nothing sees; zero where there is none.
    null: Vec<f64>,
    /// Covariance, row-major; infinite where the rank is short.
    covariance: Vec<f64>,
}

/// The scaled factor's rank and null vectors, and the covariance where it exists.
fn spread(at: &Arrived, measured: &Measured<'_>, sigma: &[f64], options: Options) -> Spread {
    let n = at.x.len();
    let mut out = Spread {
        rank: n,
        null: vec![0.0; n],
        covariance: vec![f64::INFINITY; n * n],
    };
    let mut rtol = options
        .rtol
        .unwrap_or_else(|| spectrum::default_rtol(measured.measurements(), n));
    let mut factor = Cow::Borrowed(&at.factor[..]);
    let mut scale = vec![1.0; n];
    spectrum::unit_columns(&factor, n, &mut scale);
    let mut b = vec![0.0; n * n];
    let mut least = least_ratio(&factor, n, &scale, &mut b);
    // Rounding of coordinates counts where the target is next to a carrier, and where the
    // rank is in doubt.
    let doubtful = || least < DOUBT || measured.scene.coarseness(&measured.full(&at.x)) > COARSE;
    if options.rtol.is_none() && doubtful() {
        let noise = measured.rounding_at(&at.x);
        let cleaned = rounding::remove(factor.to_mut(), n, &noise);
        rtol = cleaned.map_or(rtol, |left| left.max(rtol));
        spectrum::unit_columns(&factor, n, &mut scale);
        least = least_ratio(&factor, n, &scale, &mut b);
    }
    if !(least > 4.0 * rtol) {
        let mut s = vec![0.0; n];
        let (mut v, mut work) = (vec![0.0; n * n], vec![0.0; n * n]);
        spectrum::decompose(&factor, n, &scale, &mut s, &mut v, &mut work);
        out.rank = spectrum::rank(&s, rtol);
        if out.rank < n {
            for (null, (v, scale)) in out
                .null
                .iter_mut()
                .zip(v[out.rank * n..][..n].iter().zip(&scale))
            {
                *null = v * scale;
            }
            return out;
        }
        // B = V / s, scaled: the covariance is B B^T.
        for k in 0..n {
            for i in 0..n {
                b[i * n + k] = scale[i] * v[k * n + i] / s[k];
            }
        }
    }
    if options.loss == Loss::Squares {
        for i in 0..n {
            for j in 0..=i {
                let sum = (0..n).map(|k| b[i * n + k] * b[j * n + k]).sum();
                out.covariance[i * n + j] = sum;
                out.covariance[j * n + i] = sum;
            }
        }
    } else {
        out.covariance = sandwich(at, measured, sigma, options.loss, &b);
    }
    out
}

/// Above this share of the largest singular value the least one is no rounding.
const DOUBT: f64 = 1e-6;

/// Rounding of an offset, relative to its length, above which it counts beside any rank.
const COARSE: f64 = 1e-8;

/// The least singular value of the scaled factor is at least this share of the largest:
/// without singular values, by 1 / |inverse| and sqrt(n); 0 where there is no inverse.
/// Writes the inverse of the factor.
fn least_ratio(factor: &[f64], n: usize, scale: &[f64], b: &mut [f64]) -> f64 {
    let mut square = 0.0;
    for i in (0..n).rev() {
        let (above, below) = b.split_at_mut((i + 1) * n);
        let row = &mut above[i * n..];
        row.fill(0.0);
        row[i] = 1.0;
        for (k, other) in (i + 1..n).zip(below.chunks_exact(n)) {
            let factor = factor[i * n + k];
            for (entry, other) in row[k..].iter_mut().zip(&other[k..]) {
                *entry -= factor * other;
            }
        }
        let inverse = 1.0 / (factor[i * n + i] * scale[i]);
        for entry in &mut row[i..] {
            let unscaled = *entry * inverse;
            square += unscaled * unscaled;
            *entry = unscaled * scale[i];
        }
    }
    if square.is_finite() {
        1.0 / (square * n as f64).sqrt()
    } else {
        0.0
    }
}

/// H^-1 (sum psi^2 a a^T + priors) H^-1 with H = sum psi' a a^T + priors, in the
/// coordinates of `b`, where the weighted information is the unit matrix.
fn sandwich(
    at: &Arrived,
    measured: &Measured<'_>,
    sigma: &[f64],
    loss: Loss,
    b: &[f64],
) -> Vec<f64> {
    let n = at.x.len();
    let mut residuals = vec![0.0; measured.measurements()];
    let mut rows = vec![0.0; residuals.len() * n];
    let found = measured.linearize(&at.x, &mut residuals, Some(&mut rows));
    if found.is_err() {
        return vec![f64::INFINITY; n * n];
    }
    let mut bread = vec![0.0; n * n];
    let mut filling = vec![0.0; n * n];
    let mut add = |row: &[f64], slope: f64, square: f64| {
        let y: Vec<f64> = (0..n)
            .map(|k| (0..n).map(|i| row[i] * b[i * n + k]).sum())
            .collect();
        for i in 0..n {
            for j in 0..n {
                bread[i * n + j] += slope * y[i] * y[j];
                filling[i * n + j] += square * y[i] * y[j];
            }
        }
    };
    // The mean slope, as in regression: the slope of one residual is 0 or 1 alone.
    let m = residuals.len().max(1) as f64;
    let slope = residuals.iter().map(|&r| loss.slope(r)).sum::<f64>() / m;
    let square = residuals
        .iter()
        .map(|&r| (loss.at(r).1 * r).powi(2))
        .sum::<f64>()
        / m;
    let freedom = m / (m - n as f64).max(1.0);
    for i in 0..residuals.len() {
        add(&rows[i * n..][..n], slope.max(0.05), square * freedom);
    }
    for k in (0..n).filter(|&k| sigma[k].is_finite()) {
        let mut row = vec![0.0; n];
        row[k] = 1.0 / sigma[k];
        add(&row, 1.0, 1.0);
    }
    // bread = L L^T; C = B bread^-1 filling bread^-1 B^T.
    let inverse = inverse_of(&bread, n);
    let product = |a: &[f64], c: &[f64], turned: bool| {
        let mut out = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..n {
                out[i * n + j] = (0..n)
                    .map(|k| a[i * n + k] * if turned { c[j * n + k] } else { c[k * n + j] })
                    .sum();
            }
        }
        out
    };
    let left = product(b, &inverse, false);
    product(&product(&left, &filling, false), &left, true)
}

/// Inverse of a symmetric positive definite matrix, by its Cholesky factor.
fn inverse_of(a: &[f64], n: usize) -> Vec<f64> {
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let sum = (0..j).fold(a[i * n + j], |sum, k| sum - l[i * n + k] * l[j * n + k]);
            l[i * n + j] = if i == j {
                sum.max(f64::MIN_POSITIVE).sqrt()
            } else {
                sum / l[j * n + j]
            };
        }
    }
    let mut out = vec![0.0; n * n];
    for column in 0..n {
        let mut y = vec![0.0; n];
        for i in 0..n {
            let unit = if i == column { 1.0 } else { 0.0 };
            y[i] = (0..i).fold(unit, |sum, k| sum - l[i * n + k] * y[k]) / l[i * n + i];
        }
        for i in (0..n).rev() {
            y[i] = (i + 1..n).fold(y[i], |sum, k| sum - l[k * n + i] * y[k]) / l[i * n + i];
            out[i * n + column] = y[i];
        }
    }
    out
}

/// Where things are in the numbers of one trial of [`estimate`].
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// All states of the scene, n.
    pub states: usize,
}

impl Layout {
    /// Numbers a trial: state (n), covariance (n x n, 0 for known states), null direction
    /// (n), the next best solution (n), then cost, cost of that, chi-square of the
    /// data, samples present, rank, iterations, 1 where the steps came to rest,
    /// [`Scene::vagueness`], and the p of [`Lag1Test`].
    pub const fn size(self) -> usize {
        self.states * (self.states + 3) + 9
    }
}

/// What all trials of [`estimate`] have in common.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// For each state its value where it is known, NaN elsewhere.
    pub known: &'a [f64],
    /// For each state a prior mean.
    pub mean: &'a [f64],
    /// For each state a prior deviation, infinite for none.
    pub sigma: &'a [f64],
    /// Steps, loss, starts.
    pub options: Options,
}

/// What an estimate is worth, worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// The measurements and the prior leave a combination open.
    Unobservable,
    /// The model does not fit.
    Misfit,
    /// The steps did not come to rest.
    NotConverged,
    /// Another solution fits as well.
    Ambiguous,
    /// A position is uncertain by a good part of its distance.
    Weak,
    /// None of these.
    Determined,
}

/// A status, and the test of the fit behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// What the estimate is worth.
    pub status: Status,
    /// Degrees of freedom: measurements that are there and priors, less free states.
    pub dof: f64,
    /// Probability of a larger cost where the model is true; NaN with a robust loss, and
    /// without degrees of freedom.
    pub p_value: f64,
}

impl Status {
    /// All of them, worst first.
    pub const ALL: [Self; 6] = [
        Self::Unobservable,
        Self::Misfit,
        Self::NotConverged,
        Self::Ambiguous,
        Self::Weak,
        Self::Determined,
    ];

    /// The status as it is written.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unobservable => "unobservable",
            Self::Misfit => "misfit",
            Self::NotConverged => "not_converged",
            Self::Ambiguous => "ambiguous",
            Self::Weak => "weak",
            Self::Determined => "determined",
        }
    }
}

impl Verdict {
    /// What decided, in a sentence: from the costs of the solution and of the next best one,
    /// a change that no measurement sees where there is one, and the names of the states.
    pub fn reason<S: AsRef<str>>(
        &self,
        cost: f64,
        other: f64,
        unseen: &[f64],
        names: &[S],
    ) -> String {
        match self.status {
            Status::Unobservable => {
                let size = unseen.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
                let kept: Vec<f64> = unseen
                    .iter()
                    .map(|x| if x.abs() < 1e-9 * size { 0.0 } else { *x })
                    .collect();
                format!("no measurement sees {}", moves(&kept, names))
            }
            Status::Misfit => {
                let fit = Goodness {
                    chi2: cost,
                    dof: self.dof,
                    p_value: self.p_value,
                };
                fit.misfit(1.0).unwrap_or_default()
            }
            Status::NotConverged => String::from("the steps did not come to rest"),
            Status::Ambiguous => format!(
                "another solution fits as well: chi2 is larger by {}",
                brief(other - cost, 2)
            ),
            Status::Weak => String::from(
                "a position of the track is uncertain by a good part of its distance (weak_ratio)",
            ),
            Status::Determined => String::from("one solution fits"),
        }
    }
}

/// Another solution counts as fitting as well where its cost is larger by less than this:
/// noise prefers it in about one trial of 140.
const AS_WELL: f64 = 6.0;

impl Task<'_> {
    /// "weak" above this share of a position's distance, by default.
    pub const WEAK_RATIO: f64 = 0.25;

    /// Judges a trial that [`estimate`] has written: "misfit" where the cost is improbable at
    /// the level `alpha`, "weak" where a position's deviation is more than `weak_ratio` of its
    /// distance.
    pub fn judge(&self, trial: &[f64], alpha: f64, weak_ratio: f64) -> Verdict {
        let mut tail = [f64::NAN; 9];
        if let Some(last) = trial.last_chunk::<9>() {
            tail = *last;
        }
        let [cost, other, _, present, rank, _, converged, vagueness, _] = tail;
        let free = self.known.iter().filter(|x| x.is_nan()).count() as f64;
        let information = self.sigma.iter().filter(|s| s.is_finite()).count() as f64;
        let dof = present + information - free;
        let tested = matches!(self.options.loss, Loss::Squares) && dof > 0.0 && cost.is_finite();
        let mut fit = Goodness::new(cost, dof);
        if !tested {
            fit.p_value = f64::NAN;
        }
        let status = if rank < free {
            Status::Unobservable
        } else if fit.is_misfit(alpha) {
            Status::Misfit
        } else if converged < 1.0 {
            Status::NotConverged
        } else if other - cost < AS_WELL {
            Status::Ambiguous
        } else if vagueness > weak_ratio {
            Status::Weak
        } else {
            Status::Determined
        };
        Verdict {
            status,
            dof,
            p_value: fit.p_value,
        }
    }
}

/// Trials that are followed together.
const GROUP: usize = 256;

/// Nanoseconds for a trial, roughly.
pub fn cost(scene: &Scene, starts: usize) -> f64 {
    let (m, n) = (scene.measurements() as f64, scene.states() as f64);
    2000.0 + starts as f64 * (200.0 + 10.0 * m * (8.0 + n + 0.3 * n * n))
}

/// Estimates of (trials, measurements); NaN is a missing sample. `starts` are states to
/// begin from, several behind each other; found by [`Scene::starts`] where there are none.
///
/// # Errors
/// [`InSensor`] for arrays that do not fit.
pub fn estimate(
    task: Task<'_>,
    measurements: Items<'_>,
    starts: Option<Items<'_>>,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), InSensor> {
    let n = task.scene.states();
    let size = Layout { states: n }.size();
    let work = cost(task.scene, task.options.polish);
    threads.over_groups(out, size, GROUP, work, |first, out| {
        let starts = starts.map(|s| s.skip(first));
        group(task, measurements.skip(first), starts, out)
    })
}

/// A few trials, side by side.
fn group(
    task: Task<'_>,
    measurements: Items<'_>,
    starts: Option<Items<'_>>,
    out: &mut [f64],
) -> Result<(), InSensor> {
    let (scene, options) = (task.scene, task.options);
    let n = scene.states();
    let size = Layout { states: n }.size();
    let count = out.len() / size;
    for trial in 0..count {
        crate::scalar::check_length(
            "measurements",
            measurements.get(trial).len(),
            scene.measurements,
        )
        .map_err(|error| InSensor {
            sensor: usize::MAX,
            error: error.into(),
        })?;
    }
    let mut trials = Trials::new(scene, measurements, task.known, task.mean, task.sigma);
    let free = trials.free().to_vec();
    let pick = |all: &[f64]| free.iter().map(|&k| all[k]).collect::<Vec<f64>>();
    let sigma = pick(task.sigma);
    // Each trial's starts, the best first.
    let mut candidates: Vec<Vec<Vec<f64>>> = (0..count)
        .map(|trial| match starts {
            Some(given) => given.get(trial).chunks_exact(n).map(pick).collect(),
            None => scene
                .starts(measurements.get(trial), task.mean, task.sigma, task.known)
                .iter()
                .map(|x| pick(x))
                .collect(),
        })
        .collect();
    let how = crate::solve::Options {
        max_iterations: options.max_iterations,
        loss: options.loss,
        ..crate::solve::Options::default()
    };
    if matches!(options.loss, Loss::Tukey(_)) {
        lead(&mut trials, &mut candidates, how, options.polish, scene);
    }
    rank(&mut trials, &mut candidates, how, options.polish, scene);
    let mut found: Vec<Vec<Arrived>> = vec![Vec::new(); count];
    // Which of the starts of each trial are followed.
    let mut follow = |some: &[core::ops::Range<usize>], found: &mut [Vec<Arrived>]| {
        let mut jobs: Vec<(usize, &[f64])> = Vec::new();
        for (trial, (starts, some)) in candidates.iter().zip(some).enumerate() {
            let part = some.start.min(starts.len())..some.end.min(starts.len());
            jobs.extend(starts[part].iter().map(|x| (trial, &x[..])));
        }
        let arrived = minimize_all(&mut trials, &jobs, how, scene.path);
        for (arrived, (trial, _)) in arrived.into_iter().zip(&jobs) {
            if arrived.chi2.is_finite() {
                found[*trial].push(arrived);
            }
        }
    };
    let polish = options.polish.max(1);
    follow(&vec![0..polish; count], &mut found);
    if starts.is_none() {
        // Where none of the best starts fits, others are followed too.
        let more: Vec<_> = (0..count)
            .map(|trial| {
                let z = measurements.get(trial);
                let present = z.iter().filter(|z| !z.is_nan()).count();
                let dof = present.saturating_sub(free.len()) as f64;
                let plausible = dof + 6.0 * (2.0 * dof).sqrt() + 20.0;
                let fits = |s: &Arrived| s.converged && s.chi2 < plausible;
                if found[trial].iter().any(fits) {
                    0..0
                } else {
                    polish..polish + 12
                }
            })
            .collect();
        follow(&more, &mut found);
    }
    let known: Vec<Option<f64>> = task
        .known
        .iter()
        .map(|x| (!x.is_nan()).then_some(*x))
        .collect();
    let test = Lag1Test::new(match options.loss {
        Loss::Squares => options.correlation,
        _ => 0.0,
    });
    for (trial, (found, out)) in found.iter_mut().zip(out.chunks_exact_mut(size)).enumerate() {
        found.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        let measured = Measured::new(scene, measurements.get(trial), &known)?;
        let starts = &candidates[trial];
        let starts = &starts[..starts.len().min(polish)];
        let mean = pick(task.mean);
        let observable = settle(&measured, &mean, &sigma, how, starts, found);
        let observable = || {
            let first = starts.first();
            observable || first.is_some_and(|x| has_rank_at(x, &measured, &mean, &sigma, options))
        };
        let best = found.first();
        let lag = best.map_or(1.0, |best| correlated(test, &measured, &mean, &sigma, best));
        let near = |k: usize| anchor(task.mean, task.sigma, k);
        write(
            &measured, &near, &sigma, options, &free, found, observable, lag, out,
        );
    }
    Ok(())
}

/// Puts before the starts of each trial where Huber's loss leads from the best of them: Tukey's
/// has minima where most measurements count nothing.
fn lead(
    trials: &mut Trials<'_>,
    candidates: &mut [Vec<Vec<f64>>],
    how: crate::solve::Options,
    polish: usize,
    scene: &Scene,
) {
    let how = crate::solve::Options {
        loss: Loss::Huber(1.345),
        ..how
    };
    rank(trials, candidates, how, polish, scene);
    let jobs: Vec<(usize, &[f64])> = candidates
        .iter()
        .enumerate()
        .flat_map(|(trial, starts)| starts.iter().take(polish).map(move |x| (trial, &x[..])))
        .collect();
    let arrived = minimize_all(trials, &jobs, how, scene.path);
    let mut best: Vec<Option<Arrived>> = vec![None; candidates.len()];
    for (arrived, &(trial, _)) in arrived.into_iter().zip(&jobs) {
        if arrived.chi2 < best[trial].as_ref().map_or(f64::INFINITY, |b| b.chi2) {
            best[trial] = Some(arrived);
        }
    }
    for (starts, best) in candidates.iter_mut().zip(best) {
        starts.splice(0..0, best.map(|b| b.x));
    }
}

/// Puts the starts of each trial in the order of their losses, where there are more of
/// them than are followed; those without a value go.
fn rank(
    trials: &mut Trials<'_>,
    candidates: &mut [Vec<Vec<f64>>],
    how: crate::solve::Options,
    polish: usize,
    scene: &Scene,
) {
    let jobs: Vec<(usize, &[f64])> = candidates
        .iter()
        .enumerate()
        .filter(|(_, starts)| starts.len() > polish)
        .flat_map(|(trial, starts)| starts.iter().map(move |x| (trial, &x[..])))
        .collect();
    let mut found = losses(trials, &jobs, how, scene.path).into_iter();
    for starts in candidates.iter_mut().filter(|s| s.len() > polish) {
        let mut ranked: Vec<(f64, Vec<f64>)> = found
            .by_ref()
            .take(starts.len())
            .zip(core::mem::take(starts))
            .filter(|(loss, _)| loss.is_finite())
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        *starts = ranked.into_iter().map(|(_, x)| x).collect();
    }
}

/// Puts a solution to the front whose steps came to rest, where the best one's did not and
/// this one fits as well; where there is none, the most likely state within reach of the
/// starts: the best one ran away. Whether the rows have full rank at a start though they
/// may have lost it where the steps ended.
fn settle(
    measured: &Measured<'_>,
    mean: &[f64],
    sigma: &[f64],
    how: crate::solve::Options,
    starts: &[Vec<f64>],
    found: &mut Vec<Arrived>,
) -> bool {
    let Some(best) = found.first().filter(|best| !best.converged) else {
        return false;
    };
    let limit = best.chi2 + AS_WELL;
    if let Some(at) = found.iter().position(|s| s.converged && s.chi2 < limit) {
        found.swap(0, at);
        return false;
    }
    if how.loss != Loss::Squares {
        return false;
    }
    let n = best.x.len();
    let identity = identity(n);
    let model = WithPrior::new(measured, &identity, mean, sigma);
    let ran = crate::solve::Solution {
        x: best.x.clone(),
        chi2: best.chi2,
        iterations: best.iterations,
        converged: false,
        held: true,
        determined: false,
        slopes: Vec::new(),
    };
    let how = crate::solve::Options {
        max_iterations: how.max_iterations.max(200),
        ..how
    };
    let Some(within) = within_reach(&model, &ran, starts, how) else {
        return false;
    };
    if !(within.unbounded || within.solution.converged) {
        return true;
    }
    let Some(kept) = arrive(&model, measured.measurements(), &within.solution.x) else {
        return true;
    };
    let kept = Arrived {
        chi2: within.solution.chi2,
        iterations: best.iterations + within.solution.iterations,
        ..kept
    };
    found.insert(0, kept);
    true
}

/// The p of the test of neighbouring residuals where they are correlated, and 1 elsewhere.
fn correlated(
    test: Lag1Test,
    measured: &Measured<'_>,
    mean: &[f64],
    sigma: &[f64],
    best: &Arrived,
) -> f64 {
    if !test.is_made() {
        return 1.0;
    }
    let mut residuals = vec![0.0; measured.measurements()];
    if measured.linearize(&best.x, &mut residuals, None).is_err() {
        return 1.0;
    }
    let n = best.x.len();
    let model = WithPrior::new(measured, &identity(n), mean, sigma);
    if !test.leaves_open(&residuals, n, model.priors(), model.channels()) {
        return 1.0;
    }
    Fit::new(&model, &best.x).map_or(1.0, |fit| fit.lag1().p_value)
}

/// The unit matrix, row-major.
fn identity(n: usize) -> Vec<f64> {
    let mut identity = vec![0.0; n * n];
    identity.iter_mut().step_by(n + 1).for_each(|x| *x = 1.0);
    identity
}

/// A state as if steps had ended there; `None` where the model has no value.
fn arrive(model: &impl Model, measured: usize, x: &[f64]) -> Option<Arrived> {
    let (m, n) = (model.measurements(), x.len());
    let mut residuals = vec![0.0; m];
    let mut factor = vec![0.0; m.max(n) * n];
    model
        .linearize(x, &mut residuals, Some(&mut factor[..m * n]))
        .ok()?;
    triangularize(&mut factor, n, &mut vec![0.0; n]);
    factor.truncate(n * n);
    let squares = |part: &[f64]| part.iter().map(|r| r * r).sum();
    Some(Arrived {
        x: x.to_vec(),
        chi2: squares(&residuals),
        data: squares(&residuals[..measured]),
        iterations: 0,
        converged: true,
        factor,
    })
}

/// Whether the rows have full rank at a start: a fit that ends at infinity, or on a carrier,
/// has lost rank that the problem has.
fn has_rank_at(
    start: &[f64],
    measured: &Measured<'_>,
    mean: &[f64],
    sigma: &[f64],
    options: Options,
) -> bool {
    let identity = identity(start.len());
    let model = WithPrior::new(measured, &identity, mean, sigma);
    arrive(&model, measured.measurements(), start)
        .is_some_and(|there| spread(&there, measured, sigma, options).rank == start.len())
}

/// The best solution, what the rows say there, and the next best, as [`Layout`] has them.
#[allow(clippy::too_many_arguments)]
fn write(
    measured: &Measured<'_>,
    near: &dyn Fn(usize) -> f64,
    sigma: &[f64],
    options: Options,
    free: &[usize],
    found: &[Arrived],
    observable: impl FnOnce() -> bool,
    lag: f64,
    out: &mut [f64],
) {
    let scene = &*measured.scene;
    let n = scene.states();
    let (state, rest) = out.split_at_mut(n);
    let (covariance, rest) = rest.split_at_mut(n * n);
    let (null, rest) = rest.split_at_mut(n);
    let (other, tail) = rest.split_at_mut(n);
    let Some(best) = found.first() else {
        state.fill(f64::NAN);
        covariance.fill(f64::INFINITY);
        null.fill(0.0);
        other.fill(f64::NAN);
        let present = measured.measurements() as f64;
        tail.copy_from_slice(&[
            f64::INFINITY,
            f64::INFINITY,
            f64::INFINITY,
            present,
            // No start has a value: nothing is said of the rank.
            free.len() as f64,
            0.0,
            0.0,
            f64::INFINITY,
            1.0,
        ]);
        return;
    };
    let spread = spread(best, measured, sigma, options);
    let whole = |x: &[f64]| {
        let mut x = measured.full(x);
        scene.normalize(&mut x, near);
        x
    };
    let here = whole(&best.x);
    state.copy_from_slice(&here);
    covariance.fill(0.0);
    null.fill(0.0);
    for (i, &a) in free.iter().enumerate() {
        null[a] = spread.null[i];
        for (j, &b) in free.iter().enumerate() {
            covariance[a * n + b] = spread.covariance[i * free.len() + j];
        }
    }
    // The next best solution that is another one: off by several deviations.
    let mut next = None;
    if spread.rank == free.len() {
        next = found.iter().skip(1).find(|s| {
            let there = whole(&s.x);
            s.converged
                && free.iter().enumerate().any(|(i, &k)| {
                    let std = spread.covariance[i * free.len() + i].sqrt();
                    (there[k] - here[k]).abs() > std
                })
        });
    }
    match next {
        Some(next) => other.copy_from_slice(&whole(&next.x)),
        None => other.fill(f64::NAN),
    }
    tail.copy_from_slice(&[
        best.chi2,
        next.map_or(f64::INFINITY, |s| s.chi2),
        best.data,
        measured.measurements() as f64,
        // The rank of the problem, not that of a place at infinity.
        if spread.rank == free.len() || observable() {
            free.len()
        } else {
            spread.rank
        } as f64,
        f64::from(best.iterations),
        f64::from(u8::from(best.converged)),
        scene.vagueness(state, covariance),
        lag,
    ]);
}
