//! Other passes that give sensors the same readings, or nearly so.

use alloc::vec::Vec;

use super::super::Pass;
use super::super::description::Motion;
use super::{Measured, Part, cross, three};
use crate::numbers::algebra::dot;

/// Turns of a whole one that are tried.
const TURNS: u32 = 16;
/// Passes of so many times twice or half the size are tried.
const DOUBLINGS: i32 = 4;

impl Measured {
    /// The range at the closest point of a straight pass, seen from the first sensor, and its
    /// derivatives by (r0, v, m).
    pub(in crate::models::dipole) fn closest(&self, state: &[f64; 9]) -> (f64, [f64; 9]) {
        let seen: [f64; 3] = core::array::from_fn(|i| state[i] - self.places[0][i]);
        let velocity = three(&state[3..]);
        let squared = dot(&velocity, &velocity);
        let time = if squared > 0.0 {
            -dot(&seen, &velocity) / squared
        } else {
            0.0
        };
        let place: [f64; 3] = core::array::from_fn(|i| seen[i] + time * velocity[i]);
        let range = dot(&place, &place).sqrt();
        // At the closest point a change of its time changes nothing.
        let unit = place.map(|p| p / range.max(f64::MIN_POSITIVE));
        let by = core::array::from_fn(|i| match i {
            0..3 => unit[i],
            3..6 => time * unit[i - 3],
            _ => 0.0,
        });
        (range, by)
    }

    /// The mirror image about a single sensor, where knowledge does not exclude it.
    pub(super) fn mirrored(&self, x: &[f64]) -> Option<Vec<f64>> {
        if self.places.len() != 1 {
            return None;
        }
        // About the middle of a gradiometer, with the opposite moment.
        let heads: Vec<[f64; 3]> = self.sensors().heads(0).map(|h| h.place).collect();
        let count = heads.len() as f64;
        let center: [f64; 3] =
            core::array::from_fn(|i| heads.iter().map(|h| h[i]).sum::<f64>() / count);
        let sign = if heads.len() == 1 { 1.0 } else { -1.0 };
        let excluded = (0..9).any(|i| {
            let still = match i {
                0..3 => center[i],
                3..6 => 0.0,
                _ => return sign < 0.0 && self.knowledge.exact[i].is_some_and(|m| m != 0.0),
            };
            self.knowledge.exact[i].is_some_and(|value| value != still)
        });
        let sided = self.parts.iter().any(|p| matches!(p, Part::Side { .. }));
        if excluded || sided {
            return None;
        }
        let (mut state, _) = self.expand(x);
        for i in 0..3 {
            state[i] = 2.0 * center[i] - state[i];
            state[3 + i] = -state[3 + i];
            state[6 + i] *= sign;
        }
        let mut image = self.coordinates(&state);
        let at = self.layout();
        image[at.motion..].copy_from_slice(&x[at.motion..]);
        if self.description.motion == Motion::Accelerated {
            for a in &mut image[at.motion..at.sources] {
                *a = -*a;
            }
        }
        for index in 1..self.description.sources {
            let own = &mut image[at.sources + 6 * (index - 1)..][..6];
            for offset in &mut own[..3] {
                *offset = -*offset;
            }
            for moment in &mut own[3..] {
                *moment *= sign;
            }
        }
        // Its field is odd where that of a dipole is even.
        for entry in &mut image[at.quadrupole..at.induced] {
            *entry *= -sign;
        }
        if self.description.induced.is_some() {
            image[at.induced] *= sign;
        }
        Some(image)
    }

    /// The reflection in the plane of all heads and the ambient field, where sensors of the total
    /// field lie in one: it turns the field at a head into its reflection, which has the same size
    /// beside the ambient field. None of a body that is more than dipoles on a straight pass, and
    /// about one head, where any plane through the field will do.
    pub(super) fn reflected(&self, x: &[f64]) -> Option<Vec<f64>> {
        let about = &self.description;
        let straight = matches!(about.motion, Motion::Straight | Motion::Along);
        if !straight || about.quadrupole.is_some() || about.induced.is_some() {
            return None;
        }
        let along = unit(self.ambient.as_ref()?)?;
        let sensors = self.sensors();
        let heads: Vec<[f64; 3]> = (0..self.places.len())
            .flat_map(|s| sensors.heads(s).map(|head| head.place))
            .collect();
        let first = *heads.first()?;
        let apart = |head: &[f64; 3]| -> [f64; 3] { core::array::from_fn(|i| head[i] - first[i]) };
        // The head that is farthest from the line along the field spans the plane with it.
        let sides = heads.iter().map(|head| cross(&along, &apart(head)));
        let normal = sides.max_by(|a, b| dot(a, a).total_cmp(&dot(b, b)))?;
        let reach = dot(&normal, &normal).sqrt();
        let normal = unit(&normal)?;
        let flat = |head: &[f64; 3]| dot(&apart(head), &normal).abs() <= 1e-9 * reach;
        if self.parts.iter().any(|p| matches!(p, Part::Side { .. })) || !heads.iter().all(flat) {
            return None;
        }
        let turned = |v: &[f64; 3]| -> [f64; 3] {
            let part = 2.0 * dot(&normal, v);
            core::array::from_fn(|i| v[i] - part * normal[i])
        };
        let (state, _) = self.expand(x);
        let mut image = [0.0; 9];
        let place = turned(&core::array::from_fn(|i| state[i] - first[i]));
        for i in 0..3 {
            image[i] = first[i] + place[i];
        }
        image[3..6].copy_from_slice(&turned(&three(&state[3..])));
        image[6..].copy_from_slice(&turned(&three(&state[6..])));
        let differs = |i: usize| {
            let size = self.knowledge.exact[i]?.abs().max(image[i].abs());
            Some(self.knowledge.exact[i]? - image[i]).filter(|off| off.abs() > 1e-9 * size)
        };
        if (0..9).any(|i| differs(i).is_some()) {
            return None;
        }
        let at = self.layout();
        let mut own = self.coordinates(&image);
        own[at.motion..].copy_from_slice(&x[at.motion..]);
        for vector in own[at.sources..at.quadrupole].as_chunks_mut::<3>().0 {
            *vector = turned(vector);
        }
        Some(own)
    }

    /// Where a search may find other solutions for sensors of the total field and gradiometers,
    /// of which few numbers of each sample leave other passes; none for others. What is known
    /// stays as it is.
    pub fn alike(&self, x: &[f64]) -> Vec<Vec<f64>> {
        let passes = match (&self.ambient, &*self.places, &*self.baselines) {
            (None, _, []) => Vec::new(),
            (Some(ambient), [center], []) => self.turned(x, center, ambient),
            _ => self.sized(x),
        };
        let at = self.layout();
        let states = passes.into_iter().map(|(pass, by)| {
            let mut image = self.coordinates(&pass.state());
            image[at.motion..].copy_from_slice(&x[at.motion..]);
            for entry in &mut image[at.quadrupole..at.induced] {
                *entry *= by;
            }
            image
        });
        states.collect()
    }

    /// Each is a pass, and by what a quadrupole grows with it.
    ///
    /// One sensor of the total field reads the same of a pass that is turned about the ambient
    /// field, or reflected in a plane through that; and where this field is far the stronger
    /// one, nearly the same of one turned about its track, with another moment.
    fn turned(&self, x: &[f64], center: &[f64; 3], ambient: &[f64; 3]) -> Vec<(Pass<f64>, f64)> {
        let (state, _) = self.expand(x);
        let seen: [f64; 3] = core::array::from_fn(|i| state[i] - center[i]);
        let (velocity, moment) = (three(&state[3..]), three(&state[6..]));
        let mut passes = Vec::new();
        for (axis, reflected) in [(ambient, false), (ambient, true), (&velocity, false)] {
            let Some(axis) = unit(axis) else { continue };
            for turn in 0..TURNS {
                let angle = core::f64::consts::TAU * f64::from(turn) / f64::from(TURNS);
                for side in [1.0, -1.0] {
                    let moved = |v: &[f64; 3]| {
                        let v = turned(v, &axis, angle);
                        if reflected { across(&v, &axis) } else { v }
                    };
                    let r = moved(&seen);
                    let pass = Pass {
                        position: core::array::from_fn(|i| center[i] + side * r[i]),
                        velocity: moved(&velocity).map(|v| side * v),
                        moment: moved(&moment),
                    };
                    passes.push((pass, side));
                }
            }
        }
        passes
    }

    /// Several of them read nearly the same of a pass of another size, with the moment that has
    /// as strong a field, and of one turned about the ambient field by a quarter.
    fn sized(&self, x: &[f64]) -> Vec<(Pass<f64>, f64)> {
        let (state, _) = self.expand(x);
        let count = self.places.len() as f64;
        let center: [f64; 3] =
            core::array::from_fn(|i| self.places.iter().map(|p| p[i]).sum::<f64>() / count);
        let axis = self.ambient.as_ref().and_then(unit);
        let quarters = if axis.is_some() { 4 } else { 1 };
        // The field falls as the cube of the distance, a difference of it by one power more.
        let power = if self.baselines.is_empty() { 3 } else { 4 };
        let mut passes = Vec::new();
        for quarter in 0..quarters {
            let angle = core::f64::consts::FRAC_PI_2 * f64::from(quarter);
            let moved = |v: [f64; 3]| axis.map_or(v, |axis| turned(&v, &axis, angle));
            let seen = moved(core::array::from_fn(|i| state[i] - center[i]));
            let (velocity, moment) = (moved(three(&state[3..])), moved(three(&state[6..])));
            for k in -DOUBLINGS..=DOUBLINGS {
                let size = 2.0_f64.powi(k);
                if k != 0 || quarter != 0 {
                    let pass = Pass {
                        position: core::array::from_fn(|i| center[i] + size * seen[i]),
                        velocity: velocity.map(|v| size * v),
                        moment: moment.map(|m| size.powi(power) * m),
                    };
                    passes.push((pass, size.powi(power + 1)));
                }
            }
        }
        passes
    }
}

fn unit(v: &[f64; 3]) -> Option<[f64; 3]> {
    let size = dot(v, v).sqrt();
    (size > 0.0).then(|| v.map(|x| x / size))
}

/// A vector turned about a unit vector.
fn turned(v: &[f64; 3], axis: &[f64; 3], angle: f64) -> [f64; 3] {
    let (sin, cos) = angle.sin_cos();
    let (along, side) = (dot(axis, v), cross(axis, v));
    core::array::from_fn(|i| cos * v[i] + sin * side[i] + (1.0 - cos) * along * axis[i])
}

/// A vector reflected in a plane through an axis.
fn across(v: &[f64; 3], axis: &[f64; 3]) -> [f64; 3] {
    // The coordinate axis that is farthest from it spans the plane with it.
    let mut near = [0.0; 3];
    let least = (0..3).min_by(|&i, &j| axis[i].abs().total_cmp(&axis[j].abs()));
    near[least.unwrap_or(0)] = 1.0;
    let normal = cross(axis, &near);
    let part = 2.0 * dot(&normal, v) / dot(&normal, &normal);
    core::array::from_fn(|i| v[i] - part * normal[i])
}
