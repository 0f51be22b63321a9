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
//!     p = u + T w1 + T^2/2 w2 + .. - s d.
//!
//! The start is the pseudo-linear solution of Li & Sheng 2009, eq. 3, freed from
//! its bias: cross(b_i, p) = 0 is homogeneous in h = (u, w, s), and noise adds to
//! its squares sum (dp . b_i)^2 on average, so the generalised eigenvector of the
//! two sums is consistent where the least-squares solution is not. Where that
//! fails, a ladder of ranges is tried. Every step reduces rows orthogonally.

mod kernels;

use alloc::vec;
use alloc::vec::Vec;

use super::lanes::{Block, LANES};
use super::simd::Path;
use super::{Items, Stream, Threads};
use crate::bearings;
use crate::scalar::hypot;
use crate::spectrum;
use crate::square_root::rotate_in;
use kernels::{
    Directions, Exact, Field, Linearize, MAX, PseudoLinear, Samples, Triangularize, Turn,
};

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
    /// [`default_rtol`](spectrum::default_rtol) and of the coordinates given.
    pub rtol: Option<f64>,
    /// Gauss-Newton steps at most, from each start.
    pub max_iterations: u32,
    /// [`Status::Weak`] where the deviation of the first range exceeds this many
    /// times the range.
    pub weak_ratio: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rtol: None,
            max_iterations: 50,
            weak_ratio: 0.5,
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
    /// then status, nullity, iterations, and the squares of all whitened
    /// residuals, those of the prior included.
    pub const fn size(self) -> usize {
        2 * self.states + self.states * self.states + 4
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
    let each = |solver: &mut Solver<N>, trial: usize, out: &mut [f64]| {
        solver.load(track, trial);
        solver.bearings(bearings.get(trial));
        solver.solve().write(solver, out);
        Ok(())
    };
    let size = Layout { states: N }.size();
    let scratch = || Solver::<N>::new(count, options, path);
    let Ok::<(), core::convert::Infallible>(()) =
        threads.over_with(out, size, cost(count, N), scratch, each);
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

fn state_of<const N: usize>(given: &[f64]) -> [f64; N] {
    let mut state = [0.0; N];
    state.copy_from_slice(&given[..N]);
    state
}

/// One trial after the other, in its own memory.
struct Solver<const N: usize> {
    options: Options,
    path: Path,
    count: usize,
    samples: Samples,
    columns: Vec<Block>,
    noise: Vec<Block>,
    loaded: bool,
    origin: [f64; 2],
    /// Metres to a unit of observer displacement, and for each derivative on.
    units: [f64; 4],
    rtol: f64,
    /// Squares below this are rounding of the bearings.
    floor: f64,
    prior: Option<([f64; N], [f64; N])>,
    /// See [`Linearize`]; of the model that was linearised last.
    bending: [[f64; N]; N],
}

/// Where the steps ended.
#[derive(Clone, Copy)]
struct Fit<const N: usize> {
    /// (u, w1, w2, .., s).
    model: [f64; MAX],
    /// Triangular factor of the information on (direction, w.., s).
    root: [[f64; N]; N],
    chi2: f64,
    cost: f64,
    iterations: u32,
    converged: bool,
}

impl<const N: usize> Solver<N> {
    fn new(count: usize, options: Options, path: Path) -> Self {
        let samples = Samples::new(count);
        let blocks = samples.blocks;
        Self {
            options,
            path,
            count,
            samples,
            columns: vec![[0.0; LANES]; (N + 1) * blocks],
            noise: vec![[0.0; LANES]; blocks],
            loaded: false,
            origin: [0.0; 2],
            units: [1.0; 4],
            rtol: 0.0,
            floor: 0.0,
            prior: None,
            bending: [[0.0; N]; N],
        }
    }

    /// Takes in times, observer, noise and prior of a trial.
    fn load(&mut self, track: &Track<'_>, trial: usize) {
        self.prior = track.prior.map(|prior| {
            (
                state_of(prior.mean.get(trial)),
                state_of(prior.sigma.get(trial)),
            )
        });
        let shared = [track.times, track.observer, track.sigma]
            .iter()
            .all(|item| item.step == 0);
        if shared && self.loaded {
            return;
        }
        self.loaded = true;
        let times = track.times.get(trial);
        let (observer, _) = track.observer.get(trial).as_chunks::<2>();
        let sigma = track.sigma.get(trial);
        let origin = observer[0];
        let (mut length, mut largest) = (0.0_f64, 0.0_f64);
        for place in observer {
            length = length.max(hypot(place[0] - origin[0], place[1] - origin[1]));
            largest = largest.max(place[0].abs()).max(place[1].abs());
        }
        let span = times[self.count - 1] - times[0];
        let known = if length > 0.0 {
            8.0 * f64::EPSILON * largest / length
        } else {
            0.0
        };
        self.rtol = self
            .options
            .rtol
            .unwrap_or_else(|| spectrum::default_rtol::<f64>(self.count, N).max(known));
        let length = if length > 0.0 { length } else { 1.0 };
        let span = if span > 0.0 { span } else { 1.0 };
        self.origin = origin;
        self.units = [
            length,
            length / span,
            length / span / span,
            length / span / span / span,
        ];
        // Behind the last sample the last again, with no weight.
        let last = self.count - 1;
        let fill = |values: &mut [f64], of: &dyn Fn(usize) -> f64| {
            for (i, value) in values.iter_mut().enumerate() {
                *value = of(i.min(last));
            }
        };
        fill(self.samples.field_mut(Field::Time), &|i| {
            (times[i] - times[0]) / span
        });
        fill(self.samples.field_mut(Field::East), &|i| {
            (observer[i][0] - origin[0]) / length
        });
        fill(self.samples.field_mut(Field::North), &|i| {
            (observer[i][1] - origin[1]) / length
        });
        let weights = self.samples.field_mut(Field::Weight);
        fill(weights, &|i| {
            1.0 / sigma[if sigma.len() == 1 { 0 } else { i }]
        });
        weights[self.count..].fill(0.0);
        let heaviest = weights.iter().fold(0.0_f64, |a, &b| a.max(b));
        let rounding = 8.0 * f64::EPSILON * heaviest;
        self.floor = rounding * rounding * N as f64;
    }

    fn bearings(&mut self, bearings: &[f64]) {
        let last = self.count - 1;
        for (i, value) in self.samples.field_mut(Field::Sine).iter_mut().enumerate() {
            let angle = bearings[i.min(last)];
            // Far from zero whole turns are taken off first.
            *value = if angle.abs() < 1e5 {
                angle
            } else {
                angle % core::f64::consts::TAU
            };
        }
        self.path.run(Directions(&mut self.samples));
    }

    fn simulate(
        &mut self,
        truth: &[f64; N],
        sigma: &[f64],
        stream: &mut Stream,
    ) -> Result<(), bearings::Error> {
        let Some(model) = self.model_of(truth) else {
            return Err(bearings::Error::OnTarget { index: 0 });
        };
        self.path.run(Exact::<N>(&mut self.samples, &model));
        if let Some(index) = self.samples.field_mut(Field::Sine)[..self.count]
            .iter()
            .position(|x| x.is_nan())
        {
            return Err(bearings::Error::OnTarget { index });
        }
        for (i, noise) in self.noise.as_flattened_mut()[..self.count]
            .iter_mut()
            .enumerate()
        {
            *noise = sigma[if sigma.len() == 1 { 0 } else { i }] * stream.normal();
        }
        self.path.run(Turn(&mut self.samples, &self.noise));
        Ok(())
    }

    /// The model of a state; `None` where it is on the first observer position.
    fn model_of(&self, state: &[f64; N]) -> Option<[f64; MAX]> {
        let (east, north) = (state[0] - self.origin[0], state[1] - self.origin[1]);
        let range = hypot(east, north);
        if !(range > 0.0) {
            return None;
        }
        let mut model = [0.0; MAX];
        (model[0], model[1]) = (east / range, north / range);
        let s = self.units[0] / range;
        for i in 2..N {
            model[i] = state[i] * s / self.units[i / 2];
        }
        model[N] = s;
        Some(model)
    }

    /// The state of a model with s > 0.
    fn state(&self, h: &[f64; MAX]) -> [f64; N] {
        core::array::from_fn(|i| {
            let value = self.units[i / 2] * h[i] / h[N];
            if i < 2 { value + self.origin[i] } else { value }
        })
    }

    /// How a change of (direction, w.., s) moves each state, times s^2: finite
    /// at infinite range too.
    fn move_states(&self, h: &[f64; MAX], change: &[f64; N]) -> [f64; N] {
        let s = h[N];
        let (turn, ds) = (change[0], change[N - 1]);
        core::array::from_fn(|i| {
            let along = match i {
                0 => h[1] * turn,
                1 => -h[0] * turn,
                _ => change[i - 1],
            };
            self.units[i / 2] * (s * along - h[i] * ds)
        })
    }

    /// The change of (direction, w.., s) that moves the states by `moved`.
    fn change_of(&self, h: &[f64; MAX], moved: &[f64; N]) -> [f64; N] {
        let s = h[N];
        let (east, north) = (moved[0] / self.units[0], moved[1] / self.units[0]);
        let ds = -s * s * (h[0] * east + h[1] * north);
        let mut change = [0.0; N];
        change[0] = s * (h[1] * east - h[0] * north);
        for i in 2..N {
            change[i - 1] = s * moved[i] / self.units[i / 2] + h[i] * ds / s;
        }
        change[N - 1] = ds;
        change
    }

    /// Rows and residuals at a model into the columns: chi-square, and the cost
    /// with the prior.
    fn linearize(&mut self, model: &[f64; MAX]) -> (f64, f64) {
        let (chi2, bending) = self.path.run(Linearize::<N> {
            samples: &self.samples,
            model,
            columns: &mut self.columns,
        });
        self.bending = bending;
        let Some((mean, sigma)) = &self.prior else {
            return (chi2, chi2);
        };
        if !(model[N] > 0.0) {
            return (chi2, f64::INFINITY);
        }
        let state = self.state(model);
        let cost = (0..N).fold(chi2, |sum, i| {
            let residual = (mean[i] - state[i]) / sigma[i];
            sum + residual * residual
        });
        (chi2, cost)
    }

    /// Reduces the columns, and the prior at `model`, to a factor and the
    /// residual's part along it.
    fn reduce(&mut self, model: &[f64; MAX]) -> ([[f64; N]; N], [f64; N]) {
        let mut factor = [[0.0; MAX]; MAX];
        self.triangularize(self.rtol, &mut factor);
        if let Some((mean, sigma)) = &self.prior {
            let mut flat = flatten::<N>(&factor);
            let state = self.state(model);
            let per_square = 1.0 / (model[N] * model[N]);
            // Columns of the Jacobian, one for each parameter.
            let columns: [[f64; N]; N] = core::array::from_fn(|j| {
                let mut unit = [0.0; N];
                unit[j] = per_square;
                self.move_states(model, &unit)
            });
            for i in (0..N).filter(|&i| sigma[i].is_finite()) {
                let mut row = [0.0; MAX];
                for j in 0..N {
                    row[j] = columns[j][i] / sigma[i];
                }
                row[N] = (mean[i] - state[i]) / sigma[i];
                rotate_in(&mut flat[..(N + 1) * (N + 1)], &mut row[..=N]);
            }
            split::<N>(&flat)
        } else {
            (
                core::array::from_fn(|i| core::array::from_fn(|j| factor[i][j])),
                core::array::from_fn(|i| factor[i][N]),
            )
        }
    }

    fn triangularize(&mut self, rtol: f64, factor: &mut [[f64; MAX]; MAX]) {
        self.path.run(Triangularize {
            blocks: self.samples.blocks,
            count: N + 1,
            rtol,
            columns: &mut self.columns,
            factor,
        });
    }

    /// The estimate from the best start.
    fn solve(&mut self) -> Fit<N> {
        let (factor, start) = self.pseudo_linear();
        let mut starts = [
            start,
            self.prior.and_then(|(mean, sigma)| {
                let known = sigma[0].is_finite() && sigma[1].is_finite();
                let state =
                    core::array::from_fn(|i| if sigma[i].is_finite() { mean[i] } else { 0.0 });
                if known { self.model_of(&state) } else { None }
            }),
        ]
        .map(|model| model.map(|model| (self.linearize(&model).1, model)));
        starts.sort_by(|a, b| order(a.map(|a| a.0), b.map(|b| b.0)));
        let mut best: Option<Fit<N>> = None;
        if let Some((_, model)) = starts[0].filter(|start| start.0.is_finite()) {
            let fit = self.descend(model);
            let freedom = self.count.saturating_sub(N) as f64;
            let plausible = fit.chi2 < freedom + 6.0 * (2.0 * freedom).sqrt() + 20.0;
            if fit.converged && plausible && fit.model[N] > 0.0 {
                return fit;
            }
            best = Some(fit);
        }
        let model = self.ladder(&factor);
        let second = self.descend(model);
        match best {
            Some(best) if !(second.cost < best.cost) && best.converged >= second.converged => best,
            _ => second,
        }
    }

    /// The pseudo-linear factor, and the consistent start where it exists.
    fn pseudo_linear(&mut self) -> ([[f64; MAX]; MAX], Option<[f64; MAX]>) {
        let mut factor = [[0.0; MAX]; MAX];
        let mut noise = [[0.0; MAX]; MAX];
        let Self {
            path,
            samples,
            columns,
            ..
        } = self;
        path.run(PseudoLinear::<N> {
            samples,
            turned: false,
            columns,
        });
        self.triangularize(self.rtol, &mut factor);
        if (0..N).any(|k| factor[k][k] == 0.0) {
            return (factor, None);
        }
        let mut h = [0.0; MAX];
        h[N] = 1.0;
        for i in (0..N).rev() {
            let sum = (i + 1..=N).fold(0.0, |sum, j| sum + factor[i][j] * h[j]);
            h[i] = -sum / factor[i][i];
        }
        if factor[N][N] > 0.0 {
            let Self {
                path,
                samples,
                columns,
                ..
            } = self;
            path.run(PseudoLinear::<N> {
                samples,
                turned: true,
                columns,
            });
            self.triangularize(0.0, &mut noise);
            // Inverse iteration: converges by the ratio of noise to signal.
            for _ in 0..4 {
                h = inverse_step::<N>(&factor, &noise, &h);
            }
        }
        let start = self.oriented(h);
        (factor, start)
    }

    /// The model with |u| = 1 and the target ahead of the bearings.
    fn oriented(&self, h: [f64; MAX]) -> Option<[f64; MAX]> {
        let length = hypot(h[0], h[1]);
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        let ahead = self.ahead(&h);
        let factor = if ahead < 0.0 {
            -1.0 / length
        } else {
            1.0 / length
        };
        let model = h.map(|x| x * factor);
        model.iter().all(|x| x.is_finite()).then_some(model)
    }

    /// Whether the target of h is ahead along the bearings (> 0) or behind.
    fn ahead(&self, h: &[f64; MAX]) -> f64 {
        let field = |field| self.samples.field(field).as_flattened();
        let (sine, cosine) = (field(Field::Sine), field(Field::Cosine));
        let (time, east, north) = (field(Field::Time), field(Field::East), field(Field::North));
        let step = (self.count / 8).max(1);
        (0..self.count).step_by(step).fold(0.0, |sum, i| {
            let (mut x, mut y) = (-h[N] * east[i], -h[N] * north[i]);
            let mut power = 1.0;
            for k in 0..N / 2 {
                x += h[2 * k] * power;
                y += h[2 * k + 1] * power;
                power *= time[i] / (k + 1) as f64;
            }
            sum + (sine[i] * x + cosine[i] * y) / hypot(x, y).max(f64::MIN_POSITIVE)
        })
    }

    /// The best of a ladder of ranges: for each the pseudo-linear solution, from
    /// its factor.
    fn ladder(&mut self, factor: &[[f64; MAX]; MAX]) -> [f64; MAX] {
        let r: [[f64; N]; N] = core::array::from_fn(|i| core::array::from_fn(|j| factor[i][j]));
        let (s, v) = decompose(&r, &[1.0; N]);
        // The direction of relative motion, and what each unit of s adds to it.
        let mut shift = [0.0; N];
        for k in 0..N - 1 {
            if s[k] > self.rtol * s[0] {
                let image: [f64; N] =
                    core::array::from_fn(|i| (0..N).fold(0.0, |sum, j| sum + r[i][j] * v[k][j]));
                let along = (0..N).fold(0.0, |sum, i| sum + image[i] * factor[i][N]);
                for i in 0..N {
                    shift[i] -= v[k][i] * along / (s[k] * s[k]);
                }
            }
        }
        let length = hypot(v[N - 1][0], v[N - 1][1]);
        let mut base = [0.0; MAX];
        for i in 0..N {
            base[i] = if length > 1e-9 {
                v[N - 1][i] / length
            } else {
                0.0
            };
        }
        if !(length > 1e-9) {
            let field = |field| self.samples.field(field).as_flattened()[0];
            (base[0], base[1]) = (field(Field::Sine), field(Field::Cosine));
        }
        if self.ahead(&base) < 0.0 {
            base = base.map(|x| -x);
        }
        let mut best = (f64::INFINITY, base);
        for reciprocal in [3.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 5e-3, 1e-3, 1e-4] {
            let mut h = base;
            for i in 0..N {
                h[i] += reciprocal * shift[i];
            }
            h[N] = reciprocal;
            if let Some(model) = self.oriented(h) {
                let cost = self.linearize(&model).1;
                if model[N] > 0.0 && cost < best.0 {
                    best = (cost, model);
                }
            }
        }
        if best.0 == f64::INFINITY {
            best.1[N] = 1e-3;
        }
        best.1
    }

    /// Newton's steps from a model, and where they fail or do not exist damped
    /// Gauss-Newton steps.
    fn descend(&mut self, start: [f64; MAX]) -> Fit<N> {
        let (chi2, cost) = self.linearize(&start);
        let mut fit = Fit {
            model: start,
            root: [[0.0; N]; N],
            chi2,
            cost,
            iterations: 0,
            converged: false,
        };
        let tolerance = self.floor.max(1e-12);
        let mut damping = 0.0_f64;
        loop {
            let (root, rest) = self.reduce(&fit.model);
            fit.root = root;
            if (0..N).any(|k| root[k][k] == 0.0) {
                damping = damping.max(1e-6);
            }
            let mut newton = newton(&root, &self.bending, &rest);
            let length = newton.unwrap_or(rest);
            let decrease = (0..N).fold(0.0, |sum, i| sum + rest[i] * length[i]);
            if decrease <= tolerance {
                fit.converged = true;
                return fit;
            }
            loop {
                if fit.iterations >= self.options.max_iterations || damping > 1e12 {
                    return fit;
                }
                fit.iterations += 1;
                let quick = newton.is_some();
                let change = match newton.take() {
                    Some(along) => step(&root, &along, 0.0),
                    None => step(&root, &rest, damping),
                };
                let model = stepped(&fit.model, &change);
                let (chi2, cost) = self.linearize(&model);
                if cost <= fit.cost * (1.0 + 1e-13) + tolerance {
                    (fit.model, fit.chi2, fit.cost) = (model, chi2, cost);
                    if quick && decrease < 1e-8 {
                        // Newton's next step would be nothing.
                        fit.root = self.reduce(&model).0;
                        fit.converged = true;
                        return fit;
                    }
                    damping = if damping < 1e-5 { 0.0 } else { damping * 0.1 };
                    break;
                }
                if !quick {
                    damping = (damping * 10.0).max(1e-3);
                }
            }
        }
    }
}

/// Newton's step in units of deviations, (I + R^-T B R^-1) y = rest; `None`
/// where that matrix is not safely positive.
fn newton<const N: usize>(
    root: &[[f64; N]; N],
    bending: &[[f64; N]; N],
    rest: &[f64; N],
) -> Option<[f64; N]> {
    let diagonal: [f64; N] = core::array::from_fn(|k| 1.0 / root[k][k]);
    if diagonal.iter().any(|x| !x.is_finite()) {
        return None;
    }
    // R^-T on the symmetric matrix from the left, then from the right.
    let mut b: [[f64; N]; N] =
        core::array::from_fn(|i| core::array::from_fn(|j| bending[i.min(j)][i.max(j)]));
    for _ in 0..2 {
        for i in 0..N {
            for j in 0..N {
                let sum = (0..i).fold(b[i][j], |sum, k| sum - root[k][i] * b[k][j]);
                b[i][j] = sum * diagonal[i];
            }
        }
        b = core::array::from_fn(|i| core::array::from_fn(|j| b[j][i]));
    }
    // Cholesky.
    let mut y = *rest;
    for i in 0..N {
        for j in 0..=i {
            let unit = if i == j { 1.0 } else { 0.0 };
            let sum = (0..j).fold(unit + b[i][j], |sum, k| sum - b[i][k] * b[j][k]);
            if i == j {
                if !(sum > 0.02) {
                    return None;
                }
                b[i][i] = sum.sqrt();
            } else {
                b[i][j] = sum / b[j][j];
            }
        }
        let sum = (0..i).fold(y[i], |sum, k| sum - b[i][k] * y[k]);
        y[i] = sum / b[i][i];
    }
    for i in (0..N).rev() {
        let sum = (i + 1..N).fold(y[i], |sum, k| sum - b[k][i] * y[k]);
        y[i] = sum / b[i][i];
    }
    Some(y)
}

fn order(a: Option<f64>, b: Option<f64>) -> core::cmp::Ordering {
    let key = |x: Option<f64>| x.filter(|x| !x.is_nan()).unwrap_or(f64::INFINITY);
    key(a).total_cmp(&key(b))
}

/// h' = A^-1 C h, with A and C given by their triangular factors; unit length.
fn inverse_step<const N: usize>(
    a: &[[f64; MAX]; MAX],
    c: &[[f64; MAX]; MAX],
    h: &[f64; MAX],
) -> [f64; MAX] {
    let mut image = [0.0; MAX];
    for i in 0..=N {
        image[i] = (i..=N).fold(0.0, |sum, j| sum + c[i][j] * h[j]);
    }
    let mut y = [0.0; MAX];
    for j in 0..=N {
        y[j] = (0..=j).fold(0.0, |sum, i| sum + c[i][j] * image[i]);
    }
    for i in 0..=N {
        let sum = (0..i).fold(y[i], |sum, k| sum - a[k][i] * y[k]);
        y[i] = sum / a[i][i];
    }
    for i in (0..=N).rev() {
        let sum = (i + 1..=N).fold(y[i], |sum, k| sum - a[i][k] * y[k]);
        y[i] = sum / a[i][i];
    }
    let size = y.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
    y.map(|x| x / size)
}

/// The model after a step. It is homogeneous, so that |u| is made 1 again by
/// scaling all of it.
fn stepped<const N: usize>(h: &[f64; MAX], change: &[f64; N]) -> [f64; MAX] {
    let mut next = *h;
    next[0] += h[1] * change[0];
    next[1] -= h[0] * change[0];
    for i in 2..=N {
        next[i] += change[i - 1];
    }
    let length = hypot(next[0], next[1]);
    next.map(|x| x / length)
}

/// The step that solves root step = rest, damped by the information's diagonal.
fn step<const N: usize>(root: &[[f64; N]; N], rest: &[f64; N], damping: f64) -> [f64; N] {
    let (mut root, mut rest) = (*root, *rest);
    if damping > 0.0 {
        let mut factor = [[0.0; MAX]; MAX];
        for i in 0..N {
            factor[i][..N].copy_from_slice(&root[i]);
            factor[i][N] = rest[i];
        }
        let mut flat = flatten::<N>(&factor);
        for j in 0..N {
            let square = (0..=j).fold(0.0, |sum, i| sum + root[i][j] * root[i][j]);
            let mut row = [0.0; MAX];
            row[j] = (damping * if square > 0.0 { square } else { 1.0 }).sqrt();
            rotate_in(&mut flat[..(N + 1) * (N + 1)], &mut row[..=N]);
        }
        (root, rest) = split::<N>(&flat);
    }
    for i in (0..N).rev() {
        let sum = (i + 1..N).fold(rest[i], |sum, j| sum - root[i][j] * rest[j]);
        rest[i] = sum / root[i][i];
    }
    rest
}

/// The first N + 1 rows and columns, without gaps.
fn flatten<const N: usize>(factor: &[[f64; MAX]; MAX]) -> [f64; MAX * MAX] {
    let mut flat = [0.0; MAX * MAX];
    for (row, line) in factor.iter().zip(flat.chunks_exact_mut(N + 1)).take(N + 1) {
        line.copy_from_slice(&row[..=N]);
    }
    flat
}

/// The triangle and its right-hand side.
fn split<const N: usize>(flat: &[f64; MAX * MAX]) -> ([[f64; N]; N], [f64; N]) {
    let at = |i: usize, j: usize| flat[i * (N + 1) + j];
    (
        core::array::from_fn(|i| core::array::from_fn(|j| at(i, j))),
        core::array::from_fn(|i| at(i, N)),
    )
}

fn decompose<const N: usize>(r: &[[f64; N]; N], scale: &[f64; N]) -> ([f64; N], [[f64; N]; N]) {
    let (mut s, mut v, mut work) = ([0.0; N], [[0.0; N]; N], [[0.0; N]; N]);
    spectrum::decompose(
        r.as_flattened(),
        N,
        scale,
        &mut s,
        v.as_flattened_mut(),
        work.as_flattened_mut(),
    );
    (s, v)
}

impl<const N: usize> Fit<N> {
    /// The nullity and, if it is not zero, the first null vector.
    fn nullity(&self, rtol: f64) -> (usize, [f64; N]) {
        let mut scale = [1.0; N];
        spectrum::unit_columns(self.root.as_flattened(), N, &mut scale);
        if let Some(inverse) = self.inverse() {
            // 1 / |R^-1| is a lower bound of the smallest singular value, the
            // root of N an upper one of the largest.
            let square = (0..N).fold(0.0, |sum, i| {
                (i..N).fold(sum, |sum, j| {
                    let x = inverse[i][j] / scale[i];
                    sum + x * x
                })
            });
            if square * rtol * rtol * (N as f64) < 1.0 {
                return (0, [0.0; N]);
            }
        }
        let (s, v) = decompose(&self.root, &scale);
        let rank = spectrum::rank(&s, rtol);
        let mut null = v.get(rank).copied().unwrap_or([0.0; N]);
        for (x, scale) in null.iter_mut().zip(&scale) {
            *x *= scale;
        }
        (N - rank, null)
    }

    /// The inverse of the factor, upper triangular; `None` with a zero diagonal.
    fn inverse(&self) -> Option<[[f64; N]; N]> {
        let r = &self.root;
        if (0..N).any(|k| r[k][k] == 0.0) {
            return None;
        }
        let mut inverse = [[0.0; N]; N];
        for j in 0..N {
            inverse[j][j] = 1.0 / r[j][j];
            for i in (0..j).rev() {
                let sum = (i + 1..=j).fold(0.0, |sum, k| sum + r[i][k] * inverse[k][j]);
                inverse[i][j] = -sum / r[i][i];
            }
        }
        Some(inverse)
    }

    fn judge(&self, solver: &Solver<N>, nullity: usize) -> Status {
        let s = self.model[N];
        if nullity > 0 {
            Status::Unobservable
        } else if !(s > 0.0) {
            Status::Unbounded
        } else if !self.converged {
            Status::NotConverged
        } else if 1.0 / (self.root[N - 1][N - 1] * s) > solver.options.weak_ratio {
            Status::Weak
        } else {
            Status::Converged
        }
    }

    /// Columns of a square root of the covariance of the states.
    fn spread(&self, solver: &Solver<N>) -> Option<[[f64; N]; N]> {
        let inverse = self.inverse()?;
        let per_square = 1.0 / (self.model[N] * self.model[N]);
        Some(core::array::from_fn(|k| {
            let change = core::array::from_fn(|i| inverse[i][k] * per_square);
            solver.move_states(&self.model, &change)
        }))
    }

    fn write(&self, solver: &Solver<N>, out: &mut [f64]) {
        let (nullity, null) = self.nullity(solver.rtol);
        let status = self.judge(solver, nullity);
        let (estimate, out) = out.split_at_mut(N);
        let (direction, out) = out.split_at_mut(N);
        let (covariance, tail) = out.split_at_mut(N * N);
        direction.fill(0.0);
        let spread = match status {
            Status::Unobservable | Status::Unbounded => None,
            _ => self.spread(solver),
        };
        if let Some(spread) = spread {
            estimate.copy_from_slice(&solver.state(&self.model));
            for i in 0..N {
                for j in 0..N {
                    covariance[i * N + j] = spread.iter().fold(0.0, |sum, x| sum + x[i] * x[j]);
                }
            }
        } else {
            estimate.fill(f64::NAN);
            covariance.fill(f64::INFINITY);
        }
        if nullity > 0 {
            let moved = solver.move_states(&self.model, &null);
            let length = hypot(moved[0], moved[1]);
            let size = moved.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
            // In metres of position, where the position moves at all.
            let unit = if length > 1e-9 * size { length } else { size };
            for (out, x) in direction.iter_mut().zip(&moved) {
                *out = x / unit;
            }
        }
        tail.copy_from_slice(&[
            status.code(),
            nullity as f64,
            f64::from(self.iterations),
            self.cost,
        ]);
    }

    fn write_error(&self, solver: &Solver<N>, truth: &[f64; N], out: &mut [f64]) {
        let (nullity, _) = self.nullity(solver.rtol);
        let status = self.judge(solver, nullity);
        let (error, out) = out.split_at_mut(N);
        let (deviation, tail) = out.split_at_mut(N);
        let spread = match status {
            Status::Unobservable | Status::Unbounded => None,
            _ => self.spread(solver),
        };
        let mut square = f64::NAN;
        if let Some(spread) = spread {
            let estimate = solver.state(&self.model);
            let moved: [f64; N] = core::array::from_fn(|i| estimate[i] - truth[i]);
            error.copy_from_slice(&moved);
            for i in 0..N {
                deviation[i] = spread.iter().fold(0.0, |sum, x| sum + x[i] * x[i]).sqrt();
            }
            let change = solver.change_of(&self.model, &moved);
            square = (0..N).fold(0.0, |sum, i| {
                let x = (i..N).fold(0.0, |x, j| x + self.root[i][j] * change[j]);
                sum + x * x
            });
        } else {
            error.fill(f64::NAN);
            deviation.fill(f64::INFINITY);
        }
        tail.copy_from_slice(&[square, self.cost, status.code(), f64::from(self.iterations)]);
    }
}
