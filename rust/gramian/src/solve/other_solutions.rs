//! Which other states fit as well: what the information matrix cannot see.
//!
//! # Algorithm
//! The symmetries the model declares; along the weakest direction to where chi2 has
//! risen and falls again; from points spread over the prior or a box. Each is followed
//! by the model's own Gauss-Newton steps, and what they reach is clustered.

use alloc::vec;
use alloc::vec::Vec;

use super::Model;
use super::gauss_newton::{Options, Solution, minimize, norm};
use super::starts::{Cluster, Spread, gather, same_place};
use crate::chi_square;
use crate::observability::Observability;

/// How to search.
#[derive(Clone, Debug)]
pub struct Search {
    /// Where further solutions may be; without it only symmetries and the weakest
    /// directions are tried.
    pub spread: Option<Spread>,
    /// How many points of it are followed.
    pub starts: usize,
    /// Of the independent starts.
    pub seed: u64,
    /// How each is followed.
    pub options: Options,
}

/// Another state that fits.
#[derive(Clone, Debug, PartialEq)]
pub struct Other {
    /// Where it is, and how well it fits.
    pub solution: Solution,
    /// |h(other) - h(x)|, whitened.
    pub distance: f64,
    /// The chance that noise prefers the wrong one of the two: Q(distance / 2).
    pub chance: f64,
    /// How many starts reached it.
    pub hits: usize,
}

/// What a search has found.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The state searched from, or a better one that was reached.
    pub best: Solution,
    /// Every other one, the likeliest first.
    pub others: Vec<Other>,
    /// Independent starts that converged.
    pub starts: usize,
    /// Clusters that exactly one of them reached.
    pub single: usize,
    /// Upper 95 % limit on the probability that a further independent start reaches a
    /// cluster not seen; 1 without starts.
    pub unseen: f64,
}

/// Searches from `x`, a state the measurements were fitted with.
///
/// # Source
/// The limit on what was missed is Good's 1953 estimate of unseen mass, single clusters
/// over starts, with the margin of three that the rule of three gives.
pub fn other_solutions<M: Model + ?Sized>(model: &M, x: &Solution, search: &Search) -> Found {
    let options = search.options;
    let mut clusters = vec![Cluster {
        solution: x.clone(),
        hits: 0,
    }];
    let mut tried = Vec::new();
    model.symmetries(&x.x, &mut |image| tried.push(image.to_vec()));
    along_weakest(model, x, &mut tried);
    for start in &tried {
        let solution = minimize(model, start, &[], options);
        if solution.converged {
            gather(model, &mut clusters, solution);
        }
    }
    for cluster in &mut clusters {
        cluster.hits = 0;
    }
    let (mut starts, mut single, mut unseen) = (0_u32, 0, 1.0);
    if let Some(spread) = search.spread.as_ref().filter(|_| search.starts > 0) {
        // Half of them even, to miss little; half independent, to tell what was missed.
        let even = search.starts / 2;
        for index in 0..even {
            let solution = minimize(model, &spread.point(index), &[], options);
            if solution.converged {
                gather(model, &mut clusters, solution);
            }
        }
        let before: Vec<usize> = clusters.iter().map(|c| c.hits).collect();
        for index in even..search.starts {
            let start = spread.random(search.seed, index as u64);
            let solution = minimize(model, &start, &[], options);
            if solution.converged {
                starts += 1;
                gather(model, &mut clusters, solution);
            }
        }
        single = clusters
            .iter()
            .enumerate()
            .filter(|(i, c)| c.hits == before.get(*i).copied().unwrap_or(0) + 1)
            .count();
        if starts > 0 {
            unseen = ((single as f64 + 3.0) / f64::from(starts)).min(1.0);
        }
    }
    // Images of whatever turned out to be another solution.
    for index in 1..clusters.len() {
        let mut images = Vec::new();
        model.symmetries(&clusters[index].solution.x, &mut |image| {
            images.push(image.to_vec());
        });
        for start in images {
            let solution = minimize(model, &start, &[], options);
            if solution.converged {
                gather(model, &mut clusters, solution);
            }
        }
    }
    let best = (0..clusters.len())
        .min_by(|&a, &b| {
            let chi2 = |i: usize| clusters[i].solution.chi2;
            // The given state stays the answer where another one fits no better.
            let (a2, b2) = (chi2(a), chi2(b));
            let margin = 1e-9 * (1.0 + a2.min(b2));
            if (a2 - b2).abs() <= margin {
                a.cmp(&b)
            } else {
                a2.total_cmp(&b2)
            }
        })
        .unwrap_or(0);
    let best = clusters.swap_remove(best).solution;
    let mut out = vec![0.0; model.measurements()];
    let mut others: Vec<Other> = clusters
        .into_iter()
        .filter(|c| !same_place(model, &best.x, &c.solution.x))
        .map(|c| {
            let sound = model.difference(&best.x, &c.solution.x, &mut out).is_ok();
            let distance = if sound { norm(&out) } else { f64::INFINITY };
            Other {
                chance: chance(distance),
                distance,
                hits: c.hits,
                solution: c.solution,
            }
        })
        .collect();
    others.sort_by(|a, b| a.solution.chi2.total_cmp(&b.solution.chi2));
    Found {
        best,
        others,
        starts: starts as usize,
        single,
        unseen,
    }
}

/// Q(distance / 2): the chance that noise prefers the wrong one of two states whose
/// exact data are this far apart, whitened.
pub fn chance(distance: f64) -> f64 {
    0.5 * chi_square::tail(distance * distance / 4.0, 1.0)
}

/// Starts along +- the two weakest directions and each state, where chi2 has risen and
/// falls again.
fn along_weakest<M: Model + ?Sized>(model: &M, x: &Solution, starts: &mut Vec<Vec<f64>>) {
    let (m, n) = (model.measurements(), model.states());
    let mut residuals = vec![0.0; m];
    let mut rows = vec![0.0; m * n];
    if model
        .linearize(&x.x, &mut residuals, Some(&mut rows))
        .is_err()
    {
        return;
    }
    let Ok(found) = Observability::new(&rows, n, None) else {
        return;
    };
    let scale = found.scale();
    let mut directions = found.longest_axes(2);
    // A mirror image is often across an axis, whatever the weakest direction.
    for (k, std) in found.crlb_std().into_iter().enumerate() {
        let mut axis = vec![0.0; n];
        axis[k] = if std.is_finite() { std } else { scale[k] };
        directions.push(axis);
    }
    for direction in directions {
        for sign in [-1.0, 1.0] {
            let mut before = x.chi2;
            let (mut rising, mut risen, mut far) = (true, false, 1.0_f64);
            let mut last = x.x.clone();
            for _ in 0..40 {
                let place: Vec<f64> = (0..n).map(|k| x.x[k] + sign * far * direction[k]).collect();
                let chi2 = match model.linearize(&place, &mut residuals, None) {
                    Ok(()) => residuals.iter().map(|r| r * r).sum(),
                    Err(_) => f64::INFINITY,
                };
                if chi2 < before {
                    rising = false;
                } else if !rising {
                    // The lowest place between two rises.
                    if risen {
                        starts.push(last.clone());
                    }
                    rising = true;
                }
                risen |= chi2 > x.chi2 + 1.0;
                before = chi2;
                last = place;
                far *= 1.3;
            }
            if !rising && risen {
                starts.push(last);
            }
        }
    }
}
