//! The posterior bound over many trials: one trial in each lane.

use alloc::vec;
use alloc::vec::Vec;
use core::convert::Infallible;
use core::ops::{Add, Mul, Sub};

use pulp::Simd;

use super::simd::Path;
use super::{Items, Threads};
use crate::bound::standard_deviations;
use crate::lane::Lane;
use crate::posterior::{
    Form, predict, scratch, update, variances_of_covariance, variances_of_information,
};
use crate::spectrum::{decompose, default_rtol, rank, unit_columns};

/// Trials that are packed together; a multiple of the lanes of every path.
const GROUP: usize = 16;
/// Vectors in flight for each number. Square roots and divisions follow upon
/// each other, and a second vector fills their waiting time.
const UNROLL: usize = 2;
/// Steps that are packed together: few enough for the first cache.
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
    let used = used(recursion.transition, out.len() / size, n);
    let cost = (recursion.steps * n * n * n) as f64 * 0.3 * GROUP as f64;
    let whole = out.len() / (size * GROUP) * size * GROUP;
    let (groups, rest) = out.split_at_mut(whole);
    let group = |first: usize, out: &mut [f64]| -> Result<(), Infallible> {
        path.run(Group {
            recursion: &recursion,
            used: &used,
            first: first * GROUP,
            out,
        });
        Ok(())
    };
    let Ok(()) = threads.over(groups, size * GROUP, cost, group);
    if !rest.is_empty() {
        let Ok(()) = group(whole / (size * GROUP), rest);
    }
}

/// Which entries of a transition are ever other than zero, in any trial.
fn used(transition: Items<'_>, trials: usize, n: usize) -> Vec<bool> {
    let mut used = vec![false; n * n];
    let distinct = if transition.is_shared() { 1 } else { trials };
    for trial in 0..distinct {
        for matrix in transition.get(trial).chunks_exact(n * n) {
            for (used, &entry) in used.iter_mut().zip(matrix) {
                *used |= entry != 0.0;
            }
        }
    }
    used
}

struct Group<'a> {
    recursion: &'a Recursion<'a>,
    used: &'a [bool],
    first: usize,
    out: &'a mut [f64],
}

impl pulp::WithSimd for Group<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let lanes = S::F64_LANES * UNROLL;
        let size = self.recursion.size();
        for (i, out) in self.out.chunks_mut(lanes * size).enumerate() {
            let first = self.first + i * lanes;
            // A known size lets the compiler unroll.
            match self.recursion.states {
                4 => run(simd, 4, self.recursion, self.used, first, out),
                n => run(simd, n, self.recursion, self.used, first, out),
            }
        }
    }
}

/// As many trials as there are lanes, or fewer.
#[inline(always)]
fn run<S: Simd>(
    simd: S,
    n: usize,
    recursion: &Recursion<'_>,
    used: &[bool],
    first: usize,
    out: &mut [f64],
) {
    let &Recursion { form, steps, .. } = recursion;
    let lanes = S::F64_LANES * UNROLL;
    let size = recursion.size();
    let trials = out.len() / size;
    let zero = Wide::<S>::splat_on(simd, 0.0);
    let row_count = recursion.rows.size() / (steps * n);
    let after_count = recursion.after.size() / ((steps - 1).max(1) * n);
    let each_step = |items: Items<'_>| if items.size() > n * n { n * n } else { 0 };
    let (f_step, g_step) = (each_step(recursion.transition), each_step(recursion.noise));
    let widest = row_count.max(after_count).max(n);

    let mut packed = vec![0.0; lanes * BLOCK * (widest.max(n + 2) * n)];
    let mut space = vec![zero; 3 * n * n + widest * n + scratch(n, widest) + 2 * n];
    let (root, space) = space.split_at_mut(n * n);
    let (transition, space) = space.split_at_mut(n * n);
    let (noise, space) = space.split_at_mut(n * n);
    let (rows, space) = space.split_at_mut(widest * n);
    let (std, work) = space.split_at_mut(2 * n);

    let pack = |items: Items<'_>, offset: usize, packed: &mut [f64]| {
        for lane in 0..lanes {
            let from = &items.get(first + lane.min(trials - 1))[offset..];
            for (to, &from) in packed.chunks_exact_mut(lanes).zip(from) {
                to[lane] = from;
            }
        }
    };
    let mut small = vec![0.0; lanes * n * n];
    for (items, to) in [
        (recursion.root, &mut *root),
        (recursion.transition, &mut *transition),
        (recursion.noise, &mut *noise),
    ] {
        // Without a transition there may be nothing to pack.
        pack(items, 0, &mut small);
        load(simd, &small, to);
    }

    let mut row_block = vec![0.0; lanes * BLOCK * row_count * n];
    let mut after_block = vec![0.0; lanes * BLOCK * after_count * n];
    let mut f_block = vec![0.0; lanes * BLOCK * f_step];
    let mut g_block = vec![0.0; lanes * BLOCK * g_step];
    for start in (0..steps).step_by(BLOCK) {
        let block = BLOCK.min(steps - start);
        pack(recursion.rows, start * row_count * n, &mut row_block);
        if start + 1 < steps {
            let pack_legs = |items, size: usize, packed: &mut [f64]| {
                if size > 0 {
                    pack(items, start * size, packed);
                }
            };
            pack_legs(recursion.after, after_count * n, &mut after_block);
            pack_legs(recursion.transition, f_step, &mut f_block);
            pack_legs(recursion.noise, g_step, &mut g_block);
        }
        for step in 0..block {
            if row_count > 0 {
                let rows = &mut rows[..row_count * n];
                load(simd, &row_block[lanes * step * row_count * n..], rows);
                update(form, root, n, rows, work);
            }
            let packed = &mut packed[lanes * step * (n + 2) * n..];
            match form {
                Form::Covariance => variances_of_covariance(root, n, std),
                Form::Information => {
                    let (variance, inflation) = std.split_at_mut(n);
                    variances_of_information(root, n, variance, work);
                    variances_of_covariance(root, n, inflation);
                    for j in 0..n {
                        inflation[j] = inflation[j] * variance[j];
                    }
                }
            }
            for j in 0..n {
                std[j].root().store(&mut packed[lanes * j..]);
                std[n + j].store(&mut packed[lanes * (n + j)..]);
            }
            if form == Form::Information || recursion.every_root || start + step + 1 == steps {
                for j in 0..n * n {
                    root[j].store(&mut packed[lanes * (2 * n + j)..]);
                }
            }
            if start + step + 1 < steps {
                if after_count > 0 {
                    let rows = &mut rows[..after_count * n];
                    load(simd, &after_block[lanes * step * after_count * n..], rows);
                    update(form, root, n, rows, work);
                }
                if f_step > 0 {
                    load(simd, &f_block[lanes * step * f_step..], transition);
                }
                if g_step > 0 {
                    load(simd, &g_block[lanes * step * g_step..], noise);
                }
                predict(form, root, n, transition, used, noise, work);
            }
        }
        unpack(recursion, start..start + block, lanes, &packed, out);
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, packed: &[f64], to: &mut [Wide<S>]) {
    let lanes = S::F64_LANES * UNROLL;
    for (to, from) in to.iter_mut().zip(packed.chunks_exact(lanes)) {
        *to = Wide::load(simd, from);
    }
}

/// From lanes to trials: the results of the steps in `block`.
fn unpack(
    recursion: &Recursion<'_>,
    block: core::ops::Range<usize>,
    lanes: usize,
    packed: &[f64],
    out: &mut [f64],
) {
    let &Recursion { form, steps, .. } = recursion;
    let n = recursion.states;
    for (lane, out) in out.chunks_exact_mut(recursion.size()).enumerate() {
        let (std, roots) = out.split_at_mut(steps * n);
        for (step, packed) in block.clone().zip(packed.chunks_exact(lanes * (n + 2) * n)) {
            let at = |i: usize| packed[lanes * i + lane];
            let std = &mut std[step * n..(step + 1) * n];
            for j in 0..n {
                std[j] = at(j);
            }
            if form == Form::Information && !(0..n).all(|j| trusted(at(n + j))) {
                let root: Vec<f64> = (0..n * n).map(|j| at(2 * n + j)).collect();
                by_singular_values(&root, n, step + 1, std);
            }
            if recursion.every_root || step + 1 == steps {
                let place = if recursion.every_root { step } else { 0 };
                for j in 0..n * n {
                    roots[place * n * n + j] = at(2 * n + j);
                }
            }
        }
    }
}

fn trusted(inflation: f64) -> bool {
    // Below one only where a diagonal entry is zero.
    inflation > 0.5 && inflation < INFLATION
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

/// [`UNROLL`] vectors: one trial in each lane.
#[derive(Clone, Copy)]
struct Wide<S: Simd> {
    simd: S,
    value: [S::f64s; UNROLL],
}

impl<S: Simd> Wide<S> {
    #[inline(always)]
    fn splat_on(simd: S, value: f64) -> Self {
        Self {
            simd,
            value: [simd.splat_f64s(value); UNROLL],
        }
    }

    #[inline(always)]
    fn load(simd: S, from: &[f64]) -> Self {
        let (vectors, _) = S::as_simd_f64s(from);
        let mut out = Self::splat_on(simd, 0.0);
        out.value.copy_from_slice(&vectors[..UNROLL]);
        out
    }

    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        let (vectors, _) = S::as_mut_simd_f64s(to);
        vectors[..UNROLL].copy_from_slice(&self.value);
    }
}

// Loops, no closures: those may be compiled apart, without the instructions of
// the path, and then every operation is a call.
impl<S: Simd> Add for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, other: Self) -> Self {
        for u in 0..UNROLL {
            self.value[u] = self.simd.add_f64s(self.value[u], other.value[u]);
        }
        self
    }
}

impl<S: Simd> Sub for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(mut self, other: Self) -> Self {
        for u in 0..UNROLL {
            self.value[u] = self.simd.sub_f64s(self.value[u], other.value[u]);
        }
        self
    }
}

impl<S: Simd> Mul for Wide<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(mut self, other: Self) -> Self {
        for u in 0..UNROLL {
            self.value[u] = self.simd.mul_f64s(self.value[u], other.value[u]);
        }
        self
    }
}

impl<S: Simd> Lane for Wide<S> {
    #[inline(always)]
    fn splat(self, value: f64) -> Self {
        Self::splat_on(self.simd, value)
    }

    #[inline(always)]
    fn mul_add(mut self, factor: Self, term: Self) -> Self {
        for u in 0..UNROLL {
            let (a, b, c) = (self.value[u], factor.value[u], term.value[u]);
            self.value[u] = self.simd.mul_add_e_f64s(a, b, c);
        }
        self
    }

    #[inline(always)]
    fn negate_mul_add(mut self, factor: Self, term: Self) -> Self {
        for u in 0..UNROLL {
            let (a, b, c) = (self.value[u], factor.value[u], term.value[u]);
            self.value[u] = self.simd.negate_mul_add_e_f64s(a, b, c);
        }
        self
    }

    #[inline(always)]
    fn root(mut self) -> Self {
        for u in 0..UNROLL {
            self.value[u] = self.simd.sqrt_f64s(self.value[u]);
        }
        self
    }

    #[inline(always)]
    fn recip_or_zero(mut self) -> Self {
        let simd = self.simd;
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        for u in 0..UNROLL {
            let a = self.value[u];
            let nothing = simd.equal_f64s(a, zero);
            self.value[u] = simd.select_f64s(nothing, zero, simd.div_f64s(one, a));
        }
        self
    }
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
