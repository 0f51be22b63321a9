//! Levels, observability matrices and Gramians of many linear systems.

mod gramian;

pub use gramian::{Span, gramian_cost, linear_gramian};

use alloc::vec;
use alloc::vec::Vec;
use core::convert::Infallible;

use crate::batch::simd::Path;
use crate::batch::{Items, Threads};
use crate::linear::analysis::Analysis;
use crate::linear::scaling::{self, Systems, Work};
use crate::linear::staircase::{self, Staircase};

/// Lanes that rows are padded to.
const LANES: usize = 8;

/// Ranks of `O_0` .. `O_{n-1}` and the level of each state (`inf` for never) of
/// systems A (trials, n, n), C (trials, p, n): 2 n numbers for each trial. Where levels
/// cannot be told they are NaN, and so are all ranks but the last.
pub fn linear_levels(
    a: Items<'_>,
    c: Items<'_>,
    n: usize,
    rtol: Option<f64>,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) {
    let p = c.size().checked_div(n).unwrap_or(0);
    let given = rtol;
    let rtol = rtol.unwrap_or_else(|| staircase::default_rtol(n));
    let cost = linear_cost(n, p);
    let each = |space: &mut Space, trial: usize, out: &mut [f64]| -> Result<(), Infallible> {
        let (a, c) = (a.get(trial), c.get(trial));
        let reliable = path.run(LevelsKernel {
            a,
            c,
            rtol,
            space,
            out,
        });
        if !reliable {
            carefully(a, c, n, given, out);
        }
        Ok(())
    };
    let Ok(()) = threads.over_with(out, 2 * n, cost, || Space::new(n, p), each);
}

/// The levels of one system whose staircase may not be relied on: NaN where they cannot
/// be told, but for the last rank, which the pencil decides.
fn carefully(a: &[f64], c: &[f64], n: usize, rtol: Option<f64>, out: &mut [f64]) {
    out.fill(f64::NAN);
    let Ok(found) = Analysis::new(a, c, n, rtol) else {
        return;
    };
    let (ranks, levels) = out.split_at_mut(n);
    ranks[n - 1] = found.rank() as f64;
    if let (Some(known), Some(states)) = (found.ranks(), found.state_levels()) {
        for (out, &rank) in ranks.iter_mut().zip(known) {
            *out = rank as f64;
        }
        for (out, level) in levels.iter_mut().zip(states) {
            *out = level.map_or(f64::INFINITY, |level| level as f64);
        }
    }
}

/// Roughly what the levels of one system take, in nanoseconds.
pub fn linear_cost(n: usize, p: usize) -> f64 {
    500.0 + (n * n * (n + p)) as f64
}

/// Everything that the levels of one system are worked out in, rows padded.
struct Space {
    n: usize,
    stride: usize,
    a: Vec<f64>,
    c: Vec<f64>,
    basis: Vec<f64>,
    pattern: Vec<f64>,
    see: Vec<f64>,
    state: Vec<f64>,
    rows: Vec<f64>,
    states: Vec<f64>,
    output: Vec<f64>,
    outputs: Vec<f64>,
    ranks: Vec<usize>,
}

impl Space {
    fn new(n: usize, p: usize) -> Self {
        let stride = n.next_multiple_of(LANES);
        Self {
            n,
            stride,
            a: vec![0.0; n * stride],
            c: vec![0.0; p * stride],
            basis: vec![0.0; n * stride],
            pattern: vec![0.0; n * stride],
            see: vec![0.0; p * stride],
            state: vec![0.0; 5 * stride],
            rows: vec![0.0; n.max(p) * stride],
            states: vec![0.0; stride],
            output: vec![0.0; 4 * p],
            outputs: vec![0.0; p],
            ranks: vec![0; n],
        }
    }
}

struct LevelsKernel<'a> {
    a: &'a [f64],
    c: &'a [f64],
    rtol: f64,
    space: &'a mut Space,
    out: &'a mut [f64],
}

impl pulp::WithSimd for LevelsKernel<'_> {
    type Output = bool;

    // The vectors are those of the path this is inlined into: rows are padded to
    // whole vectors and the sums over them run in eight lanes.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> bool {
        let Space {
            n,
            stride,
            a,
            c,
            basis,
            pattern,
            see,
            state,
            rows,
            states,
            output,
            outputs,
            ranks,
        } = self.space;
        let (n, stride) = (*n, *stride);
        for (from, to) in [(self.a, &mut *a), (self.c, &mut *c)] {
            for (from, to) in from.chunks_exact(n).zip(to.chunks_exact_mut(stride)) {
                to[..n].copy_from_slice(from);
                to[n..].fill(0.0);
            }
        }
        let center = staircase::center(a, n, stride, states);
        let systems = Systems { a, c, n, stride };
        let work = Work {
            pattern,
            outputs_see: see,
            state,
            output,
        };
        let balance = scaling::balance(systems, work, states, outputs);
        balance.apply(states, outputs, a, c);
        let (v, rest) = state.split_at_mut(stride);
        let w = &mut rest[..stride];
        let form = Staircase {
            n,
            stride,
            a,
            c,
            basis,
            rows,
        };
        let found = form.reduce(self.rtol, v, w, ranks);
        let touch = found.touch(self.rtol);
        let (rank_out, level_out) = self.out.split_at_mut(n);
        for (out, &rank) in rank_out.iter_mut().zip(ranks.iter()) {
            *out = rank as f64;
        }
        staircase::state_levels(basis, n, stride, ranks, touch, |i, level| {
            level_out[i] = level.map_or(f64::INFINITY, |level| level as f64);
        });
        found.reliable(n) && found.above_rounding_of(center * balance.time, n)
    }
}

/// Observability matrices [C; CA; ..; CA^order] of systems A (trials, n, n),
/// C (trials, p, n): (order + 1) p n numbers for each trial.
///
/// # Errors
/// The first trial with an entry that exceeds the numbers.
pub fn observability_matrix(
    a: Items<'_>,
    c: Items<'_>,
    n: usize,
    order: usize,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) -> Result<(), usize> {
    let size = c.size();
    let cost = 100.0 + 0.3 * (size * n * order) as f64;
    let each = |space: &mut Vec<f64>, trial: usize, out: &mut [f64]| {
        let (a, c) = (a.get(trial), c.get(trial));
        out[..size].copy_from_slice(c);
        path.run(PowersKernel {
            a,
            n,
            size,
            space,
            out,
        });
        // The sum of zero products is NaN iff an entry is not finite.
        let sum: f64 = out[out.len() - size..].iter().map(|x| x * 0.0).sum();
        if sum == 0.0 { Ok(()) } else { Err(trial) }
    };
    let stride = n.next_multiple_of(LANES);
    let scratch = || vec![0.0; (n + 2 * (size / n)) * stride];
    threads.over_with(out, size * (order + 1), cost, scratch, each)
}

/// Fills `out` after its first `size` numbers: each row is one before times A.
struct PowersKernel<'a> {
    a: &'a [f64],
    n: usize,
    size: usize,
    /// A, the block before and the next, rows padded to whole vectors.
    space: &'a mut [f64],
    out: &'a mut [f64],
}

impl pulp::WithSimd for PowersKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let Self {
            a,
            n,
            size,
            space,
            out,
        } = self;
        let stride = n.next_multiple_of(LANES);
        let (lines, blocks) = space.split_at_mut(n * stride);
        let (mut before, mut after) = blocks.split_at_mut(size / n * stride);
        for (from, to) in a.chunks_exact(n).zip(lines.chunks_exact_mut(stride)) {
            to[..n].copy_from_slice(from);
        }
        let (first, rest) = out.split_at_mut(size);
        for (from, to) in first.chunks_exact(n).zip(before.chunks_exact_mut(stride)) {
            to[..n].copy_from_slice(from);
        }
        for block in rest.chunks_exact_mut(size) {
            // Rows in groups, so that their sums do not wait for each other.
            let (mut rows, mut next, mut out) = (&*before, &mut *after, block);
            while !rows.is_empty() {
                let left = rows.len() / stride;
                let count = match left {
                    6.. => 6,
                    3..6 => 3,
                    _ => 1,
                };
                let (group, others) = rows.split_at(count * stride);
                let (group_next, others_next) = next.split_at_mut(count * stride);
                let (group_out, others_out) = out.split_at_mut(count * n);
                match count {
                    6 => rows_times::<S, 6>(simd, lines, group, n, group_next, group_out),
                    3 => rows_times::<S, 3>(simd, lines, group, n, group_next, group_out),
                    _ => rows_times::<S, 1>(simd, lines, group, n, group_next, group_out),
                }
                (rows, next, out) = (others, others_next, others_out);
            }
            core::mem::swap(&mut before, &mut after);
        }
    }
}

/// R rows times the matrix of `lines`, into `next` (padded) and `out` (not).
#[inline(always)]
fn rows_times<S: pulp::Simd, const R: usize>(
    simd: S,
    lines: &[f64],
    rows: &[f64],
    n: usize,
    next: &mut [f64],
    out: &mut [f64],
) {
    let stride = n.next_multiple_of(LANES);
    let vectors = stride / S::F64_LANES;
    let (lines, _) = S::as_simd_f64s(lines);
    let (next, _) = S::as_mut_simd_f64s(next);
    for v in (0..vectors).step_by(2) {
        // One lane a vector leaves odd numbers of them.
        let pair = v + 1 < vectors;
        let mut sums = [[simd.splat_f64s(0.0); 2]; R];
        for i in 0..n {
            let line = &lines[i * vectors + v..];
            let second = if pair { line[1] } else { line[0] };
            for r in 0..R {
                let factor = simd.splat_f64s(rows[r * stride + i]);
                sums[r][0] = simd.mul_add_e_f64s(factor, line[0], sums[r][0]);
                sums[r][1] = simd.mul_add_e_f64s(factor, second, sums[r][1]);
            }
        }
        for r in 0..R {
            for w in 0..=usize::from(pair) {
                next[r * vectors + v + w] = sums[r][w];
                let from = (v + w) * S::F64_LANES;
                let to = n.min(from + S::F64_LANES);
                if from < to {
                    simd.partial_store_f64s(&mut out[r * n + from..r * n + to], sums[r][w]);
                }
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    pub(in crate::models::linear::batch) fn numbers(count: usize, seed: u64) -> Vec<f64> {
        let mut out = vec![0.0; count];
        crate::batch::normals(seed, 0, count, Threads::One, &mut out);
        out
    }

    #[test]
    fn every_path_gives_the_plain_matrix() {
        for n in [1, 3, 8, 9, 15, 16, 24, 31, 40] {
            // One, three and six rows at a time.
            let p = 10;
            let (a, c) = (numbers(n * n, 1), numbers(p * n, 2));
            let mut plain = vec![0.0; p * n * 4];
            plain[..p * n].copy_from_slice(&c);
            for k in p * n..plain.len() {
                let row = k / n - p;
                plain[k] = (0..n).map(|i| plain[row * n + i] * a[i * n + k % n]).sum();
            }
            for path in Path::available() {
                let mut out = vec![0.0; plain.len()];
                let (a, c) = (Items::shared(&a), Items::shared(&c));
                let done = observability_matrix(a, c, n, 3, Threads::One, path, &mut out);
                assert_eq!(done, Ok(()));
                for (x, y) in out.iter().zip(&plain) {
                    assert!((x - y).abs() <= 1e-12 * y.abs().max(1.0), "{path:?} {n}");
                }
            }
        }
    }

    #[test]
    fn every_path_gives_the_levels_of_one_system() {
        for n in [2, 5, 8, 15, 17] {
            // The last state drives the others and nothing sees it drive; the
            // next-to-last is not seen at all.
            let (mut a, mut c) = (numbers(n * n, 3), numbers(n, 4));
            for i in 0..n - 1 {
                a[i * n + n - 1] = 0.0;
            }
            c[n - 1] = 0.0;
            let one = Analysis::new(&a, &c, n, None).unwrap();
            assert_eq!(one.rank(), n - 1);
            for path in Path::available() {
                let mut out = vec![0.0; 2 * n];
                let (a, c) = (Items::shared(&a), Items::shared(&c));
                linear_levels(a, c, n, None, Threads::One, path, &mut out);
                let ranks: Vec<f64> = one.ranks().unwrap().iter().map(|&r| r as f64).collect();
                assert_eq!(out[..n], ranks[..], "{path:?} {n}");
                assert_eq!(out[2 * n - 1], f64::INFINITY);
            }
        }
    }
}
