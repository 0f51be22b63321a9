//! Headings of the closed-form laws, trial by trial.

use crate::batch::{Items, Threads};
use crate::maneuver::{Error, Law, Side, heading};

/// The side of a number: its sign.
pub(super) fn side(value: f64) -> Side {
    if value < 0.0 { Side::Left } else { Side::Right }
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
