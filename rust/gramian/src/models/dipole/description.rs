//! What a record may hold beside one dipole on a straight pass: how the body moves, how many
//! dipoles it carries, what is wrong with the sensors.

use alloc::string::{String, ToString};

use crate::numbers::algebra::dot;
use crate::tracks::motion::{Change, CoordinatedTurn, Motion as _, Polynomial};

/// How the body moves; position and velocity of the state are those at its instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Motion {
    /// At constant velocity.
    #[default]
    Straight,
    /// Along a line, at a constant acceleration, m/s^2.
    Along,
    /// At constant acceleration, three components.
    Accelerated,
    /// At constant speed and rate about the third axis, rad/s clockwise seen from above; its
    /// dipoles turn with it.
    Turning,
}

/// Where the body is, and how that follows from the states.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Of the first dipole, m.
    pub place: [f64; 3],
    /// m/s.
    pub velocity: [f64; 3],
    /// The derivatives of the place by position and velocity of the state.
    pub by_state: [[f64; 3]; 6],
    /// By what more the motion has.
    pub by_more: [[f64; 3]; 3],
    /// Sine and cosine of the angle that the body has turned.
    turned: [f64; 2],
    /// Derivative of that angle by the rate.
    by_rate: f64,
}

impl Step {
    /// A vector of the body as it lies now.
    pub fn turn(&self, vector: &[f64; 3]) -> [f64; 3] {
        let ([sin, cos], [x, y, z]) = (self.turned, *vector);
        [x * cos + y * sin, y * cos - x * sin, z]
    }

    /// A symmetric tensor of the body as it lies now, and its derivative by the rate.
    pub fn turn_tensor(&self, tensor: &[[f64; 3]; 3]) -> [[[f64; 3]; 3]; 2] {
        let half = tensor.map(|row| self.turn(&row));
        let columns: [[f64; 3]; 3] = core::array::from_fn(|j| half.map(|row| row[j]));
        let by_rate = columns.map(|column| self.turn_by_rate(&column));
        [
            columns.map(|column| self.turn(&column)),
            core::array::from_fn(|i| core::array::from_fn(|j| by_rate[i][j] + by_rate[j][i])),
        ]
    }

    /// The derivative of [`turn`](Self::turn) by the rate.
    pub fn turn_by_rate(&self, vector: &[f64; 3]) -> [f64; 3] {
        let [x, y, _] = self.turn(vector);
        [self.by_rate * y, -self.by_rate * x, 0.0]
    }
}

impl Motion {
    /// How many states it has beside position and velocity.
    pub fn states(self) -> usize {
        match self {
            Self::Straight => 0,
            Self::Along | Self::Turning => 1,
            Self::Accelerated => 3,
        }
    }

    /// Names of these states, and their unit.
    pub fn names(self) -> (&'static [&'static str], &'static str) {
        match self {
            Self::Straight => (&[], ""),
            Self::Along => (&["acceleration along"], "m/s^2"),
            Self::Accelerated => (&["ax", "ay", "az"], "m/s^2"),
            Self::Turning => (&["turn rate"], "rad/s"),
        }
    }

    /// Where a body of this state (r0, v, ..), with these further states, is at a time.
    pub fn at(self, state: &[f64; 9], more: &[f64], t: f64) -> Step {
        let mut step = Step {
            place: [0.0; 3],
            velocity: [0.0; 3],
            by_state: [[0.0; 3]; 6],
            by_more: [[0.0; 3]; 3],
            turned: [0.0, 1.0],
            by_rate: 0.0,
        };
        let more: [f64; 3] = core::array::from_fn(|i| more.get(i).copied().unwrap_or(0.0));
        if self == Self::Turning {
            let (vx, vy) = (state[3], state[4]);
            let speed = vx.hypot(vy).max(f64::MIN_POSITIVE);
            let (sin, cos) = (vx / speed, vy / speed);
            let x = [
                state[0],
                state[1],
                state[2],
                speed,
                vx.atan2(vy),
                more[0],
                state[5],
            ];
            let mut changes = [Change::<f64, 3>::zero(0.0); 7];
            let point = CoordinatedTurn.at(&x, t, &mut changes);
            (step.place, step.velocity) = (point.place, point.velocity);
            for axis in 0..3 {
                step.by_state[axis] = changes[axis].place;
            }
            for i in 0..3 {
                let (by_speed, by_course) = (changes[3].place[i], changes[4].place[i] / speed);
                step.by_state[3][i] = by_speed * sin + by_course * cos;
                step.by_state[4][i] = by_speed * cos - by_course * sin;
            }
            step.by_state[5] = changes[6].place;
            step.by_more[0] = changes[5].place;
            let (sin, cos) = (more[0] * t).sin_cos();
            (step.turned, step.by_rate) = ([sin, cos], t);
            return step;
        }
        let velocity = [state[3], state[4], state[5]];
        let speed = dot(&velocity, &velocity).sqrt().max(f64::MIN_POSITIVE);
        let along = velocity.map(|v| v / speed);
        let acceleration = match self {
            Self::Along => along.map(|u| u * more[0]),
            _ => more,
        };
        let mut x = [0.0; 9];
        x[..6].copy_from_slice(&state[..6]);
        x[6..].copy_from_slice(&acceleration);
        let mut changes = [Change::<f64, 3>::zero(0.0); 9];
        let point = Polynomial::CONSTANT_ACCELERATION.at(&x, t, &mut changes);
        (step.place, step.velocity) = (point.place, point.velocity);
        for (by, change) in step.by_state.iter_mut().zip(&changes) {
            *by = change.place;
        }
        let half = 0.5 * t * t;
        match self {
            Self::Accelerated => step.by_more = [6, 7, 8].map(|k| changes[k].place),
            Self::Along => {
                step.by_more[0] = along.map(|u| half * u);
                // The direction turns with the velocity.
                for i in 0..3 {
                    for k in 0..3 {
                        let unit = if i == k { 1.0 } else { 0.0 };
                        step.by_state[3 + k][i] +=
                            half * more[0] * (unit - along[i] * along[k]) / speed;
                    }
                }
            }
            _ => {}
        }
        step
    }
}

/// What a record is explained by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Description {
    /// How the body moves.
    pub motion: Motion,
    /// How many dipoles it carries, 1 to [`MOST`]: those after the first at an offset from it.
    pub sources: usize,
    /// Whether it has a [quadrupole](super::quadrupole) too, at the place of the first dipole, which
    /// turns with the body. Of the components of the place those that are told are the centre's:
    /// Q m has no part along them, so that the quadrupole has a state less for each.
    pub quadrupole: Option<[bool; 3]>,
    /// Whether a drift of each channel, linear in time, is fitted beside its constant.
    pub drift: bool,
    /// Standard deviation of the attitude of each sensor, rad; exact if `None`.
    pub attitude: Option<f64>,
    /// Of the scale of each sensor, relative to 1.
    pub scale: Option<f64>,
    /// The ambient field over the vacuum permeability, A/m, where the body has a moment that it
    /// induces too: that times a volume (times susceptibility), a state, m^3. Where the body
    /// turns, it and the moment that turns with it are told apart.
    pub induced: Option<[f64; 3]>,
}

/// The most dipoles of one body.
pub const MOST: usize = 4;

impl Default for Description {
    fn default() -> Self {
        Self {
            motion: Motion::Straight,
            sources: 1,
            quadrupole: None,
            drift: false,
            attitude: None,
            scale: None,
            induced: None,
        }
    }
}

impl Description {
    /// Names and units of the states of a further dipole.
    pub fn source(index: usize) -> [(String, &'static str); 6] {
        ["dx", "dy", "dz", "mx", "my", "mz"].map(|name| {
            let unit = if name.starts_with('d') { "m" } else { "A m^2" };
            (
                name.to_string() + &alloc::format!(" of dipole {}", index + 1),
                unit,
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_have_their_derivatives_and_meet_the_straight_pass() {
        let state = [-10.0, -9.0, 5.0, 1.0, 0.8, 0.1, 10.0, 20.0, -10.0];
        let straight = Motion::Straight.at(&state, &[], 3.0);
        for (motion, more) in [
            (Motion::Along, [0.05, 0.0, 0.0]),
            (Motion::Accelerated, [0.05, -0.02, 0.03]),
            (Motion::Turning, [0.04, 0.0, 0.0]),
        ] {
            let count = motion.states();
            let none = motion.at(&state, &[0.0; 3][..count], 3.0);
            for i in 0..3 {
                assert!((none.place[i] - straight.place[i]).abs() < 1e-12);
            }
            let here = motion.at(&state, &more[..count], 3.0);
            let body = [1.0, -2.0, 0.5];
            for k in 0..6 + count {
                let at = |by: f64| {
                    let (mut state, mut more) = (state, more);
                    if k < 6 {
                        state[k] += by;
                    } else {
                        more[k - 6] += by;
                    }
                    motion.at(&state, &more[..count], 3.0)
                };
                let (plus, minus) = (at(1e-6), at(-1e-6));
                let wanted = if k < 6 {
                    here.by_state[k]
                } else {
                    here.by_more[k - 6]
                };
                for i in 0..3 {
                    let slope = (plus.place[i] - minus.place[i]) / 2e-6;
                    assert!((slope - wanted[i]).abs() < 1e-7, "{motion:?} {k} {i}");
                    if k == 6 {
                        let turned = (plus.turn(&body)[i] - minus.turn(&body)[i]) / 2e-6;
                        assert!((turned - here.turn_by_rate(&body)[i]).abs() < 1e-7);
                    }
                }
            }
        }
    }
}
