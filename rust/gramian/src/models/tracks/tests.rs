//! Derivatives of all motions and sensors against dual numbers.

#![allow(clippy::unwrap_used)]

use core::ops::{Add, Div, Mul, Neg, Sub};

use super::motion::{
    Change, CoordinatedTurn, Instant, Legs, Motion, Polynomial, SteadyLegs, Turns, emitted,
};
use super::sensors::{
    Bearing, ConeAngle, Course, Elevation, Frequency, Place, Range, RangeRate, Reading, Sensor,
    Sight, SignalStrength, Speed,
};
use crate::numbers::lane::Lane;

/// A number and its derivative by one variable.
#[derive(Clone, Copy, Debug)]
struct Dual(f64, f64);

impl Add for Dual {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Self(self.0 + b.0, self.1 + b.1)
    }
}
impl Sub for Dual {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Self(self.0 - b.0, self.1 - b.1)
    }
}
impl Mul for Dual {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        Self(self.0 * b.0, self.0 * b.1 + self.1 * b.0)
    }
}
impl Div for Dual {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let quotient = self.0 / b.0;
        Self(quotient, (self.1 - quotient * b.1) / b.0)
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}

impl Lane for Dual {
    fn times(self, factor: f64) -> Self {
        Self(self.0 * factor, self.1 * factor)
    }
    fn abs(self) -> Self {
        if self.0 < 0.0 { -self } else { self }
    }
    fn min(self, other: Self) -> Self {
        if other.0 < self.0 { other } else { self }
    }
    fn max(self, other: Self) -> Self {
        if other.0 > self.0 { other } else { self }
    }
    fn hypot(self, other: Self) -> Self {
        (self * self + other * other).sqrt()
    }
    fn inverted([x, y]: [Self; 2], scale: Self) -> [Self; 2] {
        let weight = (x * x + y * y) * scale;
        [x / weight, y / weight]
    }
    fn round(self) -> Self {
        Self(self.0.round(), 0.0)
    }
    fn remainder(self, divisor: Self) -> Self {
        Self(self.0 % divisor.0, self.1)
    }
    fn any_greater(self, other: Self) -> bool {
        self.0 > other.0
    }
    fn splat(self, value: f64) -> Self {
        Self(value, 0.0)
    }
    fn mul_add(self, factor: Self, term: Self) -> Self {
        self * factor + term
    }
    fn negate_mul_add(self, factor: Self, term: Self) -> Self {
        term - self * factor
    }
    fn sqrt(self) -> Self {
        let root = self.0.sqrt();
        Self(root, self.1 / (2.0 * root))
    }
    fn recip(self) -> Self {
        Self(1.0, 0.0) / self
    }
    fn recip_or_zero(self) -> Self {
        self.recip()
    }
    fn select_greater(self, other: Self, yes: Self, no: Self) -> Self {
        if self.0 > other.0 { yes } else { no }
    }
    fn sin_cos(self) -> (Self, Self) {
        let (sine, cosine) = self.0.sin_cos();
        (Self(sine, self.1 * cosine), Self(cosine, -self.1 * sine))
    }
    fn atan2(self, x: Self) -> Self {
        let square = self.0 * self.0 + x.0 * x.0;
        Self(self.0.atan2(x.0), (self.1 * x.0 - self.0 * x.1) / square)
    }
    fn ln(self) -> Self {
        Self(self.0.ln(), self.1 / self.0)
    }
}

/// A simple generator, so that geometries are the same on every machine.
struct Random(u64);

impl Random {
    /// In (-1, 1).
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
    fn vector<const D: usize>(&mut self, size: f64) -> [f64; D] {
        core::array::from_fn(|_| size * self.next())
    }
}

fn near(given: f64, wanted: f64, scale: f64, what: &str) {
    let error = (given - wanted).abs();
    assert!(
        error <= 1e-10 * scale.max(wanted.abs()),
        "{what}: {given} not {wanted}"
    );
}

const MOST: usize = 16;

/// Place and velocity with derivatives against those of dual numbers, one state at a time.
fn check_motion<const D: usize>(motion: &impl Motion<D>, x: &[f64], u: f64, delay: Option<f64>) {
    let receiver: [f64; D] = core::array::from_fn(|axis| 200.0 * axis as f64 - 900.0);
    let carried: [f64; D] = core::array::from_fn(|axis| 3.0 - 4.0 * axis as f64);
    let n = motion.states();
    assert_eq!(n, x.len());
    let mut changes = [Change::<f64, D>::zero(0.0); MOST];
    let out = emitted(motion, x, u, &receiver, &carried, delay, &mut changes);
    let (now, pace): (Instant<f64, D>, f64) = (out.instant, out.pace);
    let dual = |k: usize| {
        // Index n: the time; the receiver moves with it.
        let mut states = [Dual(0.0, 0.0); MOST];
        for (i, state) in states[..n].iter_mut().enumerate() {
            *state = Dual(x[i], if i == k { 1.0 } else { 0.0 });
        }
        let time = Dual(u, if k == n { 1.0 } else { 0.0 });
        let place = core::array::from_fn(|axis| {
            Dual(receiver[axis], if k == n { carried[axis] } else { 0.0 })
        });
        let still = [Dual(0.0, 0.0); D];
        let mut unused = [Change::<Dual, D>::zero(time); MOST];
        emitted(motion, &states, time, &place, &still, delay, &mut unused).instant
    };
    let mut plain = [Change::<f64, D>::zero(0.0); MOST];
    motion.at(x, u, &mut plain);
    for k in 0..n {
        let wanted = dual(k);
        if let Some(only) = motion.component(k) {
            for axis in (0..D).filter(|&axis| axis != only) {
                assert_eq!((plain[k].place[axis], plain[k].velocity[axis]), (0.0, 0.0));
            }
        }
        for axis in 0..D {
            let scale = changes[k]
                .place
                .iter()
                .fold(1e-6_f64, |a, b| a.max(b.abs()));
            near(changes[k].place[axis], wanted.place[axis].1, scale, "place");
            let scale = changes[k]
                .velocity
                .iter()
                .fold(1e-6_f64, |a, b| a.max(b.abs()));
            near(
                changes[k].velocity[axis],
                wanted.velocity[axis].1,
                scale,
                "velocity",
            );
        }
    }
    let wanted = dual(n);
    for axis in 0..D {
        near(
            now.velocity[axis] * pace,
            wanted.place[axis].1,
            1.0,
            "rate of place",
        );
        near(
            now.acceleration[axis] * pace,
            wanted.velocity[axis].1,
            1e-3,
            "acceleration",
        );
        near(now.place[axis], wanted.place[axis].0, 1.0, "value");
    }
}

fn motions<const D: usize>(delay: Option<f64>) {
    let mut random = Random(17);
    for trial in 0..60 {
        let u = 300.0 * random.next();
        let start: [f64; D] = random.vector(5000.0);
        let mut x = [0.0; MOST];
        x[..D].copy_from_slice(&start);
        for (order, size) in [0.0, 10.0, 0.05, 1e-4].into_iter().enumerate() {
            for axis in 0..D {
                x[D * order + axis] = if order == 0 {
                    start[axis]
                } else {
                    size * random.next()
                };
            }
            check_motion::<D>(&Polynomial { order }, &x[..D * (order + 1)], u, delay);
        }
        // Three legs.
        let turns = [40.0 + 30.0 * random.next(), 150.0 + 50.0 * random.next()];
        for k in D..4 * D {
            x[k] = 10.0 * random.next();
        }
        let known = Legs {
            turns: Turns::Known(&turns),
        };
        check_motion::<D>(&known, &x[..4 * D], u, delay);
        x[4 * D..4 * D + 2].copy_from_slice(&turns);
        let unknown = Legs {
            turns: Turns::Unknown(2),
        };
        check_motion::<D>(&unknown, &x[..4 * D + 2], u, delay);
        // Of one speed; headings through north and all round.
        x[D] = 3.0 + 2.0 * random.next();
        for k in 0..3 {
            x[D + 1 + k] = if trial % 3 == k {
                0.0
            } else {
                4.0 * random.next()
            };
        }
        let mut end = D + 4;
        if D == 3 {
            x[end] = random.next();
            end += 1;
        }
        check_motion::<D>(
            &SteadyLegs {
                turns: Turns::Known(&turns),
            },
            &x[..end],
            u,
            delay,
        );
        x[end..end + 2].copy_from_slice(&turns);
        check_motion::<D>(
            &SteadyLegs {
                turns: Turns::Unknown(2),
            },
            &x[..end + 2],
            u,
            delay,
        );
        // A turn, also at a rate of zero and next to it.
        let rates = [0.0, 1e-12, -1e-9, 1e-6, 1e-4, 1.3e-3, 1.34e-3, 0.02, -0.2];
        x[D + 2] = rates[trial % rates.len()];
        if D == 3 {
            x[D + 3] = random.next();
        }
        check_motion::<D>(&CoordinatedTurn, &x[..=2 * D], u, delay);
    }
}

#[test]
fn motions_in_the_plane_and_in_space() {
    motions::<2>(None);
    motions::<3>(None);
}

#[test]
fn emission_of_what_moves_as_any_motion() {
    motions::<2>(Some(1500.0));
    motions::<3>(Some(340.0));
}

/// A rate through zero changes nothing: the displacement of a tiny rate is that of none
/// to first order.
#[test]
fn turn_rate_through_zero() {
    let mut changes = [Change::<f64, 2>::zero(0.0); 5];
    let at = |rate: f64, changes: &mut [Change<f64, 2>]| {
        CoordinatedTurn.at(&[0.0, 0.0, 10.0, 0.3, rate], 100.0, changes)
    };
    let zero = at(0.0, &mut changes);
    let slope = changes[4].place;
    for rate in [1e-9, -1e-9, 1e-7] {
        let now = at(rate, &mut changes);
        for axis in 0..2 {
            let wanted = zero.place[axis] + rate * slope[axis];
            assert!((now.place[axis] - wanted).abs() < 1e-3 * (rate * 1e5).powi(2) + 1e-9);
        }
    }
    // A quarter circle: radius s / w.
    let w = core::f64::consts::FRAC_PI_2 / 100.0;
    let quarter = CoordinatedTurn.at(&[0.0, 0.0, 10.0, 0.0, w], 100.0, &mut changes);
    for axis in 0..2 {
        assert!((quarter.place[axis] - 10.0 / w).abs() < 1e-9);
    }
    assert!((quarter.velocity[0] - 10.0).abs() < 1e-12 && quarter.velocity[1].abs() < 1e-12);
}

fn sight<L: Lane, const D: usize>(
    place: &[L; D],
    velocity: &[L; D],
    at: &[f64; D],
    carried: &[f64; D],
    heading: &[f64; D],
) -> Sight<L, D> {
    let like = place[0];
    Sight {
        offset: core::array::from_fn(|k| place[k] - like.splat(at[k])),
        target: *velocity,
        carrier: core::array::from_fn(|k| like.splat(carried[k])),
        axis: core::array::from_fn(|k| like.splat(heading[k])),
    }
}

fn check_sensor<const D: usize>(sensor: &impl Sensor<D>, random: &mut Random, closest: f64) {
    let carrier: [f64; D] = random.vector(2000.0);
    let carried: [f64; D] = random.vector(8.0);
    let mut heading: [f64; D] = random.vector(1.0);
    let length = heading.iter().map(|x| x * x).sum::<f64>().sqrt();
    for x in &mut heading {
        *x /= length;
    }
    let away: [f64; D] = random.vector(closest);
    let place: [f64; D] = core::array::from_fn(|k| carrier[k] + away[k]);
    let velocity: [f64; D] = random.vector(10.0);
    let parameters = [300.0 + random.next(), 2.0 + 0.5 * random.next()];
    let given: Reading<f64, D> = sensor.read(
        &sight(&place, &velocity, &carrier, &carried, &heading),
        &parameters,
    );
    let lift = |x: &[f64; D], one: Option<usize>| -> [Dual; D] {
        core::array::from_fn(|k| Dual(x[k], if one == Some(k) { 1.0 } else { 0.0 }))
    };
    let constants = parameters.map(|p| Dual(p, 0.0));
    let size = |x: &[f64; D]| x.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    for axis in 0..D {
        let moved = sight(
            &lift(&place, Some(axis)),
            &lift(&velocity, None),
            &carrier,
            &carried,
            &heading,
        );
        let wanted = sensor.read(&moved, &constants).value;
        near(given.value, wanted.0, 0.0, "value");
        near(
            given.by_place[axis],
            wanted.1,
            size(&given.by_place),
            "by place",
        );
        let moved = sight(
            &lift(&place, None),
            &lift(&velocity, Some(axis)),
            &carrier,
            &carried,
            &heading,
        );
        let wanted = sensor.read(&moved, &constants).value.1;
        near(
            given.by_velocity[axis],
            wanted,
            size(&given.by_velocity),
            "by velocity",
        );
    }
    for k in 0..2 {
        let mut varied = constants;
        varied[k].1 = 1.0;
        let still = sight(
            &lift(&place, None),
            &lift(&velocity, None),
            &carrier,
            &carried,
            &heading,
        );
        let wanted = sensor.read(&still, &varied).value.1;
        near(given.by_parameter[k], wanted, 0.0, "by parameter");
    }
}

#[test]
fn sensors_in_the_plane_and_in_space() {
    let mut random = Random(3);
    for trial in 0..200 {
        // Passages over the sensor among them.
        let closest = [5000.0, 100.0, 1.0][trial % 3];
        macro_rules! both {
            ($($sensor:expr),*) => {$(
                check_sensor::<2>(&$sensor, &mut random, closest);
                check_sensor::<3>(&$sensor, &mut random, closest);
            )*};
        }
        both!(
            Bearing,
            Range { factor: 1.0 },
            Range {
                factor: 1.0 / 1500.0
            },
            RangeRate,
            Frequency { speed: 1500.0 },
            ConeAngle,
            SignalStrength,
            Place { axis: 0 },
            Place { axis: 1 },
            Speed,
            Course
        );
        check_sensor::<3>(&Elevation, &mut random, closest);
        check_sensor::<3>(&Place { axis: 2 }, &mut random, closest);
    }
}

/// Known values.
#[test]
fn readings() {
    let still = [0.0; 2];
    let at =
        |place: [f64; 2], velocity: [f64; 2]| sight(&place, &velocity, &still, &still, &[0.0, 1.0]);
    let bearing = Bearing.read(&at([1.0, 1.0], still), &[0.0; 2]).value;
    assert!((bearing - core::f64::consts::FRAC_PI_4).abs() < 1e-15);
    let closing = RangeRate
        .read(&at([3.0, 4.0], [-6.0, -8.0]), &[0.0; 2])
        .value;
    assert!((closing + 10.0).abs() < 1e-14);
    // 10 m/s towards the receiver in water: 300 c / (c - 10).
    let frequency = Frequency { speed: 1500.0 }
        .read(&at([3.0, 4.0], [-6.0, -8.0]), &[300.0, 0.0])
        .value;
    assert!((frequency - 300.0 * 1500.0 / 1490.0).abs() < 1e-12);
    // The first-order formula differs at (v / c)^2.
    let first_order = 300.0 * (1.0 + 10.0 / 1500.0);
    assert!(((frequency - first_order).abs() - 0.0134).abs() < 1e-3);
    let cone = ConeAngle.read(&at([-1.0, 1.0], still), &[0.0; 2]).value;
    assert!((cone - core::f64::consts::FRAC_PI_4).abs() < 1e-15);
    let strength = SignalStrength
        .read(&at([0.0, 100.0], still), &[10.0, 2.0])
        .value;
    assert!((strength + 30.0).abs() < 1e-12);
}

/// The same texts in single precision: to what single precision holds.
#[test]
fn single_precision() {
    let mut random = Random(5);
    let mut wide = [Change::<f64, 2>::zero(0.0); MOST];
    let mut narrow = [Change::<f32, 2>::zero(0.0); MOST];
    for _ in 0..100 {
        let x: [f64; 5] = [
            1000.0 * random.next(),
            1000.0 * random.next(),
            5.0 + random.next(),
            3.0 * random.next(),
            0.02 * random.next(),
        ];
        #[allow(clippy::cast_possible_truncation)]
        let single = x.map(|x| x as f32);
        let x = single.map(f64::from);
        let a = CoordinatedTurn.at(&x, 60.0, &mut wide);
        let b = CoordinatedTurn.at(&single, 60.0, &mut narrow);
        for axis in 0..2 {
            assert!((a.place[axis] - f64::from(b.place[axis])).abs() < 1e-3);
            for k in 0..5 {
                let (x, y) = (wide[k].place[axis], f64::from(narrow[k].place[axis]));
                assert!((x - y).abs() < 2e-4 * (1.0 + x.abs()), "{x} {y}");
            }
        }
        let far = sight(&a.place, &a.velocity, &[0.0; 2], &[1.0; 2], &[0.0, 1.0]);
        let near = sight(&b.place, &b.velocity, &[0.0; 2], &[1.0; 2], &[0.0, 1.0]);
        let exact = Bearing.read(&far, &[0.0; 2]);
        let rough = Bearing.read(&near, &[0.0; 2]);
        let turn = (exact.value - f64::from(rough.value)).abs();
        assert!(turn < 1e-4 || (turn - core::f64::consts::TAU).abs() < 1e-4);
        let exact = Frequency { speed: 1500.0 }.read(&far, &[300.0, 0.0]);
        let rough = Frequency { speed: 1500.0 }.read(&near, &[300.0, 0.0]);
        assert!((exact.value - f64::from(rough.value)).abs() < 1e-3);
    }
}
