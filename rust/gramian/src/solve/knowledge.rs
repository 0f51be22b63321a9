//! What is known beyond the measurements, as part of a model: priors as further rows,
//! exact values as columns that are left out. Everything else then sees a plain model.

use alloc::sync::Arc;
use alloc::vec;
use alloc::vec::Vec;

use super::Model;

/// A model with independent normal priors of states and combinations of them.
#[derive(Clone, Debug)]
pub struct WithPrior<M> {
    model: M,
    known: Vec<Known>,
}

/// One prior: a combination of states, its mean and standard deviation.
#[derive(Clone, Debug)]
struct Known {
    /// State and coefficient.
    terms: Vec<(usize, f64)>,
    mean: f64,
    sigma: f64,
}

impl Known {
    fn of(&self, x: impl Fn(usize) -> f64) -> f64 {
        self.terms.iter().fold(0.0, |sum, &(k, c)| sum + c * x(k))
    }
}

impl<M: Model> WithPrior<M> {
    /// A prior for each of `combinations`, rows of as many coefficients as the model has
    /// states; `sigma` is infinite for one of which nothing is known.
    pub fn new(model: M, combinations: &[f64], mean: &[f64], sigma: &[f64]) -> Self {
        let known = combinations
            .chunks_exact(model.states().max(1))
            .zip(mean.iter().zip(sigma))
            .filter(|(_, (_, sigma))| sigma.is_finite())
            .map(|(row, (&mean, &sigma))| Known {
                terms: (0..)
                    .zip(row.iter().copied())
                    .filter(|t| t.1 != 0.0)
                    .collect(),
                mean,
                sigma,
            })
            .collect();
        Self { model, known }
    }
}

impl<M: Model> Model for WithPrior<M> {
    type Error = M::Error;

    crate::forward_model!(this => this.model; states, exact, channels, change, extent, retract, rounding, symmetries);

    fn measurements(&self) -> usize {
        self.model.measurements() + self.known.len()
    }

    fn priors(&self) -> usize {
        self.model.priors() + self.known.len()
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> Result<(), M::Error> {
        let (m, n) = (self.model.measurements(), x.len());
        let (data, rest) = residuals.split_at_mut(m);
        for (out, known) in rest.iter_mut().zip(&self.known) {
            *out = (known.mean - known.of(|k| x[k])) / known.sigma;
        }
        let Some(rows) = rows else {
            return self.model.linearize(x, data, None);
        };
        let (above, below) = rows.split_at_mut(m * n);
        below.fill(0.0);
        for (row, known) in below.chunks_exact_mut(n).zip(&self.known) {
            for &(k, coefficient) in &known.terms {
                row[k] = coefficient / known.sigma;
            }
        }
        self.model.linearize(x, data, Some(above))
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), M::Error> {
        let (data, rest) = out.split_at_mut(self.model.measurements());
        for (out, known) in rest.iter_mut().zip(&self.known) {
            *out = known.of(|k| b[k] - a[k]) / known.sigma;
        }
        self.model.difference(a, b, data)
    }
}

/// A model some of whose states are known exactly.
#[derive(Clone, Debug)]
pub struct Held<M> {
    model: M,
    /// All states, the known ones at their values.
    template: Vec<f64>,
    free: Vec<usize>,
}

impl<M: Model> Held<M> {
    /// `known` has a value for each state that is known, and `None` for the others.
    pub fn new(model: M, known: &[Option<f64>]) -> Self {
        let template = known.iter().map(|k| k.unwrap_or(0.0)).collect();
        let free = (0..known.len()).filter(|&k| known[k].is_none()).collect();
        Self {
            model,
            template,
            free,
        }
    }

    /// All states of the model inside.
    pub fn whole(&self, x: &[f64]) -> Vec<f64> {
        let mut whole = self.template.clone();
        for (&k, &value) in self.free.iter().zip(x) {
            whole[k] = value;
        }
        whole
    }
}

impl<M: Model> Model for Held<M> {
    type Error = M::Error;

    crate::forward_model!(this => this.model; measurements, priors, exact, channels);

    fn states(&self) -> usize {
        self.free.len()
    }

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> Result<(), M::Error> {
        let whole = self.whole(x);
        let Some(rows) = rows else {
            return self.model.linearize(&whole, residuals, None);
        };
        let mut all = vec![0.0; residuals.len() * whole.len()];
        self.model.linearize(&whole, residuals, Some(&mut all))?;
        if x.is_empty() {
            return Ok(());
        }
        for (out, row) in rows.chunks_exact_mut(x.len()).zip(all.chunks(whole.len())) {
            for (out, &k) in out.iter_mut().zip(&self.free) {
                *out = row[k];
            }
        }
        Ok(())
    }

    fn difference(&self, a: &[f64], b: &[f64], out: &mut [f64]) -> Result<(), M::Error> {
        self.model.difference(&self.whole(a), &self.whole(b), out)
    }

    fn change(&self, a: &[f64], b: &[f64], out: &mut [f64]) {
        let mut all = vec![0.0; self.template.len()];
        self.model.change(&self.whole(a), &self.whole(b), &mut all);
        for (out, &k) in out.iter_mut().zip(&self.free) {
            *out = all[k];
        }
    }

    fn extent(&self, x: &[f64], k: usize) -> (f64, f64) {
        self.model.extent(&self.whole(x), self.free[k])
    }

    fn retract(&self, x: &mut [f64]) {
        let mut whole = self.whole(x);
        self.model.retract(&mut whole);
        for (x, &k) in x.iter_mut().zip(&self.free) {
            *x = whole[k];
        }
    }

    fn rounding(&self, x: &[f64], noise: &mut [f64]) -> bool {
        let mut all = vec![0.0; self.template.len()];
        let any = self.model.rounding(&self.whole(x), &mut all);
        for (out, &k) in noise.iter_mut().zip(&self.free) {
            *out = all[k];
        }
        any
    }

    fn symmetries(&self, x: &[f64], found: &mut dyn FnMut(&[f64])) {
        self.model.symmetries(&self.whole(x), &mut |other| {
            // An image that changes what is known is none.
            let near = |k: usize| {
                let (given, image) = (self.template[k], other[k]);
                (given - image).abs() <= 1e-9 * given.abs().max(1e-300)
            };
            if (0..other.len()).all(|k| self.free.contains(&k) || near(k)) {
                let part: Vec<f64> = self.free.iter().map(|&k| other[k]).collect();
                found(&part);
            }
        });
    }
}

// What points to a model is a model too.
macro_rules! pointer {
    ($pointer:ty $(, $bound:ident)?) => {
        impl<M: Model + ?Sized $(+ $bound)?> Model for $pointer {
            type Error = M::Error;

            crate::forward_model!(
                this => (**this);
                states, measurements, priors, exact, channels, linearize, difference, change,
                extent, retract, rounding, symmetries
            );
        }
    };
}

pointer!(&M);
pointer!(Arc<M>, Send);
