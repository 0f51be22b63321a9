//! The test on noisy bearings, trial by trial, by vectors over the bearings.
//!
//! The sums of each step run over vectors; the few operations between steps are
//! those of [`crate::bearings::observability_test`], which is also the plain
//! text that this one is tested against.

use alloc::vec;

use crate::batch::simd::{Path, atan2, sin_cos};
use crate::batch::{Items, Threads};
use crate::bearings::{self, Clock, Residuals, SMALLEST, Sums, check_sigma, fit};

/// Numbers for each trial: statistic, p-value, relative motion (4).
pub const TEST_SIZE: usize = 6;
/// The widest vector.
const WIDEST: usize = 8;

/// Tests every trial's bearings for an unobservable track, m - 3 degrees of
/// freedom; `sigma` has one number or m.
///
/// # Errors
/// As [`bearings::observability_test`], with the trial.
pub fn observability_tests(
    times: Items<'_>,
    bearings: Items<'_>,
    sigma: Items<'_>,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    let m = times.get(0).len();
    let check = |trial: usize| {
        let (times, sigma) = (times.get(trial), sigma.get(trial));
        bearings::check_track(times, times, None, 4)
            .and_then(|()| check_sigma(sigma, m))
            .map_err(|error| (trial, error))?;
        Ok(Clock::of(times))
    };
    let shared = times.is_shared() && sigma.is_shared();
    let common = if shared { Some(check(0)?) } else { None };
    let scratch = || vec![0.0; 4 * m.next_multiple_of(WIDEST)];
    let cost = 300.0 + 25.0 * m as f64;
    threads.over_with(out, TEST_SIZE, cost, scratch, |space, trial, out| {
        let clock = match common {
            Some(clock) => clock,
            None => check(trial)?,
        };
        path.run(Kernel {
            times: times.get(trial),
            bearings: bearings.get(trial),
            sigma: sigma.get(trial),
            clock,
            space,
            out,
        });
        Ok(())
    })
}

struct Kernel<'a> {
    times: &'a [f64],
    bearings: &'a [f64],
    sigma: &'a [f64],
    clock: Clock<f64>,
    space: &'a mut [f64],
    out: &'a mut [f64],
}

impl pulp::WithSimd for Kernel<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let m = self.bearings.len();
        let size = m.next_multiple_of(S::F64_LANES);
        let (sines, space) = self.space.split_at_mut(size);
        let (cosines, space) = space.split_at_mut(size);
        let (times, space) = space.split_at_mut(size);
        let (weights, _) = space.split_at_mut(size);
        for (standard, &time) in times.iter_mut().zip(self.times) {
            *standard = self.clock.read(time);
        }
        times[m..].fill(0.0);
        if let [sigma] = self.sigma {
            weights[..m].fill(1.0 / (sigma * sigma));
        } else {
            for (weight, sigma) in weights.iter_mut().zip(self.sigma) {
                *weight = 1.0 / (sigma * sigma);
            }
        }
        weights[m..].fill(0.0);
        let lanes = S::F64_LANES;
        for ((b, sin), cos) in self
            .bearings
            .chunks(lanes)
            .zip(sines.chunks_exact_mut(lanes))
            .zip(cosines.chunks_exact_mut(lanes))
        {
            let (s, c) = sin_cos(simd, simd.partial_load_f64s(b));
            simd.partial_store_f64s(sin, s);
            simd.partial_store_f64s(cos, c);
        }
        let (sin, cos) = (sines[m / 2], cosines[m / 2]);
        let points = Points {
            simd,
            sines: S::as_simd_f64s(sines).0,
            cosines: S::as_simd_f64s(cosines).0,
            times: S::as_simd_f64s(times).0,
            weights: S::as_simd_f64s(weights).0,
        };
        let gram = points.gram();
        let (motion, statistic, p_value) = fit(&gram, sin, cos, m - 3, &points);
        self.out[0] = statistic;
        self.out[1] = p_value;
        self.out[2..].copy_from_slice(&self.clock.at_first(&motion));
    }
}

/// Sines, cosines, standard times and weights, with weight zero behind the last.
struct Points<'a, S: pulp::Simd> {
    simd: S,
    sines: &'a [S::f64s],
    cosines: &'a [S::f64s],
    times: &'a [S::f64s],
    weights: &'a [S::f64s],
}

impl<S: pulp::Simd> Points<'_, S> {
    /// Sums of w (cos^2, -sin cos, sin^2) times 1, T and T^2.
    #[inline(always)]
    fn gram(&self) -> [f64; 9] {
        let simd = self.simd;
        let mut sums = [simd.splat_f64s(0.0); 9];
        for v in 0..self.times.len() {
            let (s, c, t) = (self.sines[v], self.cosines[v], self.times[v]);
            let (ws, wc) = (
                simd.mul_f64s(self.weights[v], s),
                simd.mul_f64s(self.weights[v], c),
            );
            let products = [
                simd.mul_f64s(wc, c),
                simd.neg_f64s(simd.mul_f64s(ws, c)),
                simd.mul_f64s(ws, s),
            ];
            add_moments(simd, &mut sums, &products, t);
        }
        reduced(simd, &sums)
    }
}

impl<S: pulp::Simd> Residuals<f64> for Points<'_, S> {
    #[inline(always)]
    fn sums(&self, c: &[f64; 4]) -> Sums<f64> {
        let simd = self.simd;
        let zero = simd.splat_f64s(0.0);
        let c = [
            simd.splat_f64s(c[0]),
            simd.splat_f64s(c[1]),
            simd.splat_f64s(c[2]),
            simd.splat_f64s(c[3]),
        ];
        let smallest = simd.splat_f64s(SMALLEST);
        let mut statistic = zero;
        let mut gradient = [zero; 4];
        let mut normal = [zero; 9];
        for v in 0..self.times.len() {
            let (sin, cos, t) = (self.sines[v], self.cosines[v], self.times[v]);
            let w = self.weights[v];
            let x = simd.mul_add_e_f64s(t, c[2], c[0]);
            let y = simd.mul_add_e_f64s(t, c[3], c[1]);
            let (xx, yy) = (simd.mul_f64s(x, x), simd.mul_f64s(y, y));
            let rr = simd.max_f64s(simd.add_f64s(xx, yy), smallest);
            let across = simd.negate_mul_add_e_f64s(cos, x, simd.mul_f64s(sin, y));
            let ahead = simd.mul_add_e_f64s(cos, y, simd.mul_f64s(sin, x));
            let error = atan2(simd, across, ahead);
            let weight = simd.div_f64s(w, rr);
            let curve = simd.div_f64s(weight, rr);
            let slope = simd.mul_f64s(weight, error);
            statistic = simd.mul_add_e_f64s(simd.mul_f64s(w, error), error, statistic);
            let (east, north) = (
                simd.mul_f64s(slope, y),
                simd.neg_f64s(simd.mul_f64s(slope, x)),
            );
            gradient[0] = simd.add_f64s(gradient[0], east);
            gradient[1] = simd.add_f64s(gradient[1], north);
            gradient[2] = simd.mul_add_e_f64s(east, t, gradient[2]);
            gradient[3] = simd.mul_add_e_f64s(north, t, gradient[3]);
            let products = [
                simd.mul_f64s(curve, yy),
                simd.neg_f64s(simd.mul_f64s(simd.mul_f64s(curve, x), y)),
                simd.mul_f64s(curve, xx),
            ];
            add_moments(simd, &mut normal, &products, t);
        }
        Sums {
            statistic: simd.reduce_sum_f64s(statistic),
            gradient: reduced(simd, &gradient),
            normal: reduced(simd, &normal),
        }
    }
}

/// The sums over the lanes.
#[inline(always)]
fn reduced<S: pulp::Simd, const N: usize>(simd: S, sums: &[S::f64s; N]) -> [f64; N] {
    let mut out = [0.0; N];
    for n in 0..N {
        out[n] = simd.reduce_sum_f64s(sums[n]);
    }
    out
}

/// Adds three products times 1, T and T^2.
#[inline(always)]
fn add_moments<S: pulp::Simd>(
    simd: S,
    sums: &mut [S::f64s; 9],
    products: &[S::f64s; 3],
    t: S::f64s,
) {
    let tt = simd.mul_f64s(t, t);
    for (k, &product) in products.iter().enumerate() {
        sums[k] = simd.add_f64s(sums[k], product);
        sums[3 + k] = simd.mul_add_e_f64s(product, t, sums[3 + k]);
        sums[6 + k] = simd.mul_add_e_f64s(product, tt, sums[6 + k]);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use alloc::vec::Vec;

    use super::*;
    use crate::batch::Stream;

    #[test]
    fn every_path_gives_the_plain_test() {
        for m in [4, 7, 8, 9, 30, 60] {
            let times: Vec<f64> = (0..m).map(|i| 5.0 * f64::from(i)).collect();
            let span = times[times.len() - 1];
            for trial in 0..20 {
                let mut noise = Stream::new(5, trial);
                let bent = if trial % 2 == 0 { 0.0 } else { 0.3 };
                let bearings: Vec<f64> = times
                    .iter()
                    .map(|t| {
                        let u = t / span;
                        // Across north and south both, within +-pi.
                        let b = 3.0 + (2.0 * u - 0.7 + bent * u * u).atan();
                        crate::scalar::wrapped(b + 0.01 * noise.normal())
                    })
                    .collect();
                let plain = bearings::observability_test(&times, &bearings, &[0.01]).unwrap();
                for path in Path::available() {
                    let mut out = [0.0; TEST_SIZE];
                    let sigma = vec![0.01; times.len()];
                    observability_tests(
                        Items::shared(&times),
                        Items::each(&bearings, times.len()),
                        Items::shared(&sigma),
                        Threads::One,
                        path,
                        &mut out,
                    )
                    .unwrap();
                    let close = (out[0] - plain.statistic).abs() <= 1e-6 * (1.0 + plain.statistic);
                    assert!(close, "{path:?} m = {m} trial {trial}: {out:?} {plain:?}");
                }
            }
        }
    }
}
