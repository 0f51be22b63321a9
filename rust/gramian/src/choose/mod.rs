//! Which measurements, sensors or places to add: so many of the candidates that what is
//! known afterwards is best.
//!
//! A candidate is a group of whitened rows. [`Design::greedy`] adds the best one after the
//! other, [`Design::exchange`] swaps until no swap helps, and [`Design::relax`] lets
//! fractions be chosen: its optimum, found with a duality gap, limits what any choice can
//! reach.
//!
//! # Source
//! Pukelsheim, *Optimal Design of Experiments* (1993), chapters 6 and 9; Joshi & Boyd,
//! *Sensor selection via convex optimization*, IEEE Trans. SP 57 (2009); Nemhauser, Wolsey
//! & Fisher (1978) for the guarantee of the greedy choice. Exchange: Fedorov (1972).

use alloc::vec;
use alloc::vec::Vec;

use crate::observability::Observability;
use crate::scalar::NumberError;

mod dense;
pub mod gram;

use dense::{covariance, log_det};
pub use gram::Gram;

/// Why there is no choice.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ChoiceError {
    /// A number that does not fit.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// The caller asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// What is to be best.
#[derive(Clone, Debug, PartialEq)]
pub enum Goal {
    /// The determinant of the information: the volume of the error ellipsoid.
    D,
    /// The sum of the variances, each times its weight.
    A(Vec<f64>),
    /// The longest axis of the error ellipsoid, each state divided by its scale.
    E(Vec<f64>),
}

/// A set of candidates that was chosen, in the order in which they were taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Numbers of the candidates.
    pub chosen: Vec<usize>,
    /// What is known after each: the larger the better (see [`Design::worth`]).
    pub worth: Vec<f64>,
    /// The rank after each.
    pub rank: Vec<usize>,
}

/// The best with fractions, and what no choice can exceed.
#[derive(Clone, Debug, PartialEq)]
pub struct Relaxation {
    /// The fraction of each candidate, from 0 to 1; their sum is the budget.
    pub weights: Vec<f64>,
    /// What is known with these fractions.
    pub worth: f64,
    /// No choice within the budget is worth more.
    pub limit: f64,
}

/// Candidates beside what is known already.
#[derive(Clone, Debug)]
pub struct Design {
    n: usize,
    base_rows: Vec<f64>,
    base: Vec<f64>,
    rows: Vec<Vec<f64>>,
}

impl Design {
    /// `base` are the rows there are already, each candidate a group of rows; all of
    /// length `n`, row-major.
    ///
    /// # Errors
    /// [`NumberError`] for rows that are not of length `n` >= 1 or not finite.
    pub fn new(n: usize, base: &[f64], candidates: &[&[f64]]) -> Result<Self, NumberError> {
        for rows in core::iter::once(&base).chain(candidates) {
            if n == 0 || rows.len() % n != 0 {
                return Err(NumberError::Length {
                    array: "rows",
                    given: rows.len(),
                    wanted: n * rows.len().div_ceil(n.max(1)),
                });
            }
            if let Some(index) = rows.iter().position(|x| !x.is_finite()) {
                return Err(NumberError::NotFinite {
                    name: "rows",
                    index,
                    given: rows[index],
                });
            }
        }
        let mut information = vec![0.0; n * n];
        dense::add(&mut information, base, n, 1.0);
        Ok(Self {
            n,
            base_rows: base.to_vec(),
            base: information,
            rows: candidates.iter().map(|rows| rows.to_vec()).collect(),
        })
    }

    /// What is known with this information, the larger the better: half the log
    /// determinant (nats) for D, minus the weighted sum of variances for A, minus the
    /// largest variance of a scaled direction for E; minus infinity where the rank is
    /// short.
    pub fn worth(&self, goal: &Goal, information: &[f64]) -> f64 {
        match goal {
            Goal::D => log_det(information, self.n).map_or(f64::NEG_INFINITY, |l| 0.5 * l),
            Goal::A(weights) => covariance(information, self.n).map_or(f64::NEG_INFINITY, |c| {
                -(0..self.n)
                    .map(|i| weights[i] * c[i * self.n + i])
                    .sum::<f64>()
            }),
            Goal::E(scale) => covariance(information, self.n)
                .map_or(f64::NEG_INFINITY, |c| -dense::largest(&c, scale, self.n)),
        }
    }

    fn information(&self, chosen: &[usize]) -> Vec<f64> {
        let mut information = self.base.clone();
        for &i in chosen {
            dense::add(&mut information, &self.rows[i], self.n, 1.0);
        }
        information
    }

    /// Rank, and log of the product of what counts, of the rows there are with these
    /// candidates: decided on rows, not on the information.
    fn rank(&self, chosen: &[usize]) -> Result<(usize, f64), NumberError> {
        let mut rows = self.base_rows.clone();
        for &i in chosen {
            rows.extend_from_slice(&self.rows[i]);
        }
        if rows.is_empty() {
            return Ok((0, 0.0));
        }
        let found = Observability::new(&rows, self.n, None)?;
        let rank = found.rank();
        let mut product: f64 = found.singular_values()[..rank].iter().map(|s| s.ln()).sum();
        // Those are of unit columns.
        for j in 0..self.n {
            let square: f64 = rows.iter().skip(j).step_by(self.n).map(|x| x * x).sum();
            if square > 0.0 {
                product += 0.5 * square.ln();
            }
        }
        Ok((rank, product))
    }

    /// Everything that is known with `information` about the candidates; `None` where that
    /// does not make everything observable, and for E.
    fn gram(&self, goal: &Goal, information: &[f64]) -> Option<Gram> {
        let weights = match goal {
            Goal::D => None,
            Goal::A(weights) => Some(weights.clone()),
            Goal::E(_) => return None,
        };
        let mut end = 0;
        let ends: Vec<usize> = self
            .rows
            .iter()
            .map(|rows| {
                end += rows.len() / self.n;
                end
            })
            .collect();
        let covariance = covariance(information, self.n)?;
        let worth = self.worth(goal, information);
        Some(Gram::factored(
            &ends,
            self.rows.concat(),
            &covariance,
            weights,
            worth,
        ))
    }

    /// Adds the best candidate, one after the other. While the rank is short, more rank
    /// comes first, then the larger product of the singular values that count.
    ///
    /// # Errors
    /// [`ChoiceError`] where the information overflows, the budget exceeds the number of
    /// candidates, or `stop` says so.
    pub fn greedy(
        &self,
        goal: &Goal,
        budget: usize,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<Choice, ChoiceError> {
        self.check(budget)?;
        let mut choice = Choice {
            chosen: Vec::new(),
            worth: Vec::new(),
            rank: Vec::new(),
        };
        let mut left: Vec<usize> = (0..self.rows.len()).collect();
        let mut rank = self.rank(&[])?.0;
        let mut information = self.base.clone();
        let mut gram = None;
        for _ in 0..budget {
            if rank == self.n && gram.is_none() {
                gram = self.gram(goal, &information);
            }
            let mut best: Option<(usize, usize, f64)> = None;
            for (place, &i) in left.iter().enumerate() {
                check(stop)?;
                let (reached, value) = if let Some(gram) = &gram {
                    let with = gram.with(&[(i, 1.0)]);
                    (self.n, with.unwrap_or(f64::NEG_INFINITY))
                } else if rank == self.n {
                    let mut with = information.clone();
                    dense::add(&mut with, &self.rows[i], self.n, 1.0);
                    (self.n, self.worth(goal, &with))
                } else {
                    let mut with = choice.chosen.clone();
                    with.push(i);
                    let (reached, product) = self.rank(&with)?;
                    if reached == self.n {
                        let full = self.worth(goal, &self.information(&with));
                        (reached, full)
                    } else {
                        (reached, product)
                    }
                };
                if best.is_none_or(|(_, r, v)| reached > r || (reached == r && value > v)) {
                    best = Some((place, reached, value));
                }
            }
            let Some((place, reached, _)) = best else {
                break;
            };
            let i = left.remove(place);
            dense::add(&mut information, &self.rows[i], self.n, 1.0);
            gram = gram.and_then(|mut gram| gram.add(&[(i, 1.0)]).then_some(gram));
            rank = reached;
            choice.chosen.push(i);
            choice.rank.push(rank);
            choice.worth.push(if rank == self.n {
                self.worth(goal, &information)
            } else {
                f64::NEG_INFINITY
            });
        }
        Ok(choice)
    }

    /// Swaps a chosen candidate for another as long as that is better, the best swap
    /// first; at most `rounds` swaps. Nothing where the rank is short.
    ///
    /// # Errors
    /// [`ChoiceError::Interrupted`].
    pub fn exchange(
        &self,
        goal: &Goal,
        chosen: &[usize],
        rounds: usize,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<(Vec<usize>, f64), ChoiceError> {
        let mut chosen = chosen.to_vec();
        let mut information = self.information(&chosen);
        let mut worth = self.worth(goal, &information);
        if worth == f64::NEG_INFINITY {
            return Ok((chosen, worth));
        }
        if let Some(mut gram) = self.gram(goal, &information) {
            let swapped = gram.exchange(&chosen, rounds, stop)?;
            // Anew, so that differences leave no rounding behind.
            let reached = self.worth(goal, &self.information(&swapped));
            return Ok(if reached > worth {
                (swapped, reached)
            } else {
                (chosen, worth)
            });
        }
        for _ in 0..rounds {
            let mut best = (worth + 1e-12 * worth.abs().max(1.0), None);
            for (place, &out) in chosen.iter().enumerate() {
                let mut without = information.clone();
                dense::add(&mut without, &self.rows[out], self.n, -1.0);
                for into in (0..self.rows.len()).filter(|i| !chosen.contains(i)) {
                    check(stop)?;
                    let mut with = without.clone();
                    dense::add(&mut with, &self.rows[into], self.n, 1.0);
                    let reached = self.worth(goal, &with);
                    if reached > best.0 {
                        best = (reached, Some((place, into)));
                    }
                }
            }
            let Some((place, into)) = best.1 else {
                break;
            };
            chosen[place] = into;
            information = self.information(&chosen);
            worth = self.worth(goal, &information);
        }
        Ok((chosen, worth))
    }

    /// The best fractions of candidates, by moves of weight from where it helps least to
    /// where it helps most, until the duality gap is below `tolerance` times the worth
    /// (for D: nats). `None` for E, and where all candidates together leave the rank
    /// short.
    ///
    /// # Errors
    /// [`ChoiceError`] where the budget exceeds the number of candidates, or `stop` says
    /// so.
    pub fn relax(
        &self,
        goal: &Goal,
        budget: usize,
        tolerance: f64,
        steps: usize,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Relaxation>, ChoiceError> {
        self.check(budget)?;
        let m = self.rows.len();
        if m == 0 || budget == 0 {
            return Ok(None);
        }
        let mut information = self.base.clone();
        for rows in &self.rows {
            dense::add(&mut information, rows, self.n, budget as f64 / m as f64);
        }
        match self.gram(goal, &information) {
            Some(gram) => Ok(Some(gram.relaxed(budget, tolerance, steps, stop)?)),
            None => Ok(None),
        }
    }

    fn check(&self, budget: usize) -> Result<(), ChoiceError> {
        within(budget, self.rows.len())
    }
}

fn within(budget: usize, candidates: usize) -> Result<(), ChoiceError> {
    if budget > candidates {
        return Err(ChoiceError::Number(NumberError::OutOfRange {
            name: "budget",
            given: budget as f64,
            allowed: "at most the number of candidates",
        }));
    }
    Ok(())
}

fn check(stop: &mut dyn FnMut() -> bool) -> Result<(), ChoiceError> {
    if stop() {
        return Err(ChoiceError::Interrupted);
    }
    Ok(())
}

/// The same choice where everything is observable already, from C and G alone (see
/// [`gram`]): the way for problems with so many states that their information is not
/// formed.
impl Gram {
    /// Adds the best candidate, one after the other; `self` has them afterwards. Ranks are
    /// left out.
    ///
    /// # Errors
    /// [`ChoiceError`] where the budget exceeds the number of candidates, or `stop` says
    /// so.
    pub fn greedy(
        &mut self,
        budget: usize,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<Choice, ChoiceError> {
        within(budget, self.len())?;
        let mut choice = Choice {
            chosen: Vec::new(),
            worth: Vec::new(),
            rank: Vec::new(),
        };
        let mut left: Vec<usize> = (0..self.len()).collect();
        for _ in 0..budget {
            let mut best: Option<(usize, f64)> = None;
            for (place, &i) in left.iter().enumerate() {
                check(stop)?;
                let value = self.with(&[(i, 1.0)]).unwrap_or(f64::NEG_INFINITY);
                if best.is_none_or(|(_, v)| value > v) {
                    best = Some((place, value));
                }
            }
            let Some((place, _)) = best else {
                break;
            };
            let i = left.remove(place);
            if !self.add(&[(i, 1.0)]) {
                break;
            }
            choice.chosen.push(i);
            choice.worth.push(self.worth());
        }
        Ok(choice)
    }

    /// Swaps a chosen candidate (`self` has them all) for another as long as that is
    /// better, the best swap first; at most `rounds` swaps.
    ///
    /// # Errors
    /// [`ChoiceError::Interrupted`].
    pub fn exchange(
        &mut self,
        chosen: &[usize],
        rounds: usize,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<Vec<usize>, ChoiceError> {
        let mut chosen = chosen.to_vec();
        for _ in 0..rounds {
            let worth = self.worth();
            let mut best = (worth + 1e-12 * worth.abs().max(1.0), None);
            for (place, &out) in chosen.iter().enumerate() {
                for into in (0..self.len()).filter(|i| !chosen.contains(i)) {
                    check(stop)?;
                    let reached = self.with(&[(into, 1.0), (out, -1.0)]);
                    if let Some(reached) = reached.filter(|&r| r > best.0) {
                        best = (reached, Some((place, into)));
                    }
                }
            }
            let Some((place, into)) = best.1 else {
                break;
            };
            let out = core::mem::replace(&mut chosen[place], into);
            if !self.add(&[(into, 1.0), (out, -1.0)]) {
                break;
            }
        }
        Ok(chosen)
    }

    /// The best fractions of candidates, none of which `self` has: see [`Design::relax`].
    ///
    /// # Errors
    /// As [`greedy`](Self::greedy).
    pub fn relax(
        mut self,
        budget: usize,
        tolerance: f64,
        steps: usize,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Relaxation>, ChoiceError> {
        within(budget, self.len())?;
        if self.is_empty() || budget == 0 {
            return Ok(None);
        }
        let even = budget as f64 / self.len() as f64;
        for i in 0..self.len() {
            check(stop)?;
            if !self.add(&[(i, even)]) {
                return Ok(None);
            }
        }
        self.relaxed(budget, tolerance, steps, stop).map(Some)
    }

    /// Moves of weight, from equal weights of all candidates, which `self` has.
    fn relaxed(
        mut self,
        budget: usize,
        tolerance: f64,
        steps: usize,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<Relaxation, ChoiceError> {
        let m = self.len();
        let mut weights = vec![budget as f64 / m as f64; m];
        let mut limit = f64::INFINITY;
        let mut order: Vec<usize> = (0..m).collect();
        for _ in 0..steps {
            check(stop)?;
            let worth = self.worth();
            let slope = self.slopes();
            order.sort_by(|&a, &b| slope[b].total_cmp(&slope[a]));
            let best: f64 = order[..budget].iter().map(|&i| slope[i]).sum();
            let now: f64 = slope.iter().zip(&weights).map(|(s, w)| s * w).sum();
            limit = limit.min(worth + (best - now).max(0.0));
            let scale = if self.of_determinant() {
                1.0
            } else {
                worth.abs()
            };
            if limit - worth <= tolerance * scale {
                break;
            }
            // What rounding leaves of a weight has nothing to give: taken for one, it would
            // end the search.
            let up = order.iter().copied().find(|&i| weights[i] < 1.0 - RESIDUE);
            let down = order.iter().rev().copied().find(|&i| weights[i] > RESIDUE);
            let (Some(up), Some(down)) = (up, down) else {
                break;
            };
            if slope[up] <= slope[down] {
                break;
            }
            let most = (1.0 - weights[up]).min(weights[down]);
            let pair = self.part(&[up, down]);
            let (step, value) = golden(most, |t| {
                pair.with_all(&[t, -t]).unwrap_or(f64::NEG_INFINITY)
            });
            if value <= worth || !self.add(&[(up, step), (down, -step)]) {
                break;
            }
            weights[up] = (weights[up] + step).min(1.0);
            weights[down] = (weights[down] - step).max(0.0);
        }
        Ok(Relaxation {
            weights,
            worth: self.worth(),
            limit,
        })
    }
}

/// Weights this close to 0 or 1 have arrived.
const RESIDUE: f64 = 1e-12;

/// The largest of a concave function on [0, most]; also at the ends.
fn golden(most: f64, at: impl Fn(f64) -> f64) -> (f64, f64) {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    let (mut low, mut high) = (0.0, most);
    let (mut a, mut b) = (high - RATIO * (high - low), low + RATIO * (high - low));
    let (mut fa, mut fb) = (at(a), at(b));
    for _ in 0..24 {
        if fa < fb {
            (low, a, fa) = (a, b, fb);
            b = low + RATIO * (high - low);
            fb = at(b);
        } else {
            (high, b, fb) = (b, a, fa);
            a = high - RATIO * (high - low);
            fa = at(a);
        }
    }
    let middle = if fa < fb { (b, fb) } else { (a, fa) };
    let end = (most, at(most));
    if end.1 >= middle.1 { end } else { middle }
}

#[cfg(test)]
#[allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap
)]
mod tests {
    use super::*;

    fn candidates(count: usize, n: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1u32 << 31) * 2.0 - 1.0
        };
        (0..count)
            .map(|_| (0..n).map(|_| next()).collect())
            .collect()
    }

    /// The best of all choices.
    fn exhaustive(design: &Design, goal: &Goal, budget: usize) -> f64 {
        let m = design.rows.len();
        (0u32..1 << m)
            .filter(|set| set.count_ones() as usize == budget)
            .map(|set| {
                let chosen: Vec<usize> = (0..m).filter(|i| set >> i & 1 == 1).collect();
                design.worth(goal, &design.information(&chosen))
            })
            .fold(f64::NEG_INFINITY, f64::max)
    }

    #[test]
    fn the_limit_is_above_the_best_choice_and_the_choice_below_it() {
        for seed in 0..12 {
            let n = 3;
            let rows = candidates(10, n, seed);
            let groups: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
            for base in [vec![], vec![0.3, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.3]] {
                let design = Design::new(n, &base, &groups).unwrap();
                for goal in [Goal::D, Goal::A(vec![1.0, 2.0, 0.5]), Goal::E(vec![1.0; 3])] {
                    let best = exhaustive(&design, &goal, 4);
                    let greedy = design.greedy(&goal, 4, &mut || false).unwrap();
                    let (chosen, worth) = design
                        .exchange(&goal, &greedy.chosen, 50, &mut || false)
                        .unwrap();
                    assert_eq!(chosen.len(), 4);
                    assert!(greedy.worth[3] <= worth + 1e-12 && worth <= best + 1e-9);
                    if goal == Goal::D && !base.is_empty() {
                        // Nemhauser, Wolsey & Fisher.
                        let none = design.worth(&goal, &design.base);
                        let part = 1.0 - core::f64::consts::E.recip();
                        assert!(greedy.worth[3] - none >= part * (best - none) - 1e-12);
                    }
                    let relaxed = design.relax(&goal, 4, 1e-6, 2000, &mut || false).unwrap();
                    let Some(relaxed) = relaxed else {
                        assert!(matches!(goal, Goal::E(_)));
                        continue;
                    };
                    assert!(relaxed.limit >= best - 1e-9 * best.abs());
                    assert!((relaxed.weights.iter().sum::<f64>() - 4.0).abs() < 1e-9);
                    let scale = if goal == Goal::D {
                        1.0
                    } else {
                        relaxed.worth.abs()
                    };
                    assert!(relaxed.limit - relaxed.worth <= 1e-4 * scale, "{relaxed:?}");
                }
            }
        }
    }

    #[test]
    fn rank_comes_first() {
        let rows: [&[f64]; 3] = [&[90.0, 0.0], &[100.0, 0.0], &[0.0, 0.1]];
        let design = Design::new(2, &[], &rows).unwrap();
        let choice = design.greedy(&Goal::D, 2, &mut || false).unwrap();
        assert_eq!((choice.chosen, choice.rank), (vec![1, 2], vec![1, 2]));
        assert!(design.greedy(&Goal::D, 4, &mut || false).is_err());
    }
}
