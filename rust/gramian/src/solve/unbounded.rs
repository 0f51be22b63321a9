//! Likelihoods that grow without end, towards infinite range for one: no state is the most
//! likely, and the rows lose their rank on the way there though the problem has it.

use alloc::vec;
use alloc::vec::Vec;

use super::Model;
use super::gauss_newton::{Options, Solution, minimize};
use super::knowledge::WithPrior;
use crate::observability::Observability;
use crate::rounding;
use crate::spectrum;
use crate::square_root::triangularize;

/// Standard deviation of the knowledge that keeps a state within reach, in deviations of
/// each state if it alone were unknown. A target is kept within some hundred times the
/// range at which the steps began, where the likelihood has all but stopped growing.
const REACH: f64 = 1e6;

/// How far on the way to where the steps ended a second start is, in those deviations.
const ON_THE_WAY: f64 = 0.1;

/// Squared residuals of that knowledge below which it has no part in the answer.
const NO_PART: f64 = 1e-9;

/// The most likely state within reach of a start, for steps that did not come to rest, and whether the likelihood grows beyond it.
#[derive(Clone, Debug, PartialEq)]
pub struct Within {
    /// The state; its chi2 is that of the model alone.
    pub solution: Solution,
    /// Whether chi2 falls on, a little further, towards infinity: intervals from here are
    /// open.
    pub unbounded: bool,
}

/// What to report where the steps from `starts` ended at `found` without coming to rest.
/// `None` where the rows have no full rank at any of the starts either: some combination is
/// unobservable.
pub fn within_reach<M: Model + ?Sized, X: AsRef<[f64]>>(
    model: &M,
    found: &Solution,
    starts: &[X],
    options: Options,
) -> Option<Within> {
    if found.converged || !found.chi2.is_finite() {
        return None;
    }
    let mut best: Option<Within> = None;
    for start in starts {
        let Some(sigma) = reach(model, start.as_ref()) else {
            continue;
        };
        let within = kept(model, found, start.as_ref(), &sigma, options);
        if best
            .as_ref()
            .is_none_or(|best| within.solution.chi2 < best.solution.chi2)
        {
            best = Some(within);
        }
    }
    best
}

/// Deviations of the knowledge about a start; `None` where the rows have no full rank.
fn reach<M: Model + ?Sized>(model: &M, start: &[f64]) -> Option<Vec<f64>> {
    let n = start.len();
    let mut residuals = vec![0.0; model.measurements()];
    let mut rows = vec![0.0; model.measurements() * n];
    model
        .linearize(start, &mut residuals, Some(&mut rows))
        .ok()?;
    let mut noise = vec![0.0; n];
    let rank = if model.rounding(start, &mut noise) {
        // Heavy rows, of a sensor close by, carry the rounding of more than light ones say.
        let rtol = rounding::remove(&mut rows, n, &noise);
        plain_rank(&rows, n, rtol)
    } else {
        Observability::new(&rows, n, None).ok()?.rank()
    };
    if rank < n {
        return None;
    }
    let column = |j: usize| rows[j..].iter().step_by(n);
    let sigma: Vec<f64> = (0..n)
        .map(|j| REACH / column(j).fold(0.0_f64, |s, x| s.hypot(*x)))
        .collect();
    sigma.iter().all(|s| s.is_finite()).then_some(sigma)
}

/// The rank of rows with unit columns.
fn plain_rank(rows: &[f64], n: usize, rtol: Option<f64>) -> usize {
    let rtol = rtol.unwrap_or_else(|| spectrum::default_rtol(rows.len() / n.max(1), n));
    let mut factor = rows.to_vec();
    factor.resize(rows.len().max(n * n), 0.0);
    triangularize(&mut factor, n, &mut vec![0.0; n]);
    let (mut scale, mut s) = (vec![1.0; n], vec![0.0; n]);
    let (mut v, mut work) = (vec![0.0; n * n], vec![0.0; n * n]);
    spectrum::unit_columns(&factor[..n * n], n, &mut scale);
    spectrum::decompose(&factor[..n * n], n, &scale, &mut s, &mut v, &mut work);
    spectrum::rank(&s, rtol)
}

/// The most likely state with that knowledge, by steps from the start, and from a place on
/// the way to where the steps without it ended. Where neither comes to rest, what was found.
fn kept<M: Model + ?Sized>(
    model: &M,
    found: &Solution,
    start: &[f64],
    sigma: &[f64],
    options: Options,
) -> Within {
    let n = start.len();
    let mut identity = vec![0.0; n * n];
    for j in 0..n {
        identity[j * n + j] = 1.0;
    }
    let known = WithPrior::new(model, &identity, start, sigma);
    let pull = |x: &[f64]| -> f64 {
        let way = x.iter().zip(start).zip(sigma);
        way.map(|((x, start), sigma)| ((x - start) / sigma).powi(2))
            .sum()
    };
    let share = (ON_THE_WAY / pull(&found.x).sqrt()).min(1.0);
    let toward: Vec<f64> = start
        .iter()
        .zip(&found.x)
        .map(|(start, end)| start + share * (end - start))
        .collect();
    let ended = [start, &toward]
        .map(|from| minimize(&known, from, &[], options))
        .into_iter()
        .filter(|ended| ended.converged)
        .min_by(|a, b| a.chi2.total_cmp(&b.chi2));
    let Some(ended) = ended else {
        return Within {
            solution: found.clone(),
            unbounded: false,
        };
    };
    let pull = pull(&ended.x);
    Within {
        solution: Solution {
            chi2: ended.chi2 - pull,
            converged: pull < NO_PART,
            ..ended
        },
        unbounded: pull >= NO_PART,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Bearings of a fixed target from the places (k, 0).
    struct Bearings(Vec<f64>);

    impl Model for Bearings {
        type Error = ();

        fn states(&self) -> usize {
            2
        }

        fn measurements(&self) -> usize {
            self.0.len()
        }

        fn linearize(
            &self,
            x: &[f64],
            residuals: &mut [f64],
            rows: Option<&mut [f64]>,
        ) -> Result<(), ()> {
            let offset = |k: usize| [x[0] - k as f64, x[1]];
            for (k, (out, z)) in residuals.iter_mut().zip(&self.0).enumerate() {
                let [east, north] = offset(k);
                *out = (z - east.atan2(north)) / 0.01;
            }
            if let Some(rows) = rows {
                for (k, row) in rows.chunks_exact_mut(2).enumerate() {
                    let [east, north] = offset(k);
                    let square = (east * east + north * north) * 0.01;
                    row.copy_from_slice(&[north / square, -east / square]);
                }
            }
            Ok(())
        }

        fn difference(&self, _: &[f64], _: &[f64], _: &mut [f64]) -> Result<(), ()> {
            Ok(())
        }
    }

    #[test]
    fn bearings_that_diverge_are_best_explained_from_infinity() {
        // Rays that spread, if by little: the farther the better.
        let model = Bearings((0..5).map(|k| 0.001 * f64::from(k)).collect());
        let start = [1.0, 30.0];
        let options = Options::default();
        let found = minimize(&model, &start, &[], options);
        assert!(!found.converged || found.x[1] > 1e4, "{found:?}");
        let found = Solution {
            converged: false,
            ..found
        };
        let within = within_reach(&model, &found, &[start], options).unwrap();
        assert!(within.unbounded && !within.solution.converged);
        let chi2 = |x: &[f64]| {
            let mut residuals = [0.0; 5];
            model.linearize(x, &mut residuals, None).unwrap();
            residuals.iter().map(|r| r * r).sum::<f64>()
        };
        let x = &within.solution.x;
        assert!((chi2(x) - within.solution.chi2).abs() < 1e-9);
        // Far out, and almost as good as it gets.
        assert!(x[1] > 300.0 && x[1] < 1e6, "{x:?}");
        let farther = chi2(&[x[0] * 1e3, x[1] * 1e3]);
        assert!(farther < within.solution.chi2 && within.solution.chi2 < farther + 0.1);
    }

    #[test]
    fn what_is_unobservable_everywhere_is_not_within_reach() {
        // One bearing: a whole ray fits.
        let model = Bearings(vec![0.1]);
        let found = Solution {
            converged: false,
            ..minimize(&model, &[1.0, 30.0], &[], Options::default())
        };
        assert_eq!(
            within_reach(&model, &found, &[[1.0, 30.0]], Options::default()),
            None
        );
    }
}
