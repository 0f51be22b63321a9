//! Observability Gramians of many systems.

use alloc::vec;
use alloc::vec::Vec;

use super::LANES;
use crate::batch::simd::Path;
use crate::batch::transpose::{buffers, into_lanes, out_of_lanes};
use crate::batch::{Items, Threads};
use crate::linear::window::{Overflow, Window};

/// What a window is made of.
#[derive(Clone, Copy, Debug)]
pub enum Span {
    /// Samples of `x[k+1] = A x[k]`.
    Samples(usize),
    /// A duration of x' = A x.
    Duration(f64),
}

/// Gramians (trials, n, n) of systems A (trials, n, n) with whitened outputs C
/// (trials, p, n) and process noise Q (trials, n, n) if given.
///
/// # Errors
/// The first trial whose Gramian exceeds the numbers.
#[allow(clippy::too_many_arguments)]
pub fn linear_gramian(
    a: Items<'_>,
    c: Items<'_>,
    q: Option<Items<'_>>,
    n: usize,
    span: Span,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) -> Result<(), (usize, Overflow)> {
    let cost = gramian_cost(n);
    if let (Span::Samples(count), None) = (span, q) {
        return doubled(a, c, n, count, threads, path, out);
    }
    threads.over(out, n * n, cost, |trial, out| {
        let (a, c) = (a.get(trial), c.get(trial));
        let q = q.map(|q| q.get(trial));
        let window = match span {
            Span::Samples(count) => Window::sampled(a, c, q, n).many(count),
            Span::Duration(duration) => Window::integrated(a, c, q, n, duration).map(Some),
        };
        match window.map_err(|error| (trial, error))? {
            Some(window) => out.copy_from_slice(&window.gramian),
            None => out.fill(0.0),
        }
        Ok(())
    })
}

/// Systems of so many states at most are taken side by side, one in each lane; of more,
/// one after the other with their rows in the lanes.
const SIDE_BY_SIDE: usize = 12;

/// Gramians of `count` samples without process noise, windows doubled.
fn doubled(
    a: Items<'_>,
    c: Items<'_>,
    n: usize,
    count: usize,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) -> Result<(), (usize, Overflow)> {
    let group = if n <= SIDE_BY_SIDE && out.len() >= LANES * n * n {
        LANES
    } else {
        1
    };
    let run = |space: &mut Vec<f64>, first: usize, out: &mut [f64]| {
        if group > 1 {
            path.run(Many {
                a: a.skip(first),
                c: c.skip(first),
                n,
                count,
                space,
                out,
            });
        } else {
            path.run(One {
                a: a.get(first),
                c: c.get(first),
                n,
                count,
                space,
                out,
            });
        }
        match out.iter().position(|x| !x.is_finite()) {
            None => Ok(()),
            Some(at) => Err((first + at / (n * n), Overflow)),
        }
    };
    let cost = 0.1 * gramian_cost(n);
    threads.over_groups_with(out, n * n, group, cost, Vec::new, run)
}

/// The Gramians of `count` samples of up to eight systems without process noise, as
/// [`Window::repeated`] finds them, one system in each lane.
struct Many<'a> {
    a: Items<'a>,
    c: Items<'a>,
    n: usize,
    count: usize,
    space: &'a mut Vec<f64>,
    /// The Gramians, which say how many there are.
    out: &'a mut [f64],
}

impl pulp::WithSimd for Many<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let Self { a, c, n, .. } = self;
        let (size, lanes) = (n * n, S::F64_LANES);
        let each = size * lanes;
        let [phi, gram, all_phi, all_gram, part, next] = buffers(self.space, [each; 6]);
        let outputs = c.size();
        let mut packed = vec![0.0; outputs * lanes];
        for (block, out) in self.out.chunks_mut(lanes * size).enumerate() {
            // Lanes beyond the last system repeat it.
            let last = out.len() / size - 1;
            let trial = |lane: usize| block * lanes + lane.min(last);
            into_lanes(simd, &core::array::from_fn(|lane| a.get(trial(lane))), phi);
            let outputs = core::array::from_fn(|lane| c.get(trial(lane)));
            into_lanes(simd, &outputs, &mut packed);
            let rows = S::as_simd_f64s(&packed).0;
            let grams = S::as_mut_simd_f64s(gram).0;
            for i in 0..n {
                for j in 0..n {
                    let mut sum = simd.splat_f64s(0.0);
                    for row in rows.chunks_exact(n) {
                        sum = simd.mul_add_e_f64s(row[i], row[j], sum);
                    }
                    grams[i * n + j] = sum;
                }
            }
            let (mut phi, mut all_phi, mut next) = (&mut *phi, &mut *all_phi, &mut *next);
            let mut left = self.count;
            let mut started = false;
            while left > 0 {
                if left % 2 == 1 && started {
                    // What came so far, and the window after it.
                    lane_product::<S>(simd, gram, all_phi, n, part);
                    add_lane_square::<S>(simd, all_phi, part, n, all_gram);
                    lane_product::<S>(simd, phi, all_phi, n, next);
                    core::mem::swap(&mut all_phi, &mut next);
                } else if left % 2 == 1 {
                    all_phi.copy_from_slice(phi);
                    all_gram.copy_from_slice(gram);
                    started = true;
                }
                left /= 2;
                if left > 0 {
                    lane_product::<S>(simd, gram, phi, n, part);
                    add_lane_square::<S>(simd, phi, part, n, gram);
                    lane_product::<S>(simd, phi, phi, n, next);
                    core::mem::swap(&mut phi, &mut next);
                }
            }
            if started {
                out_of_lanes(simd, all_gram, size, size, out);
            } else {
                out.fill(0.0);
            }
        }
    }
}

/// left times right, n x n, one system in each lane.
#[inline(always)]
fn lane_product<S: pulp::Simd>(simd: S, left: &[f64], right: &[f64], n: usize, out: &mut [f64]) {
    let (left, right) = (S::as_simd_f64s(left).0, S::as_simd_f64s(right).0);
    let out = S::as_mut_simd_f64s(out).0;
    let mut i = 0;
    while i + TILE <= n {
        let mut j = 0;
        while j + TILE <= n {
            let made = tile::<S, TILE, TILE, false>(simd, left, right, n, i, j);
            for r in 0..TILE {
                out[(i + r) * n + j..][..TILE].copy_from_slice(&made[r]);
            }
            j += TILE;
        }
        for j in j..n {
            let made = tile::<S, TILE, 1, false>(simd, left, right, n, i, j);
            for r in 0..TILE {
                out[(i + r) * n + j] = made[r][0];
            }
        }
        i += TILE;
    }
    for i in i..n {
        let mut j = 0;
        while j + TILE <= n {
            let [made] = tile::<S, 1, TILE, false>(simd, left, right, n, i, j);
            out[i * n + j..][..TILE].copy_from_slice(&made);
            j += TILE;
        }
        for j in j..n {
            out[i * n + j] = tile::<S, 1, 1, false>(simd, left, right, n, i, j)[0][0];
        }
    }
}

/// Adds the transpose of left times right, known to be symmetric, to `sum`.
#[inline(always)]
fn add_lane_square<S: pulp::Simd>(simd: S, left: &[f64], right: &[f64], n: usize, sum: &mut [f64]) {
    let (left, right) = (S::as_simd_f64s(left).0, S::as_simd_f64s(right).0);
    let sum = S::as_mut_simd_f64s(sum).0;
    let mut add = |i: usize, j: usize, made: S::f64s| {
        // Of a pair the one of the upper triangle.
        if j >= i {
            let total = simd.add_f64s(sum[i * n + j], made);
            sum[i * n + j] = total;
            sum[j * n + i] = total;
        }
    };
    let mut i = 0;
    while i + TILE <= n {
        let mut j = i;
        while j + TILE <= n {
            let made = tile::<S, TILE, TILE, true>(simd, left, right, n, i, j);
            for r in 0..TILE {
                for s in 0..TILE {
                    add(i + r, j + s, made[r][s]);
                }
            }
            j += TILE;
        }
        for j in j..n {
            let made = tile::<S, TILE, 1, true>(simd, left, right, n, i, j);
            for r in 0..TILE {
                add(i + r, j, made[r][0]);
            }
        }
        i += TILE;
    }
    for i in i..n {
        for j in i..n {
            add(
                i,
                j,
                tile::<S, 1, 1, true>(simd, left, right, n, i, j)[0][0],
            );
        }
    }
}

/// Rows and columns of a tile: nine sums, and six numbers that are loaded for them.
const TILE: usize = 3;

/// The R x C tile at (i, j) of left times right, or of its transpose where `T`.
#[inline(always)]
fn tile<S: pulp::Simd, const R: usize, const C: usize, const T: bool>(
    simd: S,
    left: &[S::f64s],
    right: &[S::f64s],
    n: usize,
    i: usize,
    j: usize,
) -> [[S::f64s; C]; R] {
    let mut sums = [[simd.splat_f64s(0.0); C]; R];
    for k in 0..n {
        let right = &right[k * n + j..][..C];
        for r in 0..R {
            let factor = left[if T { k * n + i + r } else { (i + r) * n + k }];
            for s in 0..C {
                sums[r][s] = simd.mul_add_e_f64s(factor, right[s], sums[r][s]);
            }
        }
    }
    sums
}

/// The Gramian of `count` samples of one system without process noise, as
/// [`Window::repeated`] finds it.
struct One<'a> {
    a: &'a [f64],
    c: &'a [f64],
    n: usize,
    count: usize,
    /// For six matrices, rows padded to whole vectors.
    space: &'a mut Vec<f64>,
    out: &'a mut [f64],
}

impl pulp::WithSimd for One<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let Self { a, c, n, .. } = self;
        let stride = n.next_multiple_of(LANES);
        let [mut phi, gram, mut all_phi, all_gram, part, mut next] =
            buffers(self.space, [n * stride; 6]);
        // What pads the rows.
        phi.fill(0.0);
        for (from, to) in a.chunks_exact(n).zip(phi.chunks_exact_mut(stride)) {
            to[..n].copy_from_slice(from);
        }
        gram.fill(0.0);
        for row in c.chunks_exact(n) {
            for (&x, to) in row.iter().zip(gram.chunks_exact_mut(stride)) {
                for (to, &y) in to.iter_mut().zip(row) {
                    *to += x * y;
                }
            }
        }
        let mut count = self.count;
        let mut started = false;
        while count > 0 {
            if count % 2 == 1 && started {
                // What came so far, and the window after it.
                product::<S, false>(simd, gram, all_phi, n, part);
                product::<S, true>(simd, all_phi, part, n, next);
                add_symmetric(all_gram, next, n);
                product::<S, false>(simd, phi, all_phi, n, next);
                core::mem::swap(&mut all_phi, &mut next);
            } else if count % 2 == 1 {
                all_phi.copy_from_slice(phi);
                all_gram.copy_from_slice(gram);
                started = true;
            }
            count /= 2;
            if count > 0 {
                product::<S, false>(simd, gram, phi, n, part);
                product::<S, true>(simd, phi, part, n, next);
                add_symmetric(gram, next, n);
                product::<S, false>(simd, phi, phi, n, next);
                core::mem::swap(&mut phi, &mut next);
            }
        }
        if !started {
            self.out.fill(0.0);
            return;
        }
        for (from, to) in all_gram
            .chunks_exact(stride)
            .zip(self.out.chunks_exact_mut(n))
        {
            to.copy_from_slice(&from[..n]);
        }
    }
}

/// `left` times `right`, or its transpose where `T`: n x n, rows padded.
#[inline(always)]
fn product<S: pulp::Simd, const T: bool>(
    simd: S,
    left: &[f64],
    right: &[f64],
    n: usize,
    out: &mut [f64],
) {
    let stride = n.next_multiple_of(LANES);
    let vectors = stride / S::F64_LANES;
    let (right, _) = S::as_simd_f64s(right);
    let (out, _) = S::as_mut_simd_f64s(out);
    for i in 0..n {
        for v in 0..vectors {
            let mut sum = simd.splat_f64s(0.0);
            for k in 0..n {
                let factor = left[if T { k * stride + i } else { i * stride + k }];
                sum = simd.mul_add_e_f64s(simd.splat_f64s(factor), right[k * vectors + v], sum);
            }
            out[i * vectors + v] = sum;
        }
    }
}

/// Adds `other`, symmetric but for rounding, to `matrix`.
#[inline(always)]
fn add_symmetric(matrix: &mut [f64], other: &[f64], n: usize) {
    let stride = n.next_multiple_of(LANES);
    for i in 0..n {
        for j in 0..=i {
            let mean = 0.5 * (other[i * stride + j] + other[j * stride + i]);
            let sum = matrix[i * stride + j] + mean;
            matrix[i * stride + j] = sum;
            matrix[j * stride + i] = sum;
        }
    }
}

/// Roughly what the Gramian of one system takes, in nanoseconds.
pub fn gramian_cost(n: usize) -> f64 {
    1000.0 + 100.0 * (n * n * n) as f64
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::tests::numbers;
    use super::*;

    #[test]
    fn every_path_gives_the_gramian_of_one_window() {
        for (n, trials) in [1, 3, 6, 8, 11, 12, 13]
            .into_iter()
            .flat_map(|n| [(n, 3), (n, 21)])
        {
            // Growth of one, so that a window of a thousand samples can be held.
            let mut a = numbers(trials * n * n, 3);
            for x in &mut a {
                *x *= 0.5 / n as f64;
            }
            let c = numbers(trials * 2 * n, 4);
            let (a, c) = (Items::each(&a, n * n), Items::each(&c, 2 * n));
            for count in [0, 1, 2, 11, 1000] {
                let window = |trial| Window::sampled(a.get(trial), c.get(trial), None, n);
                for path in Path::available() {
                    let mut out = vec![f64::NAN; trials * n * n];
                    let span = Span::Samples(count);
                    let done = linear_gramian(a, c, None, n, span, Threads::One, path, &mut out);
                    assert_eq!(done, Ok(()));
                    for (trial, out) in out.chunks_exact(n * n).enumerate() {
                        let plain = window(trial).many(count).unwrap();
                        let plain = plain.map_or(vec![0.0; n * n], |window| window.gramian);
                        let size = plain.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
                        for (x, y) in out.iter().zip(&plain) {
                            assert!((x - y).abs() <= 1e-13 * size, "{path:?} {n} {count}");
                        }
                    }
                }
            }
            // Too long for what grows.
            let grows = vec![1e3; n * n];
            let mut out = vec![0.0; n * n];
            let (a, span) = (Items::shared(&grows), Span::Samples(1000));
            let done = linear_gramian(a, c, None, n, span, Threads::One, Path::Best, &mut out);
            assert_eq!(done, Err((0, Overflow)));
        }
    }
}
