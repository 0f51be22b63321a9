//! The posterior bound over many trials: one trial in each lane.

use alloc::vec;
use alloc::vec::Vec;
use core::convert::Infallible;
use core::ops::Range;

use pulp::Simd;

use super::unit_factor::{
    Factor, Shape, Weighted, absorb, from_root, multiply, reach, update_inverse,
};
use crate::batch::lanes::{LANES, Lanes};
use crate::batch::simd::Path;
use crate::batch::transpose::{Aligned, buffers, in_all_lanes, into_lanes, out_of_lanes};
use crate::batch::{Items, Threads};
use crate::bound::standard_deviations;
use crate::numbers::lane::Lane;
use crate::posterior::Form;
use crate::spectrum::{decompose, default_rtol, rank, unit_columns};

/// Trials of one task; a multiple of the lanes of every path.
const GROUP: usize = 32;
/// Steps that are turned into lanes together: few enough for the first cache.
const BLOCK: usize = 8;
/// Above this variance inflation the triangular inverse is not trusted, and
/// rank and bound are decided by singular values.
const INFLATION: f64 = 1e12;

/// A batch of recursions of the same form and size.
#[derive(Clone, Copy, Debug)]
pub struct Recursion<'a> {
    /// What the factor is a root of.
    pub form: Form,
    /// Number of states.
    pub states: usize,
    /// Number of instants at which the bound is wanted.
    pub steps: usize,
    /// The factor before the first measurement (n x n, upper triangular).
    pub root: Items<'a>,
    /// Whitened rows (steps, k, n), taken in at each instant.
    pub rows: Items<'a>,
    /// Rows (steps - 1, m, n) taken in after each instant, before the next
    /// transition; may be empty.
    pub after: Items<'a>,
    /// F^T or F^-1, as the form wants it: (n, n), or one for each transition.
    pub transition: Items<'a>,
    /// Triangular factors of the process noise: (n, n), or one for each.
    pub noise: Items<'a>,
    /// Whether the factor is kept at every instant, or at the last alone.
    pub every_root: bool,
}

impl Recursion<'_> {
    /// Numbers that a trial has in the output: the standard deviations
    /// (steps, n), then the factors (steps or 1, n, n).
    pub fn size(&self) -> usize {
        let roots = if self.every_root { self.steps } else { 1 };
        self.steps * self.states + roots * self.states * self.states
    }
}

/// Runs the recursions; see [`Recursion::size`] for what `out` gets.
pub fn posterior(recursion: Recursion<'_>, threads: Threads, path: Path, out: &mut [f64]) {
    let (n, size) = (recursion.states, recursion.size());
    if recursion.steps == 0 || n == 0 {
        return;
    }
    let trials = out.len() / size;
    let used = nonzero(recursion.transition, trials, n * n);
    let pattern = Pattern {
        reach: reach(&used, n),
        noisy: nonzero(recursion.noise, trials, n * n)
            .chunks_exact(n)
            .map(|row| row.contains(&true))
            .collect(),
        used,
    };
    let cost = (recursion.steps * n * n * n) as f64 * 0.2 * GROUP as f64;
    let whole = trials / GROUP * size * GROUP;
    let (groups, rest) = out.split_at_mut(whole);
    let group = |first: usize, out: &mut [f64]| -> Result<(), Infallible> {
        run_group(
            path,
            Group {
                recursion: &recursion,
                pattern: &pattern,
                first: first * GROUP,
                out,
            },
        );
        Ok(())
    };
    let Ok(()) = threads.over(groups, size * GROUP, cost, group);
    if !rest.is_empty() {
        let Ok(()) = group(trials / GROUP, rest);
    }
}

/// What is zero in every trial and at every step, and so need not be computed.
struct Pattern {
    /// Entries of the transition that are ever other than zero.
    used: Vec<bool>,
    /// See [`reach`].
    reach: Vec<usize>,
    /// Rows of the noise that are.
    noisy: Vec<bool>,
}

/// Which of `size` entries are other than zero in any of the arrays.
fn nonzero(arrays: Items<'_>, trials: usize, size: usize) -> Vec<bool> {
    let mut used = vec![false; size];
    let distinct = if arrays.is_shared() { 1 } else { trials };
    for trial in 0..distinct {
        for array in arrays.get(trial).chunks_exact(size) {
            for (used, &entry) in used.iter_mut().zip(array) {
                *used |= entry != 0.0;
            }
        }
    }
    used
}

struct Group<'a> {
    recursion: &'a Recursion<'a>,
    pattern: &'a Pattern,
    first: usize,
    out: &'a mut [f64],
}

/// Compiled once, however often it is called: the text is long.
#[inline(never)]
fn run_group(path: Path, group: Group<'_>) {
    path.run(group);
}

impl pulp::WithSimd for Group<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            recursion,
            pattern,
            first,
            out,
        } = self;
        let size = recursion.size();
        let zero = Lanes::splat(simd, 0.0);
        let buffer = &mut Vec::new();
        for (i, out) in out.chunks_mut(S::F64_LANES * size).enumerate() {
            let trials = Trials {
                recursion,
                pattern,
                first: first + i * S::F64_LANES,
                count: out.len() / size,
            };
            // Arrays of a size that the compiler knows stay in registers. Rows after,
            // which are rare, would make the text longer by half.
            let common = recursion.states == 4 && recursion.after.size() == 0;
            if S::F64_LANES > 1 && common {
                let (mut square, mut tall) = (Aligned([[zero; 16]; 3]), Aligned([zero; 32]));
                let mut line = Aligned([[zero; 4]; 4]);
                let space = space(&mut square.0, &mut tall.0, &mut line.0);
                match recursion.form {
                    Form::Covariance => {
                        run::<S, 4>(simd, Form::Covariance, trials, space, buffer, out);
                    }
                    Form::Information => {
                        run::<S, 4>(simd, Form::Information, trials, space, buffer, out);
                    }
                }
            } else {
                let n = recursion.states;
                let mut square = [vec![zero; n * n], vec![zero; n * n], vec![zero; n * n]];
                let mut tall = vec![zero; 2 * n * n];
                let mut line = [vec![zero; n], vec![zero; n], vec![zero; n], vec![zero; n]];
                let space = space(&mut square, &mut tall, &mut line);
                run::<S, 0>(simd, recursion.form, trials, space, buffer, out);
            }
        }
    }
}

/// As many trials as there are lanes, or fewer.
#[derive(Clone, Copy)]
struct Trials<'a> {
    recursion: &'a Recursion<'a>,
    pattern: &'a Pattern,
    first: usize,
    count: usize,
}

impl Trials<'_> {
    /// Numbers `place` of each trial, one trial in each lane.
    #[inline(always)]
    fn pack<S: Simd>(&self, simd: S, items: Items<'_>, place: Range<usize>, packed: &mut [f64]) {
        if place.is_empty() {
            return;
        }
        if items.is_shared() {
            in_all_lanes(simd, &items.get(0)[place], packed);
            return;
        }
        let mut from = [&[][..]; LANES];
        for lane in 0..LANES {
            from[lane] = &items.get(self.first + lane.min(self.count - 1))[place.clone()];
        }
        into_lanes(simd, &from, packed);
    }

    /// The factors of the roots that the trials start with, one trial in each lane.
    #[inline(always)]
    fn start<S: Simd>(&self, simd: S, unit: &mut [f64], weight: &mut [f64]) {
        let n = self.recursion.states;
        let root = self.recursion.root;
        let size = n * n + n;
        let distinct = if root.is_shared() { 1 } else { self.count };
        let mut all = vec![0.0; distinct * size];
        for (trial, both) in all.chunks_exact_mut(size).enumerate() {
            let (unit, weight) = both.split_at_mut(n * n);
            from_root(root.get(self.first + trial), unit, weight);
        }
        let all = if root.is_shared() {
            Items::shared(&all)
        } else {
            Items::each(&all, size)
        };
        let here = Self { first: 0, ..*self };
        here.pack(simd, all, 0..n * n, unit);
        here.pack(simd, all, n * n..size, weight);
    }
}

/// What a recursion is worked out in.
struct Space<'a, S: Simd> {
    factor: Factor<'a, Lanes<S>>,
    rows: Weighted<'a, Lanes<S>>,
    transition: &'a mut [Lanes<S>],
    noise: &'a mut [Lanes<S>],
    line: &'a mut [Lanes<S>],
}

#[inline(always)]
fn space<'a, S: Simd>(
    square: &'a mut [impl AsMut<[Lanes<S>]>; 3],
    tall: &'a mut [Lanes<S>],
    line: &'a mut [impl AsMut<[Lanes<S>]>; 4],
) -> Space<'a, S> {
    let [unit, transition, noise] = square;
    let [weight, weights, work, line] = line;
    Space {
        factor: Factor {
            unit: unit.as_mut(),
            weight: weight.as_mut(),
        },
        rows: Weighted {
            rows: tall,
            weight: weights.as_mut(),
            work: work.as_mut(),
        },
        transition: transition.as_mut(),
        noise: noise.as_mut(),
        line: line.as_mut(),
    }
}

/// `N` as for [`absorb`].
#[inline(always)]
fn run<S: Simd, const N: usize>(
    simd: S,
    form: Form,
    trials: Trials<'_>,
    space: Space<'_, S>,
    buffer: &mut Vec<f64>,
    out: &mut [f64],
) {
    let Trials {
        recursion, pattern, ..
    } = trials;
    let (n, steps) = (if N == 0 { recursion.states } else { N }, recursion.steps);
    let Space {
        mut factor,
        mut rows,
        transition,
        noise,
        line,
    } = space;
    let lanes = S::F64_LANES;
    let rows_size = recursion.rows.size() / steps;
    let after_size = recursion.after.size() / (steps - 1).max(1);
    let each_step = |items: Items<'_>| if items.size() > n * n { n * n } else { 0 };
    let (f_size, g_size) = (each_step(recursion.transition), each_step(recursion.noise));

    let block = lanes * BLOCK.min(steps);
    let [
        row_block,
        after_block,
        f_block,
        g_block,
        std_block,
        root_block,
        sure_block,
        small,
    ] = buffers(
        buffer,
        [
            block * rows_size,
            block * after_size,
            block * f_size,
            block * g_size,
            block * n,
            block * n * n,
            block,
            lanes * n * n,
        ],
    );

    trials.start(simd, &mut *small, &mut *std_block);
    load(simd, small, factor.unit);
    load(simd, std_block, factor.weight);
    if steps > 1 {
        trials.pack(simd, recursion.transition, 0..n * n, &mut *small);
        load(simd, small, transition);
        trials.pack(simd, recursion.noise, 0..n * n, &mut *small);
        load(simd, small, noise);
    }
    let mut doubtful = [false; BLOCK];
    for start in (0..steps).step_by(BLOCK) {
        let end = steps.min(start + BLOCK);
        // The last step is followed by no transition.
        let legs = start..end.min(steps - 1);
        for (items, range, size, packed) in [
            (recursion.rows, &(start..end), rows_size, &mut *row_block),
            (recursion.after, &legs, after_size, &mut *after_block),
            (recursion.transition, &legs, f_size, &mut *f_block),
            (recursion.noise, &legs, g_size, &mut *g_block),
        ] {
            trials.pack(simd, items, range.start * size..range.end * size, packed);
        }
        for step in 0..end - start {
            let last = start + step + 1 == steps;
            let from = &row_block[lanes * step * rows_size..][..lanes * rows_size];
            update::<S, N>(simd, form, from, &mut factor, &mut rows, line);
            let to = &mut std_block[lanes * step * n..];
            let sure = bound(simd, form, &factor, rows.work, line, to);
            doubtful[step] = form == Form::Information && sure.least() == 0.0;
            if doubtful[step] {
                sure.put(&mut sure_block[lanes * step..]);
            }
            if doubtful[step] || recursion.every_root || last {
                put_root(&factor, line, &mut root_block[lanes * step * n * n..]);
            }
            if last {
                break;
            }
            if N == 0 {
                let from = &after_block[lanes * step * after_size..][..lanes * after_size];
                update::<S, N>(simd, form, from, &mut factor, &mut rows, line);
            }
            if f_size > 0 {
                load(simd, &f_block[lanes * step * f_size..], transition);
            }
            if g_size > 0 {
                load(simd, &g_block[lanes * step * g_size..], noise);
            }
            predict::<S, N>(form, pattern, transition, noise, &mut factor, &mut rows);
        }
        let found = Found {
            std: std_block,
            root: root_block,
            sure: sure_block,
            doubtful,
        };
        found.take_out(simd, recursion, start..end, small, out);
    }
}

/// What a block of steps gives, one trial in each lane.
struct Found<'a> {
    std: &'a [f64],
    /// Of the steps at which it is wanted.
    root: &'a [f64],
    /// 1 for trials whose bound can be trusted, at the steps that are doubtful.
    sure: &'a [f64],
    doubtful: [bool; BLOCK],
}

impl Found<'_> {
    /// Writes the results of these steps; the bound of the trials that are not sure
    /// is found anew, in `small`.
    #[inline(always)]
    fn take_out<S: Simd>(
        &self,
        simd: S,
        recursion: &Recursion<'_>,
        block: Range<usize>,
        small: &mut [f64],
        out: &mut [f64],
    ) {
        let (n, size, lanes) = (recursion.states, recursion.size(), S::F64_LANES);
        let (square, roots) = (n * n, recursion.steps * n);
        let count = block.len();
        out_of_lanes(simd, self.std, count * n, size, &mut out[block.start * n..]);
        if recursion.every_root {
            let out = &mut out[roots + block.start * square..];
            out_of_lanes(simd, self.root, count * square, size, out);
        } else if block.end == recursion.steps {
            let from = &self.root[lanes * (count - 1) * square..];
            out_of_lanes(simd, from, square, size, &mut out[roots..]);
        }
        for (i, step) in block.enumerate() {
            if !self.doubtful[i] {
                continue;
            }
            let mut sure = [0.0; LANES];
            out_of_lanes(simd, &self.sure[lanes * i..], 1, 1, &mut sure);
            out_of_lanes(
                simd,
                &self.root[lanes * i * square..],
                square,
                square,
                small,
            );
            for (lane, out) in out.chunks_exact_mut(size).enumerate() {
                if sure[lane] == 0.0 {
                    let root = &small[lane * square..(lane + 1) * square];
                    by_singular_values(root, n, step + 1, &mut out[step * n..(step + 1) * n]);
                }
            }
        }
    }
}

#[inline(always)]
fn put_root<S: Simd>(factor: &Factor<'_, Lanes<S>>, line: &mut [Lanes<S>], packed: &mut [f64]) {
    let n = factor.n();
    for i in 0..n {
        factor.root_row(i, line);
        for j in 0..n {
            line[j].put(&mut packed[S::F64_LANES * (i * n + j)..]);
        }
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, packed: &[f64], to: &mut [Lanes<S>]) {
    for i in 0..to.len() {
        to[i] = Lanes::of(simd, &packed[S::F64_LANES * i..]);
    }
}

/// Moves the factor to the next step.
#[inline(always)]
fn predict<S: Simd, const N: usize>(
    form: Form,
    pattern: &Pattern,
    transition: &[Lanes<S>],
    noise: &[Lanes<S>],
    factor: &mut Factor<'_, Lanes<S>>,
    rows: &mut Weighted<'_, Lanes<S>>,
) {
    let n = factor.n();
    multiply(factor, transition, &pattern.used, rows);
    match form {
        Form::Covariance => {
            for i in 0..n * n {
                rows.rows[n * n + i] = noise[i];
            }
            absorb::<_, N>(rows, Shape::Triangle(&pattern.reach), factor);
        }
        Form::Information => {
            absorb::<_, N>(rows, Shape::Alone(&pattern.reach), factor);
            for i in 0..n {
                if pattern.noisy[i] {
                    update_inverse(factor, &noise[i * n..(i + 1) * n], rows.work);
                }
            }
        }
    }
}

/// Takes in the measurement rows of one step.
#[inline(always)]
pub(super) fn update<S: Simd, const N: usize>(
    simd: S,
    form: Form,
    packed: &[f64],
    factor: &mut Factor<'_, Lanes<S>>,
    rows: &mut Weighted<'_, Lanes<S>>,
    line: &mut [Lanes<S>],
) {
    let n = factor.n();
    let size = n * S::F64_LANES;
    match form {
        Form::Covariance => {
            for packed in packed.chunks_exact(size) {
                load(simd, packed, line);
                update_inverse(factor, line, rows.work);
            }
        }
        Form::Information => {
            for packed in packed.chunks(n * size) {
                for i in 0..n {
                    rows.weight[i] = factor.weight[i];
                    rows.rows[i * n + i] = Lanes::splat(simd, 1.0);
                    for j in i + 1..n {
                        rows.rows[i * n + j] = factor.unit[i * n + j];
                    }
                }
                let count = packed.len() / size;
                for i in 0..n {
                    if i < count {
                        let to = &mut rows.rows[(n + i) * n..(n + i + 1) * n];
                        load(simd, &packed[size * i..], to);
                    }
                }
                absorb::<_, N>(rows, Shape::Below(count), factor);
            }
        }
    }
}

/// The standard deviations, into lanes; 0 where they are not to be trusted.
#[inline(always)]
pub(super) fn bound<S: Simd>(
    simd: S,
    form: Form,
    factor: &Factor<'_, Lanes<S>>,
    work: &mut [Lanes<S>],
    line: &mut [Lanes<S>],
    packed: &mut [f64],
) -> Lanes<S> {
    let mut sure = Lanes::splat(simd, 1.0);
    match form {
        Form::Covariance => factor.diagonal(line),
        Form::Information => {
            factor.inverse_diagonal(line, work);
            factor.diagonal(work);
            for j in 0..factor.n() {
                // Without a weight a state is not determined, whatever the product.
                sure = sure * factor.weight[j].inside(1.0 / f64::MAX, f64::INFINITY);
                sure = sure * (line[j] * work[j]).inside(0.5, INFLATION);
            }
        }
    }
    for j in 0..factor.n() {
        line[j].sqrt().put(&mut packed[S::F64_LANES * j..]);
    }
    sure
}

/// The bound where some combination is hardly or not determined.
fn by_singular_values(root: &[f64], n: usize, steps: usize, out: &mut [f64]) {
    let mut space = vec![0.0; 2 * n + 2 * n * n];
    let (scale, space) = space.split_at_mut(n);
    let (s, space) = space.split_at_mut(n);
    let (v, w) = space.split_at_mut(n * n);
    // Every step adds the rounding of a reduction.
    let rtol = default_rtol::<f64>(steps * n, n);
    unit_columns(root, n, scale);
    decompose(root, n, scale, s, v, w);
    standard_deviations(s, v, scale, rank(s, rtol), rtol, out);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_path_gives_the_same() {
        let (n, steps, trials) = (4, 21, 19);
        let numbers = |seed: u64, count: usize| -> Vec<f64> {
            let mut stream = crate::batch::Stream::new(seed, 0);
            (0..count).map(|_| stream.normal()).collect()
        };
        let triangles = |seed: u64, count: usize| {
            let mut all = numbers(seed, count * n * n);
            for matrix in all.chunks_exact_mut(n * n) {
                for i in 0..n {
                    matrix[i * n..i * n + i].fill(0.0);
                }
            }
            all
        };
        let (root, noise) = (triangles(1, 1), triangles(2, steps - 1));
        let (rows, transition) = (numbers(3, trials * steps * n), numbers(4, n * n));
        for form in [Form::Covariance, Form::Information] {
            let recursion = Recursion {
                form,
                states: n,
                steps,
                root: Items::shared(&root),
                rows: Items::each(&rows, steps * n),
                after: Items::shared(&[]),
                transition: Items::shared(&transition),
                noise: Items::shared(&noise),
                every_root: true,
            };
            let results: Vec<Vec<f64>> = Path::available()
                .map(|path| {
                    let mut out = vec![0.0; trials * recursion.size()];
                    posterior(recursion, Threads::One, path, &mut out);
                    out
                })
                .collect();
            let plain = &results[results.len() - 1];
            assert!(plain.iter().all(|x| x.is_finite()));
            for result in &results {
                for (a, b) in result.iter().zip(plain) {
                    assert!((a - b).abs() <= 1e-11 * b.abs().max(1.0), "{a} {b}");
                }
            }
        }
    }
}
