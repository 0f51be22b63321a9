//! Biases and positions together, at the likeliest.

use super::solver::{along, back_substitute};
use super::{Estimator, Question};
use crate::registration::Error;
use crate::registration::look::width;
use crate::scalar::Real;

impl<T: Real> Estimator<T> {
    pub(super) fn gauss_newton(
        &mut self,
        question: &Question<'_, T>,
        reports: &[T],
    ) -> Result<(usize, bool), Error> {
        let n = self.layout.states();
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
            let length = self.advance();
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

    /// Takes the step in the biases and the one in each position that follows from
    /// it; returns its squared length in deviations.
    fn advance(&mut self) -> T {
        let layout = self.layout;
        let (d, n, c) = (layout.size(), layout.states(), width(&layout));
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
        length
    }

    /// Each position at its likeliest for the present biases.
    pub(super) fn settle(
        &mut self,
        question: &Question<'_, T>,
        reports: &[T],
    ) -> Result<(), Error> {
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
}
