//! What surrounds the rows of one track: how accurate they are, and the directions a
//! tracker asks about (range, bearing, elevation, speed, course) at the first time.

use std::vec::Vec;

use super::motion::moved_along;

/// Where a target is, D coordinates.
#[derive(Clone, Copy, Debug)]
pub enum Whereabouts<'a> {
    /// Derivatives at the first time, D numbers for each order.
    State(&'a [f64]),
    /// A position for each time.
    Positions(&'a [f64]),
}

/// What [`frame`] finds.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame<const D: usize> {
    /// Rounding of the offset at each time, relative to the range.
    pub accuracy: Vec<f64>,
    /// d range / d position.
    pub range: [f64; D],
    /// d bearing / d position, rad/m.
    pub bearing: [f64; D],
    /// d elevation / d position, rad/m, in space.
    pub elevation: Option<[f64; D]>,
    /// d speed / d velocity, for a target that moves.
    pub speed: Option<[f64; D]>,
    /// d course / d velocity, rad s/m, for a target that moves horizontally.
    pub course: Option<[f64; D]>,
    /// The range at the first time, m.
    pub reach: f64,
    /// From the first time to the last, s.
    pub span: f64,
}

impl<const D: usize> Frame<D> {
    /// What the deviation of a position (`power` 0), a velocity (1), an acceleration (2) ..
    /// must stay below to be of any use: the range, over powers of the time. `None` where
    /// that is no number: a velocity where all times are one.
    pub fn scale(&self, power: i32) -> Option<f64> {
        let scale = self.reach / self.span.powi(power);
        (scale > 0.0 && scale.is_finite()).then_some(scale)
    }
}

/// The frame of one track in the plane (D = 2) or in space (D = 3). Inputs are those of
/// rows that were found without error: at least one time, no range of 0.
///
/// ```
/// use gramian::bearings::{Whereabouts, frame};
/// let state = Whereabouts::State(&[0.0, 1000.0, 3.0, 0.0]);
/// let frame = frame::<2>(&[0.0, 10.0], &[0.0, 0.0, 0.0, 50.0], state);
/// assert_eq!(frame.range, [0.0, 1.0]);
/// assert_eq!(frame.bearing, [1e-3, 0.0]);
/// assert_eq!(frame.speed, Some([1.0, 0.0]));
/// assert_eq!((frame.scale(0), frame.scale(1)), (Some(1000.0), Some(100.0)));
/// ```
pub fn frame<const D: usize>(times: &[f64], observer: &[f64], target: Whereabouts<'_>) -> Frame<D> {
    let (path, _) = observer.as_chunks::<D>();
    let start = times.first().copied().unwrap_or(0.0);
    let positions: Vec<[f64; D]> = match target {
        Whereabouts::State(state) => times
            .iter()
            .map(|time| moved_along(state, time - start))
            .collect(),
        Whereabouts::Positions(positions) => positions.as_chunks::<D>().0.to_vec(),
    };
    let offsets: Vec<[f64; D]> = positions
        .iter()
        .zip(path)
        .map(|(place, own)| minus(place, own))
        .collect();
    let first = offsets.first().copied().unwrap_or([0.0; D]);
    // Offsets between large coordinates carry the rounding of those coordinates,
    // and those at times counted from long ago the rounding of the times.
    let span = times.last().copied().unwrap_or(start) - start;
    let late = if span > 0.0 {
        let change = offsets
            .iter()
            .map(|offset| norm(&minus(offset, &first)))
            .fold(0.0, f64::max);
        let far = times.iter().fold(0.0_f64, |far, time| far.max(time.abs()));
        change / span * far
    } else {
        0.0
    };
    let accuracy = offsets
        .iter()
        .zip(positions.iter().zip(path))
        .map(|(offset, (place, own))| {
            let size = (0..D).fold(0.0_f64, |size, i| {
                let from = match target {
                    Whereabouts::State(state) => state[i].abs(),
                    Whereabouts::Positions(_) => 0.0,
                };
                size.max(place[i].abs() + own[i].abs() + from)
            });
            8.0 * f64::EPSILON * (size + late) / norm(offset)
        })
        .collect();
    let distance = norm(&first);
    let level = first[0].hypot(first[1]);
    let (east, north) = (first[0] / level, first[1] / level);
    let mut bearing = [0.0; D];
    (bearing[0], bearing[1]) = (north / level, -east / level);
    let elevation = (D > 2).then(|| {
        let up = first[D - 1] / distance;
        let mut elevation = [0.0; D];
        (elevation[0], elevation[1]) = (-up * east / distance, -up * north / distance);
        elevation[D - 1] = level / distance / distance;
        elevation
    });
    let velocity = match target {
        Whereabouts::State(state) => {
            let mut velocity = [0.0; D];
            for (v, x) in velocity.iter_mut().zip(state.iter().skip(D)) {
                *v = *x;
            }
            velocity
        }
        Whereabouts::Positions(_) => slope(times, &positions),
    };
    let (speed, along) = (norm(&velocity), velocity[0].hypot(velocity[1]));
    let mut course = [0.0; D];
    (course[0], course[1]) = (velocity[1] / along / along, -velocity[0] / along / along);
    Frame {
        accuracy,
        range: first.map(|x| x / distance),
        bearing,
        elevation,
        speed: (speed > 0.0).then(|| velocity.map(|v| v / speed)),
        course: (along > 0.0).then_some(course),
        reach: distance,
        span,
    }
}

fn minus<const D: usize>(a: &[f64; D], b: &[f64; D]) -> [f64; D] {
    core::array::from_fn(|i| a[i] - b[i])
}

fn norm<const D: usize>(x: &[f64; D]) -> f64 {
    x.iter().fold(0.0, |norm: f64, x| norm.hypot(*x))
}

/// The velocity of the straight line that fits best.
fn slope<const D: usize>(times: &[f64], positions: &[[f64; D]]) -> [f64; D] {
    let count = times.len() as f64;
    let middle = times.iter().sum::<f64>() / count;
    let squares: f64 = times.iter().map(|t| (t - middle) * (t - middle)).sum();
    core::array::from_fn(|i| {
        let mean = positions.iter().map(|place| place[i]).sum::<f64>() / count;
        let sum: f64 = times
            .iter()
            .zip(positions)
            .map(|(t, place)| (t - middle) * (place[i] - mean))
            .sum();
        if squares > 0.0 { sum / squares } else { 0.0 }
    })
}
