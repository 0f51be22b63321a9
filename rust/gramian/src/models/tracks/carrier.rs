//! Carriers: where a sensor is, how fast and with which heading, at any time of its path.

use alloc::vec;
use alloc::vec::Vec;

use super::Error;

/// Places, velocities and headings of a carrier at the times of some samples, each with
/// `D` components a sample.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Carried {
    /// m.
    pub place: Vec<f64>,
    /// m/s.
    pub velocity: Vec<f64>,
    /// Unit vectors; zero where there is no heading.
    pub axis: Vec<f64>,
    /// Time over which each velocity was taken from the path, one number a sample, s; infinite
    /// where it was not.
    pub span: Vec<f64>,
}

/// A path with times, or a fixed place.
#[derive(Clone, Debug, PartialEq)]
pub struct Carrier {
    dimension: usize,
    times: Vec<f64>,
    path: Vec<f64>,
    velocity: Option<Vec<f64>>,
    heading: Option<Vec<f64>>,
}

impl Carrier {
    /// A fixed place, with the axis of an array there, if any (rad, clockwise from north).
    ///
    /// # Errors
    /// [`Error::Number`] for what is not finite.
    pub fn fixed(place: &[f64], heading: Option<f64>) -> Result<Self, Error> {
        crate::scalar::check_finite("path", place)?;
        crate::scalar::check_finite("heading", heading.as_slice())?;
        Ok(Self {
            dimension: place.len(),
            times: Vec::new(),
            path: place.to_vec(),
            velocity: Some(vec![0.0; place.len()]),
            heading: heading.map(|heading| vec![heading]),
        })
    }

    /// A path: places (m, D) at increasing times (m), straight in between. Velocities
    /// (m, D) and headings (m, rad) are taken from the path where they are not given.
    ///
    /// # Errors
    /// [`Error::Number`], [`Error::PathTimes`].
    pub fn along(
        dimension: usize,
        times: &[f64],
        path: &[f64],
        velocity: Option<&[f64]>,
        heading: Option<&[f64]>,
    ) -> Result<Self, Error> {
        use crate::scalar::{check_finite, check_length};
        check_finite("times", times)?;
        check_finite("path", path)?;
        check_length("path", path.len(), times.len() * dimension)?;
        if times.is_empty() {
            check_length("times", 0, 1)?;
        }
        for i in 1..times.len() {
            if !(times[i] > times[i - 1]) {
                return Err(Error::PathTimes {
                    index: i,
                    given: times[i],
                    before: times[i - 1],
                });
            }
        }
        if let Some(velocity) = velocity {
            check_finite("velocity", velocity)?;
            check_length("velocity", velocity.len(), path.len())?;
        }
        if let Some(heading) = heading {
            check_finite("heading", heading)?;
            check_length("heading", heading.len(), times.len())?;
        }
        Ok(Self {
            dimension,
            times: times.to_vec(),
            path: path.to_vec(),
            velocity: velocity.map(<[f64]>::to_vec),
            heading: heading.map(<[f64]>::to_vec),
        })
    }

    /// Number of dimensions.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Places, velocities and headings at `times`.
    ///
    /// At a corner of the path the velocity is that over both pieces.
    ///
    /// # Errors
    /// [`Error::OutsidePath`].
    pub fn at(&self, times: &[f64]) -> Result<Carried, Error> {
        let d = self.dimension;
        let mut out = Carried::default();
        let knots = self.times.len();
        for (index, &time) in times.iter().enumerate() {
            if knots == 0 {
                out.place.extend_from_slice(&self.path);
                out.velocity.extend(core::iter::repeat_n(0.0, d));
                out.span.push(f64::INFINITY);
                push_axis(&mut out.axis, d, self.heading.as_ref().map(|h| h[0]), &[]);
                continue;
            }
            let (first, last) = (self.times[0], self.times[knots - 1]);
            // What rounding of a time makes is not outside.
            let slack = 1e-9 * (last - first).max(1e-3);
            if !(time >= first - slack && time <= last + slack) {
                return Err(Error::OutsidePath {
                    index,
                    given: time,
                    first,
                    last,
                });
            }
            let next = self.times.partition_point(|&t| t <= time);
            let left = next.saturating_sub(1).min(knots.saturating_sub(2));
            let right = (left + 1).min(knots - 1);
            let span = self.times[right] - self.times[left];
            let part = if span > 0.0 {
                (time - self.times[left]) / span
            } else {
                0.0
            };
            let mix = |values: &[f64], width: usize, k: usize| {
                let (a, b) = (values[left * width + k], values[right * width + k]);
                a + part * (b - a)
            };
            let mut velocity = [0.0; 3];
            for k in 0..d {
                out.place.push(mix(&self.path, d, k));
                velocity[k] = match &self.velocity {
                    Some(given) => mix(given, d, k),
                    None => self.slope(time, left, k),
                };
            }
            out.span.push(match &self.velocity {
                Some(_) => f64::INFINITY,
                None => self
                    .pieces(time, left)
                    .fold(f64::INFINITY, |least, (a, b)| {
                        least.min(self.times[b] - self.times[a])
                    }),
            });
            out.velocity.extend_from_slice(&velocity[..d]);
            let heading = self.heading.as_ref().map(|h| {
                let turn = crate::scalar::wrapped(h[right] - h[left]);
                h[left] + part * turn
            });
            push_axis(&mut out.axis, d, heading, &velocity[..d]);
        }
        Ok(out)
    }

    /// Headings at `times`, clockwise from north, rad: those given, or those of the velocity.
    ///
    /// # Errors
    /// [`Error::OutsidePath`]; [`Error::NoHeading`] where none is given and the carrier rests.
    pub fn headings(&self, times: &[f64]) -> Result<Vec<f64>, Error> {
        let axis = self.at(times)?.axis;
        let axes = axis.chunks_exact(self.dimension.max(1)).enumerate();
        axes.map(|(index, axis)| match axis {
            [east, north, ..] if *east != 0.0 || *north != 0.0 => Ok(east.atan2(*north)),
            _ => Err(Error::NoHeading { index }),
        })
        .collect()
    }

    /// The pieces of the path, by their ends, that a sample in the one from knot `left` on
    /// takes its velocity from: that one, or at a knot both.
    fn pieces(&self, time: f64, left: usize) -> impl Iterator<Item = (usize, usize)> {
        let knots = self.times.len();
        let mut first = left;
        let mut count = usize::from(knots > 1);
        if knots > 1 {
            let span = self.times[left + 1] - self.times[left];
            for knot in [left, left + 1] {
                if (time - self.times[knot]).abs() <= 1e-9 * span && knot > 0 && knot + 1 < knots {
                    (first, count) = (knot - 1, 2);
                    break;
                }
            }
        }
        (first..first + count).map(|a| (a, a + 1))
    }

    /// The slope of component `k` at `time`, in the piece from knot `left` on.
    fn slope(&self, time: f64, left: usize, k: usize) -> f64 {
        let d = self.dimension;
        let (mut sum, mut count) = (0.0, 0.0);
        for (a, b) in self.pieces(time, left) {
            sum += (self.path[b * d + k] - self.path[a * d + k]) / (self.times[b] - self.times[a]);
            count += 1.0;
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }
}

fn push_axis(axis: &mut Vec<f64>, d: usize, heading: Option<f64>, velocity: &[f64]) {
    let start = axis.len();
    axis.resize(start + d, 0.0);
    let axis = &mut axis[start..];
    if let Some(heading) = heading {
        (axis[0], axis[1]) = heading.sin_cos();
    } else {
        let length = velocity.iter().fold(0.0_f64, |sum, x| sum.hypot(*x));
        if length > 0.0 {
            for (axis, x) in axis.iter_mut().zip(velocity) {
                *axis = x / length;
            }
        }
    }
}
