//! Paths of the closed-form laws, one trial in each lane of a vector.

use super::headings::side;
use crate::batch::lanes::{Block, LANES, Lanes};
use crate::batch::simd::Path;
use crate::batch::{Items, Threads};
use crate::bearings;
use crate::maneuver::{
    AtStandoff, Error, Law, Side, Steering, next_range, turn_to, turned, unchecked_row,
};
use crate::numbers::algebra::advanced;
use crate::numbers::lane::Lane;
use crate::scalar::hypot;
use crate::square_root::SquareRootInformation;

/// What the paths of a batch start from.
#[derive(Clone, Copy, Debug)]
pub struct Paths<'a> {
    /// East and north of the target.
    pub target: Items<'a>,
    /// East and north of the observer at the first sample.
    pub start: Items<'a>,
    /// Length of a leg.
    pub step: Items<'a>,
    /// 1 for right, -1 for left: one for the whole path, or one for each leg.
    pub side: Items<'a>,
    /// Standard deviation of a bearing.
    pub sigma: Items<'a>,
    /// The range not to go below; 0 for none.
    pub standoff: Items<'a>,
    /// The law, the same for all.
    pub law: Law,
    /// What to do at the stand-off range.
    pub at_standoff: AtStandoff,
}

impl Paths<'_> {
    /// The same paths counted from trial `first` on.
    #[must_use]
    fn skip(self, first: usize) -> Self {
        Self {
            target: self.target.skip(first),
            start: self.start.skip(first),
            step: self.step.skip(first),
            side: self.side.skip(first),
            sigma: self.sigma.skip(first),
            standoff: self.standoff.skip(first),
            ..self
        }
    }
}

/// Numbers that [`trajectories`] gives for a path of `samples`: how many samples
/// were flown, positions (samples, 2), bearings, ranges, headings (samples - 1),
/// cumulative information (samples, 2, 2) and its determinant.
pub const fn path_size(samples: usize) -> usize {
    10 * samples
}

/// Paths of `samples` positions, the first at the start; see [`path_size`]. A
/// path that stops keeps its last position and measures no more.
///
/// # Errors
/// As [`Steering::leg`] and [`row`](crate::maneuver::row), with the trial and the sample.
pub fn trajectories(
    paths: Paths<'_>,
    samples: usize,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let size = path_size(samples);
    threads.over_groups(out, size, LANES, 15.0 * samples as f64, |first, out| {
        let paths = paths.skip(first);
        let count = out.len() / size;
        let inputs = Inputs::new(&paths, count);
        let good = path.run(Kernel {
            inputs: &inputs,
            paths: &paths,
            samples,
            count,
            out,
        });
        for (trial, out) in out.chunks_exact_mut(size).enumerate() {
            if good[trial] == 0.0 {
                one_path(&paths, trial, samples, out).map_err(|error| (first + trial, error))?;
            }
        }
        Ok(())
    })
}

/// The numbers of up to eight trials side by side.
#[derive(Default)]
struct Inputs {
    target: [Block; 2],
    start: [Block; 2],
    step: Block,
    sigma: Block,
    standoff: Block,
    /// 1 where the squares of all of them are far from the ends of the numbers.
    good: Block,
    /// Whether any trial has a stand-off range.
    bounded: bool,
}

/// Lengths and deviations between which the vectors square and multiply without a
/// thought; outside, and for an eastern or northern share of a line of sight below
/// `SHARE`, a trial is computed by itself.
const SMALL: f64 = 1e-40;
const LARGE: f64 = 1e40;
const SHARE: f64 = 1e-70;

impl Inputs {
    fn new(paths: &Paths<'_>, count: usize) -> Self {
        let mut all = Self::default();
        for lane in 0..LANES {
            // Lanes beyond the last trial repeat it.
            let trial = lane.min(count - 1);
            let one = |items: Items<'_>| items.get(trial)[0];
            for axis in 0..2 {
                all.target[axis][lane] = paths.target.get(trial)[axis];
                all.start[axis][lane] = paths.start.get(trial)[axis];
            }
            all.step[lane] = one(paths.step);
            all.sigma[lane] = one(paths.sigma);
            all.standoff[lane] = one(paths.standoff);
            let normal = |x: f64| (SMALL..LARGE).contains(&x);
            let good = normal(all.step[lane])
                && normal(all.sigma[lane])
                && (0.0..LARGE).contains(&all.standoff[lane]);
            all.good[lane] = f64::from(u8::from(good));
            all.bounded |= all.standoff[lane] > 0.0;
        }
        all
    }
}

/// The sides of leg `leg` of up to eight trials.
fn sides(paths: &Paths<'_>, count: usize, leg: usize) -> Block {
    let mut block = Block::default();
    for (lane, entry) in block.iter_mut().enumerate() {
        *entry = side_of(paths, lane.min(count - 1), leg).sign();
    }
    block
}

fn side_of(paths: &Paths<'_>, trial: usize, leg: usize) -> Side {
    let given = paths.side.get(trial);
    side(given[leg.min(given.len() - 1)])
}

/// What is written of a sample, one block of trials for each number.
#[derive(Clone, Copy, Default)]
struct Sample {
    position: [Block; 2],
    bearing: Block,
    range: Block,
    heading: Block,
    information: [Block; 3],
    determinant: Block,
}

/// Samples that are kept side by side before they go to their trials' results.
const KEPT: usize = 8;

/// One trial in each lane; returns 1 for each trial that was computed, 0 for those that
/// want to be computed by themselves.
struct Kernel<'a> {
    inputs: &'a Inputs,
    paths: &'a Paths<'a>,
    samples: usize,
    count: usize,
    out: &'a mut [f64],
}

impl pulp::WithSimd for Kernel<'_> {
    type Output = Block;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> Block {
        let mut good = [0.0; LANES];
        for part in 0..self.count.div_ceil(S::F64_LANES) {
            let first = part * S::F64_LANES;
            let size = path_size(self.samples);
            let last = self.count.min(first + S::F64_LANES);
            let out = &mut self.out[first * size..last * size];
            let mut flight = Flight::new(simd, self.inputs, self.paths, part);
            let mut kept = [Sample::default(); KEPT];
            let mut done = 0;
            while done < self.samples {
                let now = KEPT.min(self.samples - done);
                for (k, sample) in kept[..now].iter_mut().enumerate() {
                    flight.measure(part, done + k, sample);
                    if done + k + 1 < self.samples {
                        if done + k == 0 || self.paths.side.size() > 1 {
                            let block = sides(self.paths, self.count, done + k);
                            flight.side = Lanes::load(simd, &block, part);
                        }
                        flight.fly(part, done + k, sample);
                    }
                }
                for (lane, out) in out.chunks_exact_mut(size).enumerate() {
                    hand_out(&kept[..now], first + lane, done, self.samples, out);
                }
                done += now;
            }
            let mut flown = [0.0; LANES];
            flight.flown(self.samples).store(&mut flown, part);
            for (lane, out) in out.chunks_exact_mut(size).enumerate() {
                out[0] = flown[first + lane];
            }
            flight.good.store(&mut good, part);
        }
        good
    }
}

/// Writes the samples from `done` on of one lane to its trial's result.
#[inline(always)]
fn hand_out(kept: &[Sample], lane: usize, done: usize, n: usize, out: &mut [f64]) {
    let Parts {
        positions,
        bearings,
        ranges,
        headings,
        information,
        determinants,
    } = Parts::of(&mut out[1..], n);
    let (positions, information) = (&mut positions[done..], &mut information[done..]);
    for ((sample, position), information) in kept.iter().zip(positions).zip(information) {
        *position = [sample.position[0][lane], sample.position[1][lane]];
        let [xx, xy, yy] = sample.information;
        *information = [xx[lane], xy[lane], xy[lane], yy[lane]];
    }
    for (sample, bearing) in kept.iter().zip(&mut bearings[done..]) {
        *bearing = sample.bearing[lane];
    }
    for (sample, range) in kept.iter().zip(&mut ranges[done..]) {
        *range = sample.range[lane];
    }
    for (sample, heading) in kept.iter().zip(&mut headings[done..]) {
        *heading = sample.heading[lane];
    }
    for (sample, determinant) in kept.iter().zip(&mut determinants[done..]) {
        *determinant = sample.determinant[lane];
    }
}

/// The parts of a result after its count.
struct Parts<'a> {
    positions: &'a mut [[f64; 2]],
    bearings: &'a mut [f64],
    ranges: &'a mut [f64],
    headings: &'a mut [f64],
    information: &'a mut [[f64; 4]],
    determinants: &'a mut [f64],
}

impl<'a> Parts<'a> {
    #[inline(always)]
    fn of(out: &'a mut [f64], n: usize) -> Self {
        let (positions, out) = out.split_at_mut(2 * n);
        let (bearings, out) = out.split_at_mut(n);
        let (ranges, out) = out.split_at_mut(n);
        let (headings, out) = out.split_at_mut(n - 1);
        let (information, determinants) = out.split_at_mut(4 * n);
        Self {
            positions: positions.as_chunks_mut().0,
            bearings,
            ranges,
            headings,
            information: information.as_chunks_mut().0,
            determinants,
        }
    }
}

/// Where the observers of a register of trials are, and what they know.
struct Flight<S: pulp::Simd> {
    simd: S,
    law: Law,
    at_standoff: AtStandoff,
    bounded: bool,
    target: [Lanes<S>; 2],
    step: Lanes<S>,
    side: Lanes<S>,
    /// Standard deviation of a bearing.
    sigma: Lanes<S>,
    standoff: Lanes<S>,
    position: [Lanes<S>; 2],
    /// Line of sight at the last sample: east, north, range and 1 over it.
    sight: [Lanes<S>; 4],
    heading: Lanes<S>,
    /// The information as L D L^T: both entries of D, and what L has below its diagonal.
    pivots: [Lanes<S>; 2],
    below: Lanes<S>,
    /// 1 where the observer still flies.
    moving: Lanes<S>,
    count: Lanes<S>,
    good: Lanes<S>,
}

impl<S: pulp::Simd> Flight<S> {
    #[inline(always)]
    fn new(simd: S, inputs: &Inputs, paths: &Paths<'_>, part: usize) -> Self {
        let load = |block: &Block| Lanes::load(simd, block, part);
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        Self {
            simd,
            law: paths.law,
            at_standoff: paths.at_standoff,
            bounded: inputs.bounded,
            target: [load(&inputs.target[0]), load(&inputs.target[1])],
            step: load(&inputs.step),
            side: one,
            sigma: load(&inputs.sigma),
            standoff: load(&inputs.standoff),
            position: [load(&inputs.start[0]), load(&inputs.start[1])],
            sight: [zero; 4],
            heading: zero,
            pivots: [zero; 2],
            below: zero,
            moving: one,
            count: zero,
            good: load(&inputs.good),
        }
    }

    #[inline(always)]
    fn flown(&self, samples: usize) -> Lanes<S> {
        let all = Lanes::splat(self.simd, samples as f64);
        self.moving.select_greater(self.zero(), all, self.count)
    }

    #[inline(always)]
    fn zero(&self) -> Lanes<S> {
        Lanes::splat(self.simd, 0.0)
    }

    /// `new` where the observer still flies, `old` where it has stopped.
    #[inline(always)]
    fn moved(&self, new: Lanes<S>, old: Lanes<S>) -> Lanes<S> {
        self.moving.select_greater(self.zero(), new, old)
    }

    /// Takes the bearing of sample `k` into the information.
    #[inline(always)]
    fn measure(&mut self, part: usize, k: usize, sample: &mut Sample) {
        let (zero, one) = (self.zero(), Lanes::splat(self.simd, 1.0));
        let east = self.target[0] - self.position[0];
        let north = self.target[1] - self.position[1];
        let square = north.mul_add(north, east * east);
        let range = square.sqrt();
        let inverse = one / range;
        self.sight = [east, north, range, inverse];
        // What is NaN is not good either.
        let large = Lanes::splat(self.simd, LARGE);
        self.good = large.select_greater(range, self.good, zero);
        self.good = range.select_greater(Lanes::splat(self.simd, SMALL), self.good, zero);
        let least = range.times(SHARE);
        for share in [east, north] {
            let size = share.select_greater(zero, share, -share);
            let none = size.select_greater(zero, zero, self.good);
            self.good = size.select_greater(least, self.good, none);
        }
        // The row (a, b), turned into the factor by a rotation without roots: the
        // second pivot is what the row has beside the first, squared, and not a
        // difference of sums.
        let [a, b] = bearings::gradient([east, north], self.sigma);
        let first = a.mul_add(a, self.pivots[0]);
        let inverse = one / first.select_greater(zero, first, one);
        let cosine = first.select_greater(zero, self.pivots[0] * inverse, one);
        let beside = a.negate_mul_add(self.below, b);
        let second = (cosine * beside).mul_add(beside, self.pivots[1]);
        let below = cosine.mul_add(self.below, a * inverse * b);
        self.pivots = [
            self.moved(first, self.pivots[0]),
            self.moved(second, self.pivots[1]),
        ];
        self.below = self.moved(below, self.below);
        let bearing = east.atan2(north);
        if k == 0 {
            // The heading of a path that stops at once.
            self.heading = bearing;
        }
        self.position[0].store(&mut sample.position[0], part);
        self.position[1].store(&mut sample.position[1], part);
        bearing.store(&mut sample.bearing, part);
        range.store(&mut sample.range, part);
        let [first, second] = self.pivots;
        let across = first * self.below;
        first.store(&mut sample.information[0], part);
        across.store(&mut sample.information[1], part);
        across
            .mul_add(self.below, second)
            .store(&mut sample.information[2], part);
        (first * second).store(&mut sample.determinant, part);
    }

    /// Flies the leg after sample `k`.
    #[inline(always)]
    fn fly(&mut self, part: usize, k: usize, sample: &mut Sample) {
        let zero = self.zero();
        let [east, north, range, inverse] = self.sight;
        let (mut cos, mut sin) = self.turn();
        if self.bounded {
            let inside = self.standoff.times(1.0 - f64::EPSILON.sqrt());
            self.good = inside.select_greater(range, self.moved(zero, self.good), self.good);
            let next = next_range(range, self.step, cos);
            match self.at_standoff {
                AtStandoff::Stop => {
                    let stopped = Lanes::splat(self.simd, (k + 1) as f64);
                    let count = self.moved(stopped, self.count);
                    self.count = self.standoff.select_greater(next, count, self.count);
                    self.moving = self.standoff.select_greater(next, zero, self.moving);
                }
                AtStandoff::Circle => {
                    let (c, s) = turn_to(range, self.step, self.standoff);
                    cos = self.standoff.select_greater(next, c, cos);
                    sin = self.standoff.select_greater(next, s, sin);
                }
            }
        }
        let line = [east * inverse, north * inverse];
        let [east, north] = turned(line, (cos, self.side * sin));
        self.heading = self.moved(east.atan2(north), self.heading);
        self.heading.store(&mut sample.heading, part);
        let [x, y] = advanced(&self.position, &[east, north], self.step);
        self.position = [
            self.moved(x, self.position[0]),
            self.moved(y, self.position[1]),
        ];
    }

    /// Cosine and sine of the law's turn: [`Law::turn`].
    #[inline(always)]
    fn turn(&mut self) -> (Lanes<S>, Lanes<S>) {
        let [_, _, range, inverse] = self.sight;
        if let Some(reach) = self.law.reach(range) {
            let short = self.moved(self.zero(), self.good);
            self.good = self.step.select_greater(reach, short, self.good);
        }
        self.law.turn_of(self.step * inverse)
    }
}

/// One path by itself: the plain form of the vectors, and for what they do not take.
fn one_path(paths: &Paths<'_>, trial: usize, n: usize, out: &mut [f64]) -> Result<(), Error> {
    let one = |items: Items<'_>| items.get(trial)[0];
    let mut steering = Steering {
        law: paths.law,
        side: Side::Right,
        step: one(paths.step),
        standoff: one(paths.standoff),
        at_standoff: paths.at_standoff,
    };
    let (target, sigma) = (paths.target.get(trial), one(paths.sigma));
    let target = [target[0], target[1]];
    let mut position = [paths.start.get(trial)[0], paths.start.get(trial)[1]];
    let (count, out) = out.split_at_mut(1);
    let Parts {
        positions,
        bearings,
        ranges,
        headings,
        information,
        determinants,
    } = Parts::of(out, n);
    let mut root = SquareRootInformation::<f64, 2>::new();
    let mut flown = n;
    for k in 0..n {
        let (east, north) = (target[0] - position[0], target[1] - position[1]);
        positions[k] = position;
        bearings[k] = bearings::sight(position, target);
        ranges[k] = hypot(east, north);
        if k < flown {
            root.absorb(&unchecked_row(east, north, sigma).map_err(|error| error.at(k))?);
        }
        let r = root.factor();
        let xy = r[0][0] * r[0][1];
        let yy = r[0][1] * r[0][1] + r[1][1] * r[1][1];
        information[k] = [r[0][0] * r[0][0], xy, xy, yy];
        determinants[k] = root.determinant();
        if k + 1 < n {
            steering.side = side_of(paths, trial, k);
            let leg = if k < flown {
                steering
                    .unchecked_leg(position, target)
                    .map_err(|error| error.at(k))?
            } else {
                None
            };
            if let Some(leg) = leg {
                position = leg.end;
                headings[k] = leg.direction[0].atan2(leg.direction[1]);
            } else {
                flown = flown.min(k + 1);
                headings[k] = if k > 0 { headings[k - 1] } else { bearings[0] };
            }
        }
    }
    count[0] = flown as f64;
    Ok(())
}

#[cfg(test)]
mod tests {
    use alloc::vec::Vec;
    use alloc::{format, vec};

    use super::*;
    use crate::batch::Stream;

    const LAWS: [Law; 5] = [
        Law::MaxDet,
        Law::HammelLiu,
        Law::BearingRate,
        Law::Circle,
        Law::Perpendicular,
    ];

    /// Starts about targets, to both sides, some near their stand-off range.
    struct Batch {
        target: Vec<f64>,
        start: Vec<f64>,
        step: Vec<f64>,
        side: Vec<f64>,
        sigma: Vec<f64>,
        standoff: Vec<f64>,
    }

    impl Batch {
        fn draw(trials: usize, bounded: bool) -> Self {
            let mut stream = Stream::new(11, trials as u64);
            let mut batch = Self {
                target: vec![],
                start: vec![],
                step: vec![],
                side: vec![],
                sigma: vec![],
                standoff: vec![],
            };
            for trial in 0..trials {
                let (target, range) = ([stream.normal(), stream.normal()], 300.0);
                let angle = 6.3 * stream.uniform();
                let range = range * (1.0 + 9.0 * stream.uniform());
                batch.target.extend(target);
                batch.start.extend([
                    target[0] - range * angle.sin(),
                    target[1] - range * angle.cos(),
                ]);
                batch.step.push(2.0 + 5.0 * stream.uniform());
                batch.side.push(if trial % 3 == 0 { -1.0 } else { 1.0 });
                batch.sigma.push(0.01 + stream.uniform());
                let share = 0.9 + 0.1 * stream.uniform();
                let limited = bounded && trial % 4 != 0;
                batch
                    .standoff
                    .push(if limited { share * range } else { 0.0 });
            }
            // Sights along the axes, where entries of rows are zero.
            if trials > 2 {
                batch.start[0..2].copy_from_slice(&[batch.target[0], batch.target[1] - 900.0]);
                batch.start[2..4].copy_from_slice(&[batch.target[2] - 900.0, batch.target[3]]);
                (batch.standoff[0], batch.standoff[1]) = (0.0, 0.0);
            }
            batch
        }

        fn paths(&self, law: Law, at_standoff: AtStandoff) -> Paths<'_> {
            Paths {
                target: Items::each(&self.target, 2),
                start: Items::each(&self.start, 2),
                step: Items::each(&self.step, 1),
                side: Items::each(&self.side, 1),
                sigma: Items::each(&self.sigma, 1),
                standoff: Items::each(&self.standoff, 1),
                law,
                at_standoff,
            }
        }
    }

    /// Compares a result with the plain one, each number by what it is made of.
    fn compare(found: &[f64], plain: &[f64], n: usize, what: &str) {
        assert_eq!(found[0], plain[0], "{what}: samples flown");
        let (mut found, mut plain) = (found[1..].to_vec(), plain[1..].to_vec());
        let (found, plain) = (Parts::of(&mut found, n), Parts::of(&mut plain, n));
        for k in 0..n {
            let range = plain.ranges[k];
            let near = |a: f64, b: f64, size: f64, tolerance: f64, name: &str| {
                assert!(
                    (a - b).abs() <= tolerance * size,
                    "{what}: {name} {k}: {a:e} {b:e}"
                );
            };
            for axis in 0..2 {
                let (a, b) = (found.positions[k][axis], plain.positions[k][axis]);
                near(a, b, range, 1e-13, "position");
            }
            near(found.ranges[k], range, range, 1e-13, "range");
            let turn = |a: f64, b: f64, name: &str| {
                near(crate::scalar::wrapped(a - b), 0.0, 1.0, 1e-12, name);
            };
            turn(found.bearings[k], plain.bearings[k], "bearing");
            if k + 1 < n {
                turn(found.headings[k], plain.headings[k], "heading");
            }
            let (a, b) = (found.information[k], plain.information[k]);
            for i in 0..4 {
                near(a[i], b[i], b[0].max(b[3]), 1e-13, "information");
            }
            let (a, b) = (found.determinants[k], plain.determinants[k]);
            // Bearings that differ by 1e-3 carry their last digits up by as much.
            let size = if k < 2 {
                plain.information[k][0].max(plain.information[k][3]).powi(2)
            } else {
                b
            };
            near(a, b, size, 1e-10, "determinant");
        }
    }

    #[test]
    fn the_vectors_fly_the_plain_paths() {
        let n = 43;
        for (trials, bounded) in [(1, false), (3, true), (8, false), (21, true)] {
            let batch = Batch::draw(trials, bounded);
            for law in LAWS {
                for at_standoff in [AtStandoff::Stop, AtStandoff::Circle] {
                    let paths = batch.paths(law, at_standoff);
                    let mut plain = vec![0.0; trials * path_size(n)];
                    for (trial, out) in plain.chunks_exact_mut(path_size(n)).enumerate() {
                        assert_eq!(one_path(&paths, trial, n, out), Ok(()));
                    }
                    for path in Path::available() {
                        let mut out = vec![0.0; plain.len()];
                        let done = trajectories(paths, n, Threads::One, path, &mut out);
                        assert_eq!(done, Ok(()));
                        for trial in 0..trials {
                            let at = trial * path_size(n)..(trial + 1) * path_size(n);
                            let what = format!("{path:?} {law} {at_standoff:?} {trial}/{trials}");
                            compare(&out[at.clone()], &plain[at], n, &what);
                        }
                        // A trial does not depend on its neighbours.
                        let mut alone = vec![0.0; path_size(n)];
                        let last = paths.skip(trials - 1);
                        let done = trajectories(last, n, Threads::One, path, &mut alone);
                        assert_eq!(done, Ok(()));
                        assert_eq!(out[(trials - 1) * path_size(n)..], alone);
                    }
                }
            }
        }
    }

    #[test]
    fn the_vectors_refuse_what_the_plain_form_refuses() {
        let n = 30;
        for path in Path::available() {
            for (wrong, law) in [(0, Law::MaxDet), (1, Law::HammelLiu), (2, Law::BearingRate)] {
                let mut batch = Batch::draw(13, true);
                match wrong {
                    // On the target; inside the stand-off range; so near that the
                    // law ends on the way.
                    0 => batch.start.copy_within(0..2, 18),
                    1 => batch.standoff[9] = 1e5,
                    _ => batch.step[9] = 1e5,
                }
                if wrong == 0 {
                    let (x, y) = (batch.target[18], batch.target[19]);
                    batch.start[18..20].copy_from_slice(&[x, y]);
                }
                let paths = batch.paths(law, AtStandoff::Stop);
                let mut out = vec![0.0; 13 * path_size(n)];
                let found = trajectories(paths, n, Threads::One, path, &mut out);
                let plain = one_path(&paths, 9, n, &mut out[..path_size(n)]);
                assert!(plain.is_err());
                assert_eq!(found, plain.map_err(|error| (9, error)), "{path:?} {wrong}");
            }
        }
    }

    #[test]
    fn trials_beyond_the_range_of_the_vectors_are_flown_by_themselves() {
        let n = 12;
        for unit in [1e-90, 1.0, 1e90] {
            let mut batch = Batch::draw(5, false);
            for values in [&mut batch.target, &mut batch.start, &mut batch.step] {
                for value in values {
                    *value *= unit;
                }
            }
            let paths = batch.paths(Law::MaxDet, AtStandoff::Stop);
            let mut out = vec![0.0; 5 * path_size(n)];
            let mut plain = vec![0.0; path_size(n)];
            assert_eq!(
                trajectories(paths, n, Threads::One, Path::Best, &mut out),
                Ok(())
            );
            assert_eq!(one_path(&paths, 4, n, &mut plain), Ok(()));
            let same = out[4 * path_size(n)..] == plain[..];
            assert_eq!(same, unit != 1.0, "unit {unit}");
        }
    }
}
