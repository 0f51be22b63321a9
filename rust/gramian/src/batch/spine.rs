//! Rows and bounds, trial by trial.

use alloc::vec;
use core::convert::Infallible;

use super::{Items, Threads};
use crate::bearings;
use crate::bound::standard_deviations;
use crate::spectrum::{decompose, default_rtol, rank, unit_columns};
use crate::square_root::triangularize;

/// Bounds (trials, n) on the standard deviation of each state, from rows
/// (trials, K, n); infinite where a state is not determined.
pub fn crlb_std(rows: Items<'_>, n: usize, rtol: Option<f64>, threads: Threads, out: &mut [f64]) {
    let size = rows.size();
    let count = size.checked_div(n).unwrap_or(0);
    let rtol = rtol.unwrap_or_else(|| default_rtol(count, n));
    let padded = count.max(n) * n;
    // Scratch: the rows, then work, scale, singular values, vectors.
    let scratch = || vec![0.0; padded + n + n + n + 2 * n * n];
    let cost = (count * n * n) as f64 + 100.0 * (n * n * n) as f64;
    let each =
        |space: &mut vec::Vec<f64>, trial: usize, out: &mut [f64]| -> Result<(), Infallible> {
            let (a, space) = space.split_at_mut(padded);
            let (work, space) = space.split_at_mut(n);
            let (scale, space) = space.split_at_mut(n);
            let (s, space) = space.split_at_mut(n);
            let (v, w) = space.split_at_mut(n * n);
            a[..size].copy_from_slice(rows.get(trial));
            a[size..].fill(0.0);
            triangularize(a, n, work);
            unit_columns(a, n, scale);
            decompose(a, n, scale, s, v, w);
            standard_deviations(s, v, scale, rank(s, rtol), rtol, out);
            Ok(())
        };
    let Ok(()) = threads.over_with(out, n, cost, scratch, each);
}

/// Where the target of a batch of bearings is.
#[derive(Clone, Copy, Debug)]
pub enum Target<'a> {
    /// Constant velocity: (x0, y0, vx, vy) for each trial.
    State(Items<'a>),
    /// A position (east, north) for each time.
    Positions(Items<'a>),
}

/// Whitened rows (trials, m, 4) of bearings-only tracks.
///
/// # Errors
/// As [`bearings::push_rows`], with the trial.
pub fn bearing_rows(
    times: Items<'_>,
    observer: Items<'_>,
    target: Target<'_>,
    sigma: Items<'_>,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, bearings::Error)> {
    let m = times.size();
    threads.over(out, 4 * m, 10.0 * m as f64, |trial, out| {
        let (times, sigma) = (times.get(trial), sigma.get(trial));
        let (observer, _) = observer.get(trial).as_chunks::<2>();
        let (rows, _) = out.as_chunks_mut::<4>();
        for (i, row) in rows.iter_mut().enumerate() {
            let time = times[i] - times[0];
            let [x, y] = match target {
                Target::State(state) => {
                    let x = state.get(trial);
                    bearings::moved(&[x[0], x[1], x[2], x[3]], time)
                }
                Target::Positions(positions) => {
                    let p = positions.get(trial);
                    [p[2 * i], p[2 * i + 1]]
                }
            };
            let s = sigma[if sigma.len() == 1 { 0 } else { i }];
            *row = bearings::unchecked_row(time, x - observer[i][0], y - observer[i][1], s)
                .map_err(|error| (trial, error.at(i)))?;
        }
        Ok(())
    })
}
