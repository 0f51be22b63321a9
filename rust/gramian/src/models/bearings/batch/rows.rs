//! Rows of bearings-only tracks, trial by trial.

use crate::batch::{Items, Threads};
use crate::bearings;

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
