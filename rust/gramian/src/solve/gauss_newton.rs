//! The most likely state from one start: damped Gauss-Newton steps.
//!
//! # Algorithm
//! Levenberg-Marquardt on rows of unit columns (Moré 1978), reduced by orthogonal
//! reflections: the information is never formed. Functions of the states are held by
//! the null-space method: a step is the shortest one that brings them to their values,
//! and the best one along which they stay (Nocedal & Wright, Numerical Optimization,
//! sections 18.1 and 18.3), under the merit function chi2 + sum mu |g - value|, where a
//! second-order correction keeps long steps along a curved surface (Maratos 1978). What a
//! model knows exactly is held in the same way. A robust loss reweights the residuals
//! (Holland & Welsch 1977). Where it is asked for, a damped step is shortened or lengthened by the
//! curvature of the model along it: that of Halley's method, which is exact where the model
//! is a quotient of linear functions along the step, as bearings are along the range.

use alloc::vec;
use alloc::vec::Vec;

use super::{Function, Model};
use crate::numbers::algebra::dot_slices as dot;
use crate::numbers::lane::Lane;
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
    /// Twice the loss of a residual, and its weight psi(r) / r.
    #[inline(always)]
    pub fn at<L: Lane>(self, r: L) -> (L, L) {
        let one = r.splat(1.0);
        match self {
            Self::Squares => (r * r, one),
            Self::Huber(c) => {
                let (size, c) = (r.abs(), r.splat(c));
                let beyond = (c + c) * size - c * c;
                (
                    size.select_greater(c, beyond, r * r),
                    size.select_greater(c, c / size, one),
                )
            }
            Self::Tukey(c) => {
                let c = r.splat(c);
                let u = r / c;
                let rest = (one - u * u).max(r.splat(0.0));
                let square = rest * rest;
                ((c * c).times(1.0 / 3.0) * (one - square * rest), square)
            }
        }
    }

    /// The derivative of psi.
    pub fn slope(self, r: f64) -> f64 {
        match self {
            Self::Squares => 1.0,
            Self::Huber(c) => f64::from(u8::from(r.abs() <= c)),
            Self::Tukey(c) => {
                let u = (r / c) * (r / c);
                if u < 1.0 {
                    (1.0 - u) * (1.0 - 5.0 * u)
                } else {
                    0.0
                }
            }
        }
    }
}

/// How to minimise.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Steps at most, tried ones that were taken back included.
    pub max_iterations: u32,
    /// Converged where the next step would be shorter than this, in deviations.
    pub tolerance: f64,
    /// How residuals count.
    pub loss: Loss,
    /// Given up where so many steps lower chi2 by less than a millionth of it; 0 for never.
    pub patience: u32,
    /// Damping of the first step, on columns of unit length. 0 goes all the way at once, which
    /// is the faster near a minimum; 1 follows the slope from far away.
    pub damping: f64,
    /// Whether a damped step is shortened or lengthened by the curvature of the model along it,
    /// for one more evaluation without rows. Nothing is held then.
    pub curved: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            max_iterations: 200,
            tolerance: 1e-8,
            loss: Loss::Squares,
            patience: 0,
            damping: 0.0,
            curved: false,
        }
    }
}

/// Where the steps from one start ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The states.
    pub x: Vec<f64>,
    /// Sum of the squares, or twice the robust loss, priors included.
    pub chi2: f64,
    /// Steps taken.
    pub iterations: u32,
    /// Whether the next step would be short enough, and the held functions are at
    /// their values.
    pub converged: bool,
    /// Whether the held functions are at their values: with that chi2 is a limit on the
    /// least one, converged or not.
    pub held: bool,
    /// Whether the rows at the end have full rank, with the held functions.
    pub determined: bool,
    /// By how much chi2 changes as the value of each held function does.
    pub slopes: Vec<f64>,
}

/// A rise of chi2 that tells two states apart: about the 95 % point with one degree of freedom.
const TELLS: f64 = 4.0;

/// What part of a step tells how the model curves along it.
const AHEAD: f64 = 0.1;
/// How much longer the curvature can make a step.
const LONGER: f64 = 2.0;

/// An exact number is met where so much of its deviation is left, itself next to nothing.
const EXACT: f64 = 1e-6;

/// A function to hold, and the value it is held at.
pub type Hold<'a> = (&'a dyn Function, f64);

/// Minimises chi2 from `start`, each function of `hold` held at its value.
///
/// The same start gives the same bits. Where the model has no value at the start, chi2
/// is infinite.
///
/// ```
/// use gramian::solve::{self, Model};
/// # struct Beacons;
/// # impl Model for Beacons {
/// #     type Error = ();
/// #     fn states(&self) -> usize { 2 }
/// #     fn measurements(&self) -> usize { 2 }
/// #     fn linearize(&self, x: &[f64], r: &mut [f64], rows: Option<&mut [f64]>) -> Result<(), ()> {
/// #         let d = [x[0].hypot(x[1]), (x[0] - 100.0).hypot(x[1])];
/// #         r.copy_from_slice(&[50.0 - d[0], 67.082_039_324_993_7 - d[1]]);
/// #         if let Some(rows) = rows {
/// #             let c = [x[0] / d[0], x[1] / d[0], (x[0] - 100.0) / d[1], x[1] / d[1]];
/// #             rows.copy_from_slice(&c);
/// #         }
/// #         Ok(())
/// #     }
/// #     fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), ()> { Ok(()) }
/// # }
/// // Ranges to beacons at (0, 0) and (100, 0).
/// let found = solve::minimize(&Beacons, &[30.0, 50.0], &[], solve::Options::default());
/// assert!(found.converged);
/// assert!((found.x[0] - 40.0).abs() < 1e-9 && (found.x[1] - 30.0).abs() < 1e-9);
/// ```
pub fn minimize<M: Model + ?Sized>(
    model: &M,
    start: &[f64],
    hold: &[Hold<'_>],
    options: Options,
) -> Solution {
    Work::new(model, hold, options).descend(start, &mut |_| false)
}

/// As [`minimize`] without held functions, ended early where `enough` says so of a stage:
/// not converged then.
pub fn minimize_until<M: Model + ?Sized>(
    model: &M,
    start: &[f64],
    options: Options,
    enough: &mut Enough<'_>,
) -> Solution {
    Work::new(model, &[], options).descend(start, enough)
}

/// A state that the steps come through.
pub struct Stage<'a> {
    /// The state.
    pub x: &'a [f64],
    /// The residuals there, unweighted.
    pub residuals: &'a [f64],
    /// Their sum of squares, or twice the robust loss.
    pub chi2: f64,
    /// The undamped step from it.
    pub step: &'a [f64],
}

/// Whether the steps may end at a stage.
pub type Enough<'a> = dyn FnMut(&Stage<'_>) -> bool + 'a;

/// The state at which a model was linearised last, reduced.
struct Work<'a, M: ?Sized> {
    model: &'a M,
    hold: &'a [Hold<'a>],
    options: Options,
    residuals: Vec<f64>,
    rows: Vec<f64>,
    /// What is missing at each held function, then at each exact number, and its gradient.
    missing: Vec<f64>,
    gradients: Vec<f64>,
    /// The squares of what is missing at the exact numbers.
    off: f64,
    scale: Vec<f64>,
    /// The residuals and rows where a curved step begins, and the residuals ahead.
    here: (Vec<f64>, Vec<f64>),
    ahead: Vec<f64>,
}

/// Rows and residuals of one linearisation, as small as they can be made.
struct Reduced {
    /// Orthogonal basis of the scaled states: first those that move what is held.
    basis: Vec<Vec<f64>>,
    /// The triangular factor of the rows along the basis, residuals as last column.
    factor: Vec<f64>,
    /// Which of what is held moves along the first basis vectors, k of them: the others are
    /// held with these, or do not change here.
    active: Vec<usize>,
    /// The triangular k x k matrix of their gradients along these vectors.
    lower: Vec<f64>,
}

impl Reduced {
    /// The step along the first basis vectors that brings what is held to its values.
    fn restore(&self, missing: &[f64]) -> Vec<f64> {
        let k = self.active.len();
        let mut step = vec![0.0; k];
        for (i, &held) in self.active.iter().enumerate() {
            let lower = &self.lower[i * k..][..=i];
            step[i] = (missing[held] - dot(&lower[..i], &step[..i])) / lower[i];
        }
        step
    }
}

impl<'a, M: Model + ?Sized> Work<'a, M> {
    fn new(model: &'a M, hold: &'a [Hold<'a>], options: Options) -> Self {
        let (m, n) = (model.measurements(), model.states());
        let held = hold.len() + model.exact().len();
        Self {
            model,
            hold,
            options,
            residuals: vec![0.0; m],
            rows: vec![0.0; m * n],
            missing: vec![0.0; held],
            gradients: vec![0.0; held * n],
            off: 0.0,
            scale: vec![0.0; n],
            here: (Vec::new(), Vec::new()),
            ahead: vec![0.0; m],
        }
    }

    /// Sum of the losses at a state, without what is exact, rows kept for the reduction;
    /// infinite where there is no value. `missing` is set too.
    fn visit(&mut self, x: &[f64]) -> f64 {
        let n = x.len();
        let rows = Some(&mut self.rows[..]);
        if self.model.linearize(x, &mut self.residuals, rows).is_err() {
            return f64::INFINITY;
        }
        for (k, (function, value)) in self.hold.iter().enumerate() {
            let gradient = &mut self.gradients[k * n..][..n];
            self.missing[k] = value - function.value(x, gradient);
        }
        let exact = self.model.exact();
        let place = self.hold.len();
        self.missing[place..].copy_from_slice(&self.residuals[exact.clone()]);
        self.gradients[place * n..].copy_from_slice(&self.rows[exact.start * n..exact.end * n]);
        self.off = dot(&self.missing[place..], &self.missing[place..]);
        let chi2: f64 = self
            .residuals
            .iter()
            .enumerate()
            .filter(|(i, _)| !exact.contains(i))
            .map(|(i, &r)| self.loss(i).at(r).0)
            .sum();
        let sound = chi2.is_finite() && self.missing.iter().all(|c| c.is_finite());
        if sound { chi2 } else { f64::INFINITY }
    }

    /// How a whitened number counts: what is known beforehand by its square.
    fn loss(&self, i: usize) -> Loss {
        if i < self.residuals.len() - self.model.priors() {
            self.options.loss
        } else {
            Loss::Squares
        }
    }

    fn reduce(&mut self) -> Reduced {
        let n = self.model.states();
        let wide = n + 1;
        let exact = self.model.exact();
        let mut stack = vec![0.0; self.residuals.len().max(wide) * wide];
        for (i, &r) in self.residuals.iter().enumerate() {
            if exact.contains(&i) {
                continue;
            }
            let weight = self.loss(i).at(r).1.sqrt();
            let line = &mut stack[i * wide..][..wide];
            for (to, from) in line.iter_mut().zip(&self.rows[i * n..][..n]) {
                *to = weight * from;
            }
            line[n] = weight * r;
        }
        triangularize(&mut stack, wide, &mut vec![0.0; wide]);
        stack.truncate(wide * wide);
        // The units of the states do not matter: columns of length one.
        for j in 0..n {
            let length = (0..=j)
                .map(|i| stack[i * wide + j])
                .fold(0.0_f64, f64::hypot);
            if length > 0.0 && length.is_finite() {
                self.scale[j] = 1.0 / length;
            } else if !(self.scale[j] > 0.0) {
                // Only what is exact shows it: as much there as the others.
                self.scale[j] = f64::NAN;
            }
        }
        for j in 0..n {
            if self.scale[j].is_nan() {
                self.scale[j] = self.as_the_others(j);
            }
            for i in 0..=j {
                stack[i * wide + j] *= self.scale[j];
            }
        }
        let (basis, active, lower) = self.basis();
        let k = active.len();
        let mut factor = vec![0.0; wide * wide];
        if k == 0 {
            factor.copy_from_slice(&stack);
        } else {
            for i in 0..wide {
                for j in 0..n {
                    factor[i * wide + j] = (i..n).map(|l| stack[i * wide + l] * basis[j][l]).sum();
                }
                factor[i * wide + n] = stack[i * wide + n];
            }
        }
        Reduced {
            basis,
            factor,
            active,
            lower,
        }
    }

    /// The scale with which a state moves what is held as much as the others do at most.
    fn as_the_others(&self, j: usize) -> f64 {
        let n = self.scale.len();
        for gradient in self.gradients.chunks_exact(n) {
            let most = gradient
                .iter()
                .zip(&self.scale)
                .map(|(g, s)| (g * s).abs())
                .fold(0.0, f64::max);
            let scale = most / gradient[j].abs();
            if scale > 0.0 && scale.is_finite() {
                return scale;
            }
        }
        1.0
    }

    /// An orthonormal basis of the scaled states whose first vectors span the gradients
    /// of what is held, by Gram-Schmidt, twice; whose gradients these are, and along it.
    fn basis(&mut self) -> (Vec<Vec<f64>>, Vec<usize>, Vec<f64>) {
        let n = self.scale.len();
        let mut basis: Vec<Vec<f64>> = Vec::with_capacity(n);
        let (mut active, mut lines) = (Vec::new(), Vec::new());
        if self.missing.is_empty() {
            return (basis, active, Vec::new());
        }
        let unit = |j: usize| {
            let mut unit = vec![0.0; n];
            unit[j] = 1.0;
            unit
        };
        for (held, gradient) in self.gradients.chunks_exact(n).enumerate() {
            let mut vector: Vec<f64> = gradient
                .iter()
                .zip(&self.scale)
                .map(|(g, s)| g * s)
                .collect();
            let length = norm(&vector);
            let mut line = vec![0.0; basis.len()];
            for _ in 0..2 {
                for (line, other) in line.iter_mut().zip(&basis) {
                    let along = dot(&vector, other);
                    *line += along;
                    add(&mut vector, -along, other);
                }
            }
            let left = norm(&vector);
            // Held twice, or a function that does not change here. Exact numbers that repeat
            // each other do so up to the errors of their derivatives.
            let least = if held < self.hold.len() { 1e-12 } else { 1e-7 };
            if !(left > least * length) || basis.len() == n {
                continue;
            }
            for v in &mut vector {
                *v /= left;
            }
            line.push(left);
            lines.push(line);
            active.push(held);
            basis.push(vector);
        }
        let k = active.len();
        let mut lower = vec![0.0; k * k];
        for (to, line) in lower.chunks_exact_mut(k.max(1)).zip(&lines) {
            to[..line.len()].copy_from_slice(line);
        }
        // The rest from the unit vectors that stick out most.
        while basis.len() < n {
            let mut best: Option<Vec<f64>> = None;
            for j in 0..n {
                let mut vector = unit(j);
                for _ in 0..2 {
                    for other in &basis {
                        let along = dot(&vector, other);
                        add(&mut vector, -along, other);
                    }
                }
                if best.as_ref().is_none_or(|b| norm(&vector) > norm(b)) {
                    best = Some(vector);
                }
            }
            let mut vector = best.unwrap_or_default();
            let length = norm(&vector);
            if length > 0.0 {
                for v in &mut vector {
                    *v /= length;
                }
            }
            basis.push(vector);
        }
        (basis, active, lower)
    }

    /// How many times a damped step from `x`, of scaled states, is best taken. The residuals
    /// after t times the step are r - t a - t^2 b up to the third order: without b the best t
    /// is 1, with it 1 / (1 + (a . b) / (a . a)), where damping is part of a . a.
    ///
    /// # Source
    /// Halley's method along a line; the second order of least squares along a step is that of
    /// Transtrum & Sethna 2012, Improvements to the Levenberg-Marquardt algorithm, section 2.3.
    fn reach(&mut self, x: &[f64], step: &[f64], damping: f64) -> f64 {
        let n = x.len();
        let step: Vec<f64> = step.iter().zip(&self.scale).map(|(s, c)| s * c).collect();
        let mut place: Vec<f64> = x.iter().zip(&step).map(|(x, s)| x + AHEAD * s).collect();
        self.model.retract(&mut place);
        if self.model.linearize(&place, &mut self.ahead, None).is_err() {
            return 1.0;
        }
        let scaled: f64 = step
            .iter()
            .zip(&self.scale)
            .map(|(s, c)| (s / c).powi(2))
            .sum();
        let (mut square, mut product) = (damping * scaled, 0.0);
        let lines = self.here.0.iter().zip(self.here.1.chunks_exact(n));
        for (i, ((here, row), ahead)) in lines.zip(&self.ahead).enumerate() {
            let weight = self.loss(i).at(*here).1;
            let slope = dot(row, &step);
            let curvature = (here - ahead) / (AHEAD * AHEAD) - slope / AHEAD;
            square += weight * slope * slope;
            product += weight * slope * curvature;
        }
        let share = product / square;
        if share.is_finite() {
            1.0 / (1.0 + share.max(1.0 / LONGER - 1.0))
        } else {
            1.0
        }
    }

    #[allow(clippy::too_many_lines)] // One loop, whose parts share all they have.
    fn descend(&mut self, start: &[f64], enough: &mut Enough<'_>) -> Solution {
        let (n, held) = (start.len(), self.hold.len());
        let wide = n + 1;
        let mut x = start.to_vec();
        self.model.retract(&mut x);
        let mut chi2 = self.visit(&x);
        let mut off = self.off;
        let mut found = Solution {
            x: x.clone(),
            chi2: chi2 + off,
            iterations: 0,
            converged: false,
            held: false,
            determined: false,
            slopes: vec![0.0; held],
        };
        if !chi2.is_finite() {
            return found;
        }
        let mut damping = self.options.damping;
        let curved = self.options.curved && self.missing.is_empty();
        let mut penalty = vec![0.0_f64; self.missing.len()];
        let mut least: Option<Vec<f64>> = None;
        let mut next = vec![0.0; n];
        let (mut before, mut off_before) = (f64::INFINITY, f64::INFINITY);
        let (mut relax, mut last) = (1.0, vec![0.0; n]);
        let mut progress = Progress::new(&x, chi2, self.options);
        loop {
            let reduced = self.reduce();
            let missing = self.missing.clone();
            let k = reduced.active.len();
            let free = n - k;
            let step = reduced.restore(&missing);
            // Along the others: the rows there, and what the first part leaves.
            let narrow = free + 1;
            let mut small = vec![0.0; wide.max(narrow) * narrow];
            for i in 0..wide {
                let row = &reduced.factor[i * wide..][..wide];
                let line = &mut small[i * narrow..][..narrow];
                line[..free].copy_from_slice(&row[k..n]);
                line[free] = row[n] - dot(&row[..k], &step);
            }
            triangularize(&mut small, narrow, &mut vec![0.0; narrow]);
            small.truncate(narrow * narrow);
            let gain: f64 = (0..free).map(|i| small[i * narrow + free].powi(2)).sum();
            // The multipliers after the whole step: at the first one chi2 may be level.
            let tail = damped(&small, free, 0.0);
            let slopes = slopes(&reduced, &[&step[..], &tail].concat(), missing.len());
            // Steps that swing to and fro, or creep, are shortened or lengthened by the
            // ratio of the last two (Aitken's relaxation, Irons & Tuck 1969).
            let whole = along(&reduced.basis, k, &tail);
            let size = dot(&last, &last);
            if size > 0.0 {
                let ratio = dot(&whole, &last) / size;
                relax = if ratio < 0.9 {
                    (relax / (1.0 - ratio)).clamp(0.3, 4.0)
                } else if ratio > 1.5 && held == 0 {
                    // Out to where there may be no minimum.
                    (2.0 * relax).min(4.0)
                } else {
                    1.0
                };
            }
            if held == 0 {
                let mut step = whole.clone();
                for (part, vector) in reduced.restore(&missing).iter().zip(&reduced.basis) {
                    add(&mut step, *part, vector);
                }
                let step: Vec<f64> = step.iter().zip(&self.scale).map(|(w, s)| w * s).collect();
                let stage = Stage {
                    x: &x,
                    residuals: &self.residuals,
                    chi2: chi2 + off,
                    step: &step,
                };
                if enough(&stage) {
                    break;
                }
            }
            last.clone_from(&whole);
            // Where chi2 is level the multipliers are next to nothing: what is missing at first,
            // by more than a deviation, is worth as much as a rise of chi2 that tells states
            // apart, or no step would seem to pay.
            let place = |i: usize| reduced.active.iter().position(|&a| a == i);
            let least = least.get_or_insert_with(|| {
                (0..missing.len())
                    .map(|i| match place(i) {
                        Some(p) if step[p].abs() > 1.0 => TELLS / missing[i].abs(),
                        _ => 0.0,
                    })
                    .collect()
            });
            for ((mu, slope), least) in penalty.iter_mut().zip(&slopes).zip(least) {
                *mu = (0.5 * *mu).max(2.0 * slope.abs()).max(*least);
            }
            found.determined = full_rank(&small, free);
            found.held = (0..held).all(|i| {
                missing[i].abs() <= 1e-12 * self.hold[i].1.abs()
                    || place(i).is_some_and(|p| step[p].abs() < 1e-7)
            });
            // Exact ones as close as they come: at the floor of rounding, no step is nearer.
            // Where they contradict each other, or what is held, chi2 tells.
            let near = |i: &usize| *i < held || missing[*i].abs() < EXACT;
            let floor = off >= 0.25 * off_before && off < 1e4 * EXACT * EXACT;
            let close = found.held && (floor || reduced.active.iter().all(near));
            off_before = off;
            found.slopes = slopes[..held].to_vec();
            let tolerance = self.options.tolerance * self.options.tolerance;
            // Below this, chi2 itself has no digits to tell.
            let rounding = 1e-15 * chi2;
            if found.determined && close && gain <= tolerance.max(1e-15 * rounding) {
                found.converged = true;
                break;
            }
            if !found.determined {
                damping = damping.max(1e-9);
            }
            let merit = |chi2: f64, missing: &[f64]| {
                chi2 + dot(
                    &penalty,
                    &missing.iter().map(|c| c.abs()).collect::<Vec<_>>(),
                )
            };
            let old = merit(chi2, &missing);
            let asked = damping;
            if curved {
                self.here.0.clone_from(&self.residuals);
                self.here.1.clone_from(&self.rows);
            }
            let mut shrink = 1.0;
            let taken = loop {
                if found.iterations >= self.options.max_iterations {
                    break false;
                }
                found.iterations += 1;
                // Held functions: the whole step is cut, as its first part alone leads up.
                let factor = match (k, damping == 0.0) {
                    (0, true) => relax,
                    (0, false) => 1.0,
                    (_, true) => relax * shrink,
                    (_, false) => shrink,
                };
                let mut tail = damped(&small, free, damping);
                let reach = if curved && damping > 0.0 {
                    self.reach(&x, &tail, damping)
                } else {
                    1.0
                };
                for t in &mut tail {
                    *t *= factor * reach;
                }
                let mut y = vec![0.0; n];
                if k == 0 {
                    y.copy_from_slice(&tail);
                } else {
                    for (part, vector) in step
                        .iter()
                        .map(|s| s * shrink)
                        .chain(tail.iter().copied())
                        .zip(&reduced.basis)
                    {
                        add(&mut y, part, vector);
                    }
                }
                let mut moved = false;
                for j in 0..n {
                    next[j] = x[j] + y[j] * self.scale[j];
                    moved |= next[j] != x[j];
                }
                if !moved {
                    // Not one digit of the state would change.
                    found.converged = close && (gain <= 1e-6 || damping == 0.0);
                    break false;
                }
                self.model.retract(&mut next);
                let mut trial = self.visit(&next);
                let most = old + 1e-13 * (1.0 + chi2);
                let good = |trial: f64, missing: &[f64]| {
                    trial.is_finite() && merit(trial, missing) <= most
                };
                if k > 0 && shrink == 1.0 && trial.is_finite() && !good(trial, &self.missing) {
                    // What bends away along the step, brought back.
                    let back = reduced.restore(&self.missing);
                    for (part, vector) in back.iter().zip(&reduced.basis) {
                        for ((x, v), s) in next.iter_mut().zip(vector).zip(&self.scale) {
                            *x += part * v * s;
                        }
                    }
                    self.model.retract(&mut next);
                    found.iterations += 1;
                    trial = self.visit(&next);
                }
                if good(trial, &self.missing) {
                    progress.note(&x, &next, trial);
                    x.copy_from_slice(&next);
                    (chi2, off) = (trial, self.off);
                    break true;
                }
                if held == 0 && close && damping == 0.0 && gain <= 1e-10 {
                    if relax == 1.0 {
                        // A step that chi2 has no digits to judge: of measured distances
                        // of 20 000 km, for one.
                        found.converged = true;
                        break false;
                    }
                    // First the plain step, without relaxation.
                    relax = 1.0;
                    last.fill(0.0);
                    continue;
                }
                if k == 0 || shrink < 1e-3 {
                    damping = (damping * 8.0).max(1e-4);
                }
                relax = 1.0;
                last.fill(0.0);
                shrink *= 0.5;
                if damping > 1e16 {
                    found.converged = close && gain <= 1e-6;
                    break false;
                }
            };
            if !taken {
                break;
            }
            // At the floor of rounding the gain stops falling.
            if close && gain < 1e-10 && gain >= 0.5 * before && gain <= 1e-13 * (1.0 + chi2) {
                found.converged = true;
            }
            before = gain;
            // From afar: what the last step needed, the next one will need too.
            if self.options.damping == 0.0 || damping <= asked {
                damping = if damping < 1e-6 { 0.0 } else { damping * 0.125 };
            }
            if found.converged || progress.ended(found.iterations, chi2, held > 0) {
                break;
            }
        }
        found.x = x;
        found.chi2 = chi2 + off;
        found
    }
}

/// Whether steps still lead somewhere.
struct Progress {
    start: Vec<f64>,
    /// chi2 before the first of the steps that each went farther from the start, by a good
    /// part of the way so far; and how many these are.
    level: f64,
    farther: u32,
    /// Steps and chi2 when patience began.
    since: (u32, f64),
    patience: u32,
}

/// So many steps of that kind, that hardly lower chi2, end nowhere.
const FARTHER: u32 = 6;
/// Patience ends with steps that lower chi2 by less than this share of it.
const STALL: f64 = 1e-6;

impl Progress {
    fn new(start: &[f64], chi2: f64, options: Options) -> Self {
        Self {
            start: start.to_vec(),
            level: chi2,
            farther: 0,
            since: (0, chi2),
            patience: options.patience,
        }
    }

    /// Takes note of a step.
    fn note(&mut self, from: &[f64], to: &[f64], chi2: f64) {
        let goes = from.iter().zip(to).zip(&self.start).any(|((a, b), s)| {
            (b - s).abs() > 1.3 * (a - s).abs() && (a - s).abs() > 1e-3 * s.abs()
        });
        if goes && self.level - chi2 < 1e-5 * (1.0 + chi2) {
            self.farther += 1;
        } else {
            self.farther = 0;
            self.level = chi2;
        }
    }

    /// Whether chi2 is level farther and farther out, where it has no minimum, or patience
    /// is at an end.
    fn ended(&mut self, steps: u32, chi2: f64, held: bool) -> bool {
        if !held && self.farther >= FARTHER {
            return true;
        }
        if self.patience == 0 || steps < self.since.0 + self.patience {
            return false;
        }
        let stalled = self.since.1 - chi2 < STALL * (1.0 + chi2);
        self.since = (steps, chi2);
        stalled
    }
}

/// A step along the last vectors of a basis; along the states where there is none.
fn along(basis: &[Vec<f64>], k: usize, tail: &[f64]) -> Vec<f64> {
    if k == 0 {
        return tail.to_vec();
    }
    let mut whole = vec![0.0; basis.len()];
    for (part, vector) in tail.iter().zip(&basis[k..]) {
        add(&mut whole, *part, vector);
    }
    whole
}

/// The multipliers after a step along the basis: the gradient of chi2 along its first
/// vectors is that of the held functions times these.
fn slopes(reduced: &Reduced, step: &[f64], count: usize) -> Vec<f64> {
    let (n, k) = (step.len(), reduced.active.len());
    let wide = n + 1;
    let left: Vec<f64> = reduced
        .factor
        .chunks_exact(wide)
        .map(|row| row[n] - dot(&row[..n], step))
        .collect();
    let mut slopes = vec![0.0; count];
    for i in (0..k).rev() {
        let column = reduced.factor.iter().skip(i).step_by(wide);
        let along: f64 = -2.0 * column.zip(&left).map(|(r, l)| r * l).sum::<f64>();
        let later: f64 = (i + 1..k)
            .map(|j| reduced.lower[j * k + i] * slopes[reduced.active[j]])
            .sum();
        slopes[reduced.active[i]] = (along - later) / reduced.lower[i * k + i];
    }
    slopes
}

/// Whether a triangular factor with the residuals as last column has full rank.
fn full_rank(factor: &[f64], n: usize) -> bool {
    let wide = n + 1;
    (0..n).all(|j| {
        let length = (0..=j)
            .map(|i| factor[i * wide + j])
            .fold(0.0_f64, f64::hypot);
        factor[j * wide + j].abs() > 1e-13 * length
    })
}

/// The step that minimises |R p - c|^2 + damping |p|^2, from the factor [R c].
fn damped(factor: &[f64], n: usize, damping: f64) -> Vec<f64> {
    let wide = n + 1;
    let mut r = factor.to_vec();
    if damping > 0.0 {
        let mut row = vec![0.0; wide];
        for j in 0..n {
            row.fill(0.0);
            row[j] = damping.sqrt();
            rotate_in(&mut r, &mut row);
        }
    }
    let mut p = vec![0.0; n];
    for i in (0..n).rev() {
        let later: f64 = (i + 1..n).map(|j| r[i * wide + j] * p[j]).sum();
        let pivot = r[i * wide + i];
        if pivot != 0.0 {
            p[i] = (r[i * wide + n] - later) / pivot;
        }
    }
    p
}

pub(super) fn norm(a: &[f64]) -> f64 {
    a.iter().fold(0.0, |sum: f64, &x| sum.hypot(x))
}

fn add(to: &mut [f64], factor: f64, from: &[f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += factor * from;
    }
}
