//! Maximum-likelihood estimates of a moving target from bearings, trial by trial.
//!
//! The target moves as a polynomial in time of order 0 to 3; its state is the
//! position at the first time and the derivatives (x0, y0, vx, vy, ax, ay, jx,
//! jy), n = 2 (order + 1) numbers.
//!
//! # Algorithm
//! Gauss-Newton with Levenberg's damping where a step fails, not on the state but
//! on (direction, derivatives over the range, 1 / range) at the first time: all
//! but the last are well determined by any bearings, and the bearings are nearly
//! linear in the last, through infinity and beyond. With u the unit vector to the
//! target, w its derivatives over the range, s the reciprocal range and d the
//! observer's displacement since the first bearing, the target is seen along
//!
//! ```text
//! p = u + T w1 + T^2/2 w2 + .. - s d.
//! ```
//!
//! The start is the pseudo-linear solution of Li & Sheng 2009, eq. 3, freed from
//! its bias: cross(b, p) = 0 is homogeneous in h = (u, w, s), and noise adds to
//! its squares sum (p . b)^2 on average, so the generalised eigenvector of the
//! two sums is consistent where the least-squares solution is not. Where that
//! fails, a ladder of ranges is tried. Every step reduces rows orthogonally.

mod algebra;
mod fit;
mod kernels;
mod solver;

use alloc::vec;

use crate::batch::simd::Path;
use crate::batch::{Items, Stream, Threads};
use crate::bearings;
use crate::bearings::measured::Measured;
use crate::solve::WithPrior;
use crate::solve::fit::{Fit, Lag1Test};
use solver::{Solver, state_of};

/// What is known of each trial besides the bearings.
#[derive(Clone, Copy, Debug)]
pub struct Track<'a> {
    /// m times, not decreasing, s.
    pub times: Items<'a>,
    /// m observer positions (east, north), m.
    pub observer: Items<'a>,
    /// Standard deviation of all bearings or of each, rad.
    pub sigma: Items<'a>,
    /// What is known of the states beforehand.
    pub prior: Option<Prior<'a>>,
}

/// Independent normal knowledge of each state; an infinite deviation for none.
#[derive(Clone, Copy, Debug)]
pub struct Prior<'a> {
    /// n means.
    pub mean: Items<'a>,
    /// n standard deviations.
    pub sigma: Items<'a>,
}

/// How to estimate and to judge.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Relative rank tolerance on rows with unit columns; by default that of
    /// [`default_rtol`](crate::spectrum::default_rtol) and of the coordinates given.
    pub rtol: Option<f64>,
    /// Gauss-Newton steps at most, from each start.
    pub max_iterations: u32,
    /// [`Status::Weak`] where the deviation of the first range exceeds this many
    /// times the range.
    pub weak_ratio: f64,
    /// Level at which neighbouring residuals are tested for correlation; 0 for no test.
    pub correlation: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rtol: None,
            max_iterations: 50,
            weak_ratio: 0.25,
            correlation: 0.0,
        }
    }
}

/// What became of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The most likely state, with a covariance that means something.
    Converged,
    /// The most likely state; but its range is hardly known, so that the
    /// covariance is only a hint.
    Weak,
    /// Some combination of states leaves every bearing as it is.
    Unobservable,
    /// The likelihood grows towards infinite range: no state is the most likely.
    Unbounded,
    /// The steps ran out.
    NotConverged,
}

impl Status {
    /// The number that stands for it in a result.
    pub fn code(self) -> f64 {
        f64::from(self as u8)
    }
}

/// Where things are in the `size` numbers of a result of [`localize`].
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// Number of states.
    pub states: usize,
}

impl Layout {
    /// Numbers a trial: estimate (n), null direction (n), covariance (n x n),
    /// then status, nullity, iterations, the squares of all whitened
    /// residuals, those of the prior included, and the p of [`Lag1Test`].
    pub const fn size(self) -> usize {
        2 * self.states + self.states * self.states + 5
    }

    /// Numbers a trial of [`simulate_and_localize`]: error (n), deviations (n),
    /// then the squared error over the covariance, the squares of the residuals
    /// as above, status, iterations.
    pub const fn trial_size(self) -> usize {
        2 * self.states + 4
    }
}

/// Estimates of (trials, m) `bearings`; `out` holds [`Layout::size`] numbers for
/// each trial. The estimate is NaN where none exists, and the covariance
/// infinite; the null direction is zero where there is none.
///
/// `states` is 2, 4, 6 or 8; with another number nothing is written.
pub fn localize(
    track: &Track<'_>,
    bearings: Items<'_>,
    states: usize,
    options: Options,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) {
    match states {
        2 => each_trial::<2>(track, bearings, options, threads, path, out),
        4 => each_trial::<4>(track, bearings, options, threads, path, out),
        6 => each_trial::<6>(track, bearings, options, threads, path, out),
        8 => each_trial::<8>(track, bearings, options, threads, path, out),
        _ => {}
    }
}

/// Nanoseconds for a trial, roughly.
pub fn cost(count: usize, states: usize) -> f64 {
    (500 * states + 5 * count * states) as f64
}

fn each_trial<const N: usize>(
    track: &Track<'_>,
    bearings: Items<'_>,
    options: Options,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) {
    let count = track.times.get(0).len();
    let test = Lag1Test::new(options.correlation);
    let each = |solver: &mut Solver<N>, trial: usize, out: &mut [f64]| {
        solver.load(track, trial);
        solver.bearings(bearings.get(trial));
        let fit = solver.solve();
        fit.write(solver, out);
        if let Some((lag, out)) = out.split_last_mut() {
            *lag = 1.0;
            // Without an estimate there are no residuals.
            if test.is_made() && out[0].is_finite() {
                let residuals = solver.residuals(&fit.model);
                *lag = correlated(test, track, bearings, trial, &out[..N], residuals);
            }
        }
        Ok(())
    };
    let size = Layout { states: N }.size();
    let scratch = || Solver::<N>::new(count, options, path);
    let Ok::<(), core::convert::Infallible>(()) =
        threads.over_with(out, size, cost(count, N), scratch, each);
}

/// The p of the test of a trial's neighbouring residuals where they are correlated, and 1
/// elsewhere.
fn correlated(
    test: Lag1Test,
    track: &Track<'_>,
    bearings: Items<'_>,
    trial: usize,
    state: &[f64],
    residuals: &[f64],
) -> f64 {
    let n = state.len();
    let prior = track
        .prior
        .map(|prior| (prior.mean.get(trial), prior.sigma.get(trial)));
    let priors = prior.map_or(0, |(_, s)| s.iter().filter(|s| s.is_finite()).count());
    if !test.leaves_open(residuals, n, priors, 1) {
        return 1.0;
    }
    let times = track.times.get(trial);
    let measured = Measured {
        times: times.iter().map(|t| t - times[0]).collect(),
        observer: track.observer.get(trial).as_chunks::<2>().0.to_vec(),
        bearings: bearings.get(trial).to_vec(),
        sigma: track.sigma.get(trial).to_vec(),
        states: n,
    };
    let mut identity = vec![0.0; n * n];
    identity.iter_mut().step_by(n + 1).for_each(|x| *x = 1.0);
    let (mean, sigma) = prior.unwrap_or_default();
    let model = WithPrior::new(measured, &identity, mean, sigma);
    Fit::new(&model, state).map_or(1.0, |fit| fit.lag1().p_value)
}

/// Simulates and estimates trials in one pass: a Monte Carlo of the estimator.
///
/// Trial i takes its noise from the stream (`seed`, `first` + i) alone, so it is
/// the same in whatever pieces and on however many threads a run is made. `truth`
/// holds the n states. `out` holds [`Layout::trial_size`] numbers for each trial.
///
/// # Errors
/// [`bearings::Error::OnTarget`] with the trial.
#[allow(clippy::too_many_arguments)]
pub fn simulate_and_localize(
    track: &Track<'_>,
    truth: Items<'_>,
    seed: u64,
    first: u64,
    options: Options,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    let run = match truth.get(0).len() {
        2 => each_simulated::<2>,
        4 => each_simulated::<4>,
        6 => each_simulated::<6>,
        8 => each_simulated::<8>,
        _ => return Ok(()),
    };
    run(track, truth, seed, first, options, threads, path, out)
}

#[allow(clippy::too_many_arguments)]
fn each_simulated<const N: usize>(
    track: &Track<'_>,
    truth: Items<'_>,
    seed: u64,
    first: u64,
    options: Options,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    let count = track.times.get(0).len();
    let each = |solver: &mut Solver<N>, trial: usize, out: &mut [f64]| {
        solver.load(track, trial);
        let truth = state_of(truth.get(trial));
        let mut stream = Stream::new(seed, first + trial as u64);
        solver
            .simulate(&truth, track.sigma.get(trial), &mut stream)
            .map_err(|error| (trial, error))?;
        solver.solve().write_error(solver, &truth, out);
        Ok(())
    };
    let size = Layout { states: N }.trial_size();
    let scratch = || Solver::<N>::new(count, options, path);
    let cost = cost(count, N) + 15.0 * count as f64;
    threads.over_with(out, size, cost, scratch, each)
}
