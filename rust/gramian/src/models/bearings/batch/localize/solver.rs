//! One trial: its samples, its starts and its steps.

use alloc::vec;
use alloc::vec::Vec;

use super::algebra::{decompose, flatten, inverse_step, newton, split, step, stepped};
use super::fit::{AT_THE_OBSERVER, Fit};
use super::kernels::{
    Directions, Exact, Field, Linearize, MAX, PseudoLinear, Samples, Triangularize, Turn,
};
use super::{Options, Track};
use crate::batch::lanes::{Block, LANES};
use crate::batch::simd::Path;
use crate::batch::{Items, Stream};
use crate::bearings;
use crate::scalar::hypot;
use crate::spectrum;
use crate::square_root::rotate_in;

/// By how much another solution may cost more than one at the observer itself.
const ON_THE_OBSERVER: f64 = 6.0;

/// Reciprocal ranges below this, in units of the observer's path, where the steps did not
/// come to rest, are infinite ranges.
const AT_INFINITY: f64 = 1e-6;

/// One trial after the other, in its own memory.
pub struct Solver<const N: usize> {
    pub options: Options,
    path: Path,
    count: usize,
    samples: Samples,
    /// Rows and residuals, which are reduced in place; then the residuals once more.
    columns: Vec<Block>,
    /// The model that was linearised last, for this trial's bearings.
    linearized: [f64; MAX],
    noise: Vec<Block>,
    loaded: bool,
    origin: [f64; 2],
    /// Metres to a unit of observer displacement, and for each derivative on.
    units: [f64; 4],
    pub rtol: f64,
    /// Squares below this are rounding of the bearings.
    floor: f64,
    prior: Option<([f64; N], [f64; N])>,
    /// See [`Linearize`]; of the model that was linearised last.
    bending: [[f64; N]; N],
}

impl<const N: usize> Solver<N> {
    pub fn new(count: usize, options: Options, path: Path) -> Self {
        let samples = Samples::new(count);
        let blocks = samples.blocks;
        Self {
            options,
            path,
            count,
            samples,
            columns: vec![[0.0; LANES]; (N + 2) * blocks],
            linearized: [f64::NAN; MAX],
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
    pub fn load(&mut self, track: &Track<'_>, trial: usize) {
        self.prior = track.prior.map(|prior| {
            (
                state_of(prior.mean.get(trial)),
                state_of(prior.sigma.get(trial)),
            )
        });
        let shared = [track.times, track.observer, track.sigma]
            .iter()
            .all(Items::is_shared);
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
        // Offsets between large coordinates carry the rounding of those, and of
        // times counted from long ago.
        let late = times[0].abs().max(times[self.count - 1].abs());
        let mut known = 0.0;
        if length > 0.0 {
            known += 8.0 * f64::EPSILON * largest / length;
        }
        if span > 0.0 {
            known += 8.0 * f64::EPSILON * late / span;
        }
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

    pub fn bearings(&mut self, bearings: &[f64]) {
        self.linearized[0] = f64::NAN;
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

    pub fn simulate(
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
    pub fn state(&self, h: &[f64; MAX]) -> [f64; N] {
        core::array::from_fn(|i| {
            let value = self.units[i / 2] * h[i] / h[N];
            if i < 2 { value + self.origin[i] } else { value }
        })
    }

    /// How a change of (direction, w.., s) moves each state, times s^2: finite
    /// at infinite range too.
    pub fn move_states(&self, h: &[f64; MAX], change: &[f64; N]) -> [f64; N] {
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
    pub fn change_of(&self, h: &[f64; MAX], moved: &[f64; N]) -> [f64; N] {
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
        self.linearized = *model;
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

    /// The whitened residuals at a model.
    pub fn residuals(&mut self, model: &[f64; MAX]) -> &[f64] {
        if self.linearized != *model {
            let _ = self.linearize(model);
        }
        let column = &self.columns[(N + 1) * self.samples.blocks..];
        &column.as_flattened()[..self.count]
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
    pub fn solve(&mut self) -> Fit<N> {
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
            let fit = self.descend(model).ranked(self.rtol);
            let freedom = self.count.saturating_sub(N) as f64;
            let plausible = fit.chi2 < freedom + 6.0 * (2.0 * freedom).sqrt() + 20.0;
            if fit.regular() && plausible {
                return fit;
            }
            best = Some(fit);
        }
        let rungs = self.ladder(&factor);
        let first = rungs[0].1;
        let second = self.descend(first).ranked(self.rtol);
        let best = match best {
            Some(best) if !(second.cost < best.cost) && best.converged >= second.converged => best,
            _ => second,
        };
        if best.regular() {
            return best;
        }
        // Rows that have lost rank where the steps ended, at infinity or on the observer,
        // say nothing of the problem where they have it elsewhere.
        let _ = self.linearize(&first);
        let root = self.reduce(&first).0;
        if (Fit { root, ..best }).ranked(self.rtol).nullity > 0 {
            return best;
        }
        self.reconsidered(best, &rungs[1..])
    }

    /// The best of `fit`, which ended at infinity or on the observer or not at all, and of
    /// what is reached from the other rungs of the ladder.
    fn reconsidered(&mut self, fit: Fit<N>, rungs: &[(f64, [f64; MAX])]) -> Fit<N> {
        let mut inside: Option<Fit<N>> = None;
        for &(cost, model) in rungs {
            if cost.is_finite() {
                let found = self.descend(model).ranked(self.rtol);
                if found.regular() && inside.is_none_or(|best| found.cost < best.cost) {
                    inside = Some(found);
                }
            }
        }
        let s = fit.model[N];
        // What the fit costs at the edge of what is possible. Beyond infinite range it is
        // on the wrong side of it, and the last of the factor tells what the way back
        // costs; on the observer one bearing fits whatever it is.
        let edge = if s > 0.0 && (fit.nullity > 0 || s >= AT_THE_OBSERVER) {
            fit.cost + ON_THE_OBSERVER
        } else if s > 0.0 {
            fit.cost
        } else {
            let back = s * fit.root[N - 1][N - 1];
            fit.cost + back * back
        };
        match inside {
            Some(inside) if inside.cost <= edge => inside,
            _ => {
                let mut fit = Fit {
                    // Its rank is that of the place, not of the problem.
                    nullity: 0,
                    converged: fit.converged && fit.nullity == 0 && s < AT_THE_OBSERVER,
                    ..fit
                };
                if s < AT_INFINITY {
                    fit.model[N] = fit.model[N].min(0.0);
                }
                fit
            }
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

    /// A ladder of ranges, the best first, each with its cost: for each the pseudo-linear
    /// solution, from its factor.
    fn ladder(&mut self, factor: &[[f64; MAX]; MAX]) -> Vec<(f64, [f64; MAX])> {
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
        let mut rungs = Vec::with_capacity(20);
        for reciprocal in [3.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 5e-3, 1e-3, 1e-4] {
            let mut h = base;
            for i in 0..N {
                h[i] += reciprocal * shift[i];
            }
            h[N] = reciprocal;
            if let Some(model) = self.oriented(h)
                && model[N] > 0.0
            {
                rungs.push((self.linearize(&model).1, model));
            }
            if let Some((mean, sigma)) = self.prior {
                // At this range along the first bearing, moving as known.
                let mut h = [0.0; MAX];
                let first = |field| self.samples.field(field).as_flattened()[0];
                (h[0], h[1]) = (first(Field::Sine), first(Field::Cosine));
                for i in (2..N).filter(|&i| sigma[i].is_finite()) {
                    h[i] = mean[i] * reciprocal / self.units[i / 2];
                }
                h[N] = reciprocal;
                rungs.push((self.linearize(&h).1, h));
            }
        }
        if !rungs.iter().any(|rung| rung.0 < f64::INFINITY) {
            let mut far = base;
            far[N] = 1e-3;
            rungs.insert(0, (f64::INFINITY, far));
        }
        rungs.sort_by(|a, b| a.0.total_cmp(&b.0));
        rungs
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
            nullity: 0,
            null: [0.0; N],
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
                // What rounding of the bearings makes of the cost is no failure.
                let rounding = (fit.cost * self.floor).sqrt();
                if cost <= fit.cost * (1.0 + 1e-13) + tolerance + rounding {
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

pub fn state_of<const N: usize>(given: &[f64]) -> [f64; N] {
    let mut state = [0.0; N];
    state.copy_from_slice(&given[..N]);
    state
}

fn order(a: Option<f64>, b: Option<f64>) -> core::cmp::Ordering {
    let key = |x: Option<f64>| x.filter(|x| !x.is_nan()).unwrap_or(f64::INFINITY);
    key(a).total_cmp(&key(b))
}
