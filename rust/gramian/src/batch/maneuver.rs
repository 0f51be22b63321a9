//! Headings and paths of the closed-form laws, trial by trial.

use super::{Items, Threads};
use crate::bearings;
use crate::maneuver::{AtStandoff, Error, Law, Side, Steering, heading, unchecked_row};
use crate::scalar::hypot;
use crate::square_root::SquareRootInformation;

/// The side of a number: its sign.
fn side(value: f64) -> Side {
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

/// What the paths of a batch start from.
#[derive(Clone, Copy, Debug)]
pub struct Paths<'a> {
    /// East and north of the target.
    pub target: Items<'a>,
    /// East and north of the observer at the first sample.
    pub start: Items<'a>,
    /// Length of a leg.
    pub step: Items<'a>,
    /// 1 for right, -1 for left.
    pub side: Items<'a>,
    /// Standard deviation of a bearing.
    pub sigma: Items<'a>,
    /// The range not to go below; 0 for none.
    pub standoff: Items<'a>,
    /// The law, the same for all.
    pub law: Law,
    /// What to do at the stand-off range.
    pub at_standoff: AtStandoff,
}

/// Numbers that [`trajectories`] gives for a path of `samples`: how many samples
/// were flown, positions (samples, 2), bearings, ranges, headings (samples - 1),
/// cumulative information (samples, 2, 2) and its determinant.
pub const fn path_size(samples: usize) -> usize {
    10 * samples
}

/// Paths of `samples` positions, the first at the start; see [`path_size`]. A
/// path that stops keeps its last position and measures no more.
///
/// # Errors
/// As [`Steering::leg`] and [`row`](crate::maneuver::row), with the trial and the sample.
pub fn trajectories(
    paths: Paths<'_>,
    samples: usize,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    if samples == 0 {
        return Ok(());
    }
    threads.over(
        out,
        path_size(samples),
        60.0 * samples as f64,
        |trial, out| one_path(&paths, trial, samples, out).map_err(|error| (trial, error)),
    )
}

fn one_path(paths: &Paths<'_>, trial: usize, n: usize, out: &mut [f64]) -> Result<(), Error> {
    let one = |items: Items<'_>| items.get(trial)[0];
    let steering = Steering {
        law: paths.law,
        side: side(one(paths.side)),
        step: one(paths.step),
        standoff: one(paths.standoff),
        at_standoff: paths.at_standoff,
    };
    let (target, sigma) = (paths.target.get(trial), one(paths.sigma));
    let target = [target[0], target[1]];
    let mut position = [paths.start.get(trial)[0], paths.start.get(trial)[1]];
    let (count, out) = out.split_at_mut(1);
    let (positions, out) = out.split_at_mut(2 * n);
    let (bearings, out) = out.split_at_mut(n);
    let (ranges, out) = out.split_at_mut(n);
    let (headings, out) = out.split_at_mut(n - 1);
    let (information, determinants) = out.split_at_mut(4 * n);
    let mut root = SquareRootInformation::<f64, 2>::new();
    let mut flown = n;
    for k in 0..n {
        let (east, north) = (target[0] - position[0], target[1] - position[1]);
        positions[2 * k..2 * k + 2].copy_from_slice(&position);
        bearings[k] = bearings::sight(position, target);
        ranges[k] = hypot(east, north);
        if k < flown {
            root.absorb(&unchecked_row(east, north, sigma).map_err(|error| error.at(k))?);
        }
        let r = root.factor();
        let xy = r[0][0] * r[0][1];
        let yy = r[0][1] * r[0][1] + r[1][1] * r[1][1];
        information[4 * k..4 * k + 4].copy_from_slice(&[r[0][0] * r[0][0], xy, xy, yy]);
        determinants[k] = root.determinant();
        if k + 1 < n {
            let leg = if k < flown {
                steering
                    .unchecked_leg(position, target)
                    .map_err(|error| error.at(k))?
            } else {
                None
            };
            if let Some(leg) = leg {
                position = leg.end;
                headings[k] = leg.direction[0].atan2(leg.direction[1]);
            } else {
                flown = flown.min(k + 1);
                headings[k] = if k > 0 { headings[k - 1] } else { bearings[0] };
            }
        }
    }
    count[0] = flown as f64;
    Ok(())
}
