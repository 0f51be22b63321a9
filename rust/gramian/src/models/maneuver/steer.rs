//! Headings that keep a path clear of circles and within its rate of turn.

use super::check_standoff;
use crate::bearings;
use crate::scalar::{NumberError, Real, check_finite, hypot, wrapped};

/// A disc that must not be entered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Circle<T> {
    /// Its centre (east, north).
    pub center: [T; 2],
    /// Its radius.
    pub radius: T,
    /// What must stay outside.
    pub part: Part,
}

/// The part of a step that must stay outside a circle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// Its end, where the next bearing is taken.
    End,
    /// All of it.
    Whole,
}

/// What bounds a path.
#[derive(Clone, Copy, Debug)]
pub struct Limits<'a, T> {
    /// Bearings are taken no closer than this to any of `targets`.
    pub standoff: T,
    /// (x0, y0, vx, vy) at the start of the path.
    pub targets: &'a [[T; 4]],
    /// Discs (east, north, radius) that the whole path stays out of.
    pub keep_out: &'a [[T; 3]],
    /// The largest change of heading from one step to the next; infinite for none.
    pub max_turn: T,
}

impl<T: Real> Limits<'_, T> {
    fn check(&self) -> Result<(), NumberError> {
        check_standoff(self.standoff)?;
        check_finite("targets", self.targets.as_flattened())?;
        check_finite("keep_out", self.keep_out.as_flattened())?;
        not_below_zero("max_turn", self.max_turn, true)
    }

    /// Number of circles.
    fn len(&self) -> usize {
        self.targets.len() + self.keep_out.len()
    }

    /// One of the circles as it is at the end of a step, at `time`.
    fn circle(&self, index: usize, time: T) -> Circle<T> {
        if index < self.targets.len() {
            Circle {
                center: bearings::moved(&self.targets[index], time),
                radius: self.standoff,
                part: Part::End,
            }
        } else {
            let [x, y, radius] = self.keep_out[index - self.targets.len()];
            Circle {
                center: [x, y],
                radius,
                part: Part::Whole,
            }
        }
    }
}

fn not_below_zero<T: Real>(name: &'static str, value: T, endless: bool) -> Result<(), NumberError> {
    if value >= T::zero() && (endless || value.is_finite()) {
        return Ok(());
    }
    Err(NumberError::OutOfRange {
        name,
        given: value.double(),
        allowed: if endless { ">= 0" } else { ">= 0 and finite" },
    })
}

/// The heading that leads straight away from the circle whose edge is nearest:
/// what is left where no heading keeps the limits. `None` without circles.
///
/// # Errors
/// [`NumberError`] for what is not finite, or limits below zero.
pub fn escape<T: Real>(
    at: [T; 2],
    time: T,
    limits: &Limits<'_, T>,
) -> Result<Option<T>, NumberError> {
    check_finite("at", &at)?;
    check_finite("time", &[time])?;
    limits.check()?;
    Ok(way_out(at, time, limits))
}

/// [`escape`] without a check.
pub(crate) fn way_out<T: Real>(at: [T; 2], time: T, limits: &Limits<'_, T>) -> Option<T> {
    let mut nearest: Option<(T, T)> = None;
    for i in 0..limits.len() {
        let circle = limits.circle(i, time);
        let (x, y) = (circle.center[0] - at[0], circle.center[1] - at[1]);
        let distance = hypot(x, y) - circle.radius;
        if nearest.is_none_or(|(least, _)| distance < least) {
            nearest = Some((distance, (-x).atan2(-y)));
        }
    }
    nearest.map(|(_, heading)| heading)
}

/// The middle and half the width of the headings that a circle forbids to a
/// step of `length` from `at`; the half width is zero where it forbids none.
pub(crate) fn forbidden<T: Real>(at: [T; 2], length: T, circle: &Circle<T>) -> (T, T) {
    let (x, y) = (circle.center[0] - at[0], circle.center[1] - at[1]);
    let (d, s, r) = (hypot(x, y), length, circle.radius);
    if !(r > T::zero()) || d >= s + r {
        // No heading: no middle either.
        return (T::zero(), if d.is_finite() { T::zero() } else { d });
    }
    let middle = x.atan2(y);
    // Beyond the point where a tangent touches, a step that crosses the circle
    // has its end outside again.
    let touch_squared = (d - r) * (d + r);
    if circle.part == Part::Whole && s * s >= touch_squared {
        let ratio = if d > r { r / d } else { T::one() };
        return (middle, ratio.asin());
    }
    let two = T::one() + T::one();
    let cosine = if d > T::zero() {
        ((d - r) * (d + r) + s * s) / (two * d * s)
    } else if s >= r {
        T::one()
    } else {
        -T::one()
    };
    (middle, cosine.clamp(-T::one(), T::one()).acos())
}

/// The heading nearest to `wanted` for a step of `length` from `at` that ends at
/// `time`, turned from the heading `before` if there is one; `None` where no
/// heading keeps the limits.
///
/// Ties go clockwise.
///
/// # Units
/// m, s, rad; headings clockwise from north. The result is `wanted` or the next
/// that is allowed, not wrapped.
///
/// # Errors
/// [`NumberError`] for what is not finite, limits or a length below zero, and circles
/// whose distance overflows.
///
/// # Source
/// Tangents to circles, ours.
///
/// ```
/// use gramian::maneuver::steer::{Limits, steer};
/// let limits = Limits {
///     standoff: 0.0,
///     targets: &[],
///     keep_out: &[[0.0, 10.0, 2.0]],
///     max_turn: f64::INFINITY,
/// };
/// // Straight on there is a disc: turned aside, clockwise.
/// let heading = steer([0.0, 0.0], 1.0, 20.0, 0.0, None, &limits).unwrap();
/// assert!((heading.unwrap() - 0.2_f64.asin()).abs() < 1e-12);
/// ```
pub fn steer<T: Real>(
    at: [T; 2],
    time: T,
    length: T,
    wanted: T,
    before: Option<T>,
    limits: &Limits<'_, T>,
) -> Result<Option<T>, NumberError> {
    check_finite("at", &at)?;
    for (name, value) in [("time", time), ("wanted", wanted)] {
        check_finite(name, &[value])?;
    }
    check_finite("before", before.as_slice())?;
    not_below_zero("length", length, false)?;
    limits.check()?;
    for i in 0..limits.len() {
        let (middle, half) = forbidden(at, length, &limits.circle(i, time));
        if !(middle.is_finite() && half.is_finite()) {
            return Err(NumberError::Overflow {
                result: "distance of a circle",
            });
        }
    }
    Ok(aside(at, time, length, wanted, before, limits))
}

/// [`steer`] without a check.
pub(crate) fn aside<T: Real>(
    at: [T; 2],
    time: T,
    length: T,
    wanted: T,
    before: Option<T>,
    limits: &Limits<'_, T>,
) -> Option<T> {
    // Headings are compared with a margin of rounding, and ends of intervals are
    // taken with twice that margin.
    let margin = T::EPSILON * T::of(16.0);
    let clear = |heading: T| {
        let turned =
            before.is_none_or(|before| wrapped(heading - before).abs() <= limits.max_turn + margin);
        turned
            && (0..limits.len()).all(|i| {
                let (middle, half) = forbidden(at, length, &limits.circle(i, time));
                half == T::zero() || wrapped(heading - middle).abs() >= half + margin
            })
    };
    let mut best: Option<(T, T)> = None;
    let mut offer = |heading: T| {
        let off = wrapped(heading - wanted).abs();
        if best.is_none_or(|(least, _)| off < least) && clear(heading) {
            best = Some((off, heading));
        }
    };
    offer(wanted);
    if let Some(before) = before
        && limits.max_turn.is_finite()
    {
        offer(before + limits.max_turn);
        offer(before - limits.max_turn);
    }
    for i in 0..limits.len() {
        let (middle, half) = forbidden(at, length, &limits.circle(i, time));
        if half > T::zero() {
            let half = half + margin + margin;
            offer(middle + half);
            offer(middle - half);
        }
    }
    best.map(|(_, heading)| heading)
}

/// Where an observer is when it asks for its next heading.
#[cfg(any(feature = "std", test))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place<T> {
    /// The step that comes.
    pub step: usize,
    /// Where it is.
    pub at: [T; 2],
    /// Time since the start.
    pub time: T,
    /// The same at the end of the step that comes.
    pub ends: T,
    /// Whether the last heading was turned aside for a limit.
    pub deflected: bool,
}

/// Writes the headings of a path that goes as `wanted` asks, turned aside where
/// a limit wants it. Returns how many steps broke a limit because no heading
/// kept all: 0 for a path that keeps them.
#[cfg(any(feature = "std", test))]
pub(crate) fn follow<T: Real>(
    start: [T; 2],
    dt: T,
    lengths: &[T],
    first: Option<T>,
    limits: &Limits<'_, T>,
    mut wanted: impl FnMut(&Place<T>) -> T,
    headings: &mut [T],
) -> usize {
    let mut place = Place {
        step: 0,
        at: start,
        time: T::zero(),
        ends: dt,
        deflected: false,
    };
    let mut before = first;
    let mut broken = 0;
    for (step, (heading, &length)) in headings.iter_mut().zip(lengths).enumerate() {
        place.step = step;
        place.time = T::of(step as f64) * dt;
        let ends = T::of((step + 1) as f64) * dt;
        place.ends = ends;
        let asked = wanted(&place);
        let found = aside(place.at, ends, length, asked, before, limits);
        if found.is_none() {
            broken += 1;
        }
        let chosen = found.unwrap_or_else(|| {
            let away = way_out(place.at, ends, limits).unwrap_or(asked);
            within_turn(away, before, limits.max_turn)
        });
        place.deflected = chosen != asked;
        *heading = chosen;
        before = Some(chosen);
        let (sin, cos) = chosen.sin_cos();
        place.at = [place.at[0] + length * sin, place.at[1] + length * cos];
    }
    broken
}

/// The heading nearest to `wanted` that a turn from `before` reaches.
#[cfg(any(feature = "std", test))]
pub(crate) fn within_turn<T: Real>(wanted: T, before: Option<T>, max_turn: T) -> T {
    match before {
        Some(before) => before + wrapped(wanted - before).clamp(-max_turn, max_turn),
        None => wanted,
    }
}

/// A family of first guesses: straight on a heading that is `offset` to one side
/// of the bearing to a point, along the edge of what turns it aside from there
/// on, and after `turn_back` steps the same to the other side.
#[cfg(any(feature = "std", test))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arc<T> {
    /// Angle between the bearing and the heading, >= 0.
    pub offset: T,
    /// +1 with the target on the left, -1 on the right.
    pub side: T,
    /// The step at which the side changes.
    pub turn_back: usize,
}

#[cfg(any(feature = "std", test))]
impl<T: Real> Arc<T> {
    /// What the guess wants next: a function for [`follow`]. The point is at
    /// `aim` (x0, y0, vx, vy) and moves.
    pub(crate) fn wanted(self, aim: [T; 4]) -> impl FnMut(&Place<T>) -> T {
        let mut heading = None;
        let mut along = false;
        move |place| {
            let back = place.step >= self.turn_back;
            let side = if back { -self.side } else { self.side };
            if place.step == self.turn_back {
                heading = None;
            }
            along |= place.deflected;
            // A circle stands where its target is at the end of the step.
            let when = if along { place.ends } else { place.time };
            let bearing = bearings::sight(place.at, bearings::moved(&aim, when));
            if along {
                // Into the circle: the edge on this side of it is the nearest way.
                return bearing + side * T::of(1e-3);
            }
            *heading.get_or_insert(bearing + side * self.offset)
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn walk(start: [f64; 2], lengths: &[f64], headings: &[f64]) -> std::vec::Vec<[f64; 2]> {
        let mut at = start;
        let mut path = std::vec![at];
        for (&length, &heading) in lengths.iter().zip(headings) {
            at = [
                at[0] + length * heading.sin(),
                at[1] + length * heading.cos(),
            ];
            path.push(at);
        }
        path
    }

    #[test]
    fn a_path_keeps_its_stand_off_and_goes_round() {
        let limits = Limits {
            standoff: 500.0,
            targets: &[[0.0, 1000.0, 0.0, 0.0]],
            keep_out: &[],
            max_turn: f64::INFINITY,
        };
        let mut headings = [0.0; 99];
        let arc = Arc {
            offset: 0.1,
            side: 1.0,
            turn_back: 99,
        };
        let wanted = arc.wanted(limits.targets[0]);
        let lengths = [20.0; 99];
        let broken = follow(
            [0.0; 2],
            1.0,
            &lengths,
            None,
            &limits,
            wanted,
            &mut headings,
        );
        assert_eq!(broken, 0);
        let path = walk([0.0; 2], &lengths, &headings);
        let range = |p: &[f64; 2]| hypot(p[0], p[1] - 1000.0);
        assert!(path.iter().all(|p| range(p) >= 500.0 * (1.0 - 1e-13)));
        assert!(path[30..].iter().all(|p| range(p) < 500.0 + 1e-6));
        // Round on the chosen side.
        assert!(path[60][0] > 400.0);
    }

    #[test]
    fn a_step_does_not_jump_over_a_small_circle() {
        let limits = Limits {
            standoff: 0.0,
            targets: &[],
            keep_out: &[[0.0, 10.0, 2.0]],
            max_turn: f64::INFINITY,
        };
        let heading = steer([0.0; 2], 1.0, 20.0, 0.0, None, &limits)
            .unwrap()
            .unwrap();
        assert!((heading.abs() - 0.2_f64.asin()).abs() < 1e-12);
        // A step that ends short of it may point at it.
        assert_eq!(steer([0.0; 2], 1.0, 7.9, 0.0, None, &limits), Ok(Some(0.0)));
    }

    #[test]
    fn no_heading_where_the_turn_cannot_avoid_the_circle() {
        let limits = Limits {
            standoff: 0.0,
            targets: &[],
            keep_out: &[[0.0, 10.0, 5.0]],
            max_turn: 0.1,
        };
        assert_eq!(
            steer([0.0; 2], 1.0, 20.0, 0.0, Some(0.0), &limits),
            Ok(None)
        );
        let mut headings = [0.0; 2];
        let broken = follow(
            [0.0; 2],
            1.0,
            &[20.0; 2],
            Some(0.0),
            &limits,
            |_| 0.0,
            &mut headings,
        );
        assert_eq!(broken, 1);
    }
}
