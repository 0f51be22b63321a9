//! A camera beside an inertial navigator: what its images of landmarks tell of place, attitude,
//! velocity and biases, of how the camera is mounted, of gravity and of scale.
//!
//! States, in this order: place p (m) and attitude q (a unit quaternion, body to world),
//! velocity v (m/s), gyro bias (rad/s) and accelerometer bias (m/s^2) in body axes, and, where
//! they are unknown, those of [`Unknown`]. They move as
//!
//! p' = v, q' = q (0, gyro - bias) / 2, v' = R(q) (accel - bias) + gravity,
//!
//! and a landmark l is seen at (c0 / c2, c1 / c2) with
//! c = camera (1 + turn x) (R(q)^T (scale l - p) - arm).
//!
//! # Source
//! Kelly & Sukhatme 2011, Visual-inertial sensor fusion: localization, mapping and
//! sensor-to-sensor self-calibration, Int. J. Robotics Research 30.

use alloc::vec::Vec;

use super::{Error, cross_matrix};
use crate::numbers::algebra::{cross, multiply};
use crate::scalar::{NumberError, check_finite, check_length};

type Vector = [f64; 3];

/// States that are there in any case: place, attitude, velocity and two biases.
pub const CORE: usize = 16;
const Q: usize = 3;
const V: usize = 7;
const GYRO: usize = 10;
const ACCEL: usize = 13;

/// What may be unknown besides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unknown {
    /// A small turn of the camera about the axes of the body, rad.
    CameraRotation,
    /// Where the camera is, in body axes, m.
    CameraArm,
    /// The acceleration of gravity in world axes, m/s^2.
    Gravity,
    /// Its strength alone, m/s^2.
    GravityStrength,
    /// What the places of the landmarks are multiplied by.
    Scale,
    /// The places of the landmarks in world axes, m.
    Landmarks,
}

impl Unknown {
    /// How many states.
    pub fn len(self, landmarks: usize) -> usize {
        match self {
            Self::GravityStrength | Self::Scale => 1,
            Self::CameraRotation | Self::CameraArm | Self::Gravity => 3,
            Self::Landmarks => 3 * landmarks,
        }
    }
}

/// A camera and a navigator with what they measured.
#[derive(Clone, Debug)]
pub struct Visual {
    /// When samples begin, s; each holds until the next.
    pub times: Vec<f64>,
    /// Measured angular rates, body axes, rad/s.
    pub gyro: Vec<Vector>,
    /// Measured specific forces, body axes, m/s^2.
    pub accel: Vec<Vector>,
    /// From body to camera axes; the third of these looks forward.
    pub camera: [Vector; 3],
    /// Of the camera, body axes, m.
    pub arm: Vector,
    /// World axes, m/s^2; down.
    pub gravity: Vector,
    /// World axes, m.
    pub landmarks: Vec<Vector>,
    /// States beside the core, in this order; gravity or its strength, not both.
    pub unknown: Vec<Unknown>,
}

/// What a state says, with the rest as it was given.
struct Place {
    p: Vector,
    w: f64,
    u: Vector,
    v: Vector,
    gyro: Vector,
    accel: Vector,
    turn: Vector,
    arm: Vector,
    gravity: Vector,
    scale: f64,
}

impl Visual {
    /// Refuses lengths that do not fit and numbers that are not finite.
    ///
    /// # Errors
    /// [`Error::Number`]; [`Error::Times`]; [`Error::Attitude`] for a camera that is no
    /// rotation.
    pub fn check(&self) -> Result<(), Error> {
        let count = self.times.len();
        // One sample holds from its time on: without any nothing is known.
        check_length("times", count, count.max(1))?;
        check_length("gyro", self.gyro.len(), count)?;
        check_length("accel", self.accel.len(), count)?;
        check_finite("times", &self.times)?;
        for (name, values) in [
            ("gyro", self.gyro.as_flattened()),
            ("accel", self.accel.as_flattened()),
            ("landmarks", self.landmarks.as_flattened()),
            ("camera", self.camera.as_flattened()),
            ("arm", &self.arm),
            ("gravity", &self.gravity),
        ] {
            check_finite(name, values)?;
        }
        if let Some(k) = (1..count).find(|&k| self.times[k] <= self.times[k - 1]) {
            return Err(Error::Times {
                index: k,
                given: self.times[k],
            });
        }
        if self.landmarks.is_empty() {
            return Err(NumberError::Length {
                array: "landmarks",
                given: 0,
                wanted: 1,
            }
            .into());
        }
        super::error_model::check_rotation(&self.camera)
    }

    /// Number of states.
    pub fn states(&self) -> usize {
        let more = self.unknown.iter().map(|u| u.len(self.landmarks.len()));
        CORE + more.sum::<usize>()
    }

    /// Number of outputs: two for each landmark.
    pub fn outputs(&self) -> usize {
        2 * self.landmarks.len()
    }

    /// The state at the first sample.
    ///
    /// # Errors
    /// [`Error::Number`] for what is not finite; [`Error::Attitude`] for a quaternion without
    /// unit length.
    pub fn start(&self, place: Vector, q: [f64; 4], velocity: Vector) -> Result<Vec<f64>, Error> {
        check_finite("position", &place)?;
        check_finite("attitude", &q)?;
        check_finite("velocity", &velocity)?;
        if (q.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() > 1e-9 {
            return Err(Error::Attitude);
        }
        let mut x = Vec::with_capacity(self.states());
        x.extend(place);
        x.extend(q);
        x.extend(velocity);
        x.resize(CORE, 0.0);
        for unknown in &self.unknown {
            match unknown {
                Unknown::CameraRotation => x.extend([0.0; 3]),
                Unknown::CameraArm => x.extend(self.arm),
                Unknown::Gravity => x.extend(self.gravity),
                Unknown::GravityStrength => x.push(size(self.gravity)),
                Unknown::Scale => x.push(1.0),
                Unknown::Landmarks => x.extend(self.landmarks.as_flattened()),
            }
        }
        Ok(x)
    }

    /// Where each group of unknown states begins.
    fn groups(&self) -> impl Iterator<Item = (Unknown, usize)> + '_ {
        let mut at = CORE;
        self.unknown.iter().map(move |&unknown| {
            let from = at;
            at += unknown.len(self.landmarks.len());
            (unknown, from)
        })
    }

    fn place(&self, x: &[f64]) -> Place {
        let three = |k: usize| [x[k], x[k + 1], x[k + 2]];
        let mut place = Place {
            p: three(0),
            w: x[Q],
            u: three(Q + 1),
            v: three(V),
            gyro: three(GYRO),
            accel: three(ACCEL),
            turn: [0.0; 3],
            arm: self.arm,
            gravity: self.gravity,
            scale: 1.0,
        };
        for (unknown, k) in self.groups() {
            match unknown {
                Unknown::CameraRotation => place.turn = three(k),
                Unknown::CameraArm => place.arm = three(k),
                Unknown::Gravity => place.gravity = three(k),
                Unknown::GravityStrength => place.gravity = times(x[k], self.down()),
                Unknown::Scale => place.scale = x[k],
                Unknown::Landmarks => {}
            }
        }
        place
    }

    /// The direction of gravity.
    fn down(&self) -> Vector {
        let strength = size(self.gravity);
        let factor = if strength > 0.0 { 1.0 / strength } else { 0.0 };
        times(factor, self.gravity)
    }

    /// The sample that holds at t.
    fn sample(&self, t: f64) -> usize {
        let after = self.times.partition_point(|&time| time <= t);
        after.saturating_sub(1).min(self.times.len() - 1)
    }

    /// x' of one state at t.
    pub fn rate(&self, t: f64, x: &[f64], out: &mut [f64]) {
        let (k, now) = (self.sample(t), self.place(x));
        out.fill(0.0);
        let rate = minus(self.gyro[k], now.gyro);
        out[..3].copy_from_slice(&now.v);
        let turned = cross(&now.u, &rate);
        out[Q] = -0.5 * crate::numbers::algebra::dot(&now.u, &rate);
        for i in 0..3 {
            out[Q + 1 + i] = 0.5 * (now.w * rate[i] + turned[i]);
        }
        let force = rotated(now.w, now.u, minus(self.accel[k], now.accel));
        for i in 0..3 {
            out[V + i] = force[i] + now.gravity[i];
        }
    }

    /// d x' / d x, n x n.
    pub fn rate_jacobian(&self, t: f64, x: &[f64], out: &mut [f64]) {
        let n = self.states();
        let (k, now) = (self.sample(t), self.place(x));
        out.fill(0.0);
        let rate = minus(self.gyro[k], now.gyro);
        let force = minus(self.accel[k], now.accel);
        let by_attitude = rotated_by_attitude(now.w, now.u, force);
        for i in 0..3 {
            out[i * n + V + i] = 1.0;
            out[(Q + 1 + i) * n + Q] = 0.5 * rate[i];
            out[Q * n + Q + 1 + i] = -0.5 * rate[i];
            out[Q * n + GYRO + i] = 0.5 * now.u[i];
            out[(Q + 1 + i) * n + GYRO + i] = -0.5 * now.w;
            for j in 0..4 {
                out[(V + i) * n + Q + j] = by_attitude[j][i];
            }
        }
        for j in 0..3 {
            let (about, toward) = (cross(&axis(j), &rate), cross(&now.u, &axis(j)));
            let line = rotated(now.w, now.u, axis(j));
            for i in 0..3 {
                out[(Q + 1 + i) * n + Q + 1 + j] = 0.5 * about[i];
                out[(Q + 1 + i) * n + GYRO + j] -= 0.5 * toward[i];
                out[(V + i) * n + ACCEL + j] = -line[i];
            }
        }
        for (unknown, at) in self.groups() {
            let down = self.down();
            for i in 0..3 {
                match unknown {
                    Unknown::Gravity => out[(V + i) * n + at + i] = 1.0,
                    Unknown::GravityStrength => out[(V + i) * n + at] = down[i],
                    _ => {}
                }
            }
        }
    }

    /// Where a landmark of number k is, in world axes and in those of body and camera.
    fn seen(&self, k: usize, x: &[f64], now: &Place) -> [Vector; 3] {
        let mut mark = self.landmarks[k];
        for (unknown, at) in self.groups() {
            if unknown == Unknown::Landmarks {
                mark.copy_from_slice(&x[at + 3 * k..at + 3 * k + 3]);
            }
        }
        let away = minus(times(now.scale, mark), now.p);
        let body = minus(rotated(now.w, times(-1.0, now.u), away), now.arm);
        let turned = cross(&now.turn, &body);
        let aligned: Vector = core::array::from_fn(|i| body[i] + turned[i]);
        [mark, body, multiply(&self.camera, &aligned)]
    }

    /// The image coordinates at one state.
    ///
    /// # Errors
    /// [`Error::Behind`] for a landmark that is not in front of the camera.
    pub fn output(&self, t: f64, x: &[f64], out: &mut [f64]) -> Result<(), Error> {
        let now = self.place(x);
        for (k, out) in out.chunks_exact_mut(2).enumerate() {
            let [_, _, c] = self.seen(k, x, &now);
            if !(c[2] > 0.0) {
                return Err(Error::Behind {
                    landmark: k,
                    time: t,
                });
            }
            out.copy_from_slice(&[c[0] / c[2], c[1] / c[2]]);
        }
        Ok(())
    }

    /// d output / d x, p x n.
    pub fn output_jacobian(&self, x: &[f64], out: &mut [f64]) {
        let n = self.states();
        let now = self.place(x);
        out.fill(0.0);
        let back = times(-1.0, now.u);
        let turn = cross_matrix(now.turn);
        for (k, lines) in out.chunks_exact_mut(2 * n).enumerate() {
            let [mark, body, c] = self.seen(k, x, &now);
            let (image_x, image_y) = (c[0] / c[2], c[1] / c[2]);
            let mut put = |column: usize, moved: Vector| {
                // What a move in body axes does to the image.
                let d = multiply(&self.camera, &moved);
                lines[column] += (d[0] - image_x * d[2]) / c[2];
                lines[n + column] += (d[1] - image_y * d[2]) / c[2];
            };
            let with_turn = |a: Vector| -> Vector {
                let b = multiply(&turn, &a);
                core::array::from_fn(|i| a[i] + b[i])
            };
            let away = minus(times(now.scale, mark), now.p);
            let by_attitude = rotated_by_attitude(now.w, back, away);
            put(Q, with_turn(by_attitude[0]));
            for j in 0..3 {
                let line = with_turn(rotated(now.w, back, axis(j)));
                put(j, times(-1.0, line));
                put(Q + 1 + j, with_turn(times(-1.0, by_attitude[1 + j])));
                for (unknown, at) in self.groups() {
                    match unknown {
                        Unknown::CameraRotation => put(at + j, cross(&axis(j), &body)),
                        Unknown::CameraArm => put(at + j, with_turn(times(-1.0, axis(j)))),
                        Unknown::Scale => put(at, times(mark[j], line)),
                        Unknown::Landmarks => put(at + 3 * k + j, times(now.scale, line)),
                        Unknown::Gravity | Unknown::GravityStrength => {}
                    }
                }
            }
        }
    }
}

fn axis(j: usize) -> Vector {
    core::array::from_fn(|i| if i == j { 1.0 } else { 0.0 })
}

fn times(factor: f64, a: Vector) -> Vector {
    a.map(|x| factor * x)
}

fn minus(a: Vector, b: Vector) -> Vector {
    core::array::from_fn(|i| a[i] - b[i])
}

fn size(a: Vector) -> f64 {
    nalgebra::ComplexField::sqrt(a.iter().map(|x| x * x).sum::<f64>())
}

/// R(q) a of the quaternion (w, u).
fn rotated(w: f64, u: Vector, a: Vector) -> Vector {
    let once = cross(&u, &a);
    let inner: Vector = core::array::from_fn(|i| w * a[i] + once[i]);
    let twice = cross(&u, &inner);
    core::array::from_fn(|i| a[i] + 2.0 * twice[i])
}

/// Its derivatives by w and the components of u.
fn rotated_by_attitude(w: f64, u: Vector, a: Vector) -> [Vector; 4] {
    let once = cross(&u, &a);
    let inner: Vector = core::array::from_fn(|i| w * a[i] + once[i]);
    core::array::from_fn(|j| {
        if j == 0 {
            return times(2.0, once);
        }
        let e = axis(j - 1);
        let (first, second) = (cross(&e, &inner), cross(&u, &cross(&e, &a)));
        core::array::from_fn(|i| 2.0 * (first[i] + second[i]))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use alloc::vec;

    use super::*;

    #[test]
    fn jacobians_are_those_of_differences() {
        for gravity in [Unknown::Gravity, Unknown::GravityStrength] {
            compare_with_differences(gravity);
        }
    }

    fn compare_with_differences(gravity: Unknown) {
        let visual = Visual {
            times: vec![0.0, 1.0],
            gyro: vec![[0.3, -0.2, 0.5]; 2],
            accel: vec![[0.4, 0.1, 9.5]; 2],
            camera: [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]],
            arm: [0.1, 0.2, -0.1],
            gravity: [0.1, 0.2, -9.8],
            landmarks: vec![[9.0, 1.0, 2.0], [12.0, -3.0, 1.0]],
            unknown: vec![
                Unknown::CameraRotation,
                Unknown::CameraArm,
                gravity,
                Unknown::Scale,
                Unknown::Landmarks,
            ],
        };
        visual.check().unwrap();
        let q = [0.9, 0.1, -0.2, 0.374_165_738_677_394_1];
        let mut x = visual.start([0.3, 0.2, 0.1], q, [1.0, 0.5, -0.3]).unwrap();
        for (k, x) in x.iter_mut().enumerate() {
            *x += 0.01 * (k as f64).sin();
        }
        let (n, p) = (visual.states(), visual.outputs());
        let (mut by_rate, mut by_output) = (vec![0.0; n * n], vec![0.0; p * n]);
        visual.rate_jacobian(0.5, &x, &mut by_rate);
        visual.output_jacobian(&x, &mut by_output);
        let h = 1e-6;
        for j in 0..n {
            let mut ends = [vec![0.0; n], vec![0.0; n]];
            let mut seen = [vec![0.0; p], vec![0.0; p]];
            for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
                let mut moved = x.clone();
                moved[j] += sign * h;
                visual.rate(0.5, &moved, &mut ends[side]);
                visual.output(0.5, &moved, &mut seen[side]).unwrap();
            }
            for i in 0..n {
                let expected = (ends[0][i] - ends[1][i]) / (2.0 * h);
                assert!((by_rate[i * n + j] - expected).abs() < 1e-8, "rate {i} {j}");
            }
            for i in 0..p {
                let expected = (seen[0][i] - seen[1][i]) / (2.0 * h);
                assert!(
                    (by_output[i * n + j] - expected).abs() < 1e-8,
                    "output {i} {j}"
                );
            }
        }
    }
}
