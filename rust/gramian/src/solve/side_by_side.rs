//! Many small problems of one shape at once: one in each lane of a vector, each from its
//! own start, by the rules of [`gauss_newton`](super::gauss_newton).
//!
//! # Algorithm
//! Levenberg-Marquardt with the damping in units of the columns (Moré 1978), changed by how
//! much of the decrease that the rows foretell each step brings (Nielsen 1999). Rows are
//! taken in pieces and reduced by Householder reflections into the triangular factor as
//! they come, so that the information is never formed and a piece stays in the cache. A
//! lane whose steps have come to rest takes the next problem. No lane depends on another:
//! the same problem gives the same bits in any company.

use alloc::vec;
use alloc::vec::Vec;

use super::gauss_newton::{Loss, Options};
use crate::batch::lanes::{Block, LANES, Lanes};
use crate::batch::simd::Path;
use crate::numbers::lane::Lane;

/// Rows that are reduced at once.
pub const PIECE: usize = 32;

/// Problems that differ in their numbers alone, one in each lane.
pub trait SideBySide {
    /// Number n of states.
    fn states(&self) -> usize;

    /// Puts a problem into a lane, in place of the one that was there.
    fn load(&mut self, lane: usize, problem: usize);

    /// Gives the whitened rows and residuals of each lane's problem at its state, n blocks
    /// `x`: not finite in a lane without value or derivative.
    fn linearize(&mut self, x: &[Block], rows: &mut Rows);
}

/// Takes rows and residuals, and reduces them.
#[derive(Debug)]
pub struct Rows {
    path: Path,
    loss: Loss,
    states: usize,
    /// Column after column of [`PIECE`] rows each, the residuals last.
    piece: Vec<Block>,
    used: usize,
    /// The triangular factor, n rows of n + 1.
    factor: Vec<Block>,
    /// Sum of the losses, and of the squares of what is no prior.
    cost: Block,
    data: Block,
    /// Whether the factor is wanted.
    reduced: bool,
}

impl Rows {
    /// For `states`.
    pub fn new(states: usize, loss: Loss, path: Path) -> Self {
        Self {
            path,
            loss,
            states,
            piece: vec![[0.0; LANES]; (states + 1) * PIECE],
            used: 0,
            factor: vec![[0.0; LANES]; states * (states + 1)],
            cost: [0.0; LANES],
            data: [0.0; LANES],
            reduced: true,
        }
    }

    fn clear(&mut self, reduced: bool) {
        self.used = 0;
        self.factor.fill([0.0; LANES]);
        (self.cost, self.data) = ([0.0; LANES], [0.0; LANES]);
        self.reduced = reduced;
    }

    /// Adds `count` rows, at most [`PIECE`], which `fill` writes: it is given memory whose
    /// entry `column * PIECE + row` belongs to a row of its and one of n + 1 columns, the
    /// residual the last, with anything in it. The loss touches what is `measured`, not
    /// what is known beforehand.
    pub fn add(&mut self, count: usize, measured: bool, fill: impl FnOnce(&mut [Block])) {
        if self.used + count > PIECE {
            self.reduce();
        }
        fill(&mut self.piece[self.used..]);
        let loss = if measured { self.loss } else { Loss::Squares };
        self.path.run(Weigh {
            loss,
            states: self.states,
            piece: &mut self.piece[self.used..],
            count,
            cost: &mut self.cost,
            data: measured.then_some(&mut self.data),
        });
        self.used += count;
    }

    fn reduce(&mut self) {
        if self.reduced && self.used > 0 {
            // Whole fours of rows.
            let padded = self.used.next_multiple_of(4);
            for column in self.piece.chunks_exact_mut(PIECE) {
                column[self.used..padded].fill([0.0; LANES]);
            }
            self.path.run(Reflect {
                states: self.states,
                rows: padded,
                stride: PIECE,
                piece: &mut self.piece,
                factor: &mut self.factor,
            });
        }
        self.used = 0;
    }
}

/// Weighs rows by a loss, and adds up.
struct Weigh<'a> {
    loss: Loss,
    states: usize,
    piece: &'a mut [Block],
    count: usize,
    cost: &'a mut Block,
    data: Option<&'a mut Block>,
}

impl pulp::WithSimd for Weigh<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let last = self.states * PIECE;
        let mut none = [0.0; LANES];
        let data = self.data.unwrap_or(&mut none);
        for part in 0..Lanes::<S>::PARTS {
            let mut cost = Lanes::load(simd, self.cost, part);
            let mut sum = Lanes::load(simd, data, part);
            for row in 0..self.count {
                let r = Lanes::load(simd, &self.piece[last + row], part);
                sum = Lane::mul_add(r, r, sum);
                if self.loss == Loss::Squares {
                    cost = Lane::mul_add(r, r, cost);
                    continue;
                }
                let (twice, weight) = self.loss.at(r);
                cost = cost + twice;
                let weight = Lane::sqrt(weight);
                for column in 0..=self.states {
                    let entry = &mut self.piece[column * PIECE + row];
                    (Lanes::load(simd, entry, part) * weight).store(entry, part);
                }
            }
            cost.store(self.cost, part);
            sum.store(data, part);
        }
    }
}

/// Reflects rows into a triangular factor.
struct Reflect<'a> {
    states: usize,
    /// A multiple of four.
    rows: usize,
    /// From one column to the next.
    stride: usize,
    piece: &'a mut [Block],
    factor: &'a mut [Block],
}

/// Sums of products of a column with `K` others.
#[inline(always)]
fn products<S: pulp::Simd, const K: usize>(
    simd: S,
    part: usize,
    column: &[Block],
    others: [&[Block]; K],
) -> [Lanes<S>; K] {
    let mut sums = [Lanes::splat(simd, 0.0); K];
    for i in 0..column.len() {
        let x = Lanes::load(simd, &column[i], part);
        for k in 0..K {
            sums[k] = Lane::mul_add(x, Lanes::load(simd, &others[k][i], part), sums[k]);
        }
    }
    sums
}

/// The square of a column, in four sums.
#[inline(always)]
fn square<S: pulp::Simd>(simd: S, part: usize, column: &[Block]) -> Lanes<S> {
    let mut sums = [Lanes::splat(simd, 0.0); 4];
    for four in column.chunks_exact(4) {
        for k in 0..4 {
            let x = Lanes::load(simd, &four[k], part);
            sums[k] = Lane::mul_add(x, x, sums[k]);
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// Takes from `K` columns their parts along one.
#[inline(always)]
#[allow(clippy::needless_pass_by_value)] // The columns are lent one by one.
fn take<S: pulp::Simd, const K: usize>(
    simd: S,
    part: usize,
    column: &[Block],
    others: [&mut [Block]; K],
    parts: [Lanes<S>; K],
) {
    for i in 0..column.len() {
        let x = Lanes::load(simd, &column[i], part);
        for k in 0..K {
            let entry = &mut others[k][i];
            Lane::negate_mul_add(x, parts[k], Lanes::load(simd, entry, part)).store(entry, part);
        }
    }
}

impl pulp::WithSimd for Reflect<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let (n, rows, stride) = (self.states, self.rows, self.stride);
        let wide = n + 1;
        let zero = Lanes::splat(simd, 0.0);
        for part in 0..Lanes::<S>::PARTS {
            for j in 0..n {
                let (head, tail) = self.piece.split_at_mut((j + 1) * stride);
                let column = &head[j * stride..][..rows];
                let line = &mut self.factor[j * wide..][..wide];
                let pivot = Lanes::load(simd, &line[j], part);
                let below = square(simd, part, column);
                let norm = Lane::sqrt(Lane::mul_add(pivot, pivot, below));
                let alpha = pivot.select_greater(zero, -norm, norm);
                let first = pivot - alpha;
                // Of a column that is zero, or whose square is, nothing is taken.
                let share = Lane::recip_or_zero(norm * first.abs());
                alpha.store(&mut line[j], part);
                let mut k = j + 1;
                while k + 4 <= wide {
                    let (a, rest) = tail[(k - j - 1) * stride..].split_at_mut(stride);
                    let (b, rest) = rest.split_at_mut(stride);
                    let (c, d) = rest.split_at_mut(stride);
                    let (a, b) = (&mut a[..rows], &mut b[..rows]);
                    let (c, d) = (&mut c[..rows], &mut d[..rows]);
                    let mut parts = products(simd, part, column, [a, b, c, d]);
                    for (q, along) in parts.iter_mut().enumerate() {
                        let entry = &mut line[k + q];
                        let above = Lanes::load(simd, entry, part);
                        *along = Lane::mul_add(first, above, *along) * share;
                        Lane::negate_mul_add(*along, first, above).store(entry, part);
                    }
                    take(simd, part, column, [a, b, c, d], parts);
                    k += 4;
                }
                while k < wide {
                    let other = &mut tail[(k - j - 1) * stride..][..rows];
                    let [along] = products(simd, part, column, [other]);
                    let above = Lanes::load(simd, &line[k], part);
                    let along = Lane::mul_add(first, above, along) * share;
                    Lane::negate_mul_add(along, first, above).store(&mut line[k], part);
                    take(simd, part, column, [other], [along]);
                    k += 1;
                }
            }
        }
    }
}

/// Where the steps of a problem from one start ended.
#[derive(Clone, Debug)]
pub struct Arrived {
    /// The states.
    pub x: Vec<f64>,
    /// Sum of the squares, or twice the robust loss, priors included; infinite where the
    /// model has no value at the start.
    pub chi2: f64,
    /// Sum of the squares of the residuals of measurements alone.
    pub data: f64,
    /// Steps taken.
    pub iterations: u32,
    /// Whether they came to rest.
    pub converged: bool,
    /// The triangular factor of the rows there, row-major (n, n), weighted by the loss.
    pub factor: Vec<f64>,
}

/// Where one lane is.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    /// Which job, if any.
    job: Option<usize>,
    fresh: bool,
    cost: f64,
    data: f64,
    /// Square of the undamped step, in deviations.
    decrease: f64,
    /// By how much the damped step lowers the loss, by the rows.
    foretold: f64,
    damping: f64,
    /// By how much damping rises where the step is refused.
    rise: f64,
    iterations: u32,
}

/// By how much damping rises after the first of the steps that are refused one after the other;
/// twice as much after each further one.
const RISE: f64 = 4.0;
/// By how much it falls at most.
const FALL: f64 = 0.1;
/// The least damping after a refused step: of one longer than a deviation, and near the minimum.
const LEAST: (f64, f64) = (0.03, 1e-4);

/// What follows a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    /// It was taken, and another follows.
    Taken,
    /// It was not: a shorter one follows.
    Refused,
    /// Done after it was taken.
    Rest(bool),
    /// Done without it.
    Stay(bool),
}

impl Place {
    /// What becomes of a step to a state of this loss.
    fn judge(&mut self, trial: f64, options: Options) -> Verdict {
        let tolerance = 1e-12 + 1e-15 * self.cost;
        if self.fresh {
            self.fresh = false;
            if !trial.is_finite() {
                self.cost = f64::INFINITY;
                return Verdict::Stay(false);
            }
            self.cost = trial;
            return Verdict::Taken;
        }
        if trial <= self.cost + tolerance {
            let gain = self.cost - trial;
            self.cost = trial;
            // A step of this size in deviations, that gains as little: at rest.
            if self.decrease < 1e-7 && gain.abs() < 1e-9 * (1.0 + trial) && self.damping < 1e-3 {
                return Verdict::Rest(true);
            }
            // What is no number changes nothing.
            let share = (gain / self.foretold).clamp(0.0, 1.0);
            self.damping *= (1.0 - (2.0 * share - 1.0).powi(3)).max(FALL);
            if self.damping < 1e-7 {
                self.damping = 0.0;
            }
            self.rise = RISE;
            return Verdict::Taken;
        }
        let least = if self.decrease > 1.0 {
            LEAST.0
        } else {
            LEAST.1
        };
        self.damping = (self.damping * self.rise).max(least);
        self.rise *= 2.0;
        // Where the rows have a jump, as when a turn meets a sample, the loss has a kink:
        // at rest where a step that small would gain nothing.
        if self.decrease < 1e-5 * (1.0 + self.damping) {
            return Verdict::Stay(true);
        }
        if self.iterations >= options.max_iterations || self.damping > 1e12 {
            return Verdict::Stay(false);
        }
        Verdict::Refused
    }
}

/// Follows each job, a problem and where it starts, to its end. The answers are in the
/// order of the jobs.
pub fn minimize_all<M: SideBySide + ?Sized>(
    model: &mut M,
    jobs: &[(usize, &[f64])],
    options: Options,
    path: Path,
) -> Vec<Arrived> {
    let n = model.states();
    let mut work = Work::new(n, options, path);
    let mut out: Vec<Option<Arrived>> = vec![None; jobs.len()];
    let mut waiting = 0;
    for lane in 0..LANES {
        work.next_job(model, lane, jobs, &mut waiting);
    }
    while work.places.iter().any(|place| place.job.is_some()) {
        work.propose();
        work.rows.clear(true);
        model.linearize(&work.next, &mut work.rows);
        work.rows.reduce();
        for lane in 0..LANES {
            let Some(job) = work.places[lane].job else {
                continue;
            };
            if let Some(converged) = work.settle(lane) {
                out[job] = Some(work.arrived(lane, converged));
                work.next_job(model, lane, jobs, &mut waiting);
            }
        }
    }
    out.into_iter().flatten().collect()
}

/// The loss of each job at its start; infinite where there is none.
pub fn losses<M: SideBySide + ?Sized>(
    model: &mut M,
    jobs: &[(usize, &[f64])],
    options: Options,
    path: Path,
) -> Vec<f64> {
    let n = model.states();
    let mut rows = Rows::new(n, options.loss, path);
    let mut x = vec![[0.0; LANES]; n];
    let mut out = Vec::with_capacity(jobs.len());
    for group in jobs.chunks(LANES) {
        for lane in 0..LANES {
            let (problem, start) = group[lane.min(group.len() - 1)];
            model.load(lane, problem);
            for (x, start) in x.iter_mut().zip(start) {
                x[lane] = *start;
            }
        }
        rows.clear(false);
        model.linearize(&x, &mut rows);
        // A loss may be level where the residual is no number.
        let found = rows.cost.iter().zip(&rows.data).take(group.len());
        out.extend(found.map(|(&cost, &data)| {
            if cost.is_finite() && data.is_finite() {
                cost
            } else {
                f64::INFINITY
            }
        }));
    }
    out
}

struct Work {
    options: Options,
    path: Path,
    n: usize,
    places: [Place; LANES],
    x: Vec<Block>,
    next: Vec<Block>,
    rows: Rows,
    /// At the states `x`.
    factor: Vec<Block>,
    damped: Vec<Block>,
    piece: Vec<Block>,
}

impl Work {
    fn new(n: usize, options: Options, path: Path) -> Self {
        let wide = n + 1;
        Self {
            options,
            path,
            n,
            places: [Place::default(); LANES],
            x: vec![[0.0; LANES]; n],
            next: vec![[0.0; LANES]; n],
            rows: Rows::new(n, options.loss, path),
            factor: vec![[0.0; LANES]; n * wide],
            damped: vec![[0.0; LANES]; n * wide],
            piece: vec![[0.0; LANES]; wide * n.next_multiple_of(4)],
        }
    }

    fn next_job<M: SideBySide + ?Sized>(
        &mut self,
        model: &mut M,
        lane: usize,
        jobs: &[(usize, &[f64])],
        waiting: &mut usize,
    ) {
        let place = &mut self.places[lane];
        *place = Place {
            rise: RISE,
            ..Place::default()
        };
        let Some(&(problem, start)) = jobs.get(*waiting) else {
            return;
        };
        place.job = Some(*waiting);
        place.fresh = true;
        *waiting += 1;
        model.load(lane, problem);
        for ((x, next), start) in self.x.iter_mut().zip(&mut self.next).zip(start) {
            x[lane] = *start;
            next[lane] = *start;
        }
    }

    /// Writes the next states to try.
    fn propose(&mut self) {
        let (n, wide) = (self.n, self.n + 1);
        let mut damping = [0.0; LANES];
        for (damping, place) in damping.iter_mut().zip(&self.places) {
            if place.job.is_some() && !place.fresh {
                *damping = place.damping;
            }
        }
        self.damped.copy_from_slice(&self.factor);
        if damping.iter().any(|&d| d > 0.0) {
            let stride = n.next_multiple_of(4);
            self.piece.fill([0.0; LANES]);
            for j in 0..n {
                let mut square = [0.0; LANES];
                for i in 0..=j {
                    let entry = &self.factor[i * wide + j];
                    for lane in 0..LANES {
                        square[lane] += entry[lane] * entry[lane];
                    }
                }
                for lane in 0..LANES {
                    let size = if square[lane] > 0.0 {
                        square[lane]
                    } else {
                        1.0
                    };
                    self.piece[j * stride + j][lane] = (damping[lane] * size).sqrt();
                }
            }
            self.path.run(Reflect {
                states: n,
                rows: stride,
                stride,
                piece: &mut self.piece,
                factor: &mut self.damped,
            });
            for (damped, factor) in self.damped.iter_mut().zip(&self.factor) {
                for lane in 0..LANES {
                    if damping[lane] == 0.0 {
                        damped[lane] = factor[lane];
                    }
                }
            }
        }
        // Back substitution; a state without a pivot stays.
        let mut step = core::mem::take(&mut self.piece);
        for i in (0..n).rev() {
            let line = &self.damped[i * wide..][..wide];
            let mut sum = line[n];
            for j in i + 1..n {
                for lane in 0..LANES {
                    sum[lane] -= line[j][lane] * step[j][lane];
                }
            }
            for lane in 0..LANES {
                let pivot = line[i][lane];
                step[i][lane] = if pivot == 0.0 { 0.0 } else { sum[lane] / pivot };
            }
        }
        for k in 0..n {
            for lane in 0..LANES {
                if !self.places[lane].fresh {
                    self.next[k][lane] = self.x[k][lane] + step[k][lane];
                }
            }
        }
        let mut foretold = [0.0; LANES];
        for i in 0..n {
            let line = &self.factor[i * wide..][..wide];
            let mut along = [0.0; LANES];
            for j in i..n {
                for lane in 0..LANES {
                    along[lane] += line[j][lane] * step[j][lane];
                }
            }
            for lane in 0..LANES {
                foretold[lane] += along[lane] * (2.0 * line[n][lane] - along[lane]);
            }
        }
        for (place, foretold) in self.places.iter_mut().zip(foretold) {
            place.foretold = foretold;
        }
        self.piece = step;
    }

    /// Takes or refuses the step of a lane; whether it converged, where it is done.
    fn settle(&mut self, lane: usize) -> Option<bool> {
        let (n, wide) = (self.n, self.n + 1);
        let place = &mut self.places[lane];
        let factor = &self.rows.factor;
        let sound = factor.iter().all(|entry| entry[lane].is_finite());
        let trial = if sound {
            self.rows.cost[lane]
        } else {
            f64::NAN
        };
        place.iterations += u32::from(!place.fresh);
        let verdict = place.judge(trial, self.options);
        if let Verdict::Refused = verdict {
            return None;
        }
        if let Verdict::Stay(converged) = verdict {
            return Some(converged);
        }
        place.data = self.rows.data[lane];
        for (x, next) in self.x.iter_mut().zip(&self.next) {
            x[lane] = next[lane];
        }
        for (to, from) in self.factor.iter_mut().zip(factor) {
            to[lane] = from[lane];
        }
        if let Verdict::Rest(converged) = verdict {
            return Some(converged);
        }
        place.decrease = (0..n).map(|i| factor[i * wide + n][lane].powi(2)).sum();
        if place.decrease <= 1e-12 + 1e-15 * place.cost {
            return Some(true);
        }
        if place.iterations >= self.options.max_iterations {
            return Some(false);
        }
        let full_rank = (0..n).all(|i| {
            let square: f64 = (0..=i).map(|k| factor[k * wide + i][lane].powi(2)).sum();
            factor[i * wide + i][lane].powi(2) > 1e-24 * square
        });
        if !full_rank {
            place.damping = place.damping.max(1e-8);
        }
        None
    }

    fn arrived(&self, lane: usize, converged: bool) -> Arrived {
        let (n, wide) = (self.n, self.n + 1);
        let place = &self.places[lane];
        let mut factor = vec![0.0; n * n];
        for i in 0..n {
            for j in i..n {
                factor[i * n + j] = self.factor[i * wide + j][lane];
            }
        }
        Arrived {
            x: self.x.iter().map(|x| x[lane]).collect(),
            chi2: place.cost,
            data: place.data,
            iterations: place.iterations,
            converged,
            factor,
        }
    }
}
