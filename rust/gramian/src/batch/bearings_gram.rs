//! Gram matrices of bearings, and their determinants, in one pass over the
//! bearings.
//!
//! H = [cos b, -sin b] x [1, T], so the sums of sin^2 b and sin b cos b times
//! 1, T and T^2 beside those of 1, T and T^2 are all there is to know. Bearings
//! are counted from the middle one and times from the middle: exact shifts that
//! keep sin^2 b small where the bearings hardly change. The determinant, which
//! no shift alters, is taken there; the matrix is turned and shifted back.

use core::convert::Infallible;

use super::simd::{Path, sin_cos};
use super::{Items, Threads};

/// Gram matrices (trials, 4, 4) of unit rows at the first time, each row
/// weighted if weights are given, and (if `det` is not empty) their determinants.
///
/// Half the digits are lost in the sums, and with them small determinants: see
/// [`discriminant_sum`](super::discriminant_sum) for all of them.
pub fn bearing_gram(
    times: Items<'_>,
    bearings: Items<'_>,
    weights: Option<Items<'_>>,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) {
    let m = times.get(0).len();
    let shared = times.is_shared() && weights.is_none_or(|w| w.is_shared());
    let common = shared.then(|| moments(times.get(0), weights.map(|w| w.get(0))));
    let each = |trial: usize, out: &mut [f64]| -> Result<(), Infallible> {
        let (times, weights) = (times.get(trial), weights.map(|w| w.get(trial)));
        let moments = common.unwrap_or_else(|| moments(times, weights));
        path.run(Kernel {
            times,
            bearings: bearings.get(trial),
            weights,
            moments,
            out,
        });
        Ok(())
    };
    let Ok(()) = threads.over(out, GRAM_SIZE, 1.0 * m as f64, each);
}

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
    times: &'a [f64],
    bearings: &'a [f64],
    weights: Option<&'a [f64]>,
    moments: [f64; 3],
    out: &'a mut [f64],
}

impl pulp::WithSimd for Kernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let m = self.bearings.len();
        let (turn, origin) = (self.bearings[m / 2], self.times[m / 2]);
        let mut sums = Sums::new(simd, turn, origin);
        let (bearings, bearings_rest) = S::as_simd_f64s(self.bearings);
        let (times, times_rest) = S::as_simd_f64s(self.times);
        if let Some(weights) = self.weights {
            let (weights, weights_rest) = S::as_simd_f64s(weights);
            for ((&b, &t), &w) in bearings.iter().zip(times).zip(weights) {
                sums.add_weighted(simd, b, t, w);
            }
            if !bearings_rest.is_empty() {
                sums.add_weighted(
                    simd,
                    simd.partial_load_f64s(bearings_rest),
                    simd.partial_load_f64s(times_rest),
                    simd.partial_load_f64s(weights_rest),
                );
            }
        } else {
            for (&b, &t) in bearings.iter().zip(times) {
                sums.add(simd, b, t);
            }
            if !bearings_rest.is_empty() {
                // The middle bearing where there is none adds nothing.
                let mut padded = [turn; 8];
                padded[..bearings_rest.len()].copy_from_slice(bearings_rest);
                sums.add(
                    simd,
                    simd.partial_load_f64s(&padded[..S::F64_LANES]),
                    simd.partial_load_f64s(times_rest),
                );
            }
        }
        let (square, product) = sums.reduce(simd);
        let (sin, cos) = sin_cos(simd, simd.splat_f64s(turn));
        let turn = (first_lane(simd, sin), first_lane(simd, cos));
        finish(
            &self.moments,
            &square,
            &product,
            turn,
            origin - self.times[0],
            self.out,
        );
    }
}

#[inline(always)]
fn first_lane<S: pulp::Simd>(simd: S, value: S::f64s) -> f64 {
    let mut lane = [0.0];
    simd.partial_store_f64s(&mut lane, value);
    lane[0]
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
    fn add(&mut self, simd: S, bearing: S::f64s, time: S::f64s) {
        let (sin, cos) = sin_cos(simd, simd.sub_f64s(bearing, self.turn));
        self.add_products(simd, simd.mul_f64s(sin, sin), simd.mul_f64s(sin, cos), time);
    }

    #[inline(always)]
    fn add_weighted(&mut self, simd: S, bearing: S::f64s, time: S::f64s, weight: S::f64s) {
        let (sin, cos) = sin_cos(simd, simd.sub_f64s(bearing, self.turn));
        let weighted = simd.mul_f64s(sin, weight);
        self.add_products(
            simd,
            simd.mul_f64s(weighted, sin),
            simd.mul_f64s(weighted, cos),
            time,
        );
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

    #[inline(always)]
    fn reduce(&self, simd: S) -> ([f64; 3], [f64; 3]) {
        (
            self.square.map(|sum| simd.reduce_sum_f64s(sum)),
            self.product.map(|sum| simd.reduce_sum_f64s(sum)),
        )
    }
}

/// The matrix in the given axes at the first time, and the determinant.
#[inline(always)]
fn finish(
    moments: &[f64; 3],
    square: &[f64; 3],
    product: &[f64; 3],
    (sin, cos): (f64, f64),
    shift: f64,
    out: &mut [f64],
) {
    // Blocks of cos^2, -sin cos and sin^2 times T^k.
    let cc = [
        moments[0] - square[0],
        moments[1] - square[1],
        moments[2] - square[2],
    ];
    out[16] = determinant(&cc, product, square);
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
    for n in 0..3 {
        let (zero, one, two) = (blocks[0][n], blocks[1][n], blocks[2][n]);
        blocks[1][n] = one + shift * zero;
        blocks[2][n] = two + shift * (2.0 * one + shift * zero);
    }
    for (k, (row, column)) in [(0, (0, 0)), (1, (0, 2)), (1, (2, 0)), (2, (2, 2))] {
        let [a, b, d] = blocks[k];
        let at = 4 * row + column;
        out[at] = a;
        out[at + 1] = b;
        out[at + 4] = b;
        out[at + 5] = d;
    }
}

/// det of [[C, -B], [-B, A]], each a 2 x 2 matrix of sums times T^(i + j).
#[inline(always)]
fn determinant(c: &[f64; 3], b: &[f64; 3], a: &[f64; 3]) -> f64 {
    // One column at a time, the times centred in the sums themselves: what is
    // subtracted then is as small as it can be.
    if !(c[0] > 0.0) {
        return c[0] * 0.0;
    }
    let f = c[1] / c[0];
    let second = c[2] - f * c[1];
    // Rows of B in the columns 1 and T - f.
    let (b01, b11) = (b[1] - f * b[0], b[2] - f * b[1]);
    if !(second > 0.0) {
        return second * 0.0;
    }
    let (g, h) = (1.0 / c[0], 1.0 / second);
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
                        Threads::One,
                        path,
                        &mut out,
                    );
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
