//! What the reports determine, and how far that is to be believed.

use alloc::vec;
use alloc::vec::Vec;

use super::solver::{Solver, along, back_substitute};
use super::{Answer, Estimator, Method, Question, Status};
use crate::registration::Error;
use crate::registration::look::{reduce, width};
use crate::scalar::Real;
use crate::spectrum::decompose;
use crate::square_root::triangularize;

/// Looks enough to judge the information of a direction by.
pub(super) const ENOUGH: usize = 64;

/// How far the information along a direction is to be believed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Doubt<T> {
    noise_share: T,
    bend: T,
}

impl<T: Real> Estimator<T> {
    /// Rank, covariance and residuals at the answer.
    pub(super) fn assess(
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
    pub(super) fn without(&mut self, question: &Question<'_, T>, nullity: usize) {
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
    pub(super) fn undetermined(&mut self, question: &Question<'_, T>) -> (usize, Doubt<T>) {
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
            layout.at_look(question.sensors, k),
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
