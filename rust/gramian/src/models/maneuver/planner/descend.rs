//! From a path to a first-order optimum: an augmented Lagrangian of the limits, each round
//! of it minimised by a limited-memory quasi-Newton method.
//!
//! # Source
//! Powell 1969 and Hestenes 1969 (multipliers), Rockafellar 1973 (inequalities), Liu &
//! Nocedal 1989 (L-BFGS), Lewis & Overton 2013 (line search by bisection, which also
//! serves corners).

use alloc::boxed::Box;
use alloc::vec;
use alloc::vec::Vec;

use super::Problem;
use super::limits::Limits;
use super::objective::Objective;
use super::paths::{Layout, Pull, Track};
use crate::numbers::algebra::dot_slices as dot;

/// Pairs of steps and changes of gradient that are kept.
const MEMORY: usize = 14;
/// What a path keeps beyond its limits, so that rounding leaves them kept.
const MARGIN: f64 = 1e-9;
/// A limit this near is active.
const ACTIVE: f64 = 1e-6;
/// Limits that are kept this well, and no better by one more round, are well enough kept.
const NEAR: f64 = 1e-6;
/// A limit this near will soon be.
const NEARLY: f64 = 1e-3;

/// Cost and limits of the paths of one layout.
pub(super) struct Program<'a> {
    pub problem: &'a Problem,
    pub objective: &'a dyn Objective,
    pub layout: Layout,
    pub limits: Limits,
    tracks: Vec<Track>,
    pulls: Vec<Pull>,
    values: Vec<f64>,
    /// Space of the objective.
    space: Vec<f64>,
    /// Asked before each cost whether to go on.
    look: &'a mut dyn FnMut() -> bool,
    /// Whether it said no.
    pub stopped: bool,
}

/// Where a descent ended.
#[derive(Clone, Debug)]
pub(super) struct Descent {
    pub x: Vec<f64>,
    /// The largest part of the gradient of the Lagrangian.
    pub projected: f64,
}

/// How far a descent goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// Rounds of multipliers.
    pub rounds: usize,
    /// Steps of each.
    pub steps: usize,
    /// Sharpness of the stand-ins of corners.
    pub sharpness: f64,
    /// The gradient to stop at.
    pub tolerance: f64,
    /// Whether to begin with the multipliers that hold the path best where it is, as is
    /// right near an optimum.
    pub warm: bool,
    /// Rounds without better kept limits after which a path that nearly keeps them is done.
    pub patience: usize,
}

impl<'a> Program<'a> {
    pub fn new(
        problem: &'a Problem,
        objective: &'a dyn Objective,
        counts: Vec<usize>,
        look: &'a mut dyn FnMut() -> bool,
    ) -> Self {
        let layout = Layout::new(problem, counts);
        let limits = Limits::new(problem, &layout);
        Self {
            problem,
            objective,
            limits,
            layout,
            tracks: Vec::new(),
            pulls: problem
                .observers
                .iter()
                .map(|_| Pull::new(problem.moves))
                .collect(),
            values: Vec::new(),
            space: Vec::new(),
            look,
            stopped: false,
        }
    }

    /// The paths.
    pub fn tracks(&mut self, x: &[f64]) -> &[Track] {
        self.layout.walk(self.problem, x, &mut self.tracks);
        &self.tracks
    }

    /// The cost, and by how much the worst limit is broken.
    pub fn judge(&mut self, x: &[f64], sharpness: f64) -> (f64, f64) {
        self.stopped = self.stopped || !(self.look)();
        self.layout.walk(self.problem, x, &mut self.tracks);
        let cost = self
            .objective
            .cost(&self.tracks, sharpness, None, &mut self.space);
        (cost, self.broken_here(x))
    }

    /// The cost, and its gradient by the unknowns.
    fn cost(&mut self, x: &[f64], sharpness: f64, gradient: &mut [f64]) -> f64 {
        self.layout.walk(self.problem, x, &mut self.tracks);
        for pull in &mut self.pulls {
            pull.clear();
        }
        let cost = self.objective.cost(
            &self.tracks,
            sharpness,
            Some(&mut self.pulls),
            &mut self.space,
        );
        gradient.fill(0.0);
        self.layout
            .back(self.problem, x, &self.tracks, &self.pulls, gradient);
        cost
    }

    fn broken_here(&mut self, x: &[f64]) -> f64 {
        self.limits.values(
            self.problem,
            &self.layout,
            x,
            &self.tracks,
            &mut self.values,
        );
        self.values.iter().fold(0.0, |worst: f64, &c| worst.max(-c))
    }

    /// The augmented Lagrangian and its gradient.
    fn lagrangian(
        &mut self,
        x: &[f64],
        multipliers: &[f64],
        penalty: f64,
        sharpness: f64,
        gradient: &mut [f64],
    ) -> f64 {
        self.stopped = self.stopped || !(self.look)();
        gradient.fill(0.0);
        self.layout.walk(self.problem, x, &mut self.tracks);
        for pull in &mut self.pulls {
            pull.clear();
        }
        let mut sum = self.objective.cost(
            &self.tracks,
            sharpness,
            Some(&mut self.pulls),
            &mut self.space,
        );
        if !sum.is_finite() {
            return f64::INFINITY;
        }
        self.limits.values(
            self.problem,
            &self.layout,
            x,
            &self.tracks,
            &mut self.values,
        );
        for index in 0..self.values.len() {
            let kept = self.values[index] - MARGIN;
            let force = multipliers[index] - penalty * kept;
            if force > 0.0 {
                sum += 0.5 * (force * force - multipliers[index] * multipliers[index]) / penalty;
                self.limits.pull(
                    index,
                    -force,
                    self.problem,
                    &self.layout,
                    x,
                    &self.tracks,
                    &mut self.pulls,
                    gradient,
                );
            } else {
                sum -= 0.5 * multipliers[index] * multipliers[index] / penalty;
            }
        }
        self.layout
            .back(self.problem, x, &self.tracks, &self.pulls, gradient);
        if gradient.iter().all(|g| g.is_finite()) {
            sum
        } else {
            f64::INFINITY
        }
    }

    /// Goes downhill from `x` to a first-order optimum that keeps its limits.
    pub fn descend(&mut self, x: &[f64], effort: Effort) -> Descent {
        let mut x = x.to_vec();
        let mut multipliers = vec![0.0; self.limits.len()];
        let mut penalty = 10.0;
        if effort.warm {
            self.hold(&x, effort.sharpness, NEARLY, &mut multipliers);
            penalty = 100.0;
        }
        let mut before = f64::INFINITY;
        let (mut least, mut idle) = (f64::INFINITY, 0);
        for round in 0..effort.rounds {
            let loose = if round == 0 { 30.0 } else { 1.0 };
            let old = x.clone();
            let gradient = self.minimize(&mut x, &multipliers, penalty, effort, loose);
            let stalled = old.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-7);
            if self.stopped || (self.limits.len() == 0 && (stalled || gradient < effort.tolerance))
            {
                break;
            }
            self.layout.walk(self.problem, &x, &mut self.tracks);
            let broken = self.broken_here(&x);
            let mut slack = 0.0_f64;
            for (multiplier, value) in multipliers.iter_mut().zip(&self.values) {
                let kept = value - MARGIN;
                slack = slack.max((*multiplier / penalty).min(kept).abs());
                *multiplier = (*multiplier - penalty * kept).max(0.0);
            }
            if slack < 1e-8 && gradient < effort.tolerance {
                break;
            }
            // So near, a larger penalty makes the rounds worse and no longer better: the rest
            // is what `restore` is for.
            idle = if slack > 0.5 * least { idle + 1 } else { 0 };
            least = least.min(slack);
            if slack < NEAR && idle >= effort.patience {
                break;
            }
            if slack > 0.3 * before {
                penalty = (penalty * 5.0).min(1e6);
            }
            before = slack;
            if broken < 1e-9 && slack < 1e-8 && stalled {
                break;
            }
        }
        self.restore(&mut x);
        let projected = self.projected_gradient(&x, effort.sharpness);
        Descent { x, projected }
    }

    /// L-BFGS on the augmented Lagrangian; returns the largest part of its gradient.
    fn minimize(
        &mut self,
        x: &mut [f64],
        multipliers: &[f64],
        penalty: f64,
        effort: Effort,
        loose: f64,
    ) -> f64 {
        let n = x.len();
        let mut gradient = vec![0.0; n];
        let mut value = self.lagrangian(x, multipliers, penalty, effort.sharpness, &mut gradient);
        if !value.is_finite() {
            return f64::INFINITY;
        }
        let mut pairs: Vec<(Vec<f64>, Vec<f64>, f64)> = Vec::new();
        let mut trial = vec![0.0; n];
        let mut slope = vec![0.0; n];
        let mut taken = vec![0.0; n];
        let mut taken_slope = vec![0.0; n];
        let mut small = 0;
        for _ in 0..effort.steps {
            let size = largest(&gradient);
            if size < effort.tolerance * loose || self.stopped {
                break;
            }
            let mut direction = two_loop(&pairs, &gradient);
            let mut descent = dot(&direction, &gradient);
            if !(descent < 0.0) {
                pairs.clear();
                direction = gradient.iter().map(|g| -g).collect();
                descent = -dot(&gradient, &gradient);
            }
            // No heading turns by more than this at once.
            let longest = largest(&direction);
            let mut step = if pairs.is_empty() {
                (0.1 / longest).min(1.0)
            } else {
                (0.7 / longest).min(1.0)
            };
            let (mut low, mut high) = (0.0, f64::INFINITY);
            // The last trial that went down far enough.
            let mut now = f64::INFINITY;
            for _ in 0..30 {
                for k in 0..n {
                    trial[k] = x[k] + step * direction[k];
                }
                let new =
                    self.lagrangian(&trial, multipliers, penalty, effort.sharpness, &mut slope);
                if new <= value + 1e-4 * step * descent {
                    now = new;
                    taken.copy_from_slice(&trial);
                    taken_slope.copy_from_slice(&slope);
                    if dot(&slope, &direction) >= 0.9 * descent {
                        break;
                    }
                    low = step;
                } else {
                    high = step;
                }
                step = if high.is_finite() {
                    0.5 * (low + high)
                } else {
                    2.0 * step
                };
                let narrow = high.is_finite() && high - low < 1e-10 * high;
                if narrow || step * longest > 3.0 || self.stopped {
                    break;
                }
            }
            if !now.is_finite() {
                if pairs.is_empty() || self.stopped {
                    break;
                }
                pairs.clear();
                continue;
            }
            let mut s = vec![0.0; n];
            let mut y = vec![0.0; n];
            for k in 0..n {
                s[k] = taken[k] - x[k];
                y[k] = taken_slope[k] - gradient[k];
            }
            let curvature = dot(&s, &y);
            if curvature > 1e-12 * dot(&y, &y).sqrt() * dot(&s, &s).sqrt() {
                if pairs.len() == MEMORY {
                    pairs.remove(0);
                }
                pairs.push((s, y, 1.0 / curvature));
            }
            let gain = value - now;
            x.copy_from_slice(&taken);
            gradient.copy_from_slice(&taken_slope);
            value = now;
            small = if gain < 1e-9 * (1.0 + value.abs()) {
                small + 1
            } else {
                0
            };
            if small >= 6 {
                break;
            }
        }
        largest(&gradient)
    }

    /// Moves a path that breaks its limits by a little back into them, by as little as
    /// possible.
    pub fn restore(&mut self, x: &mut [f64]) {
        for _ in 0..8 {
            self.layout.walk(self.problem, x, &mut self.tracks);
            if self.broken_here(x) <= 0.0 {
                return;
            }
            let near: Vec<usize> = (0..self.values.len())
                .filter(|&i| self.values[i] < ACTIVE)
                .collect();
            let wanted: Vec<f64> = near
                .iter()
                .map(|&i| (MARGIN - self.values[i]).max(0.0))
                .collect();
            let rows = self.rows(x, &near);
            let mut gram = products(&rows);
            let k = near.len();
            let trace: f64 = (0..k).map(|i| gram[i * k + i]).sum();
            for i in 0..k {
                gram[i * k + i] += 1e-12 * trace + 1e-300;
            }
            // Only pushes, no pulls: least squares with multipliers at least zero.
            let mut push = vec![0.0; k];
            non_negative(&gram, &wanted, &mut push, 400);
            for (row, push) in rows.iter().zip(&push) {
                for (x, row) in x.iter_mut().zip(row) {
                    *x += push * row;
                }
            }
        }
    }

    /// Gradients of some limits by the unknowns, at the path walked last.
    fn rows(&mut self, x: &[f64], which: &[usize]) -> Vec<Vec<f64>> {
        let mut rows = Vec::with_capacity(which.len());
        for &index in which {
            let mut row = vec![0.0; x.len()];
            for pull in &mut self.pulls {
                pull.clear();
            }
            self.limits.pull(
                index,
                1.0,
                self.problem,
                &self.layout,
                x,
                &self.tracks,
                &mut self.pulls,
                &mut row,
            );
            self.layout
                .back(self.problem, x, &self.tracks, &self.pulls, &mut row);
            rows.push(row);
        }
        rows
    }

    /// The largest part of the gradient of the cost that the active limits, with the best
    /// multipliers at least zero, do not hold.
    pub fn projected_gradient(&mut self, x: &[f64], sharpness: f64) -> f64 {
        let mut multipliers = vec![0.0; self.limits.len()];
        self.hold(x, sharpness, ACTIVE, &mut multipliers)
    }

    /// The multipliers of limits no farther than `near` that hold the path best, and the
    /// largest part of the gradient that they leave.
    fn hold(&mut self, x: &[f64], sharpness: f64, near: f64, multipliers: &mut [f64]) -> f64 {
        let mut gradient = vec![0.0; x.len()];
        if !self.cost(x, sharpness, &mut gradient).is_finite() {
            return f64::INFINITY;
        }
        self.broken_here(x);
        let near: Vec<usize> = (0..self.values.len())
            .filter(|&i| self.values[i] < near)
            .collect();
        let rows = self.rows(x, &near);
        let gram = products(&rows);
        let aim: Vec<f64> = rows.iter().map(|row| dot(row, &gradient)).collect();
        let mut forces = vec![0.0; near.len()];
        non_negative(&gram, &aim, &mut forces, 3000);
        for ((row, force), &index) in rows.iter().zip(&forces).zip(&near) {
            multipliers[index] = *force;
            for (g, row) in gradient.iter_mut().zip(row) {
                *g -= force * row;
            }
        }
        largest(&gradient)
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
}

fn products(rows: &[Vec<f64>]) -> Box<[f64]> {
    let k = rows.len();
    let mut gram = vec![0.0; k * k];
    for i in 0..k {
        for j in 0..=i {
            let value = dot(&rows[i], &rows[j]);
            gram[i * k + j] = value;
            gram[j * k + i] = value;
        }
    }
    gram.into_boxed_slice()
}

/// Makes z^T G z / 2 - b^T z small over z >= 0, coordinate by coordinate.
fn non_negative(gram: &[f64], b: &[f64], z: &mut [f64], sweeps: usize) {
    let k = b.len();
    let size = largest(b);
    for _ in 0..sweeps {
        let mut change = 0.0_f64;
        for i in 0..k {
            let row = &gram[i * k..(i + 1) * k];
            if !(row[i] > 0.0) {
                continue;
            }
            let rest = b[i] - dot(row, z);
            let new = (z[i] + rest / row[i]).max(0.0);
            change = change.max((new - z[i]).abs() * row[i]);
            z[i] = new;
        }
        if change <= 1e-13 * size {
            break;
        }
    }
}

/// Minus the inverse Hessian of the pairs times the gradient.
fn two_loop(pairs: &[(Vec<f64>, Vec<f64>, f64)], gradient: &[f64]) -> Vec<f64> {
    let mut q: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let mut alphas = vec![0.0; pairs.len()];
    for (k, (s, y, rho)) in pairs.iter().enumerate().rev() {
        let alpha = rho * dot(s, &q);
        alphas[k] = alpha;
        for (q, y) in q.iter_mut().zip(y) {
            *q -= alpha * y;
        }
    }
    if let Some((_, y, rho)) = pairs.last() {
        let scale = 1.0 / (rho * dot(y, y));
        for q in &mut q {
            *q *= scale;
        }
    }
    for (k, (s, y, rho)) in pairs.iter().enumerate() {
        let beta = rho * dot(y, &q);
        for (q, s) in q.iter_mut().zip(s) {
            *q += (alphas[k] - beta) * s;
        }
    }
    q
}
