//! Where to begin: states that the measurements suggest without any iteration.
//!
//! Bearings, bearings with ranges or elevations, and positions are linear equations on the
//! place of the target (Li & Sheng 2009, eq. 3, for bearings): for a motion that is linear
//! in its states, one least-squares problem, again with the first range held at each of a
//! ladder of ranges. Turn times that are unknown are scanned. Other sensors leave points on
//! circles about the carrier.

use alloc::vec;
use alloc::vec::Vec;

use super::images::anchor;
use super::kernels::MOST;
use super::{
    CoordinatedTurn, Group, Kind, Legs, Moving, Parameter, Polynomial, Scene, SteadyLegs, TurnTimes,
};
use crate::scalar::wrapped;
use crate::square_root::{rotate_in, triangularize};
use crate::tracks::motion::{Change, Motion};

/// A linear equation on the place at a time: weights . place = value.
struct Equation {
    time: f64,
    weights: [f64; 3],
    value: f64,
}

impl Scene {
    /// States to begin from, for measurements with NaN for what is missing. `mean` and
    /// `sigma` are a prior of all states (infinite deviations for none), `known` the
    /// values of states that are known, NaN elsewhere.
    pub fn starts(
        &self,
        measurements: &[f64],
        mean: &[f64],
        sigma: &[f64],
        known: &[f64],
    ) -> Vec<Vec<f64>> {
        let nuisance = self.nuisance_starts(measurements, mean, sigma, known);
        let equations = self.equations(measurements, &nuisance);
        let sight = self.first_sight(measurements, &nuisance);
        let mut motions: Vec<Vec<f64>> = Vec::new();
        let linear = |moving: &Moving, out: &mut Vec<(Moving, Vec<f64>)>| {
            let states = moving.states(self.dimension);
            // A prior of the motion's own states counts too, where they are the same.
            let prior = (*moving == self.motion).then_some((mean, sigma));
            // Once as it is, and with the first range at each of a ladder.
            let mut held: Vec<Option<Equation>> = Vec::new();
            if equations.len() >= states {
                held.push(None);
            }
            if let Some((along, ranges)) = &sight {
                held.extend(ranges.iter().map(|range| {
                    Some(Equation {
                        time: along.time,
                        weights: along.weights,
                        value: along.value + range,
                    })
                }));
            }
            for x in self.fit(moving, states, &equations, &held, prior) {
                out.push((moving.clone(), x));
            }
        };
        let mut found: Vec<(Moving, Vec<f64>)> = Vec::new();
        for moving in self.linear_motions() {
            linear(&moving, &mut found);
        }
        if found.is_empty() || equations.is_empty() {
            for place in self.circle(measurements) {
                let mut x = vec![0.0; 2 * self.dimension];
                x[..self.dimension].copy_from_slice(&place);
                found.push((Moving::Polynomial { order: 1 }, x));
            }
        }
        for (moving, x) in &found {
            self.translate(moving, x, &mut motions);
        }
        let mut out: Vec<Vec<f64>> = motions
            .into_iter()
            .map(|mut x| {
                x.extend_from_slice(&nuisance);
                x
            })
            .collect();
        // The prior itself, where it says where the target is.
        if sigma[..self.dimension].iter().all(|s| s.is_finite())
            && let Some(first) = out.first().cloned()
        {
            let mut x = first;
            for k in 0..self.motion_states {
                if sigma[k].is_finite() {
                    x[k] = mean[k];
                }
            }
            out.push(x);
        }
        for x in &mut out {
            self.normalize(x, |k| anchor(mean, sigma, k));
            for (x, known) in x.iter_mut().zip(known) {
                if !known.is_nan() {
                    *x = *known;
                }
            }
        }
        out.retain(|x| x.iter().all(|x| x.is_finite()));
        out
    }

    fn span(&self) -> (f64, f64) {
        let mut span = (f64::INFINITY, f64::NEG_INFINITY);
        for group in &self.groups {
            for t in &group.channel.times {
                let u = t - self.reference;
                span = (span.0.min(u), span.1.max(u));
            }
        }
        if span.0 > span.1 { (0.0, 0.0) } else { span }
    }

    /// Motions that are linear in their states and near this scene's.
    fn linear_motions(&self) -> Vec<Moving> {
        let (first, last) = self.span();
        let at = |part: f64| first + part * (last - first);
        let grid = |count: usize| -> Vec<Vec<f64>> {
            let parts: &[f64] = match count {
                1 => &[0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8],
                _ => &[0.15, 0.3, 0.45, 0.6, 0.75, 0.9],
            };
            let mut sets: Vec<Vec<f64>> = vec![Vec::new()];
            for _ in 0..count {
                sets = sets
                    .iter()
                    .flat_map(|set| {
                        parts
                            .iter()
                            .map(|&part| at(part))
                            .filter(|t| set.last().is_none_or(|last| t > last))
                            .map(|t| {
                                let mut set = set.clone();
                                set.push(t);
                                set
                            })
                            .collect::<Vec<_>>()
                    })
                    .collect();
            }
            // An even choice where there are many.
            let step = sets.len().div_ceil(24).max(1);
            sets.into_iter().step_by(step).collect()
        };
        match &self.motion {
            Moving::Polynomial { .. } => vec![self.motion.clone()],
            Moving::Legs(TurnTimes::Known(times)) | Moving::SteadyLegs(TurnTimes::Known(times)) => {
                vec![Moving::Legs(TurnTimes::Known(times.clone()))]
            }
            Moving::Legs(TurnTimes::Unknown(count))
            | Moving::SteadyLegs(TurnTimes::Unknown(count)) => grid(*count)
                .into_iter()
                .map(|times| Moving::Legs(TurnTimes::Known(times)))
                .collect(),
            Moving::CoordinatedTurn => vec![
                Moving::Polynomial { order: 1 },
                Moving::Polynomial { order: 2 },
                Moving::Legs(TurnTimes::Known(vec![at(0.5)])),
            ],
        }
    }

    /// A linear motion in the states of this scene's.
    fn translate(&self, moving: &Moving, x: &[f64], out: &mut Vec<Vec<f64>>) {
        let d = self.dimension;
        let (first, last) = self.span();
        let course = |v: &[f64]| v[0].atan2(v[1]);
        let speed = |v: &[f64]| v[0].hypot(v[1]).max(1e-3);
        // The velocities of its legs.
        let velocities: Vec<&[f64]> = match moving {
            Moving::Legs(times) => (0..=times.turns().count())
                .map(|leg| &x[d * (leg + 1)..d * (leg + 2)])
                .collect(),
            Moving::Polynomial { order } if *order > 0 => vec![&x[d..2 * d]],
            _ => vec![&[0.0; 3][..d]],
        };
        let turns: Vec<f64> = match moving {
            Moving::Legs(TurnTimes::Known(times)) => times.clone(),
            _ => Vec::new(),
        };
        match &self.motion {
            Moving::Polynomial { .. } => {
                let mut next = x.to_vec();
                next.resize(self.motion_states, 0.0);
                out.push(next);
            }
            Moving::Legs(times) | Moving::SteadyLegs(times) => {
                let legs = times.turns().count() + 1;
                let steady = matches!(self.motion, Moving::SteadyLegs(_));
                let mut next = x[..d].to_vec();
                let leg = |k: usize| velocities[k.min(velocities.len() - 1)];
                if steady {
                    let mean = (0..legs).map(|k| speed(leg(k))).sum::<f64>() / legs as f64;
                    next.push(mean);
                    next.extend((0..legs).map(|k| course(leg(k))));
                    if d == 3 {
                        next.push(leg(0)[2]);
                    }
                } else {
                    for k in 0..legs {
                        next.extend_from_slice(leg(k));
                    }
                }
                if let TurnTimes::Unknown(count) = times {
                    for k in 0..*count {
                        next.push(turns.get(k).copied().unwrap_or_else(|| {
                            let part = (k + 1) as f64 / (count + 1) as f64;
                            first + part * (last - first)
                        }));
                    }
                }
                out.push(next);
            }
            Moving::CoordinatedTurn => {
                let half = (0.5 * (last - first)).max(1e-9);
                let (v, rates): (&[f64], Vec<f64>) = match moving {
                    Moving::Legs(_) => {
                        let turn = wrapped(course(velocities[1]) - course(velocities[0]));
                        (velocities[0], vec![turn / half])
                    }
                    Moving::Polynomial { order: 2 } => {
                        let (v, a) = (&x[d..2 * d], &x[2 * d..3 * d]);
                        let square = speed(v) * speed(v);
                        (v, vec![(a[0] * v[1] - a[1] * v[0]) / square])
                    }
                    _ => {
                        let quarter = core::f64::consts::FRAC_PI_2 / (2.0 * half);
                        (velocities[0], vec![0.0, quarter, -quarter])
                    }
                };
                for rate in rates {
                    let early = if matches!(moving, Moving::Legs(_)) {
                        0.5 * half * rate
                    } else {
                        0.0
                    };
                    let mut next = x[..d].to_vec();
                    next.extend([speed(v), course(v) - early, rate]);
                    if d == 3 {
                        next.push(v[2]);
                    }
                    out.push(next);
                }
            }
        }
    }

    /// Means of priors, known values, and what the measurements suggest.
    fn nuisance_starts(
        &self,
        measurements: &[f64],
        mean: &[f64],
        sigma: &[f64],
        known: &[f64],
    ) -> Vec<f64> {
        let first = self.motion_states;
        let mut out = vec![0.0; self.nuisances];
        for group in &self.groups {
            let channel = &group.channel;
            let z = &measurements[group.first..][..group.count * group.width];
            let present: Vec<f64> = z.iter().copied().filter(|z| z.is_finite()).collect();
            let average = present.iter().sum::<f64>() / (present.len() as f64).max(1.0);
            match channel.kind {
                Kind::Frequency(_) => {
                    if let Parameter::State(index) = channel.parameters[0] {
                        out[index] = average;
                    }
                }
                Kind::SignalStrength => {
                    let exponent = match channel.parameters[1] {
                        Parameter::State(index) => {
                            out[index] = 2.0;
                            2.0
                        }
                        Parameter::Fixed(value) => value,
                    };
                    if let Parameter::State(index) = channel.parameters[0] {
                        // At 1 km.
                        out[index] = average + 30.0 * exponent;
                    }
                }
                _ => {}
            }
        }
        for k in 0..self.nuisances {
            if !known[first + k].is_nan() {
                out[k] = known[first + k];
            } else if sigma[first + k].is_finite() {
                out[k] = mean[first + k];
            }
        }
        out
    }

    fn unbiased(group: &Group, z: f64, nuisance: &[f64]) -> f64 {
        let value = |parameter| match parameter {
            Parameter::Fixed(value) => value,
            Parameter::State(index) => nuisance[index],
        };
        let bias: f64 = group
            .channel
            .bias
            .iter()
            .map(|&(factor, p)| factor * value(p))
            .sum();
        (z - bias) / (1.0 + value(group.channel.scale))
    }

    /// The reading of another kind at the same time from the same place.
    fn beside(
        &self,
        kind: Kind,
        time: f64,
        place: &[f64],
        z: &[f64],
        nuisance: &[f64],
    ) -> Option<(f64, f64)> {
        for group in self
            .groups
            .iter()
            .filter(|group| group.channel.kind == kind)
        {
            let channel = &group.channel;
            let Some(carried) = &channel.carrier else {
                continue;
            };
            let i = channel.times.partition_point(|&t| t < time - 1e-9);
            if channel.times.get(i).is_none_or(|t| (t - time).abs() > 1e-9) {
                continue;
            }
            let d = self.dimension;
            let reading = z[group.first + i];
            if reading.is_nan() || carried.place[i * d..(i + 1) * d] != *place {
                continue;
            }
            let sigma = sigma_of(group, i);
            return Some((Self::unbiased(group, reading, nuisance), sigma));
        }
        None
    }

    fn equations(&self, z: &[f64], nuisance: &[f64]) -> Vec<Equation> {
        let d = self.dimension;
        let mut out = Vec::new();
        for group in &self.groups {
            let channel = &group.channel;
            for i in 0..group.count {
                let time = channel.times[i] - self.reference;
                let reading = z[group.first + i * group.width];
                if reading.is_nan() {
                    continue;
                }
                let mut push = |weights: [f64; 3], value: f64, sigma: f64| {
                    out.push(Equation {
                        time,
                        weights: weights.map(|w| w / sigma),
                        value: value / sigma,
                    });
                };
                if channel.kind == Kind::Position {
                    for axis in 0..d {
                        let mut weights = [0.0; 3];
                        weights[axis] = 1.0;
                        push(weights, z[group.first + i * d + axis], sigma_of(group, i));
                    }
                    continue;
                }
                let (Kind::Bearing, Some(carried)) = (channel.kind, &channel.carrier) else {
                    continue;
                };
                let place = &carried.place[i * d..(i + 1) * d];
                let (sine, cosine) = Self::unbiased(group, reading, nuisance).sin_cos();
                let stamp = channel.times[i];
                let range = self.beside(Kind::Range, stamp, place, z, nuisance);
                let lift = self.beside(Kind::Elevation, stamp, place, z, nuisance);
                // A range where none is measured only weighs the angles.
                let far = range.map_or(1000.0, |r| r.0.abs().max(1.0));
                let dot = |w: [f64; 3]| (0..d).map(|k| w[k] * place[k]).sum::<f64>();
                let across = [cosine, -sine, 0.0];
                push(across, dot(across), far * sigma_of(group, i));
                let mut along = [sine, cosine, 0.0];
                if let Some((angle, sigma)) = lift.filter(|_| d == 3) {
                    let (up, level) = angle.sin_cos();
                    let above = [up * sine, up * cosine, -level];
                    push(above, dot(above), far * sigma);
                    along = [level * sine, level * cosine, up];
                }
                if let Some((range, sigma)) = range
                    && (d == 2 || lift.is_some())
                {
                    push(along, dot(along) + range, sigma);
                }
            }
        }
        out
    }

    /// The line of sight of the first bearing, as an equation with the range left out,
    /// and ranges to try.
    fn first_sight(&self, z: &[f64], nuisance: &[f64]) -> Option<(Equation, Vec<f64>)> {
        let d = self.dimension;
        let mut out: Option<Equation> = None;
        for group in &self.groups {
            let channel = &group.channel;
            let (Kind::Bearing, Some(carried)) = (channel.kind, &channel.carrier) else {
                continue;
            };
            let Some(i) = (0..group.count).find(|&i| !z[group.first + i].is_nan()) else {
                continue;
            };
            let time = channel.times[i] - self.reference;
            if out.as_ref().is_some_and(|out| out.time <= time) {
                continue;
            }
            let (sine, cosine) = Self::unbiased(group, z[group.first + i], nuisance).sin_cos();
            let place = &carried.place[i * d..(i + 1) * d];
            // Far heavier than any other: held.
            let weight = 1e3;
            out = Some(Equation {
                time,
                weights: [sine * weight, cosine * weight, 0.0],
                value: weight * (sine * place[0] + cosine * place[1]),
            });
        }
        let equation = out?;
        let measured = self.any_range(z, nuisance);
        let scale = self.scale();
        let ranges: Vec<f64> = match measured {
            Some(range) => vec![range],
            None => [0.3, 1.0, 2.0, 4.0, 8.0, 16.0, 40.0]
                .map(|r| r * scale)
                .to_vec(),
        };
        let weight = equation.weights[0].hypot(equation.weights[1]);
        Some((equation, ranges.iter().map(|r| r * weight).collect()))
    }

    /// The first range that is measured.
    fn any_range(&self, z: &[f64], nuisance: &[f64]) -> Option<f64> {
        let group = self.groups.iter().find(|g| g.channel.kind == Kind::Range)?;
        let reading = (0..group.count)
            .map(|i| z[group.first + i])
            .find(|z| !z.is_nan())?;
        Some(Self::unbiased(group, reading, nuisance).abs())
    }

    /// The size of the paths of the carriers, or 1 km.
    fn scale(&self) -> f64 {
        let d = self.dimension;
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for group in &self.groups {
            for carried in [&group.channel.carrier, &group.channel.second]
                .into_iter()
                .flatten()
            {
                for place in carried.place.chunks_exact(d) {
                    for k in 0..2 {
                        low[k] = low[k].min(place[k]);
                        high[k] = high[k].max(place[k]);
                    }
                }
            }
        }
        let size = (high[0] - low[0]).hypot(high[1] - low[1]);
        if size.is_finite() && size > 0.0 {
            size
        } else {
            1000.0
        }
    }

    /// Points on circles about the first carrier.
    fn circle(&self, z: &[f64]) -> Vec<Vec<f64>> {
        let d = self.dimension;
        let mut centre = vec![0.0; d];
        if let Some(carried) = self.groups.iter().find_map(|g| g.channel.carrier.as_ref())
            && carried.place.len() >= d
        {
            centre.copy_from_slice(&carried.place[..d]);
        }
        let nuisance = vec![0.0; self.nuisances];
        let ranges = match self.any_range(z, &nuisance) {
            Some(range) => vec![range],
            None => [0.2, 0.6, 1.5, 4.0, 12.0]
                .map(|r| r * self.scale())
                .to_vec(),
        };
        let mut out = Vec::new();
        for range in ranges {
            for k in 0..12 {
                let (sine, cosine) =
                    (core::f64::consts::TAU * (f64::from(k) + 0.25) / 12.0).sin_cos();
                let mut place = centre.clone();
                place[0] += range * sine;
                place[1] += range * cosine;
                if d == 3 {
                    place[2] += 0.1 * range;
                }
                out.push(place);
            }
        }
        out
    }

    /// The least-squares states of a linear motion, with each of `held` beside the
    /// equations, which are reduced once; what is not finite goes.
    fn fit(
        &self,
        moving: &Moving,
        states: usize,
        equations: &[Equation],
        held: &[Option<Equation>],
        prior: Option<(&[f64], &[f64])>,
    ) -> Vec<Vec<f64>> {
        let wide = states + 1;
        let mut stack = Vec::with_capacity((equations.len() + states) * wide);
        for equation in equations {
            self.line(moving, states, equation, &mut stack);
        }
        let longest = |k: usize, stack: &[f64]| {
            stack
                .chunks_exact(wide)
                .map(|row| row[k] * row[k])
                .sum::<f64>()
                .sqrt()
        };
        let sizes: Vec<f64> = (0..states).map(|k| longest(k, &stack)).collect();
        for k in 0..states {
            // So little that it decides only what nothing else does.
            let mut line = vec![0.0; wide];
            match prior {
                Some((mean, sigma)) if sigma[k].is_finite() => {
                    line[k] = 1.0 / sigma[k];
                    line[states] = mean[k] / sigma[k];
                }
                _ => line[k] = 1e-7 * sizes[k].max(1e-12),
            }
            stack.extend(line);
        }
        stack.resize(stack.len().max(wide * wide), 0.0);
        let mut work = vec![0.0; wide];
        triangularize(&mut stack, wide, &mut work);
        stack.truncate(wide * wide);
        let mut out = Vec::with_capacity(held.len());
        let mut factor = stack.clone();
        for held in held {
            factor.copy_from_slice(&stack);
            if let Some(equation) = held {
                let mut line = Vec::with_capacity(wide);
                self.line(moving, states, equation, &mut line);
                rotate_in(&mut factor, &mut line);
            }
            let mut x = vec![0.0; states];
            for i in (0..states).rev() {
                let sum = (i + 1..states).fold(factor[i * wide + states], |sum, j| {
                    sum - factor[i * wide + j] * x[j]
                });
                x[i] = sum / factor[i * wide + i];
            }
            if x.iter().all(|x| x.is_finite()) {
                out.push(x);
            }
        }
        out
    }

    /// Appends the row of an equation on the states of a linear motion, and its value.
    fn line(&self, moving: &Moving, states: usize, equation: &Equation, out: &mut Vec<f64>) {
        let zeros = [0.0; MOST];
        let mut changes2 = [Change::<f64, 2>::zero(0.0); MOST];
        let mut changes3 = [Change::<f64, 3>::zero(0.0); MOST];
        with_motion!(moving, motion => if self.dimension == 2 {
            Motion::<2>::at(motion, &zeros[..states], equation.time, &mut changes2);
        } else {
            Motion::<3>::at(motion, &zeros[..states], equation.time, &mut changes3);
        });
        for k in 0..states {
            let mut sum = 0.0;
            for axis in 0..self.dimension {
                let by = if self.dimension == 2 {
                    changes2[k].place[axis]
                } else {
                    changes3[k].place[axis]
                };
                sum += equation.weights[axis] * by;
            }
            out.push(sum);
        }
        out.push(equation.value);
    }
}

/// The deviation of a sample, roughly where its noise is a covariance.
fn sigma_of(group: &Group, sample: usize) -> f64 {
    use super::Noise;
    match &group.channel.noise {
        Noise::Sigma(sigma) | Noise::Correlated { sigma, .. } => {
            sigma[if sigma.len() == 1 {
                0
            } else {
                sample * group.width
            }]
        }
        Noise::Covariance { size, matrix } => {
            let i = (sample * group.width) % size;
            matrix[i * size + i].sqrt()
        }
    }
}
