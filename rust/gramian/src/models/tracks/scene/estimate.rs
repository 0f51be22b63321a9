//! The most likely state of a scene: damped Gauss-Newton steps from several starts, with
//! priors and robust losses, trial by trial.
//!
//! # Algorithm
//! Levenberg-Marquardt on the whitened rows, reduced by orthogonal reflections; the
//! damping is in units of the columns (Moré 1978). A robust loss is minimised by
//! reweighting the residuals (Holland & Welsch 1977), and its covariance is that of the
//! sandwich formula (Huber 1981, section 7.6).

use alloc::vec;
use alloc::vec::Vec;

use super::{InSensor, Measured, Scene};
use crate::batch::{Items, Threads};
use crate::solve::Model;
use crate::spectrum;
use crate::square_root::{rotate_in, triangularize};

/// How a residual counts, in units of its deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Its square.
    Squares,
    /// Its square up to this, linear beyond: 1.345 for 95 % efficiency.
    Huber(f64),
    /// Nothing more beyond this: 4.685 for 95 % efficiency.
    Tukey(f64),
}

impl Loss {
    /// Twice the loss, the weight psi(r) / r, and the derivative of psi.
    fn at(self, r: f64) -> (f64, f64, f64) {
        match self {
            Self::Squares => (r * r, 1.0, 1.0),
            Self::Huber(c) => {
                let size = r.abs();
                if size <= c {
                    (r * r, 1.0, 1.0)
                } else {
                    (2.0 * c * size - c * c, c / size, 0.0)
                }
            }
            Self::Tukey(c) => {
                let u = (r / c) * (r / c);
                if u >= 1.0 {
                    (c * c / 3.0, 0.0, 0.0)
                } else {
                    let rest = 1.0 - u;
                    (
                        c * c / 3.0 * (1.0 - rest * rest * rest),
                        rest * rest,
                        rest * (1.0 - 5.0 * u),
                    )
                }
            }
        }
    }
}

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
}

impl Default for Options {
    fn default() -> Self {
        Self {
            max_iterations: 60,
            loss: Loss::Squares,
            polish: 4,
            rtol: None,
        }
    }
}

/// Independent normal knowledge of the free states; an infinite deviation for none.
#[derive(Clone, Copy, Debug)]
pub struct Prior<'a> {
    /// Means.
    pub mean: &'a [f64],
    /// Standard deviations.
    pub sigma: &'a [f64],
}

/// Where the steps from one start ended.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The free states.
    pub x: Vec<f64>,
    /// Twice the loss, priors included: chi-square where the loss is that of squares.
    pub cost: f64,
    /// Steps taken.
    pub iterations: u32,
    /// Whether they came to rest.
    pub converged: bool,
}

/// One trial after the other, in its own memory.
#[derive(Debug)]
pub struct Solver<'a, M> {
    model: &'a M,
    prior: Option<Prior<'a>>,
    options: Options,
    rows: Vec<f64>,
    residuals: Vec<f64>,
    stack: Vec<f64>,
    work: Vec<f64>,
}

impl<'a, M: Model> Solver<'a, M> {
    /// For this model.
    pub fn new(model: &'a M, prior: Option<Prior<'a>>, options: Options) -> Self {
        let (m, n) = (model.measurements(), model.states());
        Self {
            model,
            prior,
            options,
            rows: vec![0.0; m * n],
            residuals: vec![0.0; m],
            stack: vec![0.0; (m.max(n + 1) + n) * (n + 1)],
            work: vec![0.0; 2 * (n + 1)],
        }
    }

    /// Twice the loss at a state; infinite where there is none.
    pub fn cost(&mut self, x: &[f64]) -> f64 {
        if self.model.linearize(x, &mut self.residuals, None).is_err() {
            return f64::INFINITY;
        }
        let cost = self.sum(x);
        if cost.is_nan() { f64::INFINITY } else { cost }
    }

    fn sum(&self, x: &[f64]) -> f64 {
        let loss = self.options.loss;
        let data: f64 = if loss == Loss::Squares {
            self.residuals.iter().map(|r| r * r).sum()
        } else {
            self.residuals.iter().map(|&r| loss.at(r).0).sum()
        };
        data + self.prior.map_or(0.0, |prior| {
            (0..x.len())
                .filter(|&k| prior.sigma[k].is_finite())
                .map(|k| ((prior.mean[k] - x[k]) / prior.sigma[k]).powi(2))
                .sum()
        })
    }

    /// The triangular factor of the weighted rows and residuals at the state that was
    /// linearised last, n + 1 columns.
    fn reduce(&mut self, x: &[f64]) -> Vec<f64> {
        let n = x.len();
        let wide = n + 1;
        let loss = self.options.loss;
        let mut used = 0;
        for (i, &r) in self.residuals.iter().enumerate() {
            let weight = loss.at(r).1.sqrt();
            let line = &mut self.stack[i * wide..][..wide];
            for (to, from) in line.iter_mut().zip(&self.rows[i * n..][..n]) {
                *to = weight * from;
            }
            line[n] = weight * r;
            used += 1;
        }
        if let Some(prior) = self.prior {
            for k in (0..n).filter(|&k| prior.sigma[k].is_finite()) {
                let line = &mut self.stack[used * wide..][..wide];
                line.fill(0.0);
                line[k] = 1.0 / prior.sigma[k];
                line[n] = (prior.mean[k] - x[k]) / prior.sigma[k];
                used += 1;
            }
        }
        while used < wide {
            self.stack[used * wide..][..wide].fill(0.0);
            used += 1;
        }
        let stack = &mut self.stack[..used * wide];
        triangularize(stack, wide, &mut self.work[..wide]);
        stack[..wide * wide].to_vec()
    }

    /// Follows one start.
    pub fn descend(&mut self, start: &[f64]) -> Solution {
        let n = start.len();
        let wide = n + 1;
        let mut x = start.to_vec();
        let mut solution = Solution {
            x: x.clone(),
            cost: f64::INFINITY,
            iterations: 0,
            converged: false,
        };
        let model = self.model;
        if model
            .linearize(&x, &mut self.residuals, Some(&mut self.rows))
            .is_err()
        {
            return solution;
        }
        let mut cost = self.sum(&x);
        if !cost.is_finite() {
            return solution;
        }
        let mut damping = 0.0_f64;
        let mut next = vec![0.0; n];
        'outer: loop {
            let factor = self.reduce(&x);
            let decrease: f64 = (0..n).map(|i| factor[i * wide + n].powi(2)).sum();
            let tolerance = 1e-12 + 1e-15 * cost;
            let full_rank = (0..n).all(|i| {
                let norm: f64 = (0..=i).map(|k| factor[k * wide + i].powi(2)).sum();
                factor[i * wide + i].powi(2) > 1e-24 * norm
            });
            if decrease <= tolerance {
                solution.converged = true;
                break;
            }
            if !full_rank {
                damping = damping.max(1e-8);
            }
            loop {
                if solution.iterations >= self.options.max_iterations || damping > 1e12 {
                    break 'outer;
                }
                solution.iterations += 1;
                let step = solve_damped(&factor, n, damping);
                for k in 0..n {
                    next[k] = x[k] + step[k];
                }
                let trial = if model
                    .linearize(&next, &mut self.residuals, Some(&mut self.rows))
                    .is_err()
                {
                    f64::INFINITY
                } else {
                    self.sum(&next)
                };
                if trial <= cost + tolerance {
                    let gain = cost - trial;
                    x.copy_from_slice(&next);
                    cost = trial;
                    // A step of this size in deviations, that gains as little: at rest.
                    if decrease < 1e-7 && gain.abs() < 1e-9 * (1.0 + cost) && damping < 1e-3 {
                        solution.converged = true;
                        break 'outer;
                    }
                    damping = if damping < 1e-7 { 0.0 } else { damping * 0.1 };
                    break;
                }
                damping = (damping * 10.0).max(1e-4);
                // Where a turn's time meets a sample the cost has a kink: at rest where a
                // step that small would gain nothing.
                if decrease < 1e-5 * (1.0 + damping) {
                    solution.converged = true;
                    break 'outer;
                }
            }
        }
        solution.x = x;
        solution.cost = cost;
        solution
    }

    /// The scaled factor's rank and null vectors, and the covariance where it exists.
    pub fn spread(&mut self, x: &[f64]) -> Spread {
        let n = x.len();
        let wide = n + 1;
        let mut out = Spread {
            rank: 0,
            null: vec![0.0; n],
            covariance: vec![f64::INFINITY; n * n],
        };
        if self
            .model
            .linearize(x, &mut self.residuals, Some(&mut self.rows))
            .is_err()
        {
            return out;
        }
        let factor = self.reduce(x);
        let mut r = vec![0.0; n * n];
        for i in 0..n {
            r[i * n..(i + 1) * n].copy_from_slice(&factor[i * wide..][..n]);
        }
        let rtol = self
            .options
            .rtol
            .unwrap_or_else(|| spectrum::default_rtol(self.residuals.len(), n));
        let (mut scale, mut s) = (vec![1.0; n], vec![0.0; n]);
        let (mut v, mut work) = (vec![0.0; n * n], vec![0.0; n * n]);
        spectrum::unit_columns(&r, n, &mut scale);
        spectrum::decompose(&r, n, &scale, &mut s, &mut v, &mut work);
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
        let mut b = vec![0.0; n * n];
        for k in 0..n {
            for i in 0..n {
                b[i * n + k] = scale[i] * v[k * n + i] / s[k];
            }
        }
        if self.options.loss == Loss::Squares {
            for i in 0..n {
                for j in 0..n {
                    out.covariance[i * n + j] = (0..n).map(|k| b[i * n + k] * b[j * n + k]).sum();
                }
            }
        } else {
            out.covariance = self.sandwich(x, &b);
        }
        out
    }

    /// H^-1 (sum psi^2 a a^T + priors) H^-1 with H = sum psi' a a^T + priors, in the
    /// coordinates of `b`, where the weighted information is the unit matrix.
    fn sandwich(&self, x: &[f64], b: &[f64]) -> Vec<f64> {
        let n = x.len();
        let loss = self.options.loss;
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
        let m = self.residuals.len().max(1) as f64;
        let slope = self.residuals.iter().map(|&r| loss.at(r).2).sum::<f64>() / m;
        let square = self
            .residuals
            .iter()
            .map(|&r| (loss.at(r).1 * r).powi(2))
            .sum::<f64>()
            / m;
        let freedom = m / (m - n as f64).max(1.0);
        for i in 0..self.residuals.len() {
            add(&self.rows[i * n..][..n], slope.max(0.05), square * freedom);
        }
        if let Some(prior) = self.prior {
            for k in (0..n).filter(|&k| prior.sigma[k].is_finite()) {
                let mut row = vec![0.0; n];
                row[k] = 1.0 / prior.sigma[k];
                add(&row, 1.0, 1.0);
            }
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
}

/// What the rows at a solution say.
#[derive(Clone, Debug)]
pub struct Spread {
    /// Rank of the rows and priors.
    pub rank: usize,
    /// The first direction that nothing sees; zero where there is none.
    pub null: Vec<f64>,
    /// Covariance, row-major; infinite where the rank is short.
    pub covariance: Vec<f64>,
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

/// The step of the triangular factor (n + 1 columns), damped by the size of each column.
fn solve_damped(factor: &[f64], n: usize, damping: f64) -> Vec<f64> {
    let wide = n + 1;
    let mut r = factor.to_vec();
    if damping > 0.0 {
        let mut row = vec![0.0; wide];
        for j in 0..n {
            let square: f64 = (0..=j).map(|i| factor[i * wide + j].powi(2)).sum();
            row.fill(0.0);
            row[j] = (damping * if square > 0.0 { square } else { 1.0 }).sqrt();
            rotate_in(&mut r, &mut row);
        }
    }
    let mut step = vec![0.0; n];
    for i in (0..n).rev() {
        let sum = (i + 1..n).fold(r[i * wide + n], |sum, j| sum - r[i * wide + j] * step[j]);
        step[i] = if r[i * wide + i] == 0.0 {
            0.0
        } else {
            sum / r[i * wide + i]
        };
    }
    step
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
    /// data, samples present, rank, iterations, and 1 where the steps came to rest.
    pub const fn size(self) -> usize {
        self.states * (self.states + 3) + 7
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

/// Nanoseconds for a trial, roughly.
pub fn cost(scene: &Scene, starts: usize) -> f64 {
    let (m, n) = (scene.measurements() as f64, scene.states() as f64);
    starts as f64 * 8.0 * (2000.0 + m * (40.0 + 4.0 * n * n))
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
    threads.over(out, size, work, |trial, out| {
        one(
            task,
            measurements.get(trial),
            starts.map(|s| s.get(trial)),
            out,
        )
    })
}

fn one(
    task: Task<'_>,
    measurements: &[f64],
    starts: Option<&[f64]>,
    out: &mut [f64],
) -> Result<(), InSensor> {
    let scene = task.scene;
    let n = scene.states();
    let known: Vec<Option<f64>> = task
        .known
        .iter()
        .map(|x| (!x.is_nan()).then_some(*x))
        .collect();
    let measured = Measured::new(scene, measurements, &known)?;
    let free: Vec<usize> = (0..n).filter(|&k| known[k].is_none()).collect();
    let pick = |all: &[f64]| free.iter().map(|&k| all[k]).collect::<Vec<f64>>();
    let (mean, sigma) = (pick(task.mean), pick(task.sigma));
    let prior = sigma.iter().any(|s| s.is_finite()).then_some(Prior {
        mean: &mean,
        sigma: &sigma,
    });
    let mut solver = Solver::new(&measured, prior, task.options);
    let candidates: Vec<Vec<f64>> = match starts {
        Some(given) => given.chunks_exact(n).map(&pick).collect(),
        None => scene
            .starts(measurements, task.mean, task.sigma, task.known)
            .iter()
            .map(|x| pick(x))
            .collect(),
    };
    let mut ranked: Vec<(f64, Vec<f64>)> = if candidates.len() > task.options.polish {
        candidates
            .into_iter()
            .map(|x| (solver.cost(&x), x))
            .filter(|(cost, _)| cost.is_finite())
            .collect()
    } else {
        candidates.into_iter().map(|x| (0.0, x)).collect()
    };
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let dof = measured.measurements().saturating_sub(free.len()) as f64;
    let mut found: Vec<Solution> = Vec::new();
    for (_, start) in ranked.iter().take(task.options.polish.max(1)) {
        let solution = solver.descend(start);
        if solution.cost.is_finite() {
            found.push(solution);
        }
    }
    // Where none of the best starts fits, the others are followed too.
    let plausible = dof + 6.0 * (2.0 * dof).sqrt() + 20.0;
    let fits = |found: &[Solution]| found.iter().any(|s| s.converged && s.cost < plausible);
    if starts.is_none() && !fits(&found) {
        for (_, start) in ranked.iter().skip(task.options.polish.max(1)).take(12) {
            let solution = solver.descend(start);
            if solution.cost.is_finite() {
                found.push(solution);
            }
            if fits(&found) {
                break;
            }
        }
    }
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    write(scene, &measured, &mut solver, &free, &found, out);
    Ok(())
}

/// The best solution, what the rows say there, and the next best, as [`Layout`] has them.
fn write(
    scene: &Scene,
    measured: &Measured<'_>,
    solver: &mut Solver<'_, Measured<'_>>,
    free: &[usize],
    found: &[Solution],
    out: &mut [f64],
) {
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
            0.0,
            0.0,
            0.0,
        ]);
        return;
    };
    let spread = solver.spread(&best.x);
    let chi2: f64 = solver.residuals.iter().map(|r| r * r).sum();
    let whole = |x: &[f64]| {
        let mut x = measured.full(x);
        scene.normalize(&mut x);
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
        best.cost,
        next.map_or(f64::INFINITY, |s| s.cost),
        chi2,
        measured.measurements() as f64,
        spread.rank as f64,
        f64::from(best.iterations),
        f64::from(u8::from(best.converged)),
    ]);
}
