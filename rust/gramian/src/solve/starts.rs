//! Where to start: points spread over a box or a prior, many starts, and the clusters of
//! what they reach.

use alloc::vec;
use alloc::vec::Vec;

use super::Model;
use super::gauss_newton::{Options, Solution, minimize};
use crate::batch::Stream;
use crate::chi_square::normal_quantile;

/// Where states may be.
#[derive(Clone, Debug, PartialEq)]
pub enum Spread {
    /// Uniform between these.
    Box {
        /// The least value of each state.
        low: Vec<f64>,
        /// The largest value of each state.
        high: Vec<f64>,
    },
    /// Independent and normal.
    Normal {
        /// Means.
        mean: Vec<f64>,
        /// Standard deviations.
        sigma: Vec<f64>,
    },
}

impl Spread {
    /// Number of states.
    pub fn states(&self) -> usize {
        match self {
            Self::Box { low, .. } => low.len(),
            Self::Normal { mean, .. } => mean.len(),
        }
    }

    /// Point `index` of a sequence that fills the spread evenly.
    ///
    /// # Source
    /// Multiples of the powers of 1 / phi, phi^(n + 1) = phi + 1 (Roberts 2018), the
    /// golden ratio's generalisation: a Kronecker sequence.
    pub fn point(&self, index: usize) -> Vec<f64> {
        let n = self.states();
        let mut phi = 2.0_f64;
        for _ in 0..60 {
            phi = (1.0 + phi).powf(1.0 / (n as f64 + 1.0));
        }
        let mut power = 1.0;
        self.map(|_| {
            power /= phi;
            (0.5 + (index as f64 + 1.0) * power).fract()
        })
    }

    /// An independent point, that of `index` under `seed`.
    pub fn random(&self, seed: u64, index: u64) -> Vec<f64> {
        let mut stream = Stream::new(seed, index);
        self.map(|_| stream.uniform())
    }

    /// The point at these fractions of the probability of each state.
    fn map(&self, mut fraction: impl FnMut(usize) -> f64) -> Vec<f64> {
        match self {
            Self::Box { low, high } => (0..low.len())
                .map(|k| low[k] + fraction(k) * (high[k] - low[k]))
                .collect(),
            Self::Normal { mean, sigma } => (0..mean.len())
                .map(|k| mean[k] + normal_quantile(fraction(k)) * sigma[k])
                .collect(),
        }
    }
}

/// By how much chi2 must be lower where steps did not come to rest than where others did:
/// noise prefers the wrong one of two solutions that far apart in one trial of 140.
const FAR_BETTER: f64 = 6.0;

/// One of the places that starts reached.
#[derive(Clone, Debug, PartialEq)]
pub struct Cluster {
    /// The best solution there.
    pub solution: Solution,
    /// How many starts reached it.
    pub hits: usize,
}

/// The square of the distance of two states that are one place: a tenth of a deviation.
pub const SAME: f64 = 0.01;

/// Whether two states are one place: less than a tenth of a deviation apart, by the rows
/// at either.
pub fn same_place<M: Model + ?Sized>(model: &M, a: &[f64], b: &[f64]) -> bool {
    let (m, n) = (model.measurements(), model.states());
    let mut change = vec![0.0; n];
    model.change(a, b, &mut change);
    let rows = |x: &[f64]| {
        let (mut residuals, mut rows) = (vec![0.0; m], vec![0.0; m * n]);
        let known = model.linearize(x, &mut residuals, Some(&mut rows));
        known.map_or(Vec::new(), |()| rows)
    };
    same(&change, &[]) || same(&change, &[&rows(a)]) && same(&change, &[&rows(b)])
}

/// Whether a change between two states is none, or a tenth of a deviation by the rows at each;
/// rows are empty where the model has none.
pub(super) fn same(change: &[f64], rows: &[&[f64]]) -> bool {
    let near = |rows: &&[f64]| !rows.is_empty() && moves(rows, change) < SAME;
    change.iter().all(|&c| c == 0.0) || !rows.is_empty() && rows.iter().all(near)
}

/// How far a change of the state moves the measurements, squared and whitened, by the rows.
pub(super) fn moves(rows: &[f64], change: &[f64]) -> f64 {
    rows.chunks_exact(change.len().max(1))
        .map(|row| crate::numbers::algebra::dot_slices(row, change).powi(2))
        .sum()
}

/// Puts a solution to the cluster it belongs to, or makes it a new one.
pub fn gather<M: Model + ?Sized>(model: &M, clusters: &mut Vec<Cluster>, solution: Solution) {
    let home = clusters
        .iter_mut()
        .find(|cluster| same_place(model, &cluster.solution.x, &solution.x));
    match home {
        Some(cluster) => {
            cluster.hits += 1;
            if solution.chi2 < cluster.solution.chi2 {
                cluster.solution = solution;
            }
        }
        None => clusters.push(Cluster { solution, hits: 1 }),
    }
}

/// Follows each start, and returns the clusters of those that converged, the best first.
/// The best of those that did not comes last, with no hits, where nothing converged.
pub fn multi_start<M: Model + ?Sized>(
    model: &M,
    starts: impl Iterator<Item = Vec<f64>>,
    options: Options,
) -> Vec<Cluster> {
    let mut clusters = Vec::new();
    let mut lost: Option<Solution> = None;
    for start in starts {
        let solution = minimize(model, &start, &[], options);
        if solution.converged {
            gather(model, &mut clusters, solution);
        } else if lost.as_ref().is_none_or(|best| solution.chi2 < best.chi2) {
            lost = Some(solution);
        }
    }
    // Where the steps that came to rest nowhere fit far better, that is the finding.
    let best = clusters
        .iter()
        .map(|cluster: &Cluster| cluster.solution.chi2)
        .fold(f64::INFINITY, f64::min);
    clusters.extend(
        lost.filter(|lost| clusters.is_empty() || lost.chi2 < best - FAR_BETTER)
            .map(|solution| Cluster { solution, hits: 0 }),
    );
    clusters.sort_by(|a, b| a.solution.chi2.total_cmp(&b.solution.chi2));
    clusters
}
