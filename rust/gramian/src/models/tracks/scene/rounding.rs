//! What rounding of coordinates and times leaves in the rows of a scene.
//!
//! # Algorithm
//! Offsets between large coordinates carry the rounding of those, and places at times that
//! count from long ago the rounding of the times: a straight path is not straight then, and
//! its rows have full rank. The carriers of all samples are moved by a share of their
//! distance, and turned in velocity, axis by axis; the change of the rows, in proportion,
//! is what rounding leaves in them.

use alloc::vec;
use alloc::vec::Vec;

use super::{Group, Kind, Measured, Parameter, Scene};
use crate::batch::lanes::{Block, LANES};

/// Roundings that count: half of one is the least, and they add up over a path.
const MANY: f64 = 8.0 * f64::EPSILON;

/// By which share of its distance or velocity a carrier is moved.
const SHARE: f64 = 1.0 / 1024.0;

/// Whether places or velocities are moved.
#[derive(Clone, Copy, PartialEq, Eq)]
enum What {
    Places,
    Velocities,
}

/// Rounding of one sample of one sensor.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Grain {
    /// Of the places of target and carriers, relative to their distance.
    pub(super) place: f64,
    /// Of the carriers' velocities, relative to `pace`.
    velocity: f64,
    /// m, from each carrier.
    distances: [f64; 2],
    /// The larger speed of target and carriers, m/s.
    pace: f64,
}

impl Scene {
    /// Rounding of the samples `which` of a sensor.
    fn grains(&self, group: &Group, x: &[f64], which: &[usize]) -> Vec<Grain> {
        let d = self.dimension;
        let late = self.value(x, group.channel.clock);
        let times: Vec<f64> = which.iter().map(|&i| group.instants[i] - late).collect();
        let track = self.motion.track(d, &x[..self.motion_states], &times);
        which
            .iter()
            .zip(track.chunks_exact(2 * d))
            .map(|(&sample, now)| self.grain(group, x, sample, &now[..d], &now[d..]))
            .collect()
    }

    /// Rounding of one sample, with the target's place and velocity then.
    pub(super) fn grain(
        &self,
        group: &Group,
        x: &[f64],
        sample: usize,
        place: &[f64],
        velocity: &[f64],
    ) -> Grain {
        let d = self.dimension;
        let far = group.glance.far;
        let largest = |v: &[f64]| v.iter().fold(0.0_f64, |top, x| top.max(x.abs()));
        let speed = norm(velocity.iter().copied());
        let mut grain = Grain::default();
        let carriers = [&group.channel.carrier, &group.channel.second];
        for (k, carrier) in carriers.iter().enumerate() {
            let Some(carrier) = carrier else { continue };
            let own = &carrier.place[sample * d..][..d];
            let its = norm(carrier.velocity[sample * d..][..d].iter().copied());
            let distance = norm(place.iter().zip(own).map(|(a, b)| a - b));
            let size = largest(place) + largest(own) + largest(&x[..d]);
            let rounding = MANY * (size + far * (speed + its));
            grain.distances[k] = distance;
            grain.place = grain.place.max(rounding / distance);
            grain.pace = grain.pace.max(its).max(speed);
            // Velocities come from differences of places.
            if grain.pace > 0.0 {
                let span = carrier.span[sample];
                grain.velocity = grain.velocity.max(rounding / span / grain.pace);
            }
        }
        grain
    }

    /// How much of the length of each column of the whitened rows (all states) is rounding
    /// of the coordinates and times that the rows are computed from: for
    /// [`rounding::remove`](crate::rounding::remove).
    ///
    /// Reports of the target's own place, speed or course carry none.
    ///
    /// ```
    /// use gramian::tracks::carrier::Carrier;
    /// use gramian::tracks::scene::{Channel, Kind, Moving, Scene};
    /// let coast = Carrier::fixed(&[1e7, 0.0], None)?;
    /// let bearing = Channel::new(Kind::Bearing, vec![0.0], Some(coast.at(&[0.0])?), 1.0);
    /// let scene = Scene::new(2, Moving::Polynomial { order: 0 }, 0.0, 0, vec![bearing]).unwrap();
    /// // A metre off, with coordinates rounded to some nanometres.
    /// let x = [1e7, 1.0];
    /// let noise = scene.rounding(&x);
    /// assert!(noise.iter().all(|noise| (1e-8..1e-6).contains(noise)));
    /// # Ok::<(), gramian::tracks::Error>(())
    /// ```
    pub fn rounding(&self, x: &[f64]) -> Vec<f64> {
        self.rounding_of(x, None)
    }

    fn rounding_of(&self, x: &[f64], present: Option<&[bool]>) -> Vec<f64> {
        let (n, m) = (self.states(), self.measurements);
        let mut noise = vec![0.0; n];
        let (mut values, mut exact) = (vec![0.0; m], vec![0.0; m * n]);
        if self.predict(x, &mut values, Some(&mut exact)).is_err() {
            return noise;
        }
        let grains: Vec<Vec<Grain>> = self
            .groups
            .iter()
            .map(|group| self.grains(group, x, &(0..group.count).collect::<Vec<_>>()))
            .collect();
        for what in [What::Places, What::Velocities] {
            for axis in 0..self.dimension {
                let mut rows = vec![0.0; m * n];
                for (group, grains) in self.groups.iter().zip(&grains) {
                    if what == What::Velocities && !uses_velocity(group) {
                        continue;
                    }
                    let moved = self.moved(group, grains, axis, what);
                    let range = group.first * n..(group.first + group.count * group.width) * n;
                    let read = self.predict_group(&moved, x, &mut values, Some(&mut rows[..]));
                    if read.is_err() {
                        // On the axis of an array, say: nothing is told from here.
                        rows[range].fill(0.0);
                        continue;
                    }
                    let each = group.width * n;
                    let samples = rows[range.clone()].chunks_exact_mut(each);
                    for ((row, exact), grain) in
                        samples.zip(exact[range].chunks_exact(each)).zip(grains)
                    {
                        let share = match what {
                            What::Places => grain.place / SHARE,
                            What::Velocities => grain.velocity / SHARE,
                        };
                        for (x, exact) in row.iter_mut().zip(exact) {
                            *x = (*x - exact) * share;
                        }
                    }
                }
                values.fill(0.0);
                self.whiten(&mut values, Some(&mut rows), present);
                for row in rows.chunks_exact(n) {
                    for (noise, x) in noise.iter_mut().zip(row) {
                        *noise = noise.hypot(*x);
                    }
                }
            }
        }
        noise
    }

    /// A sensor whose carriers are elsewhere, or move otherwise, by a share along an axis.
    fn moved(&self, group: &Group, grains: &[Grain], axis: usize, what: What) -> Group {
        let d = self.dimension;
        let mut moved = group.clone();
        let shift = |carrier: &mut Vec<Block>, which: usize| {
            for (sample, grain) in grains.iter().enumerate() {
                let block = &mut carrier[sample / LANES * 3 * d..][..3 * d];
                let lane = sample % LANES;
                if what == What::Places {
                    block[axis][lane] += SHARE * grain.distances[which];
                } else if grain.velocity > 0.0 {
                    block[d + axis][lane] += SHARE * grain.pace;
                    block[2 * d + axis][lane] += SHARE;
                }
            }
        };
        shift(&mut moved.carrier, 0);
        if let Some(second) = &mut moved.second {
            shift(second, 1);
        }
        moved
    }
}

/// The length of a vector; the square root alone where no square overflows or is lost, since
/// every estimate asks for it.
fn norm(v: impl Iterator<Item = f64> + Clone) -> f64 {
    let square: f64 = v.clone().map(|x| x * x).sum();
    if square.is_normal() {
        square.sqrt()
    } else {
        v.fold(0.0, crate::scalar::hypot)
    }
}

/// Whether the velocity or the heading of the carrier matters.
fn uses_velocity(group: &Group) -> bool {
    let channel = &group.channel;
    matches!(channel.clock, Parameter::State(_))
        || matches!(
            channel.kind,
            Kind::RangeRate | Kind::Frequency(_) | Kind::FrequencyDifference(_) | Kind::ConeAngle
        )
}

impl Measured<'_> {
    /// The same of the measurements that are there, by the free states.
    pub(super) fn rounding_at(&self, x: &[f64]) -> Vec<f64> {
        let noise = self
            .scene
            .rounding_of(&self.full(x), self.present.as_deref());
        noise
            .into_iter()
            .zip(&self.known)
            .filter(|(_, known)| known.is_none())
            .map(|(noise, _)| noise)
            .collect()
    }
}
