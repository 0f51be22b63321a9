//! Simulated bearings, their Gram matrix and the logarithm of its determinant,
//! in one pass for each trial: nothing but the result goes to memory.

use alloc::vec;
use core::convert::Infallible;

use super::{GRAM_SIZE, bearing_gram};
use crate::batch::simd::Path;
use crate::batch::{Items, Stream, Threads};

/// Trials that are simulated together, so that what they share is summed once.
const TOGETHER: usize = 16;

/// log det of the Gram matrix of noisy bearings for the trials from `first` on,
/// natural logarithm; -infinity where the determinant is not positive.
///
/// `bearings` are without noise, `sigma` is one standard deviation for all or
/// one each, in rad. Trial i depends on (seed, i) alone.
#[allow(clippy::too_many_arguments)]
pub fn bearing_log_det_trials(
    times: &[f64],
    bearings: &[f64],
    sigma: &[f64],
    seed: u64,
    first: u64,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) {
    let m = bearings.len();
    let cost = 10.0 * m as f64;
    let scratch = || (vec![0.0; TOGETHER * m], vec![0.0; TOGETHER * GRAM_SIZE]);
    let each = |space: &mut (vec::Vec<f64>, vec::Vec<f64>), start: usize, out: &mut [f64]| {
        let noisy = &mut space.0[..out.len() * m];
        let grams = &mut space.1[..out.len() * GRAM_SIZE];
        for (k, noisy) in noisy.chunks_exact_mut(m).enumerate() {
            let mut stream = Stream::new(seed, first + (start + k) as u64);
            for (i, noisy) in noisy.iter_mut().enumerate() {
                let s = sigma[if sigma.len() == 1 { 0 } else { i }];
                *noisy = bearings[i] + s * stream.normal();
            }
        }
        bearing_gram(
            Items::shared(times),
            Items::each(noisy, m),
            None,
            true,
            Threads::One,
            path,
            grams,
        );
        for (out, gram) in out.iter_mut().zip(grams.chunks_exact(GRAM_SIZE)) {
            *out = if gram[GRAM_SIZE - 1] > 0.0 {
                gram[GRAM_SIZE - 1].ln()
            } else {
                f64::NEG_INFINITY
            };
        }
    };
    let whole = out.len() / TOGETHER * TOGETHER;
    let (blocks, rest) = out.split_at_mut(whole);
    let Ok(()) = threads.over_with(
        blocks,
        TOGETHER,
        cost * TOGETHER as f64,
        scratch,
        |space, block, out| {
            each(space, block * TOGETHER, out);
            Ok::<_, Infallible>(())
        },
    );
    each(&mut scratch(), whole, rest);
}

#[cfg(test)]
mod tests {
    use alloc::vec::Vec;

    use super::*;

    #[test]
    fn any_cut_and_path_gives_the_numbers_of_simulated_bearings() {
        let m = 21;
        let times: Vec<f64> = (0..m).map(|i| 10.0 * f64::from(i)).collect();
        let bearings: Vec<f64> = (0..m)
            .map(|i| 0.3 + 0.05 * f64::from(i) + 0.003 * f64::from(i * i))
            .collect();
        let (sigma, seed, trials) = ([0.01], 5, 40);
        let mut wanted = vec![0.0; trials];
        for (trial, wanted) in wanted.iter_mut().enumerate() {
            let mut stream = Stream::new(seed, 7 + trial as u64);
            let noisy: Vec<f64> = bearings
                .iter()
                .map(|b| b + sigma[0] * stream.normal())
                .collect();
            *wanted = crate::bearings::discriminant_sum(&times, &noisy, None)
                .unwrap_or(0.0)
                .ln();
        }
        let run = |first: usize, count: usize, threads: Threads, path: Path| {
            let mut out = vec![0.0; count];
            bearing_log_det_trials(
                &times,
                &bearings,
                &sigma,
                seed,
                7 + first as u64,
                threads,
                path,
                &mut out,
            );
            out
        };
        for path in Path::available() {
            let all = run(0, trials, Threads::Auto, path);
            for (found, wanted) in all.iter().zip(&wanted) {
                assert!((found - wanted).abs() < 1e-8, "{path:?} {found} {wanted}");
            }
            for (first, count) in [(0, 1), (3, 17), (16, 24), (39, 1)] {
                let part = run(first, count, Threads::One, path);
                assert_eq!(part, all[first..first + count], "{path:?} {first} {count}");
            }
        }
    }
}
