//! Fisher information of passes from seven moments of the samples.

use core::iter::zip;

use pulp::Simd;

use super::Passes;
use crate::batch::Threads;
use crate::batch::lanes::{Block, LANES, Lanes};
use crate::batch::simd::Path;
use crate::batch::transpose::{Aligned, into_lanes, out_of_lanes};
use crate::dipole::accumulator::{Accumulator, SYMMETRIC};
use crate::dipole::{Error, MU0_OVER_4PI};
use crate::numbers::algebra::{advanced, dot};
use crate::numbers::lane::Lane;

/// Sums over samples of w t^k / r^12, k = 0..=6, with w = 1 / sigma^2.
const MOMENTS: usize = 7;

/// Fisher information (trials, 9, 9) of (r0, v, m) from three-component sensors of one head;
/// `sigma` is one standard deviation or one for each sample.
///
/// # Errors
/// A dipole on a sensor, with the trial.
///
/// # Algorithm
/// All 42 sums of [`Accumulator`] are, at constant velocity, polynomials of the time over
/// r^12: seven moments, the sums of t^k / r^12 for k = 0 to 6, make them all. Times are
/// counted from the sample nearest to the sensor, so that the terms of r^2 and of the
/// polynomials do not cancel. The samples of a trial are in the lanes for the moments; for
/// what is made of them the trials are.
pub fn dipole_fisher(
    passes: &Passes<'_>,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let count = passes.times.size();
    let sensors = passes.sensors.size() / 3;
    let cost = (60.0 + count as f64) * sensors as f64;
    threads.over_groups_with(out, 81, LANES, cost, Space::new, |space, first, out| {
        let passes = passes.skip(first);
        let group = Group { passes, space, out };
        path.run(group)
            .map_err(|(trial, error)| (first + trial, error))
    })
}

/// Trials that follow each other, at most a block.
struct Group<'a> {
    passes: Passes<'a>,
    space: &'a mut Space,
    out: &'a mut [f64],
}

/// Written before it is read: clearing it for each trial would take longer than the rest.
struct Space {
    /// For each trial the moments, each in as many parts as there are lanes.
    parts: Aligned<[[Block; MOMENTS]; LANES]>,
    /// Numbers on their way into lanes or out of them.
    packed: Aligned<[Block; 81]>,
}

impl Space {
    fn new() -> Self {
        Self {
            parts: Aligned([[[0.0; LANES]; MOMENTS]; LANES]),
            packed: Aligned([[0.0; LANES]; 81]),
        }
    }

    /// The moments, one trial in each lane.
    #[inline(always)]
    fn moments<S: Simd>(&mut self, simd: S) -> [Lanes<S>; MOMENTS] {
        let size = MOMENTS * S::F64_LANES;
        let mut from: [&[f64]; LANES] = [&[]; LANES];
        for lane in 0..LANES {
            from[lane] = &self.parts.0[lane].as_flattened()[..size];
        }
        let packed = &mut self.packed.0.as_flattened_mut()[..size * S::F64_LANES];
        into_lanes(simd, &from, packed);
        let mut sums = [Lanes::splat(simd, 0.0); MOMENTS];
        for (k, part) in packed.chunks_exact(S::F64_LANES).enumerate() {
            let sum = &mut sums[k / S::F64_LANES];
            *sum = *sum + Lanes::of(simd, part);
        }
        sums
    }
}

impl pulp::WithSimd for Group<'_> {
    type Output = Result<(), (usize, Error)>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let lanes = S::F64_LANES;
        for (part, out) in self.out.chunks_mut(81 * lanes).enumerate() {
            let passes = self.passes.skip(part * lanes);
            side_by_side(simd, &passes, self.space, out)
                .map_err(|(lane, error)| (part * lanes + lane, error))?;
        }
        Ok(())
    }
}

/// The information of as many trials as `out` has room for, at most one a lane.
#[inline(always)]
fn side_by_side<S: Simd>(
    simd: S,
    passes: &Passes<'_>,
    space: &mut Space,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let trials = out.len() / 81;
    // Lanes without a trial repeat the first.
    let trial = |lane: usize| if lane < trials { lane } else { 0 };
    let position = triple(simd, |lane| passes.position.get(trial(lane)));
    let velocity = triple(simd, |lane| passes.velocity.get(trial(lane)));
    let moment = triple(simd, |lane| passes.moment.get(trial(lane)));
    let zero = Lanes::splat(simd, 0.0);
    let mut sums = Accumulator::filled(zero);
    for sensor in 0..passes.sensors.size() / 3 {
        let at = |lane: usize| &passes.sensors.get(trial(lane))[3 * sensor..3 * sensor + 3];
        let place = triple(simd, at);
        let mut start = position;
        for axis in 0..3 {
            start[axis] = position[axis] - place[axis];
        }
        let mut samples = Samples::zeros();
        let near = Nearest::of(simd, passes, trials, &start, &velocity, &mut samples)?;
        for lane in 0..trials.min(S::F64_LANES) {
            let (times, sigma) = (passes.times.get(lane), passes.sigma.get(lane));
            samples.sum(simd, lane, times, sigma, &mut space.parts.0[lane]);
        }
        near.add_information(&moment, &space.moments(simd), &mut sums);
    }
    let matrix = sums.spread();
    let packed = &mut space.packed.0.as_flattened_mut()[..81 * S::F64_LANES];
    for (entry, to) in zip(matrix.as_flattened(), packed.chunks_exact_mut(S::F64_LANES)) {
        entry.put(to);
    }
    out_of_lanes(simd, packed, 81, 81, out);
    Ok(())
}

/// Three numbers of each trial, one trial in each lane: as [`into_lanes`] places them.
#[inline(always)]
fn triple<'a, S: Simd>(simd: S, from: impl Fn(usize) -> &'a [f64]) -> [Lanes<S>; 3] {
    let mut numbers = [&[][..]; LANES];
    for lane in 0..LANES {
        numbers[lane] = &from(lane)[..3];
    }
    let mut packed = Aligned([[0.0; LANES]; 3]);
    let packed = &mut packed.0.as_flattened_mut()[..3 * S::F64_LANES];
    into_lanes(simd, &numbers, packed);
    let mut out = [Lanes::splat(simd, 0.0); 3];
    for axis in 0..3 {
        out[axis] = Lanes::of(simd, &packed[axis * S::F64_LANES..]);
    }
    out
}

/// The numbers in the lanes, trial by trial.
#[inline(always)]
fn apart<S: Simd, const N: usize>(simd: S, lanes: [Lanes<S>; N]) -> [[f64; N]; LANES] {
    let mut packed = Aligned([[0.0; LANES]; N]);
    let packed = &mut packed.0.as_flattened_mut()[..N * S::F64_LANES];
    for (lanes, to) in zip(lanes, packed.chunks_exact_mut(S::F64_LANES)) {
        lanes.put(to);
    }
    let mut out = [[0.0; N]; LANES];
    out_of_lanes(simd, packed, N, N, out.as_flattened_mut());
    out
}

/// Passes seen from the sample nearest to the sensor, with the distance there as unit of
/// length.
struct Nearest<L> {
    /// When, counted from the first time.
    time: L,
    distance: L,
    position: [L; 3],
    velocity: [L; 3],
    /// r^2 = 1 + linear t + square t^2.
    linear: L,
    square: L,
}

impl<S: Simd> Nearest<Lanes<S>> {
    /// The passes of the first `trials` lanes; what their samples need goes to `samples`.
    #[inline(always)]
    fn of(
        simd: S,
        passes: &Passes<'_>,
        trials: usize,
        start: &[Lanes<S>; 3],
        velocity: &[Lanes<S>; 3],
        samples: &mut Samples,
    ) -> Result<Self, (usize, Error)> {
        // Where nothing moves the first sample will do.
        let (zero, speed) = (Lanes::splat(simd, 0.0), dot(velocity, velocity));
        let along = -dot(start, velocity);
        let after = speed.select_greater(zero, along / speed, zero);
        let passed = apart(simd, [after]);
        let (mut indices, mut elapsed) = ([0; LANES], [[0.0; 3]; LANES]);
        for lane in 0..trials.min(S::F64_LANES) {
            let times = passes.times.get(lane);
            indices[lane] = nearest(times, times[0] + passed[lane][0]);
            samples.clock[lane] = times[indices[lane]];
            elapsed[lane][0] = samples.clock[lane] - times[0];
        }
        let [time, _, _] = triple(simd, |lane| &elapsed[lane]);
        let place = advanced(start, velocity, time);
        let distance = dot(&place, &place).sqrt();
        let inverse = distance.recip();
        let (mut position, mut velocity) = (place, *velocity);
        for axis in 0..3 {
            position[axis] = place[axis] * inverse;
            velocity[axis] = velocity[axis] * inverse;
        }
        let linear = dot(&position, &velocity).times(2.0);
        let square = dot(&velocity, &velocity);
        let found = apart(simd, [inverse, linear, square]);
        for lane in 0..trials.min(S::F64_LANES) {
            // 1 / r^8 stands before the sums.
            if !(found[lane][0] > 0.0 && found[lane][0] < 1e38) {
                let index = indices[lane];
                return Err((lane, Error::OnSensor { index }));
            }
            (samples.linear[lane], samples.square[lane]) = (found[lane][1], found[lane][2]);
        }
        Ok(Self {
            time,
            distance,
            position,
            velocity,
            linear,
            square,
        })
    }
}

/// The index of the time nearest to `closest`.
#[inline(always)]
fn nearest(times: &[f64], closest: f64) -> usize {
    let after = times.partition_point(|&t| t < closest).min(times.len() - 1);
    let before = after.saturating_sub(1);
    if closest - times[before] < times[after] - closest {
        before
    } else {
        after
    }
}

impl<L: Lane> Nearest<L> {
    /// Adds the information that the moments `s` of the samples make.
    #[inline(always)]
    fn add_information(&self, m: &[L; 3], s: &[L; MOMENTS], out: &mut Accumulator<L>) {
        let (a, b) = (&self.position, &self.velocity);
        let (zero, one) = (self.time.splat(0.0), self.time.splat(1.0));
        let range = [one, self.linear, self.square];
        let along = [dot(a, m), dot(b, m)];
        let size = dot(m, m);
        // Polynomials of time, named for their tensor in the formulas of
        // `Accumulator` times r^12.
        let fourth = multiply::<L, 3, 3, 5>(&range, &range);
        let squared = multiply::<L, 2, 2, 3>(&along, &along);
        let unit = multiply::<L, 3, 3, 5>(&squared, &range);
        let mut mixed = multiply::<L, 2, 3, 4>(&along, &range);
        for x in &mut mixed {
            *x = x.times(-2.0);
        }
        let mut radial = squared;
        for i in 0..3 {
            radial[i] = size.mul_add(range[i], squared[i].times(5.0));
        }
        let unit_cross = multiply::<L, 2, 5, 6>(&along, &fourth);
        let sixth = multiply::<L, 3, 5, 7>(&range, &fourth);

        let unit = sums::<L, 5, 3>(&unit, s);
        let mixed = sums::<L, 4, 4>(&mixed, s);
        let radial = sums::<L, 3, 5>(&radial, s);
        let fourth = sums::<L, 5, 3>(&fourth, s);
        let unit_cross = sums::<L, 6, 2>(&unit_cross, s);
        let [sixth] = sums::<L, 7, 1>(&sixth, s);

        let inverse = self.distance.recip();
        let cube = (inverse * inverse * inverse).times(MU0_OVER_4PI);
        let quartic = (cube * inverse).times(3.0);
        let (by_position, by_both, by_moment) = (quartic * quartic, quartic * cube, cube * cube);
        let t = self.time;
        for (e, &(i, j)) in SYMMETRIC.iter().enumerate() {
            let diagonal = i == j;
            let (aa, bb, mm) = (a[i] * a[j], b[i] * b[j], m[i] * m[j]);
            let ab = a[i].mul_add(b[j], b[i] * a[j]);
            let am = a[i].mul_add(m[j], m[i] * a[j]);
            let bm = b[i].mul_add(m[j], m[i] * b[j]);
            let mut powers = [zero; 3];
            for p in 0..3 {
                let mut sum = mixed[p].mul_add(am, mixed[p + 1] * bm);
                sum = radial[p].mul_add(aa, sum);
                sum = radial[p + 1].mul_add(ab, sum);
                sum = radial[p + 2].mul_add(bb, sum);
                sum = fourth[p].mul_add(mm, sum);
                if diagonal {
                    sum = sum + unit[p];
                }
                powers[p] = by_position * sum;
            }
            let first = t.mul_add(powers[0], powers[1]);
            let second = t.mul_add(first, t.mul_add(powers[1], powers[2]));
            let tensor = fourth[0].mul_add(aa, fourth[1].mul_add(ab, fourth[2] * bb));
            let mut moments = tensor.times(3.0);
            if diagonal {
                moments = moments + sixth;
            }
            out.position[0][e] = out.position[0][e] + powers[0];
            out.position[1][e] = out.position[1][e] + first;
            out.position[2][e] = out.position[2][e] + second;
            out.moment[e] = by_moment.mul_add(moments, out.moment[e]);
        }
        for i in 0..3 {
            for j in 0..3 {
                let (aa, bb) = (a[i] * a[j], b[i] * b[j]);
                let ab = a[i].mul_add(b[j], b[i] * a[j]);
                let am = a[i].negate_mul_add(m[j], (m[i] * a[j]).times(2.0));
                let bm = b[i].negate_mul_add(m[j], (m[i] * b[j]).times(2.0));
                let mut powers = [zero; 2];
                for p in 0..2 {
                    let mut sum = mixed[p].mul_add(aa, mixed[p + 1] * ab);
                    sum = mixed[p + 2].mul_add(bb, sum).times(2.0);
                    sum = fourth[p].mul_add(am, sum);
                    sum = fourth[p + 1].mul_add(bm, sum);
                    if i == j {
                        sum = sum - unit_cross[p];
                    }
                    powers[p] = by_both * sum;
                }
                let e = 3 * i + j;
                out.cross[0][e] = out.cross[0][e] + powers[0];
                out.cross[1][e] = out.cross[1][e] + t.mul_add(powers[0], powers[1]);
            }
        }
    }
}

/// The product of two polynomials.
#[inline(always)]
fn multiply<L: Lane, const A: usize, const B: usize, const C: usize>(
    a: &[L; A],
    b: &[L; B],
) -> [L; C] {
    let mut out = [a[0].splat(0.0); C];
    for i in 0..A {
        for j in 0..B {
            out[i + j] = a[i].mul_add(b[j], out[i + j]);
        }
    }
    out
}

/// The sums over all samples of t^p times a polynomial, for p below `P`.
#[inline(always)]
fn sums<L: Lane, const C: usize, const P: usize>(
    polynomial: &[L; C],
    moments: &[L; MOMENTS],
) -> [L; P] {
    let mut out = [moments[0].splat(0.0); P];
    for p in 0..P {
        for k in 0..C {
            out[p] = polynomial[k].mul_add(moments[p + k], out[p]);
        }
    }
    out
}

/// The samples of one sensor, trial by trial.
struct Samples {
    /// The time of the nearest sample.
    clock: Block,
    /// As in [`Nearest`].
    linear: Block,
    square: Block,
}

impl Samples {
    #[inline(always)]
    fn zeros() -> Self {
        Self {
            clock: [0.0; LANES],
            linear: [0.0; LANES],
            square: [0.0; LANES],
        }
    }

    /// Sums over the samples of one trial, in parts.
    #[inline(always)]
    fn sum<S: Simd>(
        &self,
        simd: S,
        trial: usize,
        times: &[f64],
        sigma: &[f64],
        parts: &mut [Block; MOMENTS],
    ) {
        let clock = Lanes::splat(simd, self.clock[trial]);
        let linear = Lanes::splat(simd, self.linear[trial]);
        let square = Lanes::splat(simd, self.square[trial]);
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let mut sums = [zero; MOMENTS];
        let common = sigma.len() == 1;
        let (vectors, rest) = S::as_simd_f64s(times);
        let (deviations, _) = S::as_simd_f64s(sigma);
        for (k, &time) in vectors.iter().enumerate() {
            let t = Lanes::new(simd, time) - clock;
            let weight = if common {
                one
            } else {
                let sigma = Lanes::new(simd, deviations[k]);
                (sigma * sigma).recip()
            };
            add_sample(t, weight, common, linear, square, &mut sums);
        }
        if !rest.is_empty() {
            // In lanes without a sample the weight is zero, and t, where r is one.
            let (mut t, mut weight) = ([0.0; LANES], [0.0; LANES]);
            for (lane, &time) in rest.iter().enumerate() {
                t[lane] = time - self.clock[trial];
                weight[lane] = if common {
                    1.0
                } else {
                    let sigma = sigma[times.len() - rest.len() + lane];
                    1.0 / (sigma * sigma)
                };
            }
            let (t, weight) = (Lanes::load(simd, &t, 0), Lanes::load(simd, &weight, 0));
            add_sample(t, weight, false, linear, square, &mut sums);
        }
        let weight = if common {
            1.0 / (sigma[0] * sigma[0])
        } else {
            1.0
        };
        let parts = parts.as_flattened_mut();
        for (sum, to) in zip(sums, parts.chunks_exact_mut(S::F64_LANES)) {
            sum.times(weight).put(to);
        }
    }
}

/// Adds w t^k / r^12 of one sample in each lane; `even`: where the weight is one.
#[inline(always)]
fn add_sample<L: Lane>(t: L, weight: L, even: bool, linear: L, square: L, sums: &mut [L; MOMENTS]) {
    let one = t.splat(1.0);
    let squared = t * t;
    let q = t.mul_add(t.mul_add(square, linear), one).recip();
    let cube = q * q * q;
    let mut w = cube * cube;
    if !even {
        w = w * weight;
    }
    let w2 = w * squared;
    let w4 = w2 * squared;
    sums[0] = sums[0] + w;
    sums[1] = w.mul_add(t, sums[1]);
    sums[2] = sums[2] + w2;
    sums[3] = w2.mul_add(t, sums[3]);
    sums[4] = sums[4] + w4;
    sums[5] = w4.mul_add(t, sums[5]);
    sums[6] = w4.mul_add(squared, sums[6]);
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::cast_possible_truncation)]
mod tests {
    use super::super::three;
    use super::*;
    use crate::batch::{Items, Stream};
    use crate::dipole::Pass;
    use alloc::vec::Vec;

    /// The sums sample by sample, as the accumulator takes them.
    fn plain(times: &[f64], pass: &Pass<f64>, sensors: &[f64], sigma: &[f64]) -> [[f64; 9]; 9] {
        let mut sums = Accumulator::new();
        for sensor in sensors.chunks_exact(3) {
            for (k, &t) in times.iter().enumerate() {
                let t = t - times[0];
                let s = sigma[if sigma.len() == 1 { 0 } else { k }];
                let place = pass.offset(&three(sensor), t);
                sums.push(t, &place, &pass.moment, 1.0 / (s * s)).unwrap();
            }
        }
        sums.matrix()
    }

    fn far(a: &[[f64; 9]; 9], b: &[f64]) -> f64 {
        let mut far = 0.0_f64;
        for i in 0..9 {
            for j in 0..9 {
                let size = (a[i][i] * a[j][j]).sqrt();
                far = far.max((a[i][j] - b[9 * i + j]).abs() / size);
            }
        }
        far
    }

    #[test]
    fn seven_moments_make_the_42_sums_on_every_path() {
        let mut worst = 0.0_f64;
        for trial in 0..400 {
            let mut random = Stream::new(3, trial);
            let count = 1 + (trial as usize * 7) % 60;
            let duration = 10.0_f64.powf(4.0 * random.uniform() - 1.0);
            let state: [f64; 9] = core::array::from_fn(|i| match i {
                0..3 => 20.0 * random.normal(),
                3..6 => 10.0_f64.powf(3.0 * random.uniform() - 2.0) * random.normal(),
                _ => 50.0 * random.normal(),
            });
            let pass = Pass::of(&state);
            let times: Vec<f64> = (0..count)
                .map(|k| 100.0 + duration * (k as f64 + 0.3 * random.uniform()) / count as f64)
                .collect();
            let sigma: Vec<f64> = if trial % 2 == 0 {
                alloc::vec![1e-9]
            } else {
                (0..count)
                    .map(|_| 1e-9 * (1.0 + random.uniform()))
                    .collect()
            };
            let sensors = [0.0, 0.0, 0.0, 0.5, -0.2, 0.1];
            let wanted = plain(&times, &pass, &sensors, &sigma);
            for path in Path::available() {
                let mut out = [0.0; 81];
                let passes = Passes {
                    position: Items::shared(&state[..3]),
                    velocity: Items::shared(&state[3..6]),
                    moment: Items::shared(&state[6..]),
                    times: Items::shared(&times),
                    sigma: Items::shared(&sigma),
                    sensors: Items::shared(&sensors),
                    baselines: &[],
                    ambient: None,
                    quadrupole: None,
                };
                dipole_fisher(&passes, Threads::One, path, &mut out).unwrap();
                worst = worst.max(far(&wanted, &out));
            }
        }
        assert!(worst < 1e-11, "{worst}");
    }

    #[test]
    fn each_trial_of_a_batch_is_its_own() {
        let mut random = Stream::new(4, 0);
        let states: Vec<[f64; 9]> = (0..13)
            .map(|_| core::array::from_fn(|i| [10.0, 1.0, 30.0][i / 3] * random.normal()))
            .collect();
        let parts = |first: usize| -> Vec<f64> {
            states
                .iter()
                .flat_map(|x| x[first..first + 3].to_vec())
                .collect()
        };
        let (position, velocity, moment) = (parts(0), parts(3), parts(6));
        let times: Vec<f64> = (0..21).map(f64::from).collect();
        let sigma: Vec<f64> = times.iter().map(|t| 1e-9 * (1.0 + t / 20.0)).collect();
        let sensors = [0.0, 0.0, 0.0, 0.5, -0.2, 0.1];
        for path in Path::available() {
            for trials in 1..=states.len() {
                let mut out = alloc::vec![0.0; 81 * trials];
                let passes = Passes {
                    position: Items::each(&position, 3),
                    velocity: Items::each(&velocity, 3),
                    moment: Items::each(&moment, 3),
                    times: Items::shared(&times),
                    sigma: Items::shared(&sigma),
                    sensors: Items::shared(&sensors),
                    baselines: &[],
                    ambient: None,
                    quadrupole: None,
                };
                dipole_fisher(&passes, Threads::One, path, &mut out).unwrap();
                for (state, out) in states.iter().zip(out.chunks_exact(81)) {
                    let wanted = plain(&times, &Pass::of(state), &sensors, &sigma);
                    let off = far(&wanted, out);
                    assert!(off < 1e-11, "{path:?} {trials}: {off}");
                }
            }
        }
    }

    #[test]
    fn a_radial_pass_between_samples_is_fine_and_a_sample_on_the_sensor_is_not() {
        let times = [0.0, 1.0, 2.0, 3.0];
        let run = |x: f64| {
            let mut out = [0.0; 81];
            let start = [x, 0.0, 0.0];
            let passes = Passes {
                position: Items::shared(&start),
                velocity: Items::shared(&[1.0, 0.0, 0.0]),
                moment: Items::shared(&[1.0, 2.0, 3.0]),
                times: Items::shared(&times),
                sigma: Items::shared(&[1.0]),
                sensors: Items::shared(&[0.0, 0.0, 0.0]),
                baselines: &[],
                ambient: None,
                quadrupole: None,
            };
            dipole_fisher(&passes, Threads::One, Path::Best, &mut out).map(|()| out)
        };
        let state = [-1.5, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 3.0];
        let wanted = plain(&times, &Pass::of(&state), &[0.0; 3], &[1.0]);
        let given = far(&wanted, &run(-1.5).unwrap());
        assert!(given < 1e-13, "{given}");
        assert_eq!(run(-2.0), Err((0, Error::OnSensor { index: 2 })));
    }
}
