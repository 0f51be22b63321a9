//! Bounds from rows: one trial in each lane where all is well determined, singular
//! values of one trial after the other where it is not.

use alloc::vec;
use alloc::vec::Vec;
use core::convert::Infallible;

use pulp::Simd;

use super::posterior::{bound, update};
use super::unit_factor::{Factor, Weighted};
use crate::batch::lanes::{LANES, Lanes};
use crate::batch::simd::Path;
use crate::batch::transpose::{Aligned, buffers, into_lanes, out_of_lanes};
use crate::batch::{Items, Threads};
use crate::bound::standard_deviations;
use crate::observability::Observability;
use crate::posterior::Form;
use crate::spectrum::{decompose, default_rtol, rank, unit_columns};
use crate::spine::parts::{GRADED, grade};
use crate::square_root::triangularize;

/// Rows that are turned into lanes together: few enough for the first cache.
const BLOCK: usize = 32;
/// Beyond so many states the factors of all lanes leave the first cache.
const MOST_STATES: usize = 16;
/// Squares in this range, and what is added to them, are held with all digits.
const SQUARES: (f64, f64) = (1e-280, 1e280);
/// Below this variance inflation rows of very different size cost the lanes no digits that
/// matter: either they tell of all states, or of states of their own.
const MILD: f64 = GRADED * GRADED;

/// Bounds (trials, n) on the standard deviation of each state, from rows
/// (trials, K, n); infinite where a state is not determined.
pub fn crlb_std(
    rows: Items<'_>,
    n: usize,
    rtol: Option<f64>,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) {
    let count = rows.size().checked_div(n).unwrap_or(0);
    let rtol = rtol.unwrap_or_else(|| default_rtol(count, n));
    let kernel = Kernel {
        rows,
        n,
        rtol,
        first: 0,
        out: &mut [],
    };
    // What the lanes trust has a condition number below 1e6 n.
    let lanes = n > 0 && n <= MOST_STATES && rtol * (n as f64) < 1e-7;
    let size = if lanes { LANES * n } else { n };
    let cost = (if lanes { 1.0 } else { 8.0 }) * (count * n * n) as f64;
    let (whole, rest) = out.split_at_mut(if n > 0 { out.len() / size * size } else { 0 });
    let group = |index: usize, out: &mut [f64]| -> Result<(), Infallible> {
        if lanes {
            run(
                path,
                Kernel {
                    first: index * LANES,
                    out,
                    ..kernel
                },
            );
        } else {
            Kernel {
                first: index,
                out,
                ..kernel
            }
            .by_singular_values(0);
        }
        Ok(())
    };
    let groups = whole.len() / size.max(1);
    let Ok(()) = threads.over(whole, size, cost, group);
    if !rest.is_empty() {
        let Ok(()) = group(groups, rest);
    }
}

/// Compiled once, however often it is called.
#[inline(never)]
fn run(path: Path, kernel: Kernel<'_>) {
    path.run(kernel);
}

/// Trials from `first` on, as many as `out` has room for: [`LANES`] at most.
struct Kernel<'a> {
    rows: Items<'a>,
    n: usize,
    rtol: f64,
    first: usize,
    out: &'a mut [f64],
}

impl Kernel<'_> {
    /// Trial `index` of the group, with the decision on its rank.
    fn by_singular_values(&mut self, index: usize) {
        let (n, rows) = (self.n, self.rows.get(self.first + index));
        if self.is_graded(index) && self.by_levels(index) {
            return;
        }
        let padded = (rows.len()).max(n * n);
        // The rows, then work, scale, singular values, vectors.
        let mut space = vec![0.0; padded + 3 * n + 2 * n * n];
        let (a, space) = space.split_at_mut(padded);
        let (work, space) = space.split_at_mut(n);
        let (scale, space) = space.split_at_mut(n);
        let (s, space) = space.split_at_mut(n);
        let (v, w) = space.split_at_mut(n * n);
        a[..rows.len()].copy_from_slice(rows);
        triangularize(a, n, work);
        unit_columns(a, n, scale);
        decompose(a, n, scale, s, v, w);
        let found = rank(s, self.rtol);
        if found < n && self.by_levels(index) {
            // Rows of very different weight may determine more than is seen at once.
            return;
        }
        let out = &mut self.out[index * n..(index + 1) * n];
        standard_deviations(s, v, scale, found, self.rtol, out);
    }

    /// Whether the rows of a trial differ so much in size that a plain factorisation of them
    /// all loses digits.
    fn is_graded(&self, index: usize) -> bool {
        grade(self.rows.get(self.first + index), self.n) > GRADED
    }

    /// Trial `index` of the group, each row with all its digits; false for what is refused.
    fn by_levels(&mut self, index: usize) -> bool {
        let (n, rows) = (self.n, self.rows.get(self.first + index));
        let Ok(whole) = Observability::new(rows, n, Some(self.rtol)) else {
            return false;
        };
        self.out[index * n..(index + 1) * n].copy_from_slice(&whole.crlb_std());
        true
    }

    /// The bounds, as many as there are lanes from trial `start` of the group on;
    /// 0 for what they cannot be trusted, 1 for what they can where the rows are of about one
    /// size, 2 in any case.
    #[inline(always)]
    fn by_lanes<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        start: usize,
        factor: &mut Factor<'_, Lanes<S>>,
        space: &mut Weighted<'_, Lanes<S>>,
        line: &mut [Lanes<S>],
        packed: &mut [f64],
    ) -> [f64; LANES] {
        let n = if N == 0 { self.n } else { N };
        let lanes = S::F64_LANES;
        let last = self.out.len() / n - 1;
        let zero = Lanes::splat(simd, 0.0);
        for i in 0..n {
            factor.weight[i] = zero;
            for j in 0..n {
                factor.unit[i * n + j] = zero;
            }
        }
        let size = self.rows.size();
        for offset in (0..size).step_by(BLOCK * n) {
            let end = size.min(offset + BLOCK * n);
            let mut from = [&[][..]; LANES];
            for lane in 0..LANES {
                let trial = self.first + (start + lane).min(last);
                from[lane] = &self.rows.get(trial)[offset..end];
            }
            into_lanes(simd, &from, packed);
            let rows = &packed[..lanes * (end - offset)];
            update::<S, N>(simd, Form::Information, rows, factor, space, line);
        }
        let mut sure = bound(simd, Form::Information, factor, space.work, line, packed);
        let mut mild = Lanes::splat(simd, 1.0);
        for i in 0..n {
            sure = sure * factor.weight[i].inside(SQUARES.0, SQUARES.1);
            mild = mild * (line[i] * space.work[i]).inside(0.5, MILD);
        }
        out_of_lanes(simd, packed, n, n, &mut self.out[start * n..]);
        (sure + sure * mild).put(packed);
        let mut trusted = [0.0; LANES];
        out_of_lanes(simd, packed, 1, 1, &mut trusted);
        trusted
    }
}

impl pulp::WithSimd for Kernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (n, trials) = (self.n, self.out.len() / self.n);
        let zero = Lanes::splat(simd, 0.0);
        let mut buffer = Vec::new();
        let [packed] = buffers(&mut buffer, [S::F64_LANES * BLOCK * n]);
        for start in (0..trials).step_by(S::F64_LANES) {
            // Arrays of a size that the compiler knows stay in registers.
            let trusted = if S::F64_LANES > 1 && n == 4 {
                let (mut unit, mut rows) = (Aligned([zero; 16]), Aligned([zero; 32]));
                let mut lines = Aligned([[zero; 4]; 4]);
                let [weight, weights, work, line] = &mut lines.0;
                let mut factor = Factor {
                    unit: &mut unit.0,
                    weight,
                };
                let mut space = Weighted {
                    rows: &mut rows.0,
                    weight: weights,
                    work,
                };
                self.by_lanes::<S, 4>(simd, start, &mut factor, &mut space, line, packed)
            } else {
                let (mut unit, mut rows) = (vec![zero; n * n], vec![zero; 2 * n * n]);
                let mut lines = vec![zero; 4 * n];
                let (weight, lines) = lines.split_at_mut(n);
                let (weights, lines) = lines.split_at_mut(n);
                let (work, line) = lines.split_at_mut(n);
                let mut factor = Factor {
                    unit: &mut unit,
                    weight,
                };
                let mut space = Weighted {
                    rows: &mut rows,
                    weight: weights,
                    work,
                };
                self.by_lanes::<S, 0>(simd, start, &mut factor, &mut space, line, packed)
            };
            for index in start..trials.min(start + S::F64_LANES) {
                let trusted = trusted[index - start];
                if trusted == 0.0 || (trusted == 1.0 && self.is_graded(index)) {
                    self.by_singular_values(index);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::Stream;

    /// The lanes against singular values, trial by trial; some are not determined.
    #[test]
    fn every_path_gives_the_bounds_of_one_trial_alone() {
        for n in [1, 2, 4, 6] {
            for count in [1, n, 37, 70] {
                let (trials, size) = (21, count * n);
                let mut stream = Stream::new(8, (n * count) as u64);
                let mut rows: Vec<f64> = (0..trials * size).map(|_| stream.normal()).collect();
                for (trial, rows) in rows.chunks_exact_mut(size).enumerate() {
                    let scale = [1.0, 1e-150, 1e150, 1e-6][trial % 4];
                    for row in rows.chunks_exact_mut(n) {
                        if trial % 7 == 3 {
                            // Two states that cannot be told apart, or one not seen.
                            row[n - 1] = row[0] * f64::from(u8::from(n > 1));
                        }
                        row[0] *= scale;
                    }
                }
                let mut plain = vec![0.0; trials * n];
                for (trial, out) in plain.chunks_exact_mut(n).enumerate() {
                    Kernel {
                        rows: Items::each(&rows, size),
                        n,
                        rtol: default_rtol(count, n),
                        first: trial,
                        out,
                    }
                    .by_singular_values(0);
                }
                for path in Path::available() {
                    let mut out = vec![f64::NAN; trials * n];
                    let items = Items::each(&rows, size);
                    crlb_std(items, n, None, Threads::One, path, &mut out);
                    for (found, plain) in out.iter().zip(&plain) {
                        let same = found == plain || (found / plain - 1.0).abs() < 1e-9;
                        assert!(same, "{path:?} {n} {count}: {found} {plain}");
                    }
                }
            }
        }
    }
}
