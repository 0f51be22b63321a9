//! Rows of targets of any order of motion, in the plane and in space.

use crate::batch::{Items, Threads};
use crate::bearings::{self, Error};

/// Where the target is, in `dimensions` coordinates.
#[derive(Clone, Copy, Debug)]
pub enum Motion<'a> {
    /// Derivatives at the first time, order by order, for each trial.
    State(Items<'a>),
    /// A position for each time.
    Positions(Items<'a>),
}

/// Whitened rows of bearings (trials, m, n) in the plane, of azimuth and
/// elevation in turn (trials, 2 m, n) in space: n = `dimensions` (order + 1).
///
/// `sigma` holds one deviation or m in the plane; in space those of azimuth and
/// behind them as many of elevation.
///
/// # Errors
/// As [`bearings::motion_row`] and [`bearings::azimuth_elevation_rows`], with
/// the trial.
#[allow(clippy::too_many_arguments)]
pub fn motion_rows(
    times: Items<'_>,
    observer: Items<'_>,
    target: Motion<'_>,
    sigma: Items<'_>,
    dimensions: usize,
    order: usize,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let m = times.get(0).len();
    let n = dimensions * (order + 1);
    let size = m * (dimensions - 1) * n;
    threads.over(out, size, 10.0 * size as f64, |trial, out| {
        let one = Trial {
            times: times.get(trial),
            observer: observer.get(trial),
            target: match target {
                Motion::State(state) => Motion::State(Items::shared(state.get(trial))),
                Motion::Positions(places) => Motion::Positions(Items::shared(places.get(trial))),
            },
            sigma: sigma.get(trial),
        };
        let rows = if dimensions == 3 {
            one.space(n, out)
        } else {
            one.plane(n, out)
        };
        rows.map_err(|error| (trial, error))
    })
}

struct Trial<'a> {
    times: &'a [f64],
    observer: &'a [f64],
    target: Motion<'a>,
    sigma: &'a [f64],
}

impl Trial<'_> {
    fn plane(&self, n: usize, out: &mut [f64]) -> Result<(), Error> {
        for (i, row) in out.chunks_exact_mut(n).enumerate() {
            let sigma = self.sigma[if self.sigma.len() == 1 { 0 } else { i }];
            bearings::motion_row(self.time(i), self.offset(i), sigma, row)
                .map_err(|error| error.at(i))?;
        }
        Ok(())
    }

    fn space(&self, n: usize, out: &mut [f64]) -> Result<(), Error> {
        let each = self.sigma.len() / 2;
        for (i, rows) in out.chunks_exact_mut(2 * n).enumerate() {
            let at = if each == 1 { 0 } else { i };
            let sigma = [self.sigma[at], self.sigma[each + at]];
            let (azimuth, elevation) = rows.split_at_mut(n);
            let offset = self.offset(i);
            bearings::azimuth_elevation_rows(self.time(i), offset, sigma, azimuth, elevation)
                .map_err(|error| error.at(i))?;
        }
        Ok(())
    }

    fn time(&self, i: usize) -> f64 {
        self.times[i] - self.times[0]
    }

    fn offset<const D: usize>(&self, i: usize) -> [f64; D] {
        let place = match self.target {
            Motion::State(state) => bearings::moved_along::<f64, D>(state.get(0), self.time(i)),
            Motion::Positions(places) => core::array::from_fn(|k| places.get(0)[i * D + k]),
        };
        core::array::from_fn(|k| place[k] - self.observer[i * D + k])
    }
}
