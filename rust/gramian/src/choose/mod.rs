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

use dense::{covariance, log_det, quadratic};

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

    /// Adds the best candidate, one after the other. While the rank is short, more rank
    /// comes first, then the larger product of the singular values that count.
    ///
    /// # Errors
    /// [`NumberError`] where the information overflows, or the budget exceeds the number
    /// of candidates.
    pub fn greedy(&self, goal: &Goal, budget: usize) -> Result<Choice, NumberError> {
        self.check(budget)?;
        let mut choice = Choice {
            chosen: Vec::new(),
            worth: Vec::new(),
            rank: Vec::new(),
        };
        let mut left: Vec<usize> = (0..self.rows.len()).collect();
        let mut rank = self.rank(&[])?.0;
        let mut information = self.base.clone();
        for _ in 0..budget {
            let mut best: Option<(usize, usize, f64)> = None;
            let inverse = if rank == self.n {
                covariance(&information, self.n)
            } else {
                None
            };
            for (place, &i) in left.iter().enumerate() {
                let (reached, value) = if let (Some(c), Goal::D) = (&inverse, goal) {
                    // Half the log determinant of I + F C F^T: what is gained.
                    (self.n, 0.5 * quadratic(&self.rows[i], c, self.n))
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
    pub fn exchange(&self, goal: &Goal, chosen: &[usize], rounds: usize) -> (Vec<usize>, f64) {
        let mut chosen = chosen.to_vec();
        let mut information = self.information(&chosen);
        let mut worth = self.worth(goal, &information);
        if worth == f64::NEG_INFINITY {
            return (chosen, worth);
        }
        for _ in 0..rounds {
            let mut best = (worth + 1e-12 * worth.abs().max(1.0), None);
            for (place, &out) in chosen.iter().enumerate() {
                let mut without = information.clone();
                dense::add(&mut without, &self.rows[out], self.n, -1.0);
                for into in (0..self.rows.len()).filter(|i| !chosen.contains(i)) {
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
            // Anew, so that differences leave no rounding behind.
            information = self.information(&chosen);
            worth = self.worth(goal, &information);
        }
        (chosen, worth)
    }

    /// The best fractions of candidates, by moves of weight from where it helps least to
    /// where it helps most, until the duality gap is below `tolerance` times the worth
    /// (for D: nats). `None` for E, and where all candidates together leave the rank
    /// short.
    ///
    /// # Errors
    /// [`NumberError`] where the budget exceeds the number of candidates.
    pub fn relax(
        &self,
        goal: &Goal,
        budget: usize,
        tolerance: f64,
        steps: usize,
    ) -> Result<Option<Relaxation>, NumberError> {
        self.check(budget)?;
        let m = self.rows.len();
        if matches!(goal, Goal::E(_)) || m == 0 {
            return Ok(None);
        }
        let mut weights = vec![budget as f64 / m as f64; m];
        let mut information = self.base.clone();
        for (rows, &w) in self.rows.iter().zip(&weights) {
            dense::add(&mut information, rows, self.n, w);
        }
        let mut worth = self.worth(goal, &information);
        if worth == f64::NEG_INFINITY || budget == 0 {
            return Ok(None);
        }
        let mut limit = f64::INFINITY;
        let mut order: Vec<usize> = (0..m).collect();
        for _ in 0..steps {
            let Some(slope) = self.slopes(goal, &information) else {
                break;
            };
            order.sort_by(|&a, &b| slope[b].total_cmp(&slope[a]));
            let best: f64 = order[..budget].iter().map(|&i| slope[i]).sum();
            let now: f64 = slope.iter().zip(&weights).map(|(s, w)| s * w).sum();
            limit = limit.min(worth + (best - now).max(0.0));
            let scale = if *goal == Goal::D { 1.0 } else { worth.abs() };
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
            let at = |t: f64| {
                let mut moved = information.clone();
                dense::add(&mut moved, &self.rows[up], self.n, t);
                dense::add(&mut moved, &self.rows[down], self.n, -t);
                let value = self.worth(goal, &moved);
                (value, moved)
            };
            let (step, value, moved) = golden(most, at);
            if value <= worth {
                break;
            }
            worth = value;
            information = moved;
            weights[up] = (weights[up] + step).min(1.0);
            weights[down] = (weights[down] - step).max(0.0);
        }
        Ok(Some(Relaxation {
            weights,
            worth,
            limit,
        }))
    }

    /// The derivative of the worth by each candidate's weight.
    fn slopes(&self, goal: &Goal, information: &[f64]) -> Option<Vec<f64>> {
        let n = self.n;
        let c = covariance(information, n)?;
        Some(
            self.rows
                .iter()
                .map(|rows| {
                    let mut sum = 0.0;
                    for row in rows.chunks_exact(n) {
                        for j in 0..n {
                            let product: f64 = (0..n).map(|k| row[k] * c[k * n + j]).sum();
                            sum += match goal {
                                Goal::A(weights) => weights[j] * product * product,
                                _ => 0.5 * product * row[j],
                            };
                        }
                    }
                    sum
                })
                .collect(),
        )
    }

    fn check(&self, budget: usize) -> Result<(), NumberError> {
        if budget > self.rows.len() {
            return Err(NumberError::OutOfRange {
                name: "budget",
                given: budget as f64,
                allowed: "at most the number of candidates",
            });
        }
        Ok(())
    }
}

/// Weights this close to 0 or 1 have arrived.
const RESIDUE: f64 = 1e-12;

/// The largest of a concave function on [0, most]; also at the ends.
fn golden(most: f64, at: impl Fn(f64) -> (f64, Vec<f64>)) -> (f64, f64, Vec<f64>) {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    let (mut low, mut high) = (0.0, most);
    let (mut a, mut b) = (high - RATIO * (high - low), low + RATIO * (high - low));
    let (mut fa, mut fb) = (at(a).0, at(b).0);
    for _ in 0..24 {
        if fa < fb {
            (low, a, fa) = (a, b, fb);
            b = low + RATIO * (high - low);
            fb = at(b).0;
        } else {
            (high, b, fb) = (b, a, fa);
            a = high - RATIO * (high - low);
            fa = at(a).0;
        }
    }
    let middle = if fa < fb { b } else { a };
    let (value, moved) = at(middle);
    let (end, ended) = at(most);
    if end >= value {
        return (most, end, ended);
    }
    (middle, value, moved)
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
                    let greedy = design.greedy(&goal, 4).unwrap();
                    let (chosen, worth) = design.exchange(&goal, &greedy.chosen, 50);
                    assert_eq!(chosen.len(), 4);
                    assert!(greedy.worth[3] <= worth + 1e-12 && worth <= best + 1e-9);
                    if goal == Goal::D && !base.is_empty() {
                        // Nemhauser, Wolsey & Fisher.
                        let none = design.worth(&goal, &design.base);
                        let part = 1.0 - core::f64::consts::E.recip();
                        assert!(greedy.worth[3] - none >= part * (best - none) - 1e-12);
                    }
                    let relaxed = design.relax(&goal, 4, 1e-6, 2000).unwrap();
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
        let choice = design.greedy(&Goal::D, 2).unwrap();
        assert_eq!((choice.chosen, choice.rank), (vec![1, 2], vec![1, 2]));
        assert!(design.greedy(&Goal::D, 4).is_err());
    }
}
