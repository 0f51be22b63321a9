//! Many simulated records of one state, each answered and judged: for Monte Carlo checks
//! of coverage, power and false alarms.

use alloc::vec;
use alloc::vec::Vec;

use super::fit::Fit;
use super::gauss_newton::{Options, Solution, minimize};
use super::other_solutions::{Search, other_solutions};
use super::region::{self, Interval};
use super::starts::{multi_start, same_place};
use super::{Function, Model};
use crate::batch::{Stream, Threads};
use crate::observability::Observability;

/// A model whose residuals carry a given noise: the record of one trial.
#[derive(Clone, Debug)]
pub struct Noisy<'a, M: ?Sized> {
    /// With the exact data of the true state.
    pub model: &'a M,
    /// Of each whitened measurement, and of each prior.
    pub noise: Vec<f64>,
}

impl<M: Model + ?Sized> Model for Noisy<'_, M> {
    type Error = M::Error;

    crate::forward_model!(this => this.model; states, measurements, priors, exact, channels, difference, change, extent, retract, rounding, symmetries);

    fn linearize(
        &self,
        x: &[f64],
        residuals: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> Result<(), M::Error> {
        self.model.linearize(x, residuals, rows)?;
        for (r, noise) in residuals.iter_mut().zip(&self.noise) {
            *r += noise;
        }
        Ok(())
    }
}

/// What is simulated, and what is asked of each trial.
pub struct Trials<'a, M: ?Sized> {
    /// With the exact data of the true state.
    pub model: &'a M,
    /// The true state.
    pub truth: &'a [f64],
    /// Where each estimate starts.
    pub starts: &'a [Vec<f64>],
    /// How other solutions are looked for; not at all if `None`.
    pub search: Option<&'a Search>,
    /// What an interval is asked of.
    pub function: Option<&'a (dyn Function + Sync)>,
    /// Rise of chi2 of the interval, and of the region of all states.
    pub rises: [f64; 2],
    /// Whitened columns, row-major, and their number, of each alternative.
    pub alternatives: &'a [(Vec<f64>, usize)],
    /// What the data have that the model has not, whitened; none if empty.
    pub shift: &'a [f64],
    /// Trial i depends on (seed, i) alone.
    pub seed: u64,
    /// Number of the first trial.
    pub first: u64,
}

/// What is known of one trial.
#[derive(Clone, Debug)]
pub struct Trial {
    /// The estimate.
    pub best: Solution,
    /// Probability of a larger chi2.
    pub p_value: f64,
    /// Of a larger correlation of neighbours.
    pub lag_p_value: f64,
    /// The largest chance that noise prefers another solution; 0 without one.
    pub chance: f64,
    /// Whether the true state is in the region of all states.
    pub inside: bool,
    /// The interval of the function.
    pub interval: Option<Interval>,
    /// p of each alternative; 1 for one that leaves no trace.
    pub alternatives: Vec<f64>,
}

impl<M: Model + ?Sized> Trials<'_, M> {
    /// Numbers that [`run`](Self::run) writes for a trial, before states and alternatives.
    pub const HEAD: usize = 14;

    /// Numbers that [`run`](Self::run) writes for a trial.
    pub fn size(&self) -> usize {
        Self::HEAD + self.truth.len() + self.alternatives.len()
    }

    /// The record of a trial.
    pub fn record(&self, index: u64) -> Noisy<'_, M> {
        let mut stream = Stream::new(self.seed, self.first + index);
        let mut noise: Vec<f64> = (0..self.model.measurements())
            .map(|_| stream.normal())
            .collect();
        for (n, shift) in noise.iter_mut().zip(self.shift) {
            *n += shift;
        }
        Noisy {
            model: self.model,
            noise,
        }
    }

    /// The answer of a trial; `None` where no start has a value.
    pub fn answer(&self, index: u64) -> Option<Trial> {
        let model = self.record(index);
        let options = Options::default();
        let mut clusters = multi_start(&model, self.starts.iter().cloned(), options);
        if clusters.is_empty() {
            return None;
        }
        let mut best = clusters.remove(0).solution;
        let mut others: Vec<Solution> = clusters.into_iter().map(|c| c.solution).collect();
        let mut chance = 0.0_f64;
        if let Some(search) = self.search.filter(|_| best.converged) {
            let found = other_solutions(&model, &best, search);
            best = found.best;
            chance = found.others.iter().fold(0.0, |c, o| c.max(o.chance));
            others.extend(found.others.into_iter().map(|o| o.solution));
        }
        let mut interval = None;
        // Where chi2 has no least value its values still tell what is allowed.
        if let Some(function) = self.function {
            let rise = self.rises[0];
            let found = region::interval(&model, &best, &others, function, rise, options);
            interval = Some(match found.better.clone() {
                // A lower minimum was met on the way: that is the estimate.
                Some(better) if better.chi2 < best.chi2 => {
                    others.push(core::mem::replace(&mut best, better));
                    region::interval(&model, &best, &others, function, rise, options)
                }
                _ => found,
            });
        }
        let fit = Fit::new(&model, &best.x).ok()?;
        let inside = region::contains(&model, &best, self.truth, self.rises[1]).unwrap_or(false);
        let alternatives = self
            .alternatives
            .iter()
            .map(|(columns, count)| fit.score(columns, *count, 1e-3, 0.8).p_value)
            .collect();
        Some(Trial {
            p_value: fit.p_value(),
            lag_p_value: fit.lag1().p_value,
            best,
            chance,
            inside,
            interval,
            alternatives,
        })
    }

    /// Answers as many trials as `out` has places for, [`size`](Self::size) each:
    /// converged, chi2, its p, p of the lag, largest chance of another solution, truth in
    /// the region, truth in the interval, ends of the interval (infinite where open), its
    /// pieces, whether they are certain, half the length of the local one, the function at
    /// the estimate, constrained solves; the state; p of the alternatives. NaN where there
    /// is no answer.
    pub fn run(&self, threads: Threads, cost: f64, out: &mut [f64]) {
        let truth = self.function.map(|f| {
            let mut gradient = vec![0.0; self.truth.len()];
            f.value(self.truth, &mut gradient)
        });
        let each = |index: usize, out: &mut [f64]| -> Result<(), core::convert::Infallible> {
            out.fill(f64::NAN);
            let Some(trial) = self.answer(index as u64) else {
                out[0] = 0.0;
                return Ok(());
            };
            let yes = |is: bool| if is { 1.0 } else { 0.0 };
            out[0] = yes(trial.best.converged);
            out[1] = trial.best.chi2;
            out[2] = trial.p_value;
            out[3] = trial.lag_p_value;
            out[4] = trial.chance;
            out[5] = yes(trial.inside);
            if let (Some(interval), Some(function), Some(truth)) =
                (&trial.interval, self.function, truth)
            {
                let held = |p: &region::Piece| {
                    // Ends are found to ten digits.
                    p.low.is_none_or(|low| truth >= low - 1e-9 * low.abs())
                        && p.high.is_none_or(|high| truth <= high + 1e-9 * high.abs())
                };
                out[6] = yes(interval.pieces.iter().any(held));
                let low = interval.pieces.first().and_then(|p| p.low);
                let high = interval.pieces.last().and_then(|p| p.high);
                out[7] = low.unwrap_or(f64::NEG_INFINITY);
                out[8] = high.unwrap_or(f64::INFINITY);
                out[9] = interval.pieces.len() as f64;
                out[10] = yes(interval.pieces.iter().all(|p| p.certain == [true; 2]));
                out[11] = interval.local;
                out[12] = function.value(&trial.best.x, &mut vec![0.0; self.truth.len()]);
                out[13] = interval.solves as f64;
            }
            let n = self.truth.len();
            out[Self::HEAD..Self::HEAD + n].copy_from_slice(&trial.best.x);
            out[Self::HEAD + n..].copy_from_slice(&trial.alternatives);
            Ok(())
        };
        let Ok(()) = threads.over(out, self.size(), cost, each);
    }
}

/// How many of the places that an exhaustive search finds another one finds too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recall {
    /// Minima beside the state searched from.
    pub minima: usize,
    /// Those of them that the search found.
    pub found: usize,
    /// Places that are no minima of their own: a thousandth of a deviation along their weakest
    /// direction, and the steps lead elsewhere. Steps come to rest anywhere along a valley
    /// where chi2 is level to rounding.
    pub level: usize,
}

/// Compares a search from a state with an exhaustive one, in which `many` points of the spread
/// are followed to the end; of what they reach, minima within `reach` in chi2 of the best count.
pub fn recall<M: Model + ?Sized>(
    model: &M,
    x: &[f64],
    search: &Search,
    many: usize,
    reach: f64,
) -> Recall {
    let options = search.options;
    let from = minimize(model, x, &[], options);
    let found = other_solutions(model, &from, search);
    let mut out = Recall::default();
    let Some(spread) = &search.spread else {
        return out;
    };
    let starts = (0..many).map(|i| spread.random(search.seed ^ 0x5eed, i as u64));
    let places = multi_start(model, starts, options);
    let least = places.first().map_or(0.0, |c| c.solution.chi2);
    let mut known: Vec<&Solution> = vec![&found.best];
    known.extend(found.others.iter().map(|o| &o.solution));
    for place in &places {
        let home = |other: &[f64]| same_place(model, other, &place.solution.x);
        if place.hits == 0 || place.solution.chi2 > least + reach || home(&from.x) {
            continue;
        }
        if !stays(model, &place.solution.x, options) {
            out.level += 1;
            continue;
        }
        out.minima += 1;
        out.found += usize::from(known.iter().any(|s| home(&s.x)));
    }
    out
}

/// By how much a place is moved to see if it is a minimum, in deviations, and how many steps
/// it may take to come back.
const PUSH: f64 = 1e-3;
const WAY_BACK: u32 = 3000;

/// Whether steps from a little beside a place lead back to it, on either side along its
/// weakest direction.
fn stays<M: Model + ?Sized>(model: &M, x: &[f64], options: Options) -> bool {
    let n = model.states();
    let mut residuals = vec![0.0; model.measurements()];
    let mut rows = vec![0.0; residuals.len() * n];
    let axis = match model.linearize(x, &mut residuals, Some(&mut rows)) {
        Ok(()) => Observability::new(&rows, n, None).map(|found| found.longest_axes(1)),
        Err(_) => return false,
    };
    let Some(axis) = axis.ok().and_then(|axes| axes.into_iter().next()) else {
        return false;
    };
    let options = Options {
        max_iterations: WAY_BACK,
        ..options
    };
    [-PUSH, PUSH].iter().all(|push| {
        let beside: Vec<f64> = x.iter().zip(&axis).map(|(x, a)| x + push * a).collect();
        let back = minimize(model, &beside, &[], options);
        same_place(model, &back.x, x)
    })
}
