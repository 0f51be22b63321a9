//! Where to steer an observer that locates a fixed target by its bearings.
//!
//! An observer moves in legs of length `step` = speed times interval and takes a
//! bearing at every end. A law gives the heading of the next leg from bearing
//! and range alone, without a horizon: see [`Law`]. All are greedy. Over a
//! horizon a planned path gives several times the determinant.
//!
//! # Source
//! Xu, Sheng, Chen & Tan 2009, "Optimal maneuver trajectories of the observer
//! platform in passive localization system".

#[cfg(feature = "std")]
pub mod batch;
pub mod plan;
#[cfg(feature = "std")]
pub mod planner;
#[cfg(any(feature = "std", test))]
mod sides;
pub mod steer;
mod two_legs;

pub use two_legs::{TwoLegGoal, TwoLegTerms, TwoLegs, best_two_legs, two_leg_terms};

#[cfg(any(feature = "std", test))]
pub use sides::best_sides;

use crate::bearings::gradient;
use crate::numbers::algebra::advanced;
use crate::numbers::lane::Lane;
use crate::scalar::{NumberError, Real, check_finite, finite, hypot, wrapped};
use crate::square_root::SquareRootInformation;

/// A closed-form law of heading.
///
/// With alpha = atan(step / range), and the heading counted from the line of
/// sight:
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Law {
    /// pi/2 - 2 alpha: the largest determinant that two bearings, one at each end
    /// of the leg, can have (Theorem 1). Needs step <= range.
    MaxDet,
    /// pi/2 - 1.5 alpha: for small steps, the largest integral of the bearing
    /// rate over the range (Hammel, Liu, Hilliard & Gong 1989). The paper does
    /// not print it; this form gives all of its figures. Needs step <= range.
    HammelLiu,
    /// acos(step / range): perpendicular to the line of sight at the *end* of the
    /// leg, which is tangent to the circle about the target through that end. No
    /// other heading changes the bearing more over the leg (Theorem 5, eq. 22 with
    /// the text before it). The range falls: r'^2 = range^2 - step^2. Needs
    /// step <= range.
    BearingRate,
    /// acos(step / (2 range)): a chord of the circle about the target, so that the
    /// range stays. The circle of Theorem 6 is what [`Law::BearingRate`] flies in the
    /// limit of small steps; on a discrete path the two differ. Needs step <= 2 range.
    Circle,
    /// pi/2: perpendicular to the line of sight at the start of the leg. On a
    /// discrete path this spirals outward.
    Perpendicular,
}

impl Law {
    /// Cosine and sine of the angle between heading and line of sight.
    ///
    /// # Errors
    /// [`Error::Step`] and [`Error::Range`] where they are not positive and
    /// finite, [`Error::TooLong`] where the law does not reach.
    #[inline]
    pub fn turn<T: Real>(self, range: T, step: T) -> Result<(T, T), Error> {
        check(range, step)?;
        if self.reach(range).is_some_and(|reach| step > reach) {
            return Err(Error::TooLong {
                index: 0,
                step: step.double(),
                range: range.double(),
                law: self,
            });
        }
        // The ratio, so that no unit overflows.
        Ok(self.turn_of(step / range))
    }

    /// The longest step that has a heading at this range; `None` where any has.
    #[inline(always)]
    pub(crate) fn reach<L: Lane>(self, range: L) -> Option<L> {
        match self {
            Self::MaxDet | Self::HammelLiu | Self::BearingRate => Some(range),
            Self::Circle => Some(range + range),
            Self::Perpendicular => None,
        }
    }

    /// [`turn`](Self::turn) of the ratio of step to range, where the law reaches.
    #[inline(always)]
    pub(crate) fn turn_of<L: Lane>(self, ratio: L) -> (L, L) {
        let one = ratio.splat(1.0);
        match self {
            // cos(pi/2 - 2 alpha) = sin 2 alpha, by the tangent of alpha.
            Self::MaxDet => {
                let inverse = ratio.mul_add(ratio, one).recip();
                (
                    ratio.times(2.0) * inverse,
                    (one - ratio) * (one + ratio) * inverse,
                )
            }
            Self::HammelLiu => {
                let cos = ratio.mul_add(ratio, one).sqrt().recip();
                let sin = ratio * cos;
                let half = ratio.splat(0.5);
                let half_cos = cos.mul_add(half, half).sqrt();
                let half_sin = sin.times(0.5) / half_cos;
                (
                    sin.mul_add(half_cos, cos * half_sin),
                    cos.mul_add(half_cos, -(sin * half_sin)),
                )
            }
            Self::BearingRate => with_sine(ratio),
            Self::Circle => with_sine(ratio.times(0.5)),
            Self::Perpendicular => (ratio.splat(0.0), one),
        }
    }
}

/// To which side of the line of sight the observer turns.
///
/// Over two legs, keeping the side is better than changing it (Theorem 2). Over more
/// legs it need not be: with step / range = 0.2 and ten legs of [`Law::MaxDet`] the sides
/// `++--++-+++` give 1.257 times the determinant of one side; with 0.02 and 160 legs one
/// change after leg 17 gives 1.0015 times. `best_sides` searches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Side {
    /// Clockwise of the line of sight: the right branch, eq. (15).
    #[default]
    Right,
    /// Anticlockwise: the left branch, eq. (16).
    Left,
}

impl Side {
    /// 1 for right, -1 for left.
    #[inline]
    pub fn sign<T: Real>(self) -> T {
        match self {
            Self::Right => T::one(),
            Self::Left => -T::one(),
        }
    }
}

/// The heading of the next leg, in (-pi, pi], clockwise from north.
///
/// # Units
/// rad, m.
///
/// # Errors
/// As [`Law::turn`]; [`Error::Number`] for a bearing that is not finite.
///
/// # Source
/// Xu et al. 2009, eqs. (12) and (22); see [`Law`].
///
/// ```
/// use gramian::maneuver::{Law, Side, heading};
/// let right = heading(0.0, 1000.0, 20.0, Law::MaxDet, Side::Right).unwrap();
/// let alpha = (20.0_f64 / 1000.0).atan();
/// assert!((right - (core::f64::consts::FRAC_PI_2 - 2.0 * alpha)).abs() < 1e-15);
/// ```
#[inline]
pub fn heading<T: Real>(bearing: T, range: T, step: T, law: Law, side: Side) -> Result<T, Error> {
    check_finite("bearing", &[bearing])?;
    let (cos, sin) = law.turn(range, step)?;
    Ok(wrapped(bearing + side.sign::<T>() * sin.atan2(cos)))
}

/// The range after a leg at `cos` of the angle off the line of sight.
#[inline(always)]
pub(crate) fn next_range<L: Lane>(range: L, step: L, cos: L) -> L {
    // (range - step)^2 and what is left, so that nothing cancels near zero.
    let near = range - step;
    let rest = (range * step).times(2.0) * (cos.splat(1.0) - cos);
    near.mul_add(near, rest).sqrt()
}

/// A cosine with the sine of an angle in [0, pi].
#[inline(always)]
fn with_sine<L: Lane>(cos: L) -> (L, L) {
    let one = cos.splat(1.0);
    (cos, ((one - cos) * (one + cos)).sqrt())
}

/// Cosine and sine of the turn that ends a leg at range `to`.
#[inline(always)]
pub(crate) fn turn_to<L: Lane>(range: L, step: L, to: L) -> (L, L) {
    let inverse = range.recip();
    let fall = (range - to) / step * ((range + to) * inverse);
    let cos = step.mul_add(inverse, fall).times(0.5);
    let one = cos.splat(1.0);
    with_sine(cos.min(one).max(-one))
}

/// A unit vector turned clockwise.
#[inline(always)]
pub(crate) fn turned<L: Lane>([u, v]: [L; 2], (cos, sin): (L, L)) -> [L; 2] {
    [u.mul_add(cos, v * sin), v.mul_add(cos, -(u * sin))]
}

/// What to do where the next leg of a law would end inside the stand-off range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum AtStandoff {
    /// Stop: the path ends at the last sample outside.
    #[default]
    Stop,
    /// Fly the leg that ends exactly at the stand-off range instead, to the same
    /// side: the law as far as the constraint lets it.
    Circle,
}

/// A law with what it needs to make a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steering<T> {
    /// The law.
    pub law: Law,
    /// The side.
    pub side: Side,
    /// Length of a leg, m.
    pub step: T,
    /// The range that must not be gone below, m; 0 for none.
    pub standoff: T,
    /// What to do there.
    pub at_standoff: AtStandoff,
}

/// One leg of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg<T> {
    /// East and north component of the unit vector along the heading.
    pub direction: [T; 2],
    /// The position at the end, m.
    pub end: [T; 2],
}

impl<T: Real> Steering<T> {
    /// The next leg from `position`; `None` where the path stops at the
    /// stand-off range.
    ///
    /// # Errors
    /// [`Error::OnTarget`] where there is no line of sight, [`Error::Inside`] for
    /// a position inside the stand-off range, [`Error::Number`] for what is not
    /// finite or a stand-off range below zero; otherwise as [`Law::turn`].
    ///
    /// # Source
    /// Xu et al. 2009, eqs. (15) and (16) for [`Law::MaxDet`].
    pub fn leg(&self, position: [T; 2], target: [T; 2]) -> Result<Option<Leg<T>>, Error> {
        check_finite("position", &position)?;
        check_finite("target", &target)?;
        check_standoff(self.standoff)?;
        let Some(leg) = self.unchecked_leg(position, target)? else {
            return Ok(None);
        };
        finite("direction", leg.direction)?;
        finite("end", leg.end)?;
        Ok(Some(leg))
    }

    /// [`leg`](Self::leg) between finite places, not checked on the way out.
    #[inline]
    pub(crate) fn unchecked_leg(
        &self,
        position: [T; 2],
        target: [T; 2],
    ) -> Result<Option<Leg<T>>, Error> {
        let (east, north) = (target[0] - position[0], target[1] - position[1]);
        let range = hypot(east, north);
        if !(range > T::zero()) {
            return Err(Error::OnTarget { index: 0 });
        }
        // Half the digits: a leg that ends at the stand-off range is not inside.
        if range < self.standoff * (T::one() - T::EPSILON.sqrt()) {
            return Err(Error::Inside {
                index: 0,
                range: range.double(),
                standoff: self.standoff.double(),
            });
        }
        let (mut cos, mut sin) = self.law.turn(range, self.step)?;
        if next_range(range, self.step, cos) < self.standoff {
            match self.at_standoff {
                AtStandoff::Stop => return Ok(None),
                AtStandoff::Circle => {
                    (cos, sin) = turn_to(range, self.step, self.standoff);
                }
            }
        }
        let sin = self.side.sign::<T>() * sin;
        let direction = turned([east / range, north / range], (cos, sin));
        let end = advanced(&position, &direction, self.step);
        Ok(Some(Leg { direction, end }))
    }
}

/// The whitened row of a bearing of a fixed target, by its position.
///
/// Pushed into [`Information<T, 2>`](crate::information::Information) or
/// [`SquareRootInformation<T, 2>`] it is the running information of a path.
///
/// # Errors
/// [`Error::OnTarget`], [`Error::Sigma`], [`Error::Number`].
///
/// # Source
/// Xu et al. 2009, eq. (9).
#[inline]
pub fn row<T: Real>(east: T, north: T, sigma: T) -> Result<[T; 2], Error> {
    check_finite("east", &[east])?;
    check_finite("north", &[north])?;
    Ok(finite("row", unchecked_row(east, north, sigma)?)?)
}

/// [`row`] of finite numbers, not checked on the way out.
#[inline]
pub(crate) fn unchecked_row<T: Real>(east: T, north: T, sigma: T) -> Result<[T; 2], Error> {
    if east == T::zero() && north == T::zero() {
        return Err(Error::OnTarget { index: 0 });
    }
    if !(sigma > T::zero() && sigma.is_finite()) {
        return Err(Error::Sigma {
            index: 0,
            given: sigma.double(),
        });
    }
    Ok(gradient([east, north], sigma))
}

/// One choice among several headings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice<T> {
    /// Which one.
    pub index: usize,
    /// The heading, rad.
    pub heading: T,
    /// The determinant of the information after that leg; infinite or 0 where it
    /// overflows, though the choice holds.
    pub determinant: T,
}

/// The heading, of those given, whose leg ends where the next bearing makes the
/// determinant of the information largest; `None` where every one ends inside
/// the stand-off range (or none was given).
///
/// `information` holds the bearings so far, that of the present position
/// included; without any the first two bearings are compared, as the laws do.
///
/// # Errors
/// As [`row`], and [`Error::Step`]; [`Error::Number`] also for a stand-off range
/// below zero, or where the information overflows.
///
/// ```
/// use gramian::{maneuver, square_root::SquareRootInformation};
/// let mut information = SquareRootInformation::<f32, 2>::new();
/// information.push(&maneuver::row(0.0, 1000.0, 0.01).unwrap()).unwrap();
/// let headings = [0.0, 0.5, 1.0, 1.5];
/// let best = maneuver::best_heading(
///     &information, [0.0, 0.0], [0.0, 1000.0], 20.0, 0.01, 0.0, &headings,
/// );
/// assert_eq!(best.unwrap().unwrap().index, 3);
/// ```
pub fn best_heading<T: Real>(
    information: &SquareRootInformation<T, 2>,
    position: [T; 2],
    target: [T; 2],
    step: T,
    sigma: T,
    standoff: T,
    headings: &[T],
) -> Result<Option<Choice<T>>, Error> {
    if !(step > T::zero() && step.is_finite()) {
        return Err(Error::Step {
            given: step.double(),
        });
    }
    check_finite("position", &position)?;
    check_finite("target", &target)?;
    check_finite("headings", headings)?;
    check_standoff(standoff)?;
    let mut start = *information;
    if start.count() == 0 {
        start.absorb(&row(
            target[0] - position[0],
            target[1] - position[1],
            sigma,
        )?);
    }
    let mut best: Option<(T, Choice<T>)> = None;
    for (index, &heading) in headings.iter().enumerate() {
        let (sin, cos) = heading.sin_cos();
        let east = target[0] - position[0] - step * sin;
        let north = target[1] - position[1] - step * cos;
        let range = hypot(east, north);
        if range < standoff || range == T::zero() {
            continue;
        }
        let mut root = start;
        root.absorb(&row(east, north, sigma)?);
        // The root overflows last.
        let size = root.sound()?.root_determinant();
        if best.is_none_or(|(largest, _)| size > largest) {
            let choice = Choice {
                index,
                heading,
                determinant: size * size,
            };
            best = Some((size, choice));
        }
    }
    Ok(best.map(|(_, choice)| choice))
}

fn check_standoff<T: Real>(standoff: T) -> Result<(), NumberError> {
    if standoff >= T::zero() && standoff.is_finite() {
        return Ok(());
    }
    Err(NumberError::OutOfRange {
        name: "standoff",
        given: standoff.double(),
        allowed: ">= 0 and finite",
    })
}

#[inline]
fn check<T: Real>(range: T, step: T) -> Result<(), Error> {
    if !(step > T::zero() && step.is_finite()) {
        return Err(Error::Step {
            given: step.double(),
        });
    }
    if !(range > T::zero() && range.is_finite()) {
        return Err(Error::Range {
            given: range.double(),
        });
    }
    Ok(())
}

/// What can be wrong with the input of this module.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// The observer is on the target: no bearing exists.
    #[error("position {index} is the target's: a bearing needs a range > 0")]
    OnTarget {
        /// Which sample.
        index: usize,
    },
    /// A range that is not positive and finite.
    #[error("range = {given} m: must be > 0 and finite")]
    Range {
        /// The value given.
        given: f64,
    },
    /// A step that is not positive and finite.
    #[error("step = {given} m: must be > 0 and finite")]
    Step {
        /// The value given.
        given: f64,
    },
    /// A standard deviation that is not positive and finite.
    #[error("sigma[{index}] = {given} rad: must be > 0 and finite")]
    Sigma {
        /// Which sample.
        index: usize,
        /// The value given.
        given: f64,
    },
    /// A step longer than the law can use at this range.
    #[error(
        "sample {index}: the step, {step} m, is longer than {}, {range} m, where law {law} has no \
         heading; a stand-off range of a step or more keeps clear of that",
        longest(*.law)
    )]
    TooLong {
        /// Which sample.
        index: usize,
        /// The step.
        step: f64,
        /// The range there.
        range: f64,
        /// The law.
        law: Law,
    },
    /// A position inside the stand-off range.
    #[error("position {index} is at range {range} m, inside the stand-off range {standoff} m")]
    Inside {
        /// Which sample.
        index: usize,
        /// The range there.
        range: f64,
        /// The stand-off range.
        standoff: f64,
    },
    /// A number that is not finite, or too large to go on with.
    #[error(transparent)]
    Number(#[from] NumberError),
}

impl Error {
    /// The same error at another sample.
    #[must_use]
    pub fn at(mut self, sample: usize) -> Self {
        match &mut self {
            Self::OnTarget { index }
            | Self::Sigma { index, .. }
            | Self::TooLong { index, .. }
            | Self::Inside { index, .. } => *index = sample,
            Self::Number(error) => *error = error.at(sample),
            Self::Range { .. } | Self::Step { .. } => {}
        }
        self
    }
}

fn longest(law: Law) -> &'static str {
    match law {
        Law::Circle => "twice the range",
        _ => "the range",
    }
}

impl core::fmt::Display for Law {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::MaxDet => "max_det",
            Self::HammelLiu => "hammel_liu",
            Self::BearingRate => "bearing_rate",
            Self::Circle => "circle",
            Self::Perpendicular => "perpendicular",
        })
    }
}
