//! Estimators of registration biases from the reports of all sensors.
//!
//! Three of them, by one mechanism: each look is a set of linear equations in
//! the target's position and the biases, the position is eliminated by an
//! orthogonal transformation, and the rows that are left are solved for all
//! looks together.
//!
//! - Least squares: in metres, unweighted, linearised at the reports.
//! - Generalised least squares: weighted by the noise, linearised at the reports.
//! - Maximum likelihood: Gauss-Newton over biases and all positions. It alone is
//!   free of the error that noise in the linearisation makes.
//!
//! What cannot be told is found by the rank of the rows and, since reports put
//! even a target on a singular track a little beside it, by a second look at the
//! weakest directions. Information along a direction is not believed where the
//! noise of the positions would make most of it by itself (a target along the
//! baseline), nor where it changes much within the direction's own deviation (a
//! target abeam a sensor: an error of the biases turns the track out of the
//! singular line, and so seems to be seen). The verdict always comes from the
//! likeliest positions, whichever estimator gives the biases.
//!
//! ```
//! use gramian::registration::Layout;
//! use gramian::registration::estimate::{Estimator, Method, Question, Status};
//! let sensors = [0.0, 0.0, 60e3, 0.0];
//! // The second radar measures 100 m too much; a target crosses over them.
//! let mut reports = Vec::new();
//! for k in 0..50 {
//!     let (x, y) = (-20e3 + 2e3 * f64::from(k), 30e3);
//!     reports.extend([x.hypot(y), x.atan2(y)]);
//!     let x = x - 60e3;
//!     reports.extend([x.hypot(y) + 100.0, x.atan2(y)]);
//! }
//! let question = Question {
//!     layout: Layout::PAIR,
//!     sensors: &sensors,
//!     sigma: &[50.0, 1.7e-3, 50.0, 1.7e-3],
//!     prior: None,
//!     method: Method::MaximumLikelihood,
//!     iterations: 20,
//!     tolerance: 1e-6,
//!     noise_share: 0.5,
//!     bend: 0.05,
//! };
//! let mut estimator = Estimator::new(Layout::PAIR, 50).unwrap();
//! let answer = estimator.run(&question, &reports).unwrap();
//! assert_eq!(answer.status, Status::Determined);
//! assert!((estimator.biases()[2] - 100.0).abs() < 0.01);
//! ```

use alloc::vec;
use alloc::vec::Vec;

use super::look::{reduce, unchecked_linearise, unchecked_place, width};
use super::{Error, Layout, MOST};
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length, check_positive};
use crate::spectrum::{decompose, default_rtol, rank, unit_columns};
use crate::square_root::{reflect, triangularize};

/// Which estimator.
///
/// # Source
/// Least squares: Zhu, Tang & He 2013. The weighted one and the likelihood are ours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Unweighted, in metres.
    LeastSquares,
    /// Weighted by the noise of the reports.
    Generalised,
    /// Positions and biases together, at the likeliest.
    MaximumLikelihood,
}

/// How an answer came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Everything is determined.
    Determined,
    /// The iteration did not end.
    NoConvergence,
    /// Some combination of biases is determined neither by these looks nor by a prior.
    Unobservable,
}

/// What is asked.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a, T> {
    /// Which biases there are.
    pub layout: Layout,
    /// Positions of the sensors, d numbers each.
    pub sensors: &'a [T],
    /// Deviations, d numbers for each sensor.
    pub sigma: &'a [T],
    /// Deviation of each bias known beforehand (mean 0); infinite for none.
    pub prior: Option<&'a [T]>,
    /// Which estimator.
    pub method: Method,
    /// How many linearisations at most.
    pub iterations: usize,
    /// A step below this many standard deviations ends the iteration.
    pub tolerance: T,
    /// Information of which more than this share is made by the noise of the
    /// positions is none; 0.5 is a good choice.
    pub noise_share: T,
    /// Nor is information that grows by more than this share, on average, from
    /// the answer to one deviation away along its own direction; 0.05. Parts of
    /// both limits add up.
    pub bend: T,
}

/// What came out, beside the arrays in [`Estimator`].
#[derive(Clone, Copy, Debug)]
pub struct Answer<T> {
    /// How it came out.
    pub status: Status,
    /// Linearisations made.
    pub iterations: usize,
    /// Sum of the squared residuals over their deviations.
    pub chi_square: T,
    /// How many combinations of biases the reports do not determine; only the
    /// prior does then, if there is one.
    pub nullity: usize,
    /// Share of the weakest direction's information that noise makes.
    pub noise_share: T,
    /// Growth of that information one deviation away along the direction.
    pub bend: T,
}

/// How far the information along a direction is to be believed.
#[derive(Clone, Copy, Debug)]
struct Doubt<T> {
    noise_share: T,
    bend: T,
}

/// Scratch space and results of an estimation, made once for many runs.
#[derive(Clone, Debug)]
pub struct Estimator<T> {
    layout: Layout,
    looks: usize,
    biases: Vec<T>,
    positions: Vec<T>,
    covariance: Vec<T>,
    directions: Vec<T>,
    lines: Vec<T>,
    tops: Vec<T>,
    stack: Vec<T>,
    step: Vec<T>,
    moves: Vec<T>,
    spare: Vec<T>,
    spectrum: Solver<T>,
}

/// Solution of a triangular system through its spectrum.
#[derive(Clone, Debug)]
struct Solver<T> {
    n: usize,
    rank: usize,
    factor: Vec<T>,
    scale: Vec<T>,
    values: Vec<T>,
    vectors: Vec<T>,
    work: Vec<T>,
}

impl<T: Real> Solver<T> {
    fn new(n: usize) -> Self {
        let square = || vec![T::zero(); n * n];
        let line = || vec![T::zero(); n];
        Self {
            n,
            rank: 0,
            factor: square(),
            scale: line(),
            values: line(),
            vectors: square(),
            work: square(),
        }
    }

    /// Takes the triangular factor from lines of length `c`.
    fn load(&mut self, stack: &[T], c: usize, rtol: T) {
        let n = self.n;
        for (row, line) in self.factor.chunks_exact_mut(n).zip(stack.chunks_exact(c)) {
            row.copy_from_slice(&line[..n]);
        }
        unit_columns(&self.factor, n, &mut self.scale);
        decompose(
            &self.factor,
            n,
            &self.scale,
            &mut self.values,
            &mut self.vectors,
            &mut self.work,
        );
        self.rank = rank(&self.values, rtol);
    }

    /// The shortest solution of R x = y, with y in column n of `stack`.
    fn solve(&self, stack: &[T], c: usize, out: &mut [T]) {
        let n = self.n;
        out.fill(T::zero());
        for k in 0..self.rank {
            let v = &self.vectors[k * n..(k + 1) * n];
            let mut along = T::zero();
            for i in 0..n {
                let u = (0..n).fold(T::zero(), |sum, j| {
                    sum + self.factor[i * n + j] * self.scale[j] * v[j]
                });
                along += u * stack[i * c + n];
            }
            let weight = along / self.values[k] / self.values[k];
            for i in 0..n {
                out[i] += self.scale[i] * v[i] * weight;
            }
        }
    }

    /// (R^T R)^-1 on what is determined.
    fn inverse(&self, out: &mut [T]) {
        let n = self.n;
        for i in 0..n {
            for j in 0..n {
                let sum = (0..self.rank).fold(T::zero(), |sum, k| {
                    let v = &self.vectors[k * n..(k + 1) * n];
                    sum + (v[i] / self.values[k]) * (v[j] / self.values[k])
                });
                out[i * n + j] = sum * self.scale[i] * self.scale[j];
            }
        }
    }
}

impl<T: Real> Estimator<T> {
    /// Space for `looks` looks.
    ///
    /// # Errors
    /// [`Error::Sensors`] for fewer than two.
    pub fn new(layout: Layout, looks: usize) -> Result<Self, Error> {
        if layout.sensors < 2 {
            return Err(Error::Sensors {
                given: layout.sensors,
            });
        }
        Ok(Self::sized(layout, looks))
    }

    pub(crate) fn sized(layout: Layout, looks: usize) -> Self {
        let (d, n, c) = (layout.size(), layout.states(), width(&layout));
        let measured = layout.sensors * d;
        let zeros = |count: usize| vec![T::zero(); count];
        Self {
            layout,
            looks,
            biases: zeros(n),
            positions: zeros(looks * d),
            covariance: zeros(n * n),
            directions: zeros(n * n),
            // Unweighted lines carry their noise in further columns.
            lines: zeros((measured + 1) * (c + measured)),
            tops: zeros(looks * d * c),
            stack: zeros((looks * layout.rows()).max(n + 1) * (n + 1) + n * (n + 1)),
            step: zeros(n),
            moves: zeros(looks * d),
            spare: zeros((ENOUGH * layout.rows()).max(n) * n),
            spectrum: Solver::new(n),
        }
    }

    /// The biases, sensor after sensor.
    pub fn biases(&self) -> &[T] {
        &self.biases
    }

    /// The targets' positions, look after look.
    pub fn positions(&self) -> &[T] {
        &self.positions
    }

    /// Covariance of the biases; where some are not determined, on the rest.
    pub fn covariance(&self) -> &[T] {
        &self.covariance
    }

    /// The combinations of biases that are not determined, one after the other
    /// ([`Answer::nullity`] of them), of length 1 in what each bias alone would
    /// be known to; the weakest first.
    pub fn directions(&self) -> &[T] {
        &self.directions
    }

    /// Estimates the biases from `reports`: for each look N d numbers.
    ///
    /// # Errors
    /// As [`Layout::check`]; [`NumberError::Length`] for reports or a prior that do not fit;
    /// [`Error::OnSensor`] and [`Error::Overhead`] where an estimated position is;
    /// [`Error::Number`] for what is not finite, a prior or limit that is not
    /// positive, and an estimate that exceeds the numbers of this type.
    pub fn run(&mut self, question: &Question<'_, T>, reports: &[T]) -> Result<Answer<T>, Error> {
        check_finite("reports", reports)?;
        for (name, value) in [
            ("tolerance", question.tolerance),
            ("noise_share", question.noise_share),
            ("bend", question.bend),
        ] {
            check_positive(name, value)?;
        }
        if let Some(prior) = question.prior {
            check_length("prior", prior.len(), self.layout.states())?;
            if let Some(given) = prior.iter().find(|&&s| !(s > T::zero())) {
                return Err(NumberError::OutOfRange {
                    name: "prior",
                    given: given.double(),
                    allowed: "> 0",
                }
                .into());
            }
        }
        let answer = self.answer(question, reports)?;
        let numbers = [answer.chi_square, answer.noise_share, answer.bend];
        if all_finite(&numbers)
            && all_finite(&self.biases)
            && all_finite(&self.positions)
            && all_finite(&self.covariance)
            && all_finite(&self.directions)
        {
            return Ok(answer);
        }
        Err(NumberError::Overflow { result: "estimate" }.into())
    }

    /// [`run`](Self::run) of what the caller has checked; an estimate that does not
    /// converge may end in NaN.
    pub(crate) fn answer(
        &mut self,
        question: &Question<'_, T>,
        reports: &[T],
    ) -> Result<Answer<T>, Error> {
        let layout = self.layout;
        layout.check(question.sensors, question.sigma)?;
        let wanted = self.looks.saturating_mul(layout.sensors * layout.size());
        check_length("reports", reports.len(), wanted)?;
        self.biases.fill(T::zero());
        if question.method == Method::MaximumLikelihood {
            self.mean_positions(question, reports);
            let (iterations, converged) = self.gauss_newton(question, reports)?;
            return self.assess(question, reports, iterations, converged);
        }
        let (iterations, converged) = self.linear(question, reports)?;
        let answer = self.assess(question, reports, iterations, converged)?;
        // Away from the likeliest positions a singular track may look as if it
        // were none, so the verdict is made there.
        let (biases, covariance) = (self.biases.clone(), self.covariance.clone());
        let positions = self.positions.clone();
        let likeliest = Question {
            method: Method::MaximumLikelihood,
            iterations: question.iterations.max(50),
            ..*question
        };
        self.biases.fill(T::zero());
        self.mean_positions(&likeliest, reports);
        let (_, settled) = self.gauss_newton(&likeliest, reports)?;
        let verdict = self.assess(&likeliest, reports, iterations, settled)?;
        self.biases = biases;
        self.covariance = covariance;
        self.positions = positions;
        Ok(Answer {
            iterations,
            chi_square: answer.chi_square,
            ..verdict
        })
    }

    fn mean_positions(&mut self, question: &Question<'_, T>, reports: &[T]) {
        let layout = self.layout;
        let (d, per, m) = (layout.size(), layout.per_sensor(), layout.sensors);
        let share = T::one() / T::of(m as f64);
        let mut one = [T::zero(); 3];
        for k in 0..self.looks {
            let p = &mut self.positions[k * d..(k + 1) * d];
            p.fill(T::zero());
            for s in 0..m {
                unchecked_place(
                    &layout,
                    &question.sensors[s * d..(s + 1) * d],
                    &self.biases[s * per..(s + 1) * per],
                    &reports[(k * m + s) * d..(k * m + s + 1) * d],
                    &mut one,
                );
                for i in 0..d {
                    p[i] += share * one[i];
                }
            }
        }
    }

    /// Rows of the prior below those of `used` lines; returns their squares.
    fn push_prior(&mut self, question: &Question<'_, T>, used: &mut usize) -> T {
        let n = self.layout.states();
        let mut cost = T::zero();
        let Some(prior) = question.prior else {
            return cost;
        };
        for i in 0..n {
            if prior[i].is_finite() {
                let line = &mut self.stack[*used * (n + 1)..(*used + 1) * (n + 1)];
                line.fill(T::zero());
                line[i] = T::one() / prior[i];
                line[n] = -self.biases[i] / prior[i];
                cost += line[n] * line[n];
                *used += 1;
            }
        }
        cost
    }

    fn reduce(&mut self, used: usize) {
        let n = self.layout.states();
        let rtol = default_rtol(used, n);
        let count = used.max(n + 1);
        self.stack[used * (n + 1)..count * (n + 1)].fill(T::zero());
        triangularize(&mut self.stack[..count * (n + 1)], n + 1, &mut self.lines);
        self.spectrum.load(&self.stack, n + 1, rtol);
    }

    fn gauss_newton(
        &mut self,
        question: &Question<'_, T>,
        reports: &[T],
    ) -> Result<(usize, bool), Error> {
        let layout = self.layout;
        let (d, n, c) = (layout.size(), layout.states(), width(&layout));
        let half = T::of(0.5);
        let mut before = T::INFINITY;
        let mut halvings = 0;
        for iteration in 0..question.iterations {
            let mut used = 0;
            let mut cost = self.linearise_all(question, reports, &mut used)?;
            cost += self.push_prior(question, &mut used);
            if !cost.is_finite() && halvings >= 20 {
                return Ok((iteration + 1, false));
            }
            if !(cost <= before * T::of(1.0 + 1e-10)) && halvings < 20 {
                // The step went too far: half way back.
                halvings += 1;
                for (x, s) in self.biases.iter_mut().zip(&mut self.step) {
                    *s *= half;
                    *x -= *s;
                }
                for (x, s) in self.positions.iter_mut().zip(&mut self.moves) {
                    *s *= half;
                    *x -= *s;
                }
                continue;
            }
            (before, halvings) = (cost, 0);
            self.reduce(used);
            self.spectrum.solve(&self.stack, n + 1, &mut self.step);
            let mut length = T::zero();
            for i in 0..n {
                let row = &self.spectrum.factor[i * n..(i + 1) * n];
                let along = along(row, &self.step);
                length += along * along;
            }
            for (x, s) in self.biases.iter_mut().zip(&self.step) {
                *x += *s;
            }
            for k in 0..self.looks {
                let top = &self.tops[k * d * c..(k + 1) * d * c];
                let delta = &mut self.moves[k * d..(k + 1) * d];
                for i in (0..d).rev() {
                    let line = &top[i * c..(i + 1) * c];
                    let mut rest = line[c - 1];
                    for (&b, &x) in line[d..d + n].iter().zip(&self.step) {
                        rest -= b * x;
                    }
                    for j in i + 1..d {
                        rest -= line[j] * delta[j];
                    }
                    delta[i] = rest / line[i];
                    length += (rest * rest) / T::of(self.looks as f64);
                }
                for i in 0..d {
                    self.positions[k * d + i] += delta[i];
                }
            }
            if length.sqrt() < question.tolerance {
                return Ok((iteration + 1, true));
            }
            // Still astray after two steps: is there anything to find?
            if iteration >= 2 && length > T::one() {
                let mut used = 0;
                self.linearise_all(question, reports, &mut used)?;
                self.reduce(used);
                let (nullity, _) = self.undetermined(question);
                self.without(question, nullity);
                if self.spectrum.rank < n {
                    return Ok((iteration + 1, false));
                }
            }
        }
        Ok((question.iterations, false))
    }

    /// Lines of all looks at the present positions and biases: the positions'
    /// part into `tops`, the biases' part into `stack`. Returns the sum of the
    /// squared residuals.
    fn linearise_all(
        &mut self,
        question: &Question<'_, T>,
        reports: &[T],
        used: &mut usize,
    ) -> Result<T, Error> {
        let layout = self.layout;
        let (d, n, c) = (layout.size(), layout.states(), width(&layout));
        let measured = layout.sensors * d;
        let mut cost = T::zero();
        for k in 0..self.looks {
            let (lines, work) = self.lines.split_at_mut(measured * c);
            cost += reduce(
                &layout,
                question.sensors,
                question.sigma,
                &self.biases,
                &self.positions[k * d..(k + 1) * d],
                Some(&reports[k * measured..(k + 1) * measured]),
                lines,
                work,
            )
            .map_err(|error| error.at(k))?;
            self.tops[k * d * c..(k + 1) * d * c].copy_from_slice(&lines[..d * c]);
            for line in lines[d * c..].chunks_exact(c) {
                self.stack[*used * (n + 1)..(*used + 1) * (n + 1)].copy_from_slice(&line[d..]);
                *used += 1;
            }
        }
        Ok(cost)
    }

    /// Least squares, linearised at the reports as corrected so far.
    fn linear(
        &mut self,
        question: &Question<'_, T>,
        reports: &[T],
    ) -> Result<(usize, bool), Error> {
        let layout = self.layout;
        let (d, n, c) = (layout.size(), layout.states(), width(&layout));
        let measured = layout.sensors * d;
        let weighted = question.method == Method::Generalised;
        let wide = if weighted { c } else { c + measured };
        let mut spread = vec![T::zero(); n * n];
        for iteration in 0..question.iterations.max(1) {
            self.mean_positions(question, reports);
            spread.fill(T::zero());
            let mut used = 0;
            for k in 0..self.looks {
                self.linear_look(question, reports, k, wide)?;
                let (lines, work) = self.lines.split_at_mut(measured * wide);
                for column in 0..d {
                    reflect(lines, wide, column, column, work);
                }
                let rest = &lines[d * wide..];
                for line in rest.chunks_exact(wide) {
                    self.stack[used * (n + 1)..(used + 1) * (n + 1)].copy_from_slice(&line[d..c]);
                    used += 1;
                }
                if !weighted {
                    for one in rest.chunks_exact(wide) {
                        for two in rest.chunks_exact(wide) {
                            let noise = one[c..]
                                .iter()
                                .zip(&two[c..])
                                .fold(T::zero(), |sum, (&x, &y)| sum + x * y);
                            for i in 0..n {
                                for j in 0..n {
                                    spread[i * n + j] += one[d + i] * noise * two[d + j];
                                }
                            }
                        }
                    }
                }
            }
            let _ = self.push_prior(question, &mut used);
            self.reduce(used);
            self.spectrum.solve(&self.stack, n + 1, &mut self.step);
            for (x, s) in self.biases.iter_mut().zip(&self.step) {
                *x += *s;
            }
            let small = (0..n).all(|i| {
                (self.step[i] * self.spectrum.values[self.spectrum.rank.saturating_sub(1)]).abs()
                    < question.tolerance * self.spectrum.scale[i]
            });
            if weighted && small && iteration > 0 {
                self.mean_positions(question, reports);
                return Ok((iteration + 1, true));
            }
        }
        if !weighted {
            self.unweighted_covariance(&spread);
        }
        self.mean_positions(question, reports);
        Ok((question.iterations.max(1), true))
    }

    /// The lines of look `k`, each sensor linearised where its own report puts
    /// the target; of length `wide`, in metres and with their noise if that has
    /// room for it, whitened otherwise.
    fn linear_look(
        &mut self,
        question: &Question<'_, T>,
        reports: &[T],
        k: usize,
        wide: usize,
    ) -> Result<(), Error> {
        let layout = self.layout;
        let (d, c) = (layout.size(), width(&layout));
        let (per, m) = (layout.per_sensor(), layout.sensors);
        let lines = &mut self.lines[..m * d * wide];
        let weighted = wide == c;
        lines.fill(T::zero());
        for s in 0..m {
            let own = s * d..(s + 1) * d;
            let bias = &self.biases[s * per..(s + 1) * per];
            let mut at = [T::zero(); 3];
            let report = &reports[(k * m + s) * d..(k * m + s + 1) * d];
            unchecked_place(
                &layout,
                &question.sensors[own.clone()],
                bias,
                report,
                &mut at,
            );
            let (sensor, sigma) = (&question.sensors[own.clone()], &question.sigma[own]);
            let linear = unchecked_linearise(&layout, sensor, sigma, bias, &at[..d])
                .map_err(|error| error.at(k))?;
            let inverse = inverse(&linear.position, d);
            let mut apart = [T::zero(); 3];
            for i in 0..d {
                apart[i] = at[i] - self.positions[k * d + i];
            }
            for q in 0..d {
                let line = &mut lines[(s * d + q) * wide..(s * d + q + 1) * wide];
                if weighted {
                    line[..d].copy_from_slice(&linear.position[q][..d]);
                    line[d + s * per..d + (s + 1) * per].copy_from_slice(&linear.bias[q][..per]);
                    line[c - 1] = dot(&linear.position[q], &apart);
                } else {
                    line[q] = T::one();
                    for j in 0..per {
                        let column = core::array::from_fn(|i| linear.bias[i][j]);
                        line[d + s * per + j] = dot(&inverse[q], &column);
                    }
                    line[c - 1] = apart[q];
                    line[c + s * d..c + (s + 1) * d].copy_from_slice(&inverse[q][..d]);
                }
            }
        }
        Ok(())
    }

    /// N^-1 (sum of H^T R H) N^-1: unweighted squares do not reach J^-1.
    fn unweighted_covariance(&mut self, spread: &[T]) {
        let n = self.layout.states();
        let mut normal = vec![T::zero(); n * n];
        self.spectrum.inverse(&mut normal);
        for i in 0..n {
            for j in 0..n {
                let mut sum = T::zero();
                for a in 0..n {
                    for b in 0..n {
                        sum += normal[i * n + a] * spread[a * n + b] * normal[b * n + j];
                    }
                }
                self.covariance[i * n + j] = sum;
            }
        }
    }

    /// Each position at its likeliest for the present biases.
    fn settle(&mut self, question: &Question<'_, T>, reports: &[T]) -> Result<(), Error> {
        let layout = self.layout;
        let (d, c) = (layout.size(), width(&layout));
        for _ in 0..2 {
            let mut used = 0;
            self.linearise_all(question, reports, &mut used)?;
            for k in 0..self.looks {
                let mut right = [T::zero(); 3];
                for i in 0..d {
                    right[i] = self.tops[(k * d + i + 1) * c - 1];
                }
                let delta = back_substitute(&self.tops[k * d * c..], c, d, right);
                for i in 0..d {
                    self.positions[k * d + i] += delta[i];
                }
            }
        }
        Ok(())
    }

    /// Rank, covariance and residuals at the answer.
    fn assess(
        &mut self,
        question: &Question<'_, T>,
        reports: &[T],
        iterations: usize,
        converged: bool,
    ) -> Result<Answer<T>, Error> {
        let n = self.layout.states();
        if question.method != Method::MaximumLikelihood {
            self.settle(question, reports)?;
        }
        let mut used = 0;
        let chi_square = self.linearise_all(question, reports, &mut used)?;
        self.reduce(used);
        let (nullity, doubt) = self.undetermined(question);
        self.without(question, nullity);
        if question.method != Method::LeastSquares {
            self.spectrum.inverse(&mut self.covariance);
        }
        // With a prior: what neither it nor the data determine.
        let status = if self.spectrum.rank < n {
            Status::Unobservable
        } else if converged {
            Status::Determined
        } else {
            Status::NoConvergence
        };
        Ok(Answer {
            status,
            iterations,
            chi_square,
            nullity,
            noise_share: doubt.noise_share,
            bend: doubt.bend,
        })
    }

    /// Leaves in the spectrum what the data determine, all but the `nullity`
    /// weakest directions, and the prior: noise must not narrow a prior.
    fn without(&mut self, question: &Question<'_, T>, nullity: usize) {
        let n = self.layout.states();
        if question.prior.is_none() {
            self.spectrum.rank = n - nullity;
            return;
        }
        for k in 0..n {
            let line = &mut self.stack[k * (n + 1)..(k + 1) * (n + 1)];
            line.fill(T::zero());
            if k < n - nullity {
                for i in 0..n {
                    line[i] = self.spectrum.values[k] * self.spectrum.vectors[k * n + i]
                        / self.spectrum.scale[i];
                }
            }
        }
        let mut used = n;
        self.push_prior(question, &mut used);
        self.reduce(used);
    }

    /// How many combinations are not determined, from the spectrum at hand,
    /// their directions, and the doubt about the weakest.
    fn undetermined(&mut self, question: &Question<'_, T>) -> (usize, Doubt<T>) {
        let n = self.layout.states();
        for k in 0..n {
            for i in 0..n {
                self.directions[(n - 1 - k) * n + i] =
                    self.spectrum.vectors[k * n + i] * self.spectrum.scale[i];
            }
        }
        let mut nullity = n - self.spectrum.rank;
        let mut weakest = (nullity > 0).then_some(Doubt {
            noise_share: T::one(),
            bend: T::one(),
        });
        while nullity < n {
            let doubt = self.doubt(question, nullity);
            let weakest = weakest.get_or_insert(doubt);
            // Each spoils what the other leaves.
            if doubt.noise_share / question.noise_share + doubt.bend / question.bend <= T::one() {
                return (nullity, *weakest);
            }
            nullity += 1;
        }
        let none = Doubt {
            noise_share: T::one(),
            bend: T::one(),
        };
        (nullity, weakest.unwrap_or(none))
    }

    /// The doubt about direction `index`: by how much its information grows on
    /// average when each position moves by its own deviation, over what was
    /// found; and by how much the information along the direction that is
    /// weakest *there* differs when the biases move by the direction's
    /// deviation, and the positions with them. (Along a fixed direction it would
    /// grow in any weak geometry, merely because the direction turns.)
    fn doubt(&mut self, question: &Question<'_, T>, index: usize) -> Doubt<T> {
        let layout = self.layout;
        let (d, n, c) = (layout.size(), layout.states(), width(&layout));
        let place = n - 1 - index;
        let direction: Vec<T> = self.directions[index * n..(index + 1) * n].to_vec();
        let deviation = T::one() / self.spectrum.values[place];
        let all = Doubt {
            noise_share: T::one(),
            bend: T::one(),
        };
        if !deviation.is_finite() {
            return all;
        }
        let (mut found, mut noise) = (T::zero(), T::zero());
        let half = T::of(0.5);
        let step: Vec<T> = direction.iter().map(|&v| v * deviation).collect();
        let still = vec![T::zero(); n];
        let mut stack = core::mem::take(&mut self.spare);
        for k in self.sample() {
            let mut deltas = [[T::zero(); 3]; 3];
            for a in 0..d {
                let mut unit = [T::zero(); 3];
                unit[a] = T::one();
                deltas[a] = back_substitute(&self.tops[k * d * c..], c, d, unit);
            }
            let mut information = |shift: [T; 3]| {
                let lines = self.look_at(question, k, &still, shift)?;
                let sum = lines.chunks_exact(c).fold(T::zero(), |sum, line| {
                    let along = along(&line[d..d + n], &direction);
                    sum + along * along
                });
                Some(sum)
            };
            let Some(here) = information([T::zero(); 3]) else {
                continue;
            };
            for delta in &deltas[..d] {
                let up = information(*delta).unwrap_or(here);
                let down = information(delta.map(|x| -x)).unwrap_or(here);
                noise += half * (up + down) - here;
            }
            found += here;
        }
        if !(found > T::zero()) {
            self.spare = stack;
            return all;
        }
        let mut weakest = [T::zero(); 3];
        for (value, sign) in weakest.iter_mut().zip([T::zero(), T::one(), -T::one()]) {
            let aside: Vec<T> = step.iter().map(|&v| sign * v).collect();
            let mut used = 0;
            for k in self.sample() {
                let mut right = [T::zero(); 3];
                for i in 0..d {
                    let line = &self.tops[(k * d + i) * c..(k * d + i + 1) * c];
                    right[i] = -along(&line[d..d + n], &aside);
                }
                let shift = back_substitute(&self.tops[k * d * c..], c, d, right);
                let Some(lines) = self.look_at(question, k, &aside, shift) else {
                    continue;
                };
                for line in lines.chunks_exact(c) {
                    stack[used * n..(used + 1) * n].copy_from_slice(&line[d..d + n]);
                    used += 1;
                }
            }
            stack[used * n..used.max(n) * n].fill(T::zero());
            triangularize(&mut stack[..used.max(n) * n], n, &mut self.lines);
            let mut solver = Solver::new(n);
            // On the scale at hand, so that the three are comparable.
            solver.scale.copy_from_slice(&self.spectrum.scale);
            decompose(
                &stack[..n * n],
                n,
                &solver.scale,
                &mut solver.values,
                &mut solver.vectors,
                &mut solver.work,
            );
            *value = solver.values[place] * solver.values[place];
        }
        self.spare = stack;
        let [here, up, down] = weakest;
        let bend = if here > T::zero() {
            half * (up + down) / here - T::one()
        } else {
            T::one()
        };
        Doubt {
            noise_share: (noise / found).clamp(T::zero(), T::one()),
            bend: bend.clamp(T::zero(), T::one()),
        }
    }

    /// Looks enough to judge by, spread over all.
    fn sample(&self) -> core::iter::StepBy<core::ops::Range<usize>> {
        (0..self.looks).step_by(self.looks.div_ceil(ENOUGH).max(1))
    }

    /// The lines on the biases of look `k`, with the biases and its position moved.
    fn look_at(
        &mut self,
        question: &Question<'_, T>,
        k: usize,
        aside: &[T],
        shift: [T; 3],
    ) -> Option<&[T]> {
        let layout = self.layout;
        let (d, c) = (layout.size(), width(&layout));
        let (lines, work) = self.lines.split_at_mut(layout.sensors * d * c);
        let mut moved = [T::zero(); 3];
        for i in 0..d {
            moved[i] = self.positions[k * d + i] + shift[i];
        }
        for (out, (&x, &v)) in self.step.iter_mut().zip(self.biases.iter().zip(aside)) {
            *out = x + v;
        }
        reduce(
            &layout,
            question.sensors,
            question.sigma,
            &self.step,
            &moved[..d],
            None,
            lines,
            work,
        )
        .ok()?;
        Some(&lines[d * c..])
    }
}

/// Looks enough to judge the information of a direction by.
const ENOUGH: usize = 64;

/// Solves the d x d triangle at the start of `top`, lines of length `c`.
fn back_substitute<T: Real>(top: &[T], c: usize, d: usize, right: [T; 3]) -> [T; 3] {
    let mut delta = [T::zero(); 3];
    for i in (0..d).rev() {
        let mut rest = right[i];
        for j in i + 1..d {
            rest -= top[i * c + j] * delta[j];
        }
        delta[i] = rest / top[i * c + i];
    }
    delta
}

fn along<T: Real>(row: &[T], direction: &[T]) -> T {
    row.iter()
        .zip(direction)
        .fold(T::zero(), |sum, (&r, &x)| sum + r * x)
}

fn dot<T: Real>(a: &[T; 3], b: &[T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The inverse of the leading d x d block.
fn inverse<T: Real>(m: &[[T; 3]; 3], d: usize) -> [[T; 3]; 3] {
    let mut out = [[T::zero(); 3]; 3];
    if d == 2 {
        let det = m[0][0] * m[1][1] - m[0][1] * m[1][0];
        out[0] = [m[1][1] / det, -m[0][1] / det, T::zero()];
        out[1] = [-m[1][0] / det, m[0][0] / det, T::zero()];
        return out;
    }
    let cross = |a: &[T; 3], b: &[T; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let columns = [
        cross(&m[1], &m[2]),
        cross(&m[2], &m[0]),
        cross(&m[0], &m[1]),
    ];
    let det = dot(&m[0], &columns[0]);
    for i in 0..3 {
        for j in 0..3 {
            out[i][j] = columns[j][i] / det;
        }
    }
    out
}

/// Reports of targets at `positions` with these biases and no noise: N d numbers
/// for each.
///
/// # Errors
/// [`Error::OnSensor`], [`Error::Overhead`], [`NumberError::Length`]; [`Error::Number`] for
/// what is not finite, or reports that exceed the numbers of this type.
pub fn report<T: Real>(
    layout: &Layout,
    sensors: &[T],
    biases: &[T],
    positions: &[T],
    out: &mut [T],
) -> Result<(), Error> {
    let d = layout.size();
    check_length("sensors", sensors.len(), layout.sensors.saturating_mul(d))?;
    check_length("biases", biases.len(), layout.states())?;
    let wanted = positions.len().next_multiple_of(d);
    check_length("positions", positions.len(), wanted)?;
    let wanted = positions.len().saturating_mul(layout.sensors);
    check_length("out", out.len(), wanted)?;
    check_finite("sensors", sensors)?;
    check_finite("biases", biases)?;
    check_finite("positions", positions)?;
    unchecked_report(layout, sensors, biases, positions, out)?;
    if all_finite(out) {
        return Ok(());
    }
    Err(NumberError::Overflow { result: "reports" }.into())
}

pub(crate) fn unchecked_report<T: Real>(
    layout: &Layout,
    sensors: &[T],
    biases: &[T],
    positions: &[T],
    out: &mut [T],
) -> Result<(), Error> {
    let (d, per, m) = (layout.size(), layout.per_sensor(), layout.sensors);
    let unit = [T::one(); MOST];
    for (k, p) in positions.chunks_exact(d).enumerate() {
        for s in 0..m {
            let sensor = &sensors[s * d..(s + 1) * d];
            let bias = &biases[s * per..(s + 1) * per];
            let linear =
                unchecked_linearise(layout, sensor, &unit, bias, p).map_err(
                    |error| match error {
                        Error::OnSensor { .. } => Error::OnSensor { look: k, sensor: s },
                        Error::Overhead { .. } => Error::Overhead { look: k, sensor: s },
                        other => other,
                    },
                )?;
            out[(k * m + s) * d..(k * m + s + 1) * d].copy_from_slice(&linear.measured[..d]);
        }
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::registration::Dimension;

    fn question<'a>(
        layout: Layout,
        sensors: &'a [f64],
        sigma: &'a [f64],
        method: Method,
    ) -> Question<'a, f64> {
        Question {
            layout,
            sensors,
            sigma,
            prior: None,
            method,
            iterations: 50,
            tolerance: 1e-6,
            noise_share: 0.5,
            bend: 0.05,
        }
    }

    #[test]
    fn without_noise_the_biases_come_out() {
        for (dimension, sensors) in [
            (Dimension::Plane, vec![0.0, 0.0, 60e3, 0.0]),
            (Dimension::Plane, vec![0.0, 0.0, 60e3, 0.0, 30e3, -20e3]),
            (Dimension::Space, vec![0.0, 0.0, 0.0, 60e3, 0.0, 300.0]),
        ] {
            let d = if dimension == Dimension::Plane { 2 } else { 3 };
            let layout = Layout::simple(dimension, sensors.len() / d);
            let n = layout.states();
            let truth: Vec<f64> = (0..n)
                .map(|i| if i % d == 0 { 300.0 } else { 0.01 } * if i < d { 1.0 } else { -0.7 })
                .collect();
            let sigma: Vec<f64> = (0..n)
                .map(|i| if i % d == 0 { 50.0 } else { 2e-3 })
                .collect();
            let looks = 40;
            let positions: Vec<f64> = (0..looks)
                .flat_map(|k| {
                    let t = k as f64;
                    let all = [-20e3 + 2e3 * t, 25e3 + 10.0 * t * t, 8e3];
                    all[..d].to_vec()
                })
                .collect();
            let mut reports = vec![0.0; looks * n];
            report(&layout, &sensors, &truth, &positions, &mut reports).unwrap();
            let mut estimator = Estimator::new(layout, looks).unwrap();
            for method in [Method::MaximumLikelihood, Method::Generalised] {
                let answer = estimator
                    .run(&question(layout, &sensors, &sigma, method), &reports)
                    .unwrap();
                assert_eq!(answer.status, Status::Determined);
                let errors: Vec<f64> = (0..n)
                    .map(|i| (estimator.biases()[i] - truth[i]) / sigma[i])
                    .collect();
                assert!(
                    errors.iter().all(|e| e.abs() < 1e-6),
                    "{method:?} {errors:?}"
                );
            }
        }
    }
}
