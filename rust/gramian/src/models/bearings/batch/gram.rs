//! Gram matrices of bearings, and their determinants, in one pass over the
//! bearings.
//!
//! H = [cos b, -sin b] x [1, T], so the sums of sin^2 b and sin b cos b times
//! 1, T and T^2 beside those of 1, T and T^2 are all there is to know. Bearings
//! are counted from the middle one and times from the middle: exact shifts that
//! keep sin^2 b small where the bearings hardly change. The determinant, which
//! no shift alters, is taken there; the matrix is turned and shifted back.

use core::convert::Infallible;

use crate::batch::simd::{Path, prefetch, sin_cos, sin_products};
use crate::batch::{Items, Threads};
use crate::scalar::Real;

/// Gram matrices (trials, 4, 4) of unit rows at the first time, each row
/// weighted if weights are given, and with `determinant` the determinant of each after it:
/// [`GRAM_SIZE`] numbers a trial.
///
/// Half the digits are lost in the sums, and with them small determinants: see
/// [`discriminant_sum`](crate::bearings::batch::discriminant_sum) for all of them.
pub fn bearing_gram(
    times: Items<'_>,
    bearings: Items<'_>,
    weights: Option<Items<'_>>,
    determinant: bool,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) {
    let m = times.get(0).len();
    let shared = times.is_shared() && weights.is_none_or(|w| w.is_shared());
    let common = shared.then(|| moments(times.get(0), weights.map(|w| w.get(0))));
    let size = if determinant {
        GRAM_SIZE
    } else {
        GRAM_SIZE - 1
    };
    let trials = out.len() / size;
    let group = |first: usize, out: &mut [f64]| {
        path.run(Kernel {
            times: times.skip(first),
            bearings: bearings.skip(first),
            weights: weights.map(|w| w.skip(first)),
            common,
            size,
            out,
        });
    };
    // In groups, since what follows the sums takes a vector of trials at once.
    let (whole, rest) = out.split_at_mut(trials / GROUP * GROUP * size);
    let each = |index: usize, out: &mut [f64]| -> Result<(), Infallible> {
        group(index * GROUP, out);
        Ok(())
    };
    let cost = GROUP as f64 * (15.0 + 1.5 * m as f64);
    let Ok(()) = threads.over(whole, GROUP * size, cost, each);
    group(trials / GROUP * GROUP, rest);
}

/// Trials that are finished together.
const GROUP: usize = 8;

/// Numbers for each trial: the matrix and its determinant.
pub const GRAM_SIZE: usize = 17;

/// Sums of w, w T, w T^2 with T from the middle instant.
fn moments(times: &[f64], weights: Option<&[f64]>) -> [f64; 3] {
    let origin = times[times.len() / 2];
    let mut sums = [0.0; 3];
    for (i, time) in times.iter().enumerate() {
        let (w, t) = (weights.map_or(1.0, |w| w[i]), time - origin);
        sums[0] += w;
        sums[1] += w * t;
        sums[2] += w * t * t;
    }
    sums
}

struct Kernel<'a> {
    times: Items<'a>,
    bearings: Items<'a>,
    weights: Option<Items<'a>>,
    common: Option<[f64; 3]>,
    size: usize,
    out: &'a mut [f64],
}

/// Sums of up to eight trials, the trial as last index.
#[derive(Default)]
struct Group {
    moments: [[f64; GROUP]; 3],
    square: [[f64; GROUP]; 3],
    product: [[f64; GROUP]; 3],
    turn: [f64; GROUP],
    shift: [f64; GROUP],
}

impl pulp::WithSimd for Kernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let mut group = Group::default();
        let count = self.out.len() / self.size;
        for trial in 0..count {
            let (times, bearings) = (self.times.get(trial), self.bearings.get(trial));
            let middle = bearings.len() / 2;
            let mut sums = Sums::new(simd, bearings[middle], times[middle]);
            let moments = match self.weights {
                None => {
                    sums.add_all(simd, bearings, times, None);
                    self.common.unwrap_or_else(|| moments(times, None))
                }
                Some(weights) => {
                    let weights = weights.get(trial);
                    sums.add_all(simd, bearings, times, Some(weights));
                    self.common.unwrap_or_else(|| moments(times, Some(weights)))
                }
            };
            for k in 0..3 {
                group.moments[k][trial] = moments[k];
                group.square[k][trial] = simd.reduce_sum_f64s(sums.square[k]);
                group.product[k][trial] = simd.reduce_sum_f64s(sums.product[k]);
            }
            group.turn[trial] = bearings[middle];
            group.shift[trial] = times[middle] - times[0];
        }
        let (mut sin, mut cos) = ([0.0; GROUP], [0.0; GROUP]);
        let (turns, _) = S::as_simd_f64s(&group.turn);
        let (sins, _) = S::as_mut_simd_f64s(&mut sin);
        let (coss, _) = S::as_mut_simd_f64s(&mut cos);
        for v in 0..turns.len() {
            (sins[v], coss[v]) = sin_cos(simd, turns[v]);
        }
        let mut numbers = [[0.0; GROUP]; GRAM_SIZE];
        finish(&group, &sin, &cos, &mut numbers);
        // Of a length that is known when this is compiled.
        if self.size == GRAM_SIZE {
            write::<GRAM_SIZE>(&numbers, self.out);
        } else {
            write::<{ GRAM_SIZE - 1 }>(&numbers, self.out);
        }
    }
}

/// Writes the first `N` numbers of each trial.
#[inline(always)]
fn write<const N: usize>(numbers: &[[f64; GROUP]; GRAM_SIZE], out: &mut [f64]) {
    for (trial, out) in out.as_chunks_mut::<N>().0.iter_mut().enumerate() {
        for (out, number) in out.iter_mut().zip(numbers) {
            *out = number[trial];
        }
    }
}

/// Sums of w sin^2 b T^k and w sin b cos b T^k, lane by lane.
struct Sums<S: pulp::Simd> {
    turn: S::f64s,
    origin: S::f64s,
    square: [S::f64s; 3],
    product: [S::f64s; 3],
}

impl<S: pulp::Simd> Sums<S> {
    #[inline(always)]
    fn new(simd: S, turn: f64, origin: f64) -> Self {
        let zero = simd.splat_f64s(0.0);
        Self {
            turn: simd.splat_f64s(turn),
            origin: simd.splat_f64s(origin),
            square: [zero; 3],
            product: [zero; 3],
        }
    }

    #[inline(always)]
    fn add_all(&mut self, simd: S, bearings: &[f64], times: &[f64], weights: Option<&[f64]>) {
        let lanes = S::F64_LANES;
        let whole = bearings.len() / lanes * lanes;
        let zero = simd.splat_f64s(0.0);
        let (vectors, rest) = S::as_simd_f64s(bearings);
        let (clock, _) = S::as_simd_f64s(times);
        match weights {
            None => {
                for ((&b, &t), numbers) in
                    vectors.iter().zip(clock).zip(bearings.chunks_exact(lanes))
                {
                    prefetch(numbers);
                    self.add(simd, simd.sub_f64s(b, self.turn), t, None);
                }
            }
            Some(weights) => {
                let (weights, _) = S::as_simd_f64s(weights);
                for ((&b, &t), &w) in vectors.iter().zip(clock).zip(weights) {
                    self.add(simd, simd.sub_f64s(b, self.turn), t, Some(w));
                }
            }
        }
        if rest.is_empty() {
            return;
        }
        // The last vector once more, its known lanes at angle zero, where they
        // add nothing; of fewer bearings than lanes, what there is.
        let first = (whole + rest.len()).saturating_sub(lanes);
        let last = |all: &[f64]| simd.partial_load_f64s(&all[first..]);
        let (new, _) = S::as_simd_f64s(&LANE[..lanes]);
        let known = simd.splat_f64s((whole - first.min(whole)) as f64);
        let short = simd.splat_f64s((bearings.len() - first) as f64);
        let angle = simd.sub_f64s(last(bearings), self.turn);
        let angle = simd.select_f64s(simd.less_than_f64s(new[0], known), zero, angle);
        let angle = simd.select_f64s(simd.less_than_f64s(new[0], short), angle, zero);
        self.add(simd, angle, last(times), weights.map(last));
    }

    #[inline(always)]
    fn add(&mut self, simd: S, angle: S::f64s, time: S::f64s, weight: Option<S::f64s>) {
        let (square, product) = sin_products(simd, angle);
        match weight {
            None => self.add_products(simd, square, product, time),
            Some(w) => self.add_products(
                simd,
                simd.mul_f64s(w, square),
                simd.mul_f64s(w, product),
                time,
            ),
        }
    }

    #[inline(always)]
    fn add_products(&mut self, simd: S, square: S::f64s, product: S::f64s, time: S::f64s) {
        let t = simd.sub_f64s(time, self.origin);
        let tt = simd.mul_f64s(t, t);
        for (sums, value) in [(&mut self.square, square), (&mut self.product, product)] {
            sums[0] = simd.add_f64s(sums[0], value);
            sums[1] = simd.mul_add_e_f64s(value, t, sums[1]);
            sums[2] = simd.mul_add_e_f64s(value, tt, sums[2]);
        }
    }
}

/// The number of each lane.
const LANE: [f64; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

/// The matrices in the given axes at the first time, and the determinants: one
/// loop over the trials, which becomes vectors.
#[inline(always)]
fn finish(
    group: &Group,
    sin: &[f64; GROUP],
    cos: &[f64; GROUP],
    out: &mut [[f64; GROUP]; GRAM_SIZE],
) {
    for n in 0..GROUP {
        let at = |sums: &[[f64; GROUP]; 3]| [sums[0][n], sums[1][n], sums[2][n]];
        let (moments, square, product) =
            (at(&group.moments), at(&group.square), at(&group.product));
        let (sin, cos, shift) = (sin[n], cos[n], group.shift[n]);
        // Blocks of cos^2, -sin cos and sin^2 times T^k.
        let cc = [
            moments[0] - square[0],
            moments[1] - square[1],
            moments[2] - square[2],
        ];
        out[16][n] = block_determinant(&cc, &product, &square);
        let mut blocks = [[0.0; 3]; 3];
        for k in 0..3 {
            // Turned by the middle bearing: (cos b, -sin b) = turn (cos b', -sin b').
            let (a, b, d) = (cc[k], -product[k], square[k]);
            blocks[k] = [
                cos * cos * a + 2.0 * cos * sin * b + sin * sin * d,
                cos * sin * (d - a) + (cos * cos - sin * sin) * b,
                sin * sin * a - 2.0 * cos * sin * b + cos * cos * d,
            ];
        }
        for e in 0..3 {
            let (zero, one, two) = (blocks[0][e], blocks[1][e], blocks[2][e]);
            blocks[1][e] = one + shift * zero;
            blocks[2][e] = two + shift * (2.0 * one + shift * zero);
        }
        for (k, corner) in [(0, 0), (1, 2), (1, 8), (2, 10)] {
            out[corner][n] = blocks[k][0];
            out[corner + 1][n] = blocks[k][1];
            out[corner + 4][n] = blocks[k][1];
            out[corner + 5][n] = blocks[k][2];
        }
    }
}

/// det of [[C, -B], [-B, A]], each a 2 x 2 matrix of sums times T^(i + j): of the Gram
/// matrix of rows (a, b) x (1, T) of sums of a a, a b (of either sign) and b b.
#[inline(always)]
pub(crate) fn block_determinant<T: Real>(c: &[T; 3], b: &[T; 3], a: &[T; 3]) -> T {
    // One column at a time, the times centred in the sums themselves: what is
    // subtracted then is as small as it can be. A zero pivot makes a zero.
    let inverse = |x: T| {
        if x > T::zero() {
            T::one() / x
        } else {
            T::zero()
        }
    };
    let g = inverse(c[0]);
    let f = c[1] * g;
    let second = c[2] - f * c[1];
    let h = inverse(second);
    // Rows of B in the columns 1 and T - f.
    let (b01, b11) = (b[1] - f * b[0], b[2] - f * b[1]);
    let s00 = a[0] - b[0] * b[0] * g - b01 * b01 * h;
    let s01 = a[1] - b[0] * b[1] * g - b01 * b11 * h;
    let s11 = a[2] - b[1] * b[1] * g - b11 * b11 * h;
    c[0] * second * (s00 * s11 - s01 * s01)
}

#[cfg(test)]
mod tests {
    use alloc::vec;
    use alloc::vec::Vec;

    use super::*;

    #[test]
    fn the_six_sums_give_the_gram_matrix_on_every_path() {
        for m in [1, 2, 4, 7, 8, 9, 33] {
            let times: Vec<f64> = (0..m).map(|i| 100.0 + 3.0 * f64::from(i)).collect();
            let bearings: Vec<f64> = (0..m)
                .map(|i| 2.0 + 0.07 * f64::from(i) + 0.002 * f64::from(i * i))
                .collect();
            let weights: Vec<f64> = (0..m).map(|i| 0.5 + f64::from(i % 4)).collect();
            for weights in [None, Some(&weights[..])] {
                let mut wanted = [[0.0; 4]; 4];
                for i in 0..times.len() {
                    let (s, c) = bearings[i].sin_cos();
                    let t = times[i] - times[0];
                    let row = [c, -s, t * c, -t * s];
                    let w = weights.map_or(1.0, |w| w[i]);
                    for a in 0..4 {
                        for b in 0..4 {
                            wanted[a][b] += w * row[a] * row[b];
                        }
                    }
                }
                let det = bearings::discriminant_sum(&times, &bearings, weights).unwrap_or(0.0);
                for path in Path::available() {
                    let mut out = vec![0.0; GRAM_SIZE];
                    bearing_gram(
                        Items::shared(&times),
                        Items::each(&bearings, times.len()),
                        weights.map(Items::shared),
                        true,
                        Threads::One,
                        path,
                        &mut out,
                    );
                    let mut matrix = vec![0.0; 16];
                    bearing_gram(
                        Items::shared(&times),
                        Items::each(&bearings, times.len()),
                        weights.map(Items::shared),
                        false,
                        Threads::One,
                        path,
                        &mut matrix,
                    );
                    assert_eq!(matrix, out[..16]);
                    for a in 0..4 {
                        for b in 0..4 {
                            let size = (wanted[a][a] * wanted[b][b]).sqrt();
                            let error = (out[4 * a + b] - wanted[a][b]).abs();
                            assert!(
                                error <= 1e-13 * size + 1e-300,
                                "{path:?} m = {m} [{a}][{b}]"
                            );
                        }
                    }
                    if m >= 7 {
                        assert!(
                            (out[16] - det).abs() <= 1e-9 * det,
                            "{path:?} {} {det}",
                            out[16]
                        );
                    }
                }
            }
        }
    }

    use crate::bearings;
}
