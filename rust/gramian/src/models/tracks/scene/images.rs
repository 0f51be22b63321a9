//! Other names of a state, and other states that read alike or nearly so.

use alloc::vec::Vec;
use core::f64::consts::PI;
use core::ops::Range;

use super::{Kind, Measured, Moving, Parameter, Scene};
use crate::scalar::wrapped;

/// Images of a track about its observers: so many directions of a half turn.
const DIRECTIONS: usize = 12;

impl Scene {
    /// Where the speed of the motion is, and the courses; of velocities there is none.
    fn polar(&self) -> Option<(usize, Range<usize>)> {
        let d = self.dimension;
        match &self.motion {
            Moving::SteadyLegs(times) => Some((d, d + 1..d + 2 + times.turns().count())),
            Moving::CoordinatedTurn => Some((d, d + 1..d + 2)),
            Moving::Polynomial { .. } | Moving::Legs(_) => None,
        }
    }

    /// One name for one motion: speeds not below zero, courses within half a turn of `near`.
    pub(crate) fn normalize(&self, x: &mut [f64], near: impl Fn(usize) -> f64) {
        let Some((speed, courses)) = self.polar() else {
            return;
        };
        if x[speed] < 0.0 {
            turn_round(x, speed, courses.clone());
        }
        for k in courses {
            x[k] = near(k) + wrapped(x[k] - near(k));
        }
    }

    /// Whether a state is the same after a whole turn: a course, the bias of bearings.
    fn is_angle(&self, k: usize) -> bool {
        if let Some((_, courses)) = self.polar()
            && courses.contains(&k)
        {
            return true;
        }
        let Some(which) = k.checked_sub(self.motion_states) else {
            return false;
        };
        let state = Parameter::State(which);
        let mut biased = false;
        for group in &self.groups {
            let channel = &group.channel;
            let own = [channel.clock, channel.scale];
            if own.iter().chain(&channel.parameters).any(|&p| p == state) {
                return false;
            }
            for &(factor, parameter) in &channel.bias {
                if parameter == state {
                    if !channel.kind.wraps() || factor.abs() != 1.0 {
                        return false;
                    }
                    biased = true;
                }
            }
        }
        biased
    }

    /// The shortest usual time from sample to sample of a sensor, s; 0 of one sample.
    fn usual_step(&self) -> f64 {
        let median = |times: &[f64]| {
            let mut steps: Vec<f64> = times.windows(2).map(|t| (t[1] - t[0]).abs()).collect();
            steps.retain(|&step| step > 0.0);
            steps.sort_by(f64::total_cmp);
            steps.get(steps.len() / 2).copied()
        };
        let all = self.groups.iter().filter_map(|g| median(&g.instants));
        all.min_by(f64::total_cmp).unwrap_or(0.0)
    }

    /// The track of a state about its observers turned, and its mirror images, where no sensor
    /// has directions of its own: exactly alike across the line of observers that keep to it,
    /// and of others where to look for what reads nearly alike.
    pub(super) fn images(&self, x: &[f64]) -> Vec<Vec<f64>> {
        let directed = |kind| {
            matches!(
                kind,
                Kind::Bearing | Kind::Elevation | Kind::Position | Kind::Course
            )
        };
        let mut found: Vec<Vec<f64>> = self.mirrored(x).into_iter().collect();
        if self.groups.iter().any(|group| directed(group.channel.kind)) {
            return found;
        }
        let d = self.dimension;
        let (mut sum, mut count) = ([0.0; 2], 0.0);
        for group in &self.groups {
            for carried in [&group.channel.carrier, &group.channel.second] {
                for place in carried.iter().flat_map(|c| c.place.chunks_exact(d)) {
                    sum = [sum[0] + place[0], sum[1] + place[1]];
                    count += 1.0;
                }
            }
        }
        if count == 0.0 {
            return found;
        }
        let center = sum.map(|s| s / count);
        for k in 0..DIRECTIONS {
            let angle = PI * k as f64 / DIRECTIONS as f64;
            found.push(self.image(x, center, angle, true));
            if k > 0 {
                found.push(self.image(x, center, 2.0 * angle, false));
            }
        }
        found
    }

    /// The mirror image of a state across the line of all carriers, where all sensors
    /// read the same there: ranges, frequencies and cone angles from one straight path.
    pub fn mirrored(&self, x: &[f64]) -> Option<Vec<f64>> {
        if self.dimension != 2 {
            return None;
        }
        // Any two different places span the line; headings must lie along it.
        let mut places = Vec::new();
        let mut axes = Vec::new();
        for group in &self.groups {
            let channel = &group.channel;
            if matches!(
                channel.kind,
                Kind::Bearing | Kind::Elevation | Kind::Position | Kind::Course
            ) {
                return None;
            }
            for carried in [&channel.carrier, &channel.second].into_iter().flatten() {
                places.extend(carried.place.chunks_exact(2));
                if channel.kind == Kind::ConeAngle {
                    axes.extend(carried.axis.chunks_exact(2));
                }
            }
        }
        let origin = *places.first()?;
        let mut far = (0.0, [0.0; 2]);
        for place in &places {
            let offset = [place[0] - origin[0], place[1] - origin[1]];
            let length = offset[0].hypot(offset[1]);
            if length > far.0 {
                far = (length, offset.map(|x| x / length));
            }
        }
        if far.0 == 0.0 {
            // One place: any line through it mirrors, but for an axis.
            let axis = axes.first()?;
            far.1 = [axis[0], axis[1]];
        }
        let [ue, un] = far.1;
        let large = origin[0].abs().max(origin[1].abs()).max(far.0);
        let off = |place: &[f64]| ((place[0] - origin[0]) * un - (place[1] - origin[1]) * ue).abs();
        if places.iter().any(|place| off(place) > 1e-9 * large)
            || axes.iter().any(|a| (a[0] * un - a[1] * ue).abs() > 1e-9)
        {
            return None;
        }
        Some(self.image(x, [origin[0], origin[1]], ue.atan2(un), true))
    }

    /// A state whose track is turned about a place by a course, or mirrored across the line
    /// through it in that course.
    fn image(&self, x: &[f64], center: [f64; 2], course: f64, mirrored: bool) -> Vec<f64> {
        let d = self.dimension;
        let twice = if mirrored { 2.0 * course } else { course };
        let (sin, cos) = twice.sin_cos();
        let vector = |v: [f64; 2]| {
            if mirrored {
                [sin * v[1] - cos * v[0], cos * v[1] + sin * v[0]]
            } else {
                [cos * v[0] + sin * v[1], cos * v[1] - sin * v[0]]
            }
        };
        let angle = |given: f64| {
            wrapped(if mirrored {
                twice - given
            } else {
                twice + given
            })
        };
        let mut out = x.to_vec();
        let place = vector([x[0] - center[0], x[1] - center[1]]);
        (out[0], out[1]) = (place[0] + center[0], place[1] + center[1]);
        let velocities = match &self.motion {
            Moving::Polynomial { order } => *order,
            Moving::Legs(times) => times.turns().count() + 1,
            Moving::SteadyLegs(_) | Moving::CoordinatedTurn => 0,
        };
        for k in 1..=velocities {
            let v = vector([x[d * k], x[d * k + 1]]);
            out[d * k..d * k + 2].copy_from_slice(&v);
        }
        if let Some((_, courses)) = self.polar() {
            for k in courses {
                out[k] = angle(x[k]);
            }
        }
        if mirrored && matches!(self.motion, Moving::CoordinatedTurn) {
            out[d + 2] = -x[d + 2];
        }
        out
    }
}

/// The value beside which an angle is written: the mean of its prior, if it has one.
pub(super) fn anchor(mean: &[f64], sigma: &[f64], k: usize) -> f64 {
    if sigma[k].is_finite() { mean[k] } else { 0.0 }
}

/// The same motion with the opposite sign of its speed.
fn turn_round(x: &mut [f64], speed: usize, courses: Range<usize>) {
    x[speed] = -x[speed];
    for course in &mut x[courses] {
        *course += PI;
    }
}

impl Measured<'_> {
    /// Speed and courses where none of them is known, so that either sign of the speed is the
    /// same motion.
    fn polar(&self) -> Option<(usize, Range<usize>)> {
        let (speed, courses) = self.scene.polar()?;
        let free = |k: usize| self.known[k].is_none();
        (free(speed) && courses.clone().all(free)).then_some((speed, courses))
    }

    /// All states `to` as they are written beside `from`.
    pub(super) fn rename(&self, to: &mut [f64], from: &[f64]) {
        if let Some((speed, courses)) = self.polar()
            && to[speed] * from[speed] < 0.0
        {
            turn_round(to, speed, courses);
        }
        for k in self.free().filter(|&k| self.scene.is_angle(k)) {
            to[k] = from[k] + wrapped(to[k] - from[k]);
        }
    }

    /// Makes the speed one that is not below zero; whether it was.
    pub(super) fn go_ahead(&self, x: &mut [f64]) -> bool {
        match self.polar() {
            Some((speed, courses)) if x[speed] < 0.0 => {
                turn_round(x, speed, courses);
                true
            }
            _ => false,
        }
    }

    /// Where state `k` of all is written: a speed is not below zero, an angle within half a
    /// turn; a target turns by less than half a turn from sample to sample.
    pub(super) fn written(&self, x: &[f64], k: usize) -> (f64, f64) {
        if self.scene.is_angle(k) {
            return (x[k] - PI, x[k] + PI);
        }
        if self.polar().is_some_and(|(speed, _)| speed == k) && x[k] >= 0.0 {
            return (0.0, f64::INFINITY);
        }
        let turns = matches!(self.scene.motion, Moving::CoordinatedTurn);
        let step = if turns && k == self.scene.dimension + 2 {
            self.scene.usual_step()
        } else {
            0.0
        };
        if step > 0.0 && x[k].abs() < PI / step {
            return (-PI / step, PI / step);
        }
        (f64::NEG_INFINITY, f64::INFINITY)
    }
}
