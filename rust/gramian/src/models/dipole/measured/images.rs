//! Other passes that give a single sensor the same readings.

use alloc::vec::Vec;

use super::super::description::Motion;
use super::{Measured, Part, cross, three};
use crate::numbers::algebra::dot;

/// Turns of a whole one that are tried.
const TURNS: u32 = 16;

impl Measured {
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
        if self.description.induced.is_some() {
            image[at.induced] *= sign;
        }
        Some(image)
    }

    /// Where a search may find other solutions for one sensor of the total field: none for
    /// others. It reads the same of a pass that is turned about the ambient field, or reflected
    /// in a plane through that; and where this field is far the stronger one, nearly the same of
    /// one turned about its track, with another moment. What is known stays as it is.
    pub fn turned(&self, x: &[f64]) -> Vec<Vec<f64>> {
        let (Some(ambient), [center], []) = (&self.ambient, &*self.places, &*self.baselines) else {
            return Vec::new();
        };
        let (state, _) = self.expand(x);
        let seen: [f64; 3] = core::array::from_fn(|i| state[i] - center[i]);
        let (velocity, moment) = (three(&state[3..]), three(&state[6..]));
        let at = self.layout();
        let mut images = Vec::new();
        for (axis, reflected) in [(ambient, false), (ambient, true), (&velocity, false)] {
            let size = dot(axis, axis).sqrt();
            if !(size > 0.0) {
                continue;
            }
            let axis = axis.map(|a| a / size);
            for turn in 0..TURNS {
                let angle = core::f64::consts::TAU * f64::from(turn) / f64::from(TURNS);
                for side in [1.0, -1.0] {
                    let moved = |v: &[f64; 3]| {
                        let v = turned(v, &axis, angle);
                        if reflected { across(&v, &axis) } else { v }
                    };
                    let (r, v, m) = (moved(&seen), moved(&velocity), moved(&moment));
                    let mut other = [0.0; 9];
                    for i in 0..3 {
                        other[i] = center[i] + side * r[i];
                        other[3 + i] = side * v[i];
                        other[6 + i] = m[i];
                    }
                    let mut image = self.coordinates(&other);
                    image[at.motion..].copy_from_slice(&x[at.motion..]);
                    images.push(image);
                }
            }
        }
        images
    }
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
