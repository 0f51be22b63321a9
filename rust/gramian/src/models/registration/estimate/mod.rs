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
mod likelihood;
mod linear;
mod solver;
mod verdict;

use self::solver::Solver;
use self::verdict::ENOUGH;
use super::look::{reduce, unchecked_place, width};
use super::{Error, Layout};
use crate::scalar::{NumberError, Real, all_finite, check_finite, check_length, check_positive};
use crate::spectrum::default_rtol;
use crate::square_root::triangularize;

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
    /// Positions of the sensors, d numbers each; as many for each look on platforms that move.
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
    /// positive, and an estimate that overflows.
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
        layout.check_places(question.sensors, question.sigma, self.looks)?;
        check_finite("sensors", question.sensors)?;
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
                    &layout.at_look(question.sensors, k)[s * d..(s + 1) * d],
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
                layout.at_look(question.sensors, k),
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
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::registration::{Dimension, report};

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
