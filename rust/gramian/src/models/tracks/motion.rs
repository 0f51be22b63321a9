//! How things move: place, velocity and acceleration at an instant, with their
//! derivatives by the states. In the plane (`D` = 2: east, north) or in space
//! (`D` = 3: and up).

use crate::numbers::lane::Lane;

/// Where something is and how it moves at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Instant<L, const D: usize> {
    /// East, north (and up), m.
    pub place: [L; D],
    /// m/s.
    pub velocity: [L; D],
    /// m/s^2.
    pub acceleration: [L; D],
}

/// The derivative of place and velocity by one state.
#[derive(Clone, Copy, Debug)]
pub struct Change<L, const D: usize> {
    /// Of the place.
    pub place: [L; D],
    /// Of the velocity.
    pub velocity: [L; D],
}

impl<L: Lane, const D: usize> Change<L, D> {
    /// No change, in lanes like those of `like`.
    #[inline(always)]
    pub fn zero(like: L) -> Self {
        let zero = like.splat(0.0);
        Self {
            place: [zero; D],
            velocity: [zero; D],
        }
    }
}

/// A motion in `D` dimensions.
///
/// The text of an implementation serves `f32`, `f64` and vectors of samples.
pub trait Motion<const D: usize> {
    /// How many states it has.
    fn states(&self) -> usize;

    /// The instant `u` seconds after the reference time, with the derivative by each
    /// state in the first entries of `changes`. `x` and `changes` have at least
    /// [`states`](Motion::states) entries.
    fn at<L: Lane>(&self, x: &[L], u: L, changes: &mut [Change<L, D>]) -> Instant<L, D>;

    /// The one component of place and velocity that a state changes; `None` where it may
    /// change several.
    #[inline(always)]
    fn component(&self, state: usize) -> Option<usize> {
        let _ = state;
        None
    }
}

/// The place is a polynomial in time: the states are place, velocity, acceleration ..,
/// each with `D` components.
///
/// ```
/// use gramian::tracks::motion::{Change, Motion, Polynomial};
/// let motion = Polynomial::CONSTANT_VELOCITY;
/// let mut changes = [Change::<f64, 2>::zero(0.0); 4];
/// let now = motion.at(&[10.0, 0.0, 1.0, -2.0], 3.0, &mut changes);
/// assert_eq!(now.place, [13.0, -6.0]);
/// assert_eq!(changes[2].place, [3.0, 0.0]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Polynomial {
    /// 0 at rest, 1 at constant velocity, 2 at constant acceleration ..
    pub order: usize,
}

impl Polynomial {
    /// At rest.
    pub const FIXED: Self = Self { order: 0 };
    /// At constant velocity.
    pub const CONSTANT_VELOCITY: Self = Self { order: 1 };
    /// At constant acceleration.
    pub const CONSTANT_ACCELERATION: Self = Self { order: 2 };
}

impl<const D: usize> Motion<D> for Polynomial {
    #[inline(always)]
    fn states(&self) -> usize {
        D * (self.order + 1)
    }

    #[inline(always)]
    fn at<L: Lane>(&self, x: &[L], u: L, changes: &mut [Change<L, D>]) -> Instant<L, D> {
        let zero = u.splat(0.0);
        let mut now = Instant {
            place: [zero; D],
            velocity: [zero; D],
            acceleration: [zero; D],
        };
        // u^k / k! and its first two derivatives.
        let (mut power, mut first, mut second) = (u.splat(1.0), zero, zero);
        for k in 0..=self.order {
            for axis in 0..D {
                let state = x[k * D + axis];
                now.place[axis] = state.mul_add(power, now.place[axis]);
                now.velocity[axis] = state.mul_add(first, now.velocity[axis]);
                now.acceleration[axis] = state.mul_add(second, now.acceleration[axis]);
                let change = &mut changes[k * D + axis];
                *change = Change::zero(u);
                change.place[axis] = power;
                change.velocity[axis] = first;
            }
            second = first;
            first = power;
            power = power * u * u.splat(1.0 / (k + 1) as f64);
        }
        now
    }

    #[inline(always)]
    fn component(&self, state: usize) -> Option<usize> {
        Some(state % D)
    }
}

/// The times of the turns of a motion in legs, s after the reference time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turns<'a> {
    /// Known.
    Known(&'a [f64]),
    /// So many, each a state behind the others.
    Unknown(usize),
}

impl Turns<'_> {
    /// How many turns there are.
    #[inline(always)]
    pub fn count(&self) -> usize {
        match self {
            Self::Known(times) => times.len(),
            Self::Unknown(count) => *count,
        }
    }

    /// How many of them are states.
    #[inline(always)]
    pub(crate) fn unknown(&self) -> usize {
        match self {
            Self::Known(_) => 0,
            Self::Unknown(count) => *count,
        }
    }

    /// The time of one turn; unknown ones are the last states in `x`.
    #[inline(always)]
    fn time<L: Lane>(&self, turn: usize, x: &[L], states: usize, like: L) -> L {
        match self {
            Self::Known(times) => like.splat(times[turn]),
            Self::Unknown(count) => x[states - count + turn],
        }
    }
}

/// Legs of constant velocity: the states are the place at the reference time, the
/// velocity of each leg, and the times of the turns where they are unknown.
///
/// The reference time belongs to the first leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Legs<'a> {
    /// When it turns.
    pub turns: Turns<'a>,
}

/// max(0, u - turn), and 1 where that is above zero.
#[inline(always)]
fn since<L: Lane>(u: L, turn: L) -> (L, L) {
    let (zero, one) = (u.splat(0.0), u.splat(1.0));
    let after = u - turn;
    (
        after.select_greater(zero, after, zero),
        after.select_greater(zero, one, zero),
    )
}

impl<const D: usize> Motion<D> for Legs<'_> {
    #[inline(always)]
    fn states(&self) -> usize {
        D * (2 + self.turns.count()) + self.turns.unknown()
    }

    #[inline(always)]
    fn at<L: Lane>(&self, x: &[L], u: L, changes: &mut [Change<L, D>]) -> Instant<L, D> {
        let (zero, one) = (u.splat(0.0), u.splat(1.0));
        let states = <Self as Motion<D>>::states(self);
        let count = self.turns.count();
        let unknown = self.turns.unknown();
        let mut now = Instant {
            place: [zero; D],
            velocity: [zero; D],
            acceleration: [zero; D],
        };
        for axis in 0..D {
            now.place[axis] = x[axis];
            changes[axis] = Change::zero(u);
            changes[axis].place[axis] = one;
        }
        // Time on each leg, and whether it is this leg's velocity.
        let (mut begun, mut on) = (u, one);
        for leg in 0..=count {
            let (next, later) = if leg < count {
                since(u, self.turns.time(leg, x, states, u))
            } else {
                (zero, zero)
            };
            let (time, here) = (begun - next, on - later);
            for axis in 0..D {
                let index = D * (leg + 1) + axis;
                now.place[axis] = x[index].mul_add(time, now.place[axis]);
                now.velocity[axis] = x[index].mul_add(here, now.velocity[axis]);
                changes[index] = Change::zero(u);
                changes[index].place[axis] = time;
                changes[index].velocity[axis] = here;
            }
            if leg < count && unknown > 0 {
                let change = &mut changes[states - unknown + leg];
                *change = Change::zero(u);
                for axis in 0..D {
                    let before = x[D * (leg + 1) + axis];
                    let behind = x[D * (leg + 2) + axis];
                    change.place[axis] = (before - behind) * later;
                }
            }
            (begun, on) = (next, later);
        }
        now
    }
    #[inline(always)]
    fn component(&self, state: usize) -> Option<usize> {
        let turns = <Self as Motion<D>>::states(self) - self.turns.unknown();
        (state < turns).then_some(state % D)
    }
}

/// Legs of one constant speed, as of a ship: the states are the place at the reference
/// time, the speed, the course of each leg (clockwise from north), in space the climb,
/// and the times of the turns where they are unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadyLegs<'a> {
    /// When it turns.
    pub turns: Turns<'a>,
}

impl<const D: usize> Motion<D> for SteadyLegs<'_> {
    #[inline(always)]
    fn states(&self) -> usize {
        // Place, speed, courses, climb, turns.
        D + 1 + self.turns.count() + 1 + (D - 2) + self.turns.unknown()
    }

    #[inline(always)]
    fn at<L: Lane>(&self, x: &[L], u: L, changes: &mut [Change<L, D>]) -> Instant<L, D> {
        let (zero, one) = (u.splat(0.0), u.splat(1.0));
        let states = <Self as Motion<D>>::states(self);
        let count = self.turns.count();
        let unknown = self.turns.unknown();
        let mut now = Instant {
            place: [zero; D],
            velocity: [zero; D],
            acceleration: [zero; D],
        };
        for axis in 0..D {
            now.place[axis] = x[axis];
            changes[axis] = Change::zero(u);
            changes[axis].place[axis] = one;
        }
        let speed = x[D];
        changes[D] = Change::zero(u);
        let (mut begun, mut on) = (u, one);
        let mut before = zero;
        let mut before_cosine = zero;
        for leg in 0..=count {
            let (next, later) = if leg < count {
                since(u, self.turns.time(leg, x, states, u))
            } else {
                (zero, zero)
            };
            let (time, here) = (begun - next, on - later);
            let (sine, cosine) = x[D + 1 + leg].sin_cos();
            now.place[0] = (speed * sine).mul_add(time, now.place[0]);
            now.place[1] = (speed * cosine).mul_add(time, now.place[1]);
            now.velocity[0] = (speed * sine).mul_add(here, now.velocity[0]);
            now.velocity[1] = (speed * cosine).mul_add(here, now.velocity[1]);
            let by_speed = &mut changes[D];
            by_speed.place[0] = sine.mul_add(time, by_speed.place[0]);
            by_speed.place[1] = cosine.mul_add(time, by_speed.place[1]);
            by_speed.velocity[0] = sine.mul_add(here, by_speed.velocity[0]);
            by_speed.velocity[1] = cosine.mul_add(here, by_speed.velocity[1]);
            let by_course = &mut changes[D + 1 + leg];
            *by_course = Change::zero(u);
            by_course.place[0] = speed * cosine * time;
            by_course.place[1] = zero - speed * sine * time;
            by_course.velocity[0] = speed * cosine * here;
            by_course.velocity[1] = zero - speed * sine * here;
            if leg > 0 && unknown > 0 {
                let change = &mut changes[states - unknown + leg - 1];
                *change = Change::zero(u);
                change.place[0] = speed * (before - sine) * on;
                change.place[1] = speed * (before_cosine - cosine) * on;
            }
            (before, before_cosine) = (sine, cosine);
            (begun, on) = (next, later);
        }
        climb(D + 2 + count, x, u, &mut now, changes);
        now
    }
}

/// In space, the state `index` is the constant rate of the third component.
#[inline(always)]
fn climb<L: Lane, const D: usize>(
    index: usize,
    x: &[L],
    u: L,
    now: &mut Instant<L, D>,
    changes: &mut [Change<L, D>],
) {
    for axis in 2..D {
        now.place[axis] = x[index].mul_add(u, now.place[axis]);
        now.velocity[axis] = x[index];
        changes[index] = Change::zero(u);
        changes[index].place[axis] = u;
        changes[index].velocity[axis] = u.splat(1.0);
    }
}

/// A turn at constant speed and rate: the states are the place at the reference time,
/// speed, course there and rate of turn (clockwise), and in space the climb.
///
/// It is exact through a rate of zero: the displacement is along the mean course.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CoordinatedTurn;

/// sin(a) / a and its derivative over a.
#[inline(always)]
fn sinc<L: Lane>(a: L, sine: L, cosine: L) -> (L, L) {
    let one = a.splat(1.0);
    let square = a * a;
    // Below this the series is exact to rounding, above it the quotients are good to
    // some 1e-13.
    let small = a.splat(0.04);
    let safe = square.select_greater(small, square, one);
    let safe_a = square.select_greater(small, a, one);
    let plain = sine / safe_a;
    let slope = (cosine - plain) / safe;
    let mut series = a.splat(0.0);
    let mut derivative = a.splat(0.0);
    // sinc = sum (-1)^k a^2k / (2k + 1)!; its derivative over a = sum 2k (-1)^k a^(2k-2) / ..
    for (k, factorial) in [
        1.0,
        6.0,
        120.0,
        5040.0,
        362_880.0,
        39_916_800.0,
        6_227_020_800.0,
    ]
    .into_iter()
    .enumerate()
    .rev()
    {
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        series = series.mul_add(square, a.splat(sign / factorial));
        if k > 0 {
            derivative = derivative.mul_add(square, a.splat(2.0 * k as f64 * sign / factorial));
        }
    }
    (
        square.select_greater(small, plain, series),
        square.select_greater(small, slope, derivative),
    )
}

impl<const D: usize> Motion<D> for CoordinatedTurn {
    #[inline(always)]
    fn states(&self) -> usize {
        D + 3 + (D - 2)
    }

    #[inline(always)]
    fn at<L: Lane>(&self, x: &[L], u: L, changes: &mut [Change<L, D>]) -> Instant<L, D> {
        let (zero, one) = (u.splat(0.0), u.splat(1.0));
        let (speed, course, rate) = (x[D], x[D + 1], x[D + 2]);
        let half = rate * u * u.splat(0.5);
        let (sine_half, cosine_half) = half.sin_cos();
        let (mean_sine, mean_cosine) = (course + half).sin_cos();
        let (sine, cosine) = (course + half + half).sin_cos();
        let (q, slope) = sinc(half, sine_half, cosine_half);
        // Displacement s u q (sin m, cos m), with m the mean course.
        let length = u * q;
        let mut now = Instant {
            place: [zero; D],
            velocity: [zero; D],
            acceleration: [zero; D],
        };
        for axis in 0..D {
            now.place[axis] = x[axis];
            changes[axis] = Change::zero(u);
            changes[axis].place[axis] = one;
        }
        for index in D..D + 3 {
            changes[index] = Change::zero(u);
        }
        let along = [mean_sine, mean_cosine];
        let across = [mean_cosine, zero - mean_sine];
        let heading = [sine, cosine];
        let normal = [cosine, zero - sine];
        // d(half) / d(rate) = u / 2, and dq / d(half) = half * slope.
        let half_time = u * u.splat(0.5);
        for axis in 0..2 {
            now.place[axis] = (speed * length).mul_add(along[axis], now.place[axis]);
            now.velocity[axis] = speed * heading[axis];
            now.acceleration[axis] = speed * rate * normal[axis];
            changes[D].place[axis] = length * along[axis];
            changes[D].velocity[axis] = heading[axis];
            changes[D + 1].place[axis] = speed * length * across[axis];
            changes[D + 1].velocity[axis] = speed * normal[axis];
            changes[D + 2].place[axis] =
                speed * u * half_time * (half * slope * along[axis] + q * across[axis]);
            changes[D + 2].velocity[axis] = speed * u * normal[axis];
        }
        climb(D + 3, x, u, &mut now, changes);
        now
    }
}

/// Where the target was when it emitted what is received at `u`, and how much later it
/// emits what is received later.
#[derive(Clone, Copy, Debug)]
pub struct Emission<L, const D: usize> {
    /// At the time of emission.
    pub instant: Instant<L, D>,
    /// Derivative of the time of emission by that of reception.
    pub pace: L,
}

/// The instant at which the target emitted what a receiver gets at `u`; the derivatives
/// in `changes` are those of what is received. `speed` is that of the wave, above that
/// of the target; `None` where the wave takes no time.
///
/// # Source
/// c (t - t') = |p(t') - receiver|, by Newton's method; its derivatives by the implicit
/// function theorem: dt'/dx = -n . dp/dx / (c + n . v).
#[inline(always)]
pub fn emitted<L: Lane, M: Motion<D>, const D: usize>(
    motion: &M,
    x: &[L],
    u: L,
    receiver: &[L; D],
    receiver_velocity: &[L; D],
    speed: Option<f64>,
    changes: &mut [Change<L, D>],
) -> Emission<L, D> {
    let zero = u.splat(0.0);
    let c = u.splat(speed.unwrap_or(1.0));
    // Below half the speed of the wave the error is squared four times: rounding.
    let steps = if speed.is_some() { 5 } else { 1 };
    let mut time = u;
    let mut now = Instant {
        place: [zero; D],
        velocity: [zero; D],
        acceleration: [zero; D],
    };
    for step in 0..steps {
        if step > 0 {
            let (range, _, opening) = line(&now, receiver);
            time = time - ((time - u) * c + range) / (c + opening);
        }
        now = motion.at(x, time, changes);
    }
    if speed.is_none() {
        return Emission {
            instant: now,
            pace: u.splat(1.0),
        };
    }
    let (_, unit, opening) = line(&now, receiver);
    let rate = c + opening;
    for change in &mut changes[..motion.states()] {
        let mut along = zero;
        for axis in 0..D {
            along = unit[axis].mul_add(change.place[axis], along);
        }
        let earlier = along / rate;
        for axis in 0..D {
            change.place[axis] = earlier.negate_mul_add(now.velocity[axis], change.place[axis]);
            change.velocity[axis] =
                earlier.negate_mul_add(now.acceleration[axis], change.velocity[axis]);
        }
    }
    let mut own = c;
    for axis in 0..D {
        own = unit[axis].mul_add(receiver_velocity[axis], own);
    }
    Emission {
        instant: now,
        pace: own / rate,
    }
}

/// Range, the unit vector to the target (zero on the receiver), and the speed along it.
#[inline(always)]
fn line<L: Lane, const D: usize>(now: &Instant<L, D>, receiver: &[L; D]) -> (L, [L; D], L) {
    let zero = receiver[0].splat(0.0);
    let mut unit = *receiver;
    let mut square = zero;
    for axis in 0..D {
        unit[axis] = now.place[axis] - receiver[axis];
        square = unit[axis].mul_add(unit[axis], square);
    }
    let range = square.sqrt();
    let safe = square.select_greater(zero, range, zero.splat(1.0));
    let mut opening = zero;
    for axis in 0..D {
        unit[axis] = unit[axis] / safe;
        opening = unit[axis].mul_add(now.velocity[axis], opening);
    }
    (range, unit, opening)
}
