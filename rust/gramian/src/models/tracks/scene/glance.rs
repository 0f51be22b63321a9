//! A look at a track at a few of the times at which each sensor looks: how well the places are
//! known there, and what rounding leaves of them.

use super::kernels::MOST;
use super::{Group, Moving, Scene};
use crate::batch::lanes::{Block, LANES, Lanes};
use crate::models::tracks::carrier::Carried;
use crate::models::tracks::motion::{
    Change, CoordinatedTurn, Legs, Motion, Polynomial, SteadyLegs,
};
use crate::numbers::lane::Lane;

/// Samples of a sensor that are looked at: the first, the last and those between.
const LOOKS: usize = 5;

/// Those of one sensor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Glance {
    samples: [usize; LOOKS],
    /// How many of them differ: none of a sensor without samples.
    count: usize,
    /// Times after the reference time.
    times: Block,
    /// The largest size of a stamp, s.
    pub(super) far: f64,
}

impl Glance {
    pub(super) fn new(stamps: &[f64], instants: &[f64]) -> Self {
        let mut glance = Self {
            samples: [0; LOOKS],
            count: 0,
            times: [0.0; LANES],
            far: stamps.iter().fold(0.0_f64, |far, t| far.max(t.abs())),
        };
        glance.count = LOOKS.min(instants.len());
        for k in 1..glance.count {
            glance.samples[k] = k * (instants.len() - 1) / (glance.count - 1);
        }
        for k in 0..glance.count {
            glance.times[k] = instants[glance.samples[k]];
        }
        glance
    }

    /// The samples.
    pub(super) fn samples(&self) -> &[usize] {
        &self.samples[..self.count]
    }
}

/// What is seen of a track at those times; in the plane the third component has anything in it.
#[derive(Default)]
struct Seen {
    place: [Block; 3],
    velocity: [Block; 3],
    /// Sum of the variances of the components of the place.
    variance: Block,
}

/// Writes that.
struct Look<'a, M, const D: usize> {
    motion: &'a M,
    x: &'a [f64],
    times: &'a Block,
    /// By how much the stamps are late, s.
    late: f64,
    /// Of so many states, those of the motion the first.
    covariance: Option<(&'a [f64], usize)>,
    seen: &'a mut Seen,
}

impl<M: Motion<D>, const D: usize> pulp::WithSimd for Look<'_, M, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let zero = Lanes::splat(simd, 0.0);
        let states = self.motion.states();
        let mut x = [zero; MOST];
        for k in 0..states {
            x[k] = Lanes::splat(simd, self.x[k]);
        }
        let mut changes = [Change::zero(zero); MOST];
        for part in 0..Lanes::<S>::PARTS {
            let u = Lanes::load(simd, self.times, part) - Lanes::splat(simd, self.late);
            let now = self.motion.at(&x, u, &mut changes);
            for axis in 0..D {
                now.place[axis].store(&mut self.seen.place[axis], part);
                now.velocity[axis].store(&mut self.seen.velocity[axis], part);
            }
            let Some((covariance, n)) = self.covariance else {
                continue;
            };
            let mut variance = zero;
            for axis in 0..D {
                for i in 0..states {
                    let row = &covariance[i * n..][..states];
                    let mut sum = zero;
                    for j in 0..i {
                        let entry = Lanes::splat(simd, row[j]);
                        sum = Lane::mul_add(entry, changes[j].place[axis], sum);
                    }
                    // The same again from above the diagonal.
                    sum = sum + sum;
                    let by = changes[i].place[axis];
                    sum = Lane::mul_add(Lanes::splat(simd, row[i]), by, sum);
                    variance = Lane::mul_add(by, sum, variance);
                }
            }
            variance.store(&mut self.seen.variance, part);
        }
    }
}

impl Scene {
    fn look(
        &self,
        group: &Group,
        x: &[f64],
        late: f64,
        covariance: Option<(&[f64], usize)>,
    ) -> Seen {
        let mut seen = Seen::default();
        let (times, out) = (&group.glance.times, &mut seen);
        with_motion!(&self.motion, motion => if self.dimension == 2 {
            self.path.run(Look::<_, 2> { motion, x, times, late, covariance, seen: out });
        } else {
            self.path.run(Look::<_, 3> { motion, x, times, late, covariance, seen: out });
        });
        seen
    }

    /// Square of the distance from a carrier at one of the samples that were looked at.
    fn square(&self, seen: &Seen, carrier: &Carried, sample: usize, lane: usize) -> f64 {
        let own = &carrier.place[sample * self.dimension..][..self.dimension];
        own.iter()
            .zip(&seen.place)
            .map(|(own, place)| (place[lane] - own).powi(2))
            .sum()
    }

    /// The largest deviation of the target's place while the sensors look, over the least
    /// of their usual distances: by the covariance of all states, at five times of each
    /// sensor. Infinite where the covariance is, 0 where no sensor has a place.
    ///
    /// All along the track, not at its first place alone: a velocity, or the last leg,
    /// may be open where the start is known.
    pub fn vagueness(&self, x: &[f64], covariance: &[f64]) -> f64 {
        if !x.iter().chain(covariance).all(|x| x.is_finite()) {
            return f64::INFINITY;
        }
        let (mut widest, mut nearest) = (0.0_f64, f64::INFINITY);
        for group in self.groups.iter().filter(|group| group.count > 0) {
            let Some(carrier) = &group.channel.carrier else {
                continue;
            };
            let seen = self.look(group, x, 0.0, Some((covariance, x.len())));
            let mut away = [0.0; LOOKS];
            let used = group.glance.count;
            for (k, &sample) in group.glance.samples().iter().enumerate() {
                away[k] = self.square(&seen, carrier, sample, k);
                widest = widest.max(seen.variance[k]);
            }
            // A target that passes close by is no worse known for it: its usual distance.
            away[..used].sort_by(f64::total_cmp);
            let median = 0.5 * (away[(used - 1) / 2].sqrt() + away[used / 2].sqrt());
            nearest = nearest.min(median);
        }
        if nearest.is_infinite() {
            return 0.0;
        }
        (widest.max(0.0).sqrt() / nearest).min(f64::MAX)
    }

    /// The largest rounding of an offset, relative to its length, at five times of each
    /// sensor.
    pub(super) fn coarseness(&self, x: &[f64]) -> f64 {
        let mut coarse = 0.0_f64;
        for group in self.groups.iter().filter(|group| group.count > 0) {
            let late = self.value(x, group.channel.clock);
            let seen = self.look(group, x, late, None);
            for (k, &sample) in group.glance.samples().iter().enumerate() {
                let (mut place, mut velocity) = ([0.0; 3], [0.0; 3]);
                for axis in 0..self.dimension {
                    place[axis] = seen.place[axis][k];
                    velocity[axis] = seen.velocity[axis][k];
                }
                let d = self.dimension;
                let grain = self.grain(group, x, sample, &place[..d], &velocity[..d]);
                coarse = coarse.max(grain.place);
            }
        }
        coarse
    }
}
