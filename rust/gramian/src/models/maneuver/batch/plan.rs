//! Paths of laws that keep to limits.

use crate::maneuver::steer::{Limits, follow};
use crate::maneuver::{Law, Side, heading};
use crate::scalar::hypot;

/// What a path that is made step by step starts from and keeps to.
#[derive(Clone, Copy, Debug)]
pub struct Course<'a> {
    /// Where it starts.
    pub start: [f64; 2],
    /// Time of one step.
    pub dt: f64,
    /// Length of each step.
    pub lengths: &'a [f64],
    /// The heading before the start, if a turn from it counts.
    pub first: Option<f64>,
    /// The limits.
    pub limits: Limits<'a, f64>,
}

/// Makes the path of a law that keeps the limits of a course, with the true bearing and
/// range of `aim` (x0, y0, vx, vy): `out` has its headings and the number of steps that
/// broke a limit since no heading kept it.
pub fn steered(course: &Course<'_>, law: Law, side: Side, aim: [f64; 4], out: &mut [f64]) {
    let steps = course.lengths.len().min(out.len().saturating_sub(1));
    let Course {
        start,
        dt,
        lengths,
        first,
        ref limits,
    } = *course;
    let (headings, broken) = out.split_at_mut(steps);
    let wanted = |place: &crate::maneuver::steer::Place<f64>| {
        let point = crate::bearings::moved(&aim, place.time);
        let range = hypot(point[0] - place.at[0], point[1] - place.at[1]);
        let bearing = crate::bearings::sight(place.at, point);
        by_law(law, side, bearing, range, lengths[place.step])
    };
    let count = follow(start, dt, lengths, first, limits, wanted, headings);
    if let Some(broken) = broken.first_mut() {
        *broken = count as f64;
    }
}

/// A law's heading; perpendicular where the law has none.
pub(in crate::models::maneuver) fn by_law(
    law: Law,
    side: Side,
    bearing: f64,
    range: f64,
    length: f64,
) -> f64 {
    heading(bearing, range, length, law, side)
        .unwrap_or(bearing + side.sign::<f64>() * core::f64::consts::FRAC_PI_2)
}
