//! What sensors see: the exact value, and its derivatives by place and velocity of the
//! target. The text serves `f32`, `f64` and vectors of samples.
//!
//! With d = target - carrier, r = |d|, rho its horizontal part and w the relative
//! velocity:
//!
//! | sensor | value |
//! |---|---|
//! | [`Bearing`] | `atan2(d_east, d_north)` |
//! | [`Elevation`] | `atan2(d_up, rho)` |
//! | [`Range`] | r, times a factor: 1 / c for the time of flight |
//! | [`RangeRate`] | d . w / r |
//! | [`Frequency`] | `f0 (c + v_c . n) / (c + v_t . n)`, n = d / r |
//! | [`ConeAngle`] | angle between d and the carrier's axis, in (0, pi) |
//! | [`SignalStrength`] | P - 10 eta log10 r |
//! | [`Place`], [`Speed`], [`Course`] | of the target itself |
//!
//! Differences of two (of arrival times, of frequencies) are the difference of two
//! readings.

use crate::numbers::algebra::dot;
use crate::numbers::lane::Lane;

/// A target as seen from a carrier.
#[derive(Clone, Copy, Debug)]
pub struct Sight<L, const D: usize> {
    /// Target less carrier, m.
    pub offset: [L; D],
    /// Velocity of the target, m/s.
    pub target: [L; D],
    /// Velocity of the carrier, m/s.
    pub carrier: [L; D],
    /// Unit vector of the carrier's axis: the heading of a towed array.
    pub axis: [L; D],
}

impl<L: Lane, const D: usize> Sight<L, D> {
    #[inline(always)]
    fn zero(&self) -> L {
        self.offset[0].splat(0.0)
    }

    #[inline(always)]
    fn range(&self) -> L {
        dot(&self.offset, &self.offset).sqrt()
    }

    /// Square of the horizontal range.
    #[inline(always)]
    fn horizontal(&self) -> L {
        self.offset[0].mul_add(self.offset[0], self.offset[1] * self.offset[1])
    }
}

/// What a sensor reads without noise, and the derivatives of that.
#[derive(Clone, Copy, Debug)]
pub struct Reading<L, const D: usize> {
    /// The value.
    pub value: L,
    /// By the place of the target.
    pub by_place: [L; D],
    /// By its velocity.
    pub by_velocity: [L; D],
    /// By the sensor's own parameters.
    pub by_parameter: [L; 2],
}

impl<L: Lane, const D: usize> Reading<L, D> {
    #[inline(always)]
    fn new(value: L) -> Self {
        let zero = value.splat(0.0);
        Self {
            value,
            by_place: [zero; D],
            by_velocity: [zero; D],
            by_parameter: [zero; 2],
        }
    }

    /// The derivative by a state that changes place and velocity so.
    #[inline(always)]
    pub fn along(&self, place: &[L; D], velocity: &[L; D]) -> L {
        let mut sum = self.by_place[0] * place[0];
        for axis in 1..D {
            sum = self.by_place[axis].mul_add(place[axis], sum);
        }
        for axis in 0..D {
            sum = self.by_velocity[axis].mul_add(velocity[axis], sum);
        }
        sum
    }

    /// This reading less another: of arrival times, of frequencies.
    #[inline(always)]
    #[must_use]
    pub fn less(mut self, other: &Self) -> Self {
        self.value = self.value - other.value;
        for axis in 0..D {
            self.by_place[axis] = self.by_place[axis] - other.by_place[axis];
            self.by_velocity[axis] = self.by_velocity[axis] - other.by_velocity[axis];
        }
        for k in 0..2 {
            self.by_parameter[k] = self.by_parameter[k] - other.by_parameter[k];
        }
        self
    }
}

/// A kind of sensor in `D` dimensions.
pub trait Sensor<const D: usize> {
    /// Whether whole turns of the value do not matter.
    const WRAPS: bool = false;
    /// Whether the velocity of the target matters.
    const SEES_VELOCITY: bool = true;
    /// Whether the value is finite wherever the derivatives are.
    const FINITE: bool = false;

    /// The value and its derivatives; not finite where there is no derivative.
    fn read<L: Lane>(&self, sight: &Sight<L, D>, parameters: &[L; 2]) -> Reading<L, D>;
}

/// Horizontal angle clockwise from north, rad.
#[derive(Clone, Copy, Debug)]
pub struct Bearing;

impl<const D: usize> Sensor<D> for Bearing {
    const FINITE: bool = true;
    const SEES_VELOCITY: bool = false;
    const WRAPS: bool = true;

    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, _: &[L; 2]) -> Reading<L, D> {
        let [east, north] = [sight.offset[0], sight.offset[1]];
        let mut reading = Reading::new(east.atan2(north));
        [reading.by_place[0], reading.by_place[1]] = gradient([east, north], east.splat(1.0));
        reading
    }
}

/// The derivative of the bearing of a target at an offset (east, north) by its position,
/// over `sigma`.
#[inline(always)]
pub(crate) fn gradient<L: Lane>(offset: [L; 2], sigma: L) -> [L; 2] {
    let [x, y] = L::inverted(offset, sigma);
    [y, -x]
}

/// Angle above the horizontal, rad; only in space.
#[derive(Clone, Copy, Debug)]
pub struct Elevation;

impl<const D: usize> Sensor<D> for Elevation {
    const FINITE: bool = true;
    const SEES_VELOCITY: bool = false;

    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, _: &[L; 2]) -> Reading<L, D> {
        let up = sight.offset[D - 1];
        let rho = sight.horizontal().sqrt();
        let square = dot(&sight.offset, &sight.offset);
        let mut reading = Reading::new(up.atan2(rho));
        let lean = sight.zero() - up / (rho * square);
        reading.by_place[0] = sight.offset[0] * lean;
        reading.by_place[1] = sight.offset[1] * lean;
        reading.by_place[D - 1] = rho / square;
        reading
    }
}

/// Distance times a factor: 1 for metres, 1 / c for a time of flight.
#[derive(Clone, Copy, Debug)]
pub struct Range {
    /// What a metre reads.
    pub factor: f64,
}

impl<const D: usize> Sensor<D> for Range {
    const SEES_VELOCITY: bool = false;

    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, _: &[L; 2]) -> Reading<L, D> {
        let range = sight.range();
        let factor = range.splat(self.factor);
        let gain = factor / range;
        let mut reading = Reading::new(range * factor);
        for axis in 0..D {
            reading.by_place[axis] = sight.offset[axis] * gain;
        }
        reading
    }
}

/// Rate of the distance, m/s.
#[derive(Clone, Copy, Debug)]
pub struct RangeRate;

impl<const D: usize> Sensor<D> for RangeRate {
    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, _: &[L; 2]) -> Reading<L, D> {
        let inverse = sight.range().recip();
        let mut unit = sight.offset;
        let mut relative = sight.target;
        for axis in 0..D {
            unit[axis] = unit[axis] * inverse;
            relative[axis] = relative[axis] - sight.carrier[axis];
        }
        let rate = dot(&unit, &relative);
        let mut reading = Reading::new(rate);
        for axis in 0..D {
            reading.by_place[axis] = rate.negate_mul_add(unit[axis], relative[axis]) * inverse;
            reading.by_velocity[axis] = unit[axis];
        }
        reading
    }
}

/// Received frequency of a tonal, Hz. Parameter 0 is the emitted frequency.
#[derive(Clone, Copy, Debug)]
pub struct Frequency {
    /// Speed of the wave, m/s.
    pub speed: f64,
}

impl<const D: usize> Sensor<D> for Frequency {
    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, parameters: &[L; 2]) -> Reading<L, D> {
        // One division for 1 / r and 1 / (c + v_t . n): a quarter of the time of the reading.
        let range = sight.range();
        let wave = range * range.splat(self.speed);
        let below = wave + dot(&sight.offset, &sight.target);
        let shared = (range * below).recip();
        let inverse = shared * below;
        let mut unit = sight.offset;
        for axis in 0..D {
            unit[axis] = unit[axis] * inverse;
        }
        let slowness = shared * range * range;
        let ratio = (wave + dot(&sight.offset, &sight.carrier)) * shared * range;
        let tonal = parameters[0];
        let mut reading = Reading::new(tonal * ratio);
        // d ratio / d n = (v_c - ratio v_t) / (c + v_t . n), of which what is across n counts.
        let gain = tonal * slowness;
        let mut pull = sight.carrier;
        for axis in 0..D {
            pull[axis] = ratio.negate_mul_add(sight.target[axis], pull[axis]);
        }
        let along = dot(&pull, &unit);
        let near = gain * inverse;
        let fast = inverse.splat(0.0) - gain * ratio;
        for axis in 0..D {
            reading.by_place[axis] = near * along.negate_mul_add(unit[axis], pull[axis]);
            reading.by_velocity[axis] = fast * unit[axis];
        }
        reading.by_parameter[0] = ratio;
        reading
    }
}

/// Angle between the axis of an array and the target, in (0, pi), rad: the side is
/// unknown. Along the axis it has no derivative.
#[derive(Clone, Copy, Debug)]
pub struct ConeAngle;

impl<const D: usize> Sensor<D> for ConeAngle {
    const SEES_VELOCITY: bool = false;

    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, _: &[L; 2]) -> Reading<L, D> {
        let along = dot(&sight.offset, &sight.axis);
        let mut across = sight.offset;
        for axis in 0..D {
            across[axis] = along.negate_mul_add(sight.axis[axis], across[axis]);
        }
        // From both parts, the angle keeps its digits also near 0 and pi.
        let width = dot(&across, &across).sqrt();
        let square = along.mul_add(along, width * width);
        let mut reading = Reading::new(width.atan2(along));
        for axis in 0..D {
            reading.by_place[axis] =
                (along * across[axis] / width - width * sight.axis[axis]) / square;
        }
        reading
    }
}

/// Received power by distance, dB: P - 10 eta log10 r. Parameter 0 is P, the power at
/// 1 m, parameter 1 the exponent eta.
#[derive(Clone, Copy, Debug)]
pub struct SignalStrength;

/// 10 / ln 10.
const DECIBELS: f64 = 4.342_944_819_032_518;

impl<const D: usize> Sensor<D> for SignalStrength {
    const SEES_VELOCITY: bool = false;

    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, parameters: &[L; 2]) -> Reading<L, D> {
        let square = dot(&sight.offset, &sight.offset);
        let [power, exponent] = *parameters;
        let loss = square.ln() * square.splat(0.5 * DECIBELS);
        let mut reading = Reading::new(exponent.negate_mul_add(loss, power));
        let gain = exponent * square.splat(DECIBELS) / square;
        for axis in 0..D {
            reading.by_place[axis] = sight.zero() - sight.offset[axis] * gain;
        }
        reading.by_parameter = [square.splat(1.0), sight.zero() - loss];
        reading
    }
}

/// One component of the target's place from the carrier, m: of the target itself where
/// the carrier is at the origin.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// 0 east, 1 north, 2 up.
    pub axis: usize,
}

impl<const D: usize> Sensor<D> for Place {
    const SEES_VELOCITY: bool = false;

    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, _: &[L; 2]) -> Reading<L, D> {
        let mut reading = Reading::new(sight.zero());
        for axis in 0..D {
            if axis == self.axis {
                reading.value = sight.offset[axis];
                reading.by_place[axis] = sight.zero().splat(1.0);
            }
        }
        reading
    }
}

/// The target's speed, m/s.
#[derive(Clone, Copy, Debug)]
pub struct Speed;

impl<const D: usize> Sensor<D> for Speed {
    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, _: &[L; 2]) -> Reading<L, D> {
        let speed = dot(&sight.target, &sight.target).sqrt();
        let mut reading = Reading::new(speed);
        for axis in 0..D {
            reading.by_velocity[axis] = sight.target[axis] / speed;
        }
        reading
    }
}

/// The target's course, clockwise from north, rad.
#[derive(Clone, Copy, Debug)]
pub struct Course;

impl<const D: usize> Sensor<D> for Course {
    const WRAPS: bool = true;

    #[inline(always)]
    fn read<L: Lane>(&self, sight: &Sight<L, D>, _: &[L; 2]) -> Reading<L, D> {
        let [east, north] = [sight.target[0], sight.target[1]];
        let square = east.mul_add(east, north * north);
        let mut reading = Reading::new(east.atan2(north));
        reading.by_velocity[0] = north / square;
        reading.by_velocity[1] = sight.zero() - east / square;
        reading
    }
}
