//! Headings of the closed-form laws, trial by trial.

use crate::batch::{Items, Threads};
use crate::maneuver::{Error, Law, Side, best_sides, heading};

/// The side of a number: its sign.
pub(super) fn side(value: f64) -> Side {
    if value < 0.0 { Side::Left } else { Side::Right }
}

/// The sides of the legs of each trial's path: [`best_sides`] of its bearings and ranges
/// (`samples` of each), of which the first `count` were flown.
///
/// # Errors
/// None.
pub fn sides(
    bearings: Items<'_>,
    ranges: Items<'_>,
    count: Items<'_>,
    samples: usize,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let cost = (samples as f64).min(512.0).powi(2) * 10.0;
    threads.over(out, samples - 1, cost, |trial, out| {
        // A count of samples: whole, and at most the number of bearings.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let flown = (count.get(trial)[0] as usize).clamp(1, samples);
        best_sides(
            &bearings.get(trial)[..flown],
            &ranges.get(trial)[..flown],
            out,
        );
        Ok(())
    })
}

/// One heading for each trial.
///
/// # Errors
/// As [`heading`], with the trial.
pub fn headings(
    bearing: Items<'_>,
    range: Items<'_>,
    step: Items<'_>,
    sides: Items<'_>,
    law: Law,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    threads.over(out, 1, 50.0, |trial, out| {
        let one = |items: Items<'_>| items.get(trial)[0];
        out[0] = heading(one(bearing), one(range), one(step), law, side(one(sides)))
            .map_err(|error| (trial, error))?;
        Ok(())
    })
}
