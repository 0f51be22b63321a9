//! Which other states fit as well: what the information matrix cannot see.
//!
//! # Algorithm
//! What the caller knows already; the symmetries the model declares; along the weakest direction to where chi2 has
//! risen and falls again; from points spread over the prior or a box. Each is followed
//! by the model's own Gauss-Newton steps, and what they reach is clustered. One whose next
//! step leads to a place that is known already is followed no farther, nor one from where the
//! way to such a place is nearly straight; what is new is polished.

use alloc::vec;
use alloc::vec::Vec;

use super::Model;
use super::gauss_newton::{Options, Solution, Stage, minimize, minimize_until, norm};
use super::starts::{Cluster, SAME, Spread, moves, same};
use crate::chi_square;
use crate::numbers::algebra::dot_slices as dot;
use crate::observability::Observability;

/// How to search.
#[derive(Clone, Debug)]
pub struct Search {
    /// States to follow, such as other minima that are known already.
    pub from: Vec<Vec<f64>>,
    /// Whether the weakest directions are searched along.
    pub weakest: bool,
    /// Where further solutions may be; without it only the rest is tried.
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
    let mut places = Places::new(model, x, options);
    let mut tried = search.from.clone();
    model.symmetries(&x.x, &mut |image| tried.push(image.to_vec()));
    if search.weakest {
        along_weakest(model, x, &mut tried);
    }
    for start in &tried {
        places.follow(start, false);
    }
    for cluster in &mut places.clusters {
        cluster.hits = 0;
    }
    let (mut starts, mut single, mut unseen) = (0_u32, 0, 1.0);
    if let Some(spread) = search.spread.as_ref().filter(|_| search.starts > 0) {
        // Half of them even, to miss little; half independent, to tell what was missed.
        let even = search.starts / 2;
        for index in 0..even {
            places.follow(&spread.point(index), curved(index));
        }
        let before: Vec<usize> = places.clusters.iter().map(|c| c.hits).collect();
        for index in even..search.starts {
            let start = spread.random(search.seed, index as u64);
            starts += u32::from(places.follow(&start, curved(index)));
        }
        single = places
            .clusters
            .iter()
            .enumerate()
            .filter(|(i, c)| c.hits == before.get(*i).copied().unwrap_or(0) + 1)
            .count();
        if starts > 0 {
            unseen = ((single as f64 + 3.0) / f64::from(starts)).min(1.0);
        }
    }
    // Images of whatever turned out to be another solution.
    for index in 1..places.clusters.len() {
        let mut images = Vec::new();
        model.symmetries(&places.clusters[index].solution.x, &mut |image| {
            images.push(image.to_vec());
        });
        for start in images {
            places.follow(&start, false);
        }
    }
    let Places {
        mut clusters,
        mut local,
        ..
    } = places;
    let first = (0..clusters.len())
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
    let best = clusters.swap_remove(first).solution;
    let at_best = local.swap_remove(first);
    let mut out = vec![0.0; model.measurements()];
    let mut others: Vec<Other> = clusters
        .into_iter()
        .zip(&local)
        .filter(|(c, local)| !one_place(model, (&best.x, &at_best), (&c.solution.x, local)))
        .filter_map(|(mut c, _)| {
            c.solution.x = beside(model, &best.x, &c.solution.x)?;
            Some(c)
        })
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

/// What starts have reached so far.
struct Places<'a, M: ?Sized> {
    model: &'a M,
    options: Options,
    clusters: Vec<Cluster>,
    /// The model at each.
    local: Vec<Local>,
}

/// Residuals and rows at a state; empty where it has none.
struct Local {
    residuals: Vec<f64>,
    rows: Vec<f64>,
}

impl Local {
    fn new<M: Model + ?Sized>(model: &M, x: &[f64]) -> Self {
        let m = model.measurements();
        let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * model.states()]);
        let sound = model.linearize(x, &mut residuals, Some(&mut rows)).is_ok();
        if !sound {
            residuals.clear();
            rows.clear();
        }
        Self { residuals, rows }
    }

    /// How far a change of the state moves the measurements, squared and whitened, by the rows.
    fn moves(&self, change: &[f64]) -> f64 {
        moves(&self.rows, change)
    }

    /// Whether residuals after a change are nearly what the rows foretell.
    fn foretells(&self, change: &[f64], residuals: &[f64]) -> bool {
        let n = change.len().max(1);
        let (mut off, mut way) = (0.0, 0.0);
        for ((row, from), to) in self
            .rows
            .chunks_exact(n)
            .zip(&self.residuals)
            .zip(residuals)
        {
            let moved = dot(row, change);
            off += (to - from + moved).powi(2);
            way += moved * moved;
        }
        off < STRAIGHT * STRAIGHT * way
    }
}

/// As [`super::starts::same_place`], where the model at both states is known.
fn one_place<M: Model + ?Sized>(model: &M, a: (&[f64], &Local), b: (&[f64], &Local)) -> bool {
    let mut change = vec![0.0; a.0.len()];
    model.change(a.0, b.0, &mut change);
    same(&change, &[&a.1.rows, &b.1.rows])
}

/// How near a start is followed, in deviations, before it is known whether it leads to
/// something new.
const COARSE: f64 = 1e-2;
/// By how much residuals may differ from what the rows at a known place foretell, as a share of
/// the way there, and how much of the way may be left after the next step, where Gauss-Newton
/// steps lead to it.
const STRAIGHT: f64 = 0.5;
/// Whether a start is followed by steps that keep to the curvature of the model: three of four
/// are, for two thirds of the evaluations. Plain steps go astray more often, and find a few
/// places that the others pass.
fn curved(index: usize) -> bool {
    index % 4 != 1
}

/// Damping of a first step from far away: half the evaluations, and more of the starts come to
/// rest.
const FAR: f64 = 1.0;

impl<'a, M: Model + ?Sized> Places<'a, M> {
    fn new(model: &'a M, first: &Solution, options: Options) -> Self {
        Self {
            model,
            options,
            local: vec![Local::new(model, &first.x)],
            clusters: vec![Cluster {
                solution: first.clone(),
                hits: 0,
            }],
        }
    }

    /// Follows a start, by curved steps or not, and by the others where it is lost; whether it
    /// led to a minimum, known or new.
    fn follow(&mut self, start: &[f64], curved: bool) -> bool {
        self.descend(start, curved) || self.descend(start, !curved)
    }

    fn descend(&mut self, start: &[f64], curved: bool) -> bool {
        let (model, n) = (self.model, start.len());
        let coarse = Options {
            tolerance: COARSE,
            damping: FAR,
            curved,
            ..self.options
        };
        let mut known = None;
        let (mut next, mut change) = (vec![0.0; n], vec![0.0; n]);
        let (clusters, local) = (&self.clusters, &self.local);
        let mut leads = |stage: &Stage<'_>| {
            for ((next, x), step) in next.iter_mut().zip(stage.x).zip(stage.step) {
                *next = x + step;
            }
            known = clusters.iter().zip(local).position(|(cluster, local)| {
                let there = &cluster.solution;
                if local.rows.is_empty() || stage.chi2 <= there.chi2 - 1e-6 * (1.0 + there.chi2) {
                    return false;
                }
                // The next step ends there, or well on the way along which the model is nearly
                // linear.
                model.change(&there.x, &next, &mut change);
                let ahead = local.moves(&change);
                model.change(&there.x, stage.x, &mut change);
                ahead < SAME
                    || ahead < STRAIGHT * STRAIGHT * local.moves(&change)
                        && local.foretells(&change, stage.residuals)
            });
            known.is_some()
        };
        let reached = minimize_until(model, start, coarse, &mut leads);
        if let Some(index) = known {
            self.clusters[index].hits += 1;
            return true;
        }
        if !reached.converged {
            return false;
        }
        let solution = minimize(model, &reached.x, &[], self.options);
        if !solution.converged {
            return false;
        }
        let here = Local::new(model, &solution.x);
        let mut known = self.clusters.iter().zip(&self.local);
        let home = known.position(|(cluster, local)| {
            one_place(model, (&cluster.solution.x, local), (&solution.x, &here))
        });
        if let Some(index) = home {
            let cluster = &mut self.clusters[index];
            cluster.hits += 1;
            if solution.chi2 < cluster.solution.chi2 {
                cluster.solution = solution;
                self.local[index] = here;
            }
        } else {
            self.local.push(here);
            self.clusters.push(Cluster { solution, hits: 1 });
        }
        true
    }
}

/// A state as it is written beside another one; `None` where it is written otherwise alone.
pub(super) fn beside<M: Model + ?Sized>(model: &M, at: &[f64], x: &[f64]) -> Option<Vec<f64>> {
    let extents: Vec<(f64, f64)> = (0..x.len()).map(|k| model.extent(at, k)).collect();
    if extents
        .iter()
        .all(|e| e.0.is_infinite() && e.1.is_infinite())
    {
        return Some(x.to_vec());
    }
    let mut there = vec![0.0; x.len()];
    model.change(at, x, &mut there);
    for ((there, at), (x, (low, high))) in there.iter_mut().zip(at).zip(x.iter().zip(&extents)) {
        *there += at;
        if low.is_infinite() && high.is_infinite() {
            // To the last digit.
            *there = *x;
        }
    }
    let within = |(x, (low, high)): (&f64, &(f64, f64))| low <= x && x <= high;
    there.iter().zip(&extents).all(within).then_some(there)
}

/// Q(distance / 2): the chance that noise prefers the wrong one of two states whose
/// exact data are this far apart, whitened.
pub fn chance(distance: f64) -> f64 {
    0.5 * chi_square::tail(distance * distance / 4.0, 1.0)
}

/// Along a direction: by which factor each place is farther out, in deviations, and how many.
const REACH: (f64, usize) = (1.5, 24);

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
            for _ in 0..REACH.1 {
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
                far *= REACH.0;
            }
            if !rising && risen {
                starts.push(last);
            }
        }
    }
}
