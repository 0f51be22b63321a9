//! Registration biases over many trials, tracks or places of a map.

use alloc::vec;
use alloc::vec::Vec;
use core::convert::Infallible;

use crate::batch::element::Element;
use crate::batch::lanes::Lanes;
use crate::batch::simd::{Path, last_pairs, pairs};
use crate::batch::{Items, Stream, Threads};
use crate::numbers::lane::Lane;
use crate::registration::estimate::{Answer, Estimator, Question, Status};
use crate::registration::pair::{Plane, minor_sizes, products};
use crate::registration::report::unchecked_report;
use crate::registration::{Error, Layout, look};
use crate::scalar::{NumberError, all_finite};
use crate::square_root::{rotate_in, triangularize};

/// Sensors, noise and targets of a batch.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// Which biases there are.
    pub layout: Layout,
    /// Sensor positions (N, d); of platforms that move (K, N, d).
    pub sensors: Items<'a>,
    /// Deviations (N, d).
    pub sigma: Items<'a>,
    /// The biases (n) about which looks are linearised.
    pub biases: Items<'a>,
    /// Target positions (K, d).
    pub positions: Items<'a>,
}

impl<'a> Scene<'a> {
    /// The same scene counted from trial `first` on.
    #[must_use]
    pub fn skip(self, first: usize) -> Self {
        Self {
            sensors: self.sensors.skip(first),
            sigma: self.sigma.skip(first),
            biases: self.biases.skip(first),
            positions: self.positions.skip(first),
            ..self
        }
    }

    /// Number of looks of a trial.
    pub fn looks(&self) -> usize {
        self.positions.size() / self.layout.size()
    }

    fn check(&self, trial: usize) -> Result<(), (usize, Error)> {
        let (sensors, sigma) = (self.sensors.get(trial), self.sigma.get(trial));
        self.layout
            .check_places(sensors, sigma, self.looks())
            .map_err(|error| (trial, error))
    }

    fn pair(&self, trial: usize) -> Pair<'a> {
        let (sensors, sigma) = (self.sensors.get(trial), self.sigma.get(trial));
        Pair {
            positions: self.positions.get(trial).as_chunks::<2>().0,
            sensors: sensors.as_chunks::<2>().0,
            sigma: [[sigma[0], sigma[1]], [sigma[2], sigma[3]]],
        }
    }

    /// Calls `each(look, rows)` with the rows of every look of a trial.
    fn each_look(
        &self,
        trial: usize,
        work: &mut [f64],
        rows: &mut [f64],
        mut each: impl FnMut(usize, &mut [f64]),
    ) -> Result<(), (usize, Error)> {
        self.check(trial)?;
        let (sensors, sigma) = (self.sensors.get(trial), self.sigma.get(trial));
        let biases = self.biases.get(trial);
        let positions = self.positions.get(trial);
        for (k, p) in positions.chunks_exact(self.layout.size()).enumerate() {
            let sensors = self.layout.at_look(sensors, k);
            look::unchecked_rows(&self.layout, sensors, sigma, biases, p, work, rows)
                .map_err(|error| (trial, error.at(k)))?;
            each(k, rows);
        }
        Ok(())
    }

    fn scratch(&self) -> (Vec<f64>, Vec<f64>) {
        let layout = self.layout;
        let lines = layout.sensors * layout.size() + 1;
        (
            vec![0.0; lines * look::width(&layout)],
            vec![0.0; layout.rows() * layout.states()],
        )
    }

    /// What a trial's rows take, in nanoseconds, roughly.
    pub fn cost(&self) -> f64 {
        let layout = self.layout;
        let lines = layout.sensors * layout.size();
        let look = 50.0 + 2.0 * (lines * look::width(&layout) * layout.size()) as f64;
        look * self.looks() as f64
    }

    /// The same for its information: of two sensors in the plane it needs no rows.
    pub fn fisher_cost(&self) -> f64 {
        if self.layout == Layout::PAIR {
            5.0 * self.looks() as f64
        } else {
            self.cost()
        }
    }
}

/// Two sensors in the plane and the targets of one trial.
struct Pair<'a> {
    positions: &'a [[f64; 2]],
    /// Two places, or two for each look.
    sensors: &'a [[f64; 2]],
    sigma: [[f64; 2]; 2],
}

impl Pair<'_> {
    #[inline]
    fn plane(&self, look: usize, sigma: &[[f64; 2]; 2]) -> Result<Plane<f64>, Error> {
        let [a, b] = [0, 1].map(|sensor| self.offset(look, sensor));
        Plane::new(a, b, &sigma[0], &sigma[1]).map_err(|error| error.at(look))
    }

    /// From a sensor to the target of a look.
    #[inline]
    fn offset(&self, look: usize, sensor: usize) -> [f64; 2] {
        let [x, y] = self.positions[look];
        let at = if self.moves() { 2 * look } else { 0 };
        let [east, north] = self.sensors[at + sensor];
        [x - east, y - north]
    }

    fn moves(&self) -> bool {
        self.sensors.len() > 2
    }

    /// Whether the vectors, which square products of deviations, hold all of them.
    fn is_moderate(&self) -> bool {
        let mut sigma = self.sigma.as_flattened().iter();
        sigma.all(|s| (1e-30..1e30).contains(s))
    }

    /// The sum over the rows of the looks, for what leaves the numbers of the vectors on
    /// its way; or which look is wrong.
    fn look_by_look(&self, out: &mut [f64]) -> Result<(), Error> {
        let sigma = self.sigma.as_flattened();
        out.fill(0.0);
        for look in 0..self.positions.len() {
            for row in self.plane(look, &self.sigma)?.basis() {
                for i in 0..4 {
                    for j in 0..4 {
                        out[4 * i + j] += (row[i] / sigma[i]) * (row[j] / sigma[j]);
                    }
                }
            }
        }
        if all_finite(out) {
            return Ok(());
        }
        Err(EXCEEDS.into())
    }
}

/// Rows (trials, K (N-1) d, n) on the biases.
///
/// # Errors
/// As [`Layout::check`] and [`look::rows`], with the trial.
pub fn rows(scene: Scene<'_>, threads: Threads, out: &mut [f64]) -> Result<(), (usize, Error)> {
    let size = scene.layout.rows() * scene.layout.states();
    threads.over_with(
        out,
        scene.looks() * size,
        scene.cost(),
        || scene.scratch(),
        |(work, rows), trial, out| {
            if scene.layout == Layout::PAIR {
                scene.check(trial)?;
                let pair = scene.pair(trial);
                for (k, out) in out.chunks_exact_mut(size).enumerate() {
                    let basis = pair
                        .plane(k, &pair.sigma)
                        .map_err(|error| (trial, error))?
                        .basis();
                    let sigma = pair.sigma.as_flattened();
                    for (i, value) in out.iter_mut().enumerate() {
                        *value = basis[i / 4][i % 4] / sigma[i % 4];
                    }
                }
                return Ok(());
            }
            scene.each_look(trial, work, rows, |k, rows| {
                out[k * size..(k + 1) * size].copy_from_slice(rows);
            })
        },
    )
}

/// How much of each column of the [`rows`] is rounding of coordinates (trials, n), as
/// [`rounding::remove`](crate::rounding::remove) takes it.
///
/// Offsets between large coordinates carry the rounding of those coordinates, which
/// whitening enlarges where a sensor's range and azimuth differ in accuracy: what the rows
/// change by when the targets move by many roundings tells how much.
///
/// # Errors
/// As [`rows`].
pub fn rounding(scene: Scene<'_>, threads: Threads, out: &mut [f64]) -> Result<(), (usize, Error)> {
    const MANY: f64 = 256.0;
    let (n, d) = (scene.layout.states(), scene.layout.size());
    let size = scene.looks() * scene.layout.rows() * n;
    let numbers = || (vec![0.0; size], vec![0.0; size]);
    let cost = scene.cost() * (d + 1) as f64;
    threads.over_with(out, n, cost, numbers, |(exact, moved), trial, out| {
        let here = scene.skip(trial);
        rows(here, Threads::One, exact).map_err(|(_, error)| (trial, error))?;
        let positions = here.positions.get(0);
        let coordinates = positions.iter().chain(here.sensors.get(0));
        let largest = coordinates.fold(0.0_f64, |size, x| size.max(x.abs()));
        let step = MANY * 8.0 * f64::EPSILON * largest;
        out.fill(0.0);
        for axis in 0..d {
            let mut shifted = positions.to_vec();
            for x in shifted.iter_mut().skip(axis).step_by(d) {
                *x += step;
            }
            let there = Scene {
                positions: Items::shared(&shifted),
                ..here
            };
            rows(there, Threads::One, moved).map_err(|(_, error)| (trial, error))?;
            for (moved, exact) in moved.chunks_exact(n).zip(exact.chunks_exact(n)) {
                for (sum, (a, b)) in out.iter_mut().zip(moved.iter().zip(exact)) {
                    *sum += (a - b) * (a - b);
                }
            }
        }
        for sum in out {
            *sum = sum.sqrt() / MANY;
        }
        Ok(())
    })
}

/// Fisher information (trials, n, n) on the biases, positions unknown.
///
/// # Errors
/// As [`rows`]; [`Error::Number`] for information that overflows.
pub fn fisher(
    scene: Scene<'_>,
    threads: Threads,
    path: Path,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let n = scene.layout.states();
    if scene.layout == Layout::PAIR {
        return threads.over_groups(out, 16, GROUP, scene.fisher_cost(), |first, out| {
            let scene = scene.skip(first);
            let count = out.len() / 16;
            // What all trials share is checked once.
            let shared = scene.sensors.is_shared() && scene.sigma.is_shared();
            for trial in 0..if shared { 1 } else { count } {
                scene.check(trial).map_err(|(_, e)| (first + trial, e))?;
            }
            path.run(Sum { scene, out });
            for (trial, out) in out.chunks_exact_mut(16).enumerate() {
                let pair = scene.pair(trial);
                if !(all_finite(out) && pair.is_moderate()) {
                    pair.look_by_look(out)
                        .map_err(|error| (first + trial, error))?;
                }
            }
            Ok(())
        });
    }
    threads.over_with(
        out,
        n * n,
        scene.cost(),
        || scene.scratch(),
        |(work, rows), trial, out| {
            scene.each_look(trial, work, rows, |_, rows| {
                for row in rows.chunks_exact(n) {
                    for i in 0..n {
                        for j in 0..n {
                            out[i * n + j] += row[i] * row[j];
                        }
                    }
                }
            })?;
            if all_finite(out) {
                return Ok(());
            }
            Err((trial, EXCEEDS.into()))
        },
    )
}

const EXCEEDS: NumberError = NumberError::Overflow {
    result: "information",
};

/// Trials of one call of a kernel: choosing a path takes as long as some looks.
const GROUP: usize = 8;

/// The sum of the looks' projectors over the deviations, trial by trial.
struct Sum<'a> {
    scene: Scene<'a>,
    out: &'a mut [f64],
}

impl pulp::WithSimd for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let lanes = |[x, y]: [S::f64s; 2]| [Lanes::new(simd, x), Lanes::new(simd, y)];
        // From platforms that move the offsets are taken look by look.
        let mut offsets = [Vec::new(), Vec::new()];
        for (trial, out) in self.out.as_chunks_mut::<16>().0.iter_mut().enumerate() {
            let pair = self.scene.pair(trial);
            let sigma = pair.sigma;
            let constants = Constants::new(simd, &sigma);
            let mut sums = [zero; 10];
            if pair.moves() {
                for (sensor, offsets) in offsets.iter_mut().enumerate() {
                    offsets.clear();
                    let looks = 0..pair.positions.len();
                    offsets.extend(looks.flat_map(|look| pair.offset(look, sensor)));
                }
                let [a, b] = &offsets;
                let ((whole, rest), (others, _)) = (pairs::<S, f64>(a), pairs::<S, f64>(b));
                for (&a, &b) in whole.iter().zip(others) {
                    let from_a = lanes(f64::lanes_of_pairs(simd, a));
                    let from_b = lanes(f64::lanes_of_pairs(simd, b));
                    constants.add(from_a, from_b, one, &mut sums);
                }
                if !rest.is_empty() {
                    let (from_a, new) = last_pairs::<S, f64>(simd, a, rest.len());
                    let (from_b, _) = last_pairs::<S, f64>(simd, b, rest.len());
                    let weight = Lanes::new(simd, new);
                    constants.add(lanes(from_a), lanes(from_b), weight, &mut sums);
                }
            } else {
                let (a, b) = (both(simd, &pair.sensors[0]), both(simd, &pair.sensors[1]));
                let from =
                    |[x, y]: [Lanes<S>; 2], [east, north]: [Lanes<S>; 2]| [x - east, y - north];
                let places = self.scene.positions.get(trial);
                let (whole, rest) = pairs::<S, f64>(places);
                for &pair in whole {
                    let place = lanes(f64::lanes_of_pairs(simd, pair));
                    constants.add(from(place, a), from(place, b), one, &mut sums);
                }
                if !rest.is_empty() {
                    let (place, new) = last_pairs::<S, f64>(simd, places, rest.len());
                    let (place, weight) = (lanes(place), Lanes::new(simd, new));
                    constants.add(from(place, a), from(place, b), weight, &mut sums);
                }
            }
            let mut total = [0.0; 10];
            for k in 0..10 {
                total[k] = sums[k].sum();
            }
            let [[ra, ta], [rb, tb]] = sigma;
            let scale = [1.0 / ra, 1.0 / ta, 1.0 / rb, 1.0 / tb];
            let mut place = 0;
            for i in 0..4 {
                for j in i..4 {
                    let value = total[place] * scale[i] * scale[j];
                    out[i * 4 + j] = value;
                    out[j * 4 + i] = value;
                    place += 1;
                }
            }
        }
    }
}

/// Two numbers in all lanes. A map of an array is not always inlined, and is then compiled for
/// the plainest processor.
#[inline(always)]
fn both<S: pulp::Simd>(simd: S, [x, y]: &[f64; 2]) -> [Lanes<S>; 2] {
    [Lanes::splat(simd, *x), Lanes::splat(simd, *y)]
}

/// What the looks of a trial have in common, in all lanes.
struct Constants<S: pulp::Simd> {
    /// Products of two deviations, in the order of the minors.
    scales: [Lanes<S>; 6],
}

impl<S: pulp::Simd> Constants<S> {
    #[inline(always)]
    fn new(simd: S, sigma: &[[f64; 2]; 2]) -> Self {
        Self {
            scales: products(&both(simd, &sigma[0]), &both(simd, &sigma[1])),
        }
    }

    /// Adds `weight` times the upper triangles of the projectors of looks at these offsets
    /// from the two sensors.
    #[inline(always)]
    fn add(
        &self,
        [x1, y1]: [Lanes<S>; 2],
        [x2, y2]: [Lanes<S>; 2],
        weight: Lanes<S>,
        sums: &mut [Lanes<S>; 10],
    ) {
        let scales = &self.scales;
        let r1 = x1.mul_add(x1, y1 * y1).sqrt();
        let r2 = x2.mul_add(x2, y2 * y2).sqrt();
        let cross = y1.negate_mul_add(x2, x1 * y2);
        let dot = y1.mul_add(y2, x1 * x2);
        // Signs go into the products.
        let [m0, m1, m2, m3, m4, m5] = minor_sizes(scales, [r1, r2], r1 * r2, cross, dot);
        let (s0, s1, s2) = (m0 * m0, m1 * m1, m2 * m2);
        let (s3, s4, s5) = (m3 * m3, m4 * m4, m5 * m5);
        let p00 = s0 + (s1 + s2);
        let w = weight / ((p00 + s3) + (s4 + s5));
        sums[0] = p00.mul_add(w, sums[0]);
        sums[1] = m2.negate_mul_add(m4, m1 * m3).mul_add(w, sums[1]);
        sums[2] = m0.mul_add(m3, m2 * m5).negate_mul_add(w, sums[2]);
        sums[3] = m0.mul_add(m4, m1 * m5).negate_mul_add(w, sums[3]);
        sums[4] = (s0 + (s3 + s4)).mul_add(w, sums[4]);
        sums[5] = m0.mul_add(m1, m4 * m5).mul_add(w, sums[5]);
        sums[6] = m0.mul_add(m2, m3 * m5).negate_mul_add(w, sums[6]);
        sums[7] = (s1 + (s3 + s5)).mul_add(w, sums[7]);
        sums[8] = m1.negate_mul_add(m2, m3 * m4).mul_add(w, sums[8]);
        sums[9] = (s2 + (s4 + s5)).mul_add(w, sums[9]);
    }
}

/// eta (trials) of whole tracks: N / (N - 1) det(mean of the looks' projectors)^(1/n),
/// for layouts with measurement biases alone.
///
/// # Errors
/// As [`rows`].
pub fn eta(scene: Scene<'_>, threads: Threads, out: &mut [f64]) -> Result<(), (usize, Error)> {
    let (n, m) = (scene.layout.states(), scene.layout.rows());
    let looks = scene.looks();
    let space = || {
        let (work, rows) = scene.scratch();
        (work, rows, vec![0.0; (looks * m).max(n) * n], vec![0.0; n])
    };
    threads.over_with(
        out,
        1,
        scene.cost(),
        space,
        |(work, rows, all, line), trial, out| {
            let sigma = scene.sigma.get(trial);
            all.fill(0.0);
            scene.each_look(trial, work, rows, |k, rows| {
                for (value, &row) in all[k * m * n..(k + 1) * m * n].iter_mut().zip(&*rows) {
                    *value = row;
                }
                for row in all[k * m * n..(k + 1) * m * n].chunks_exact_mut(n) {
                    for (value, &s) in row.iter_mut().zip(sigma) {
                        *value *= s;
                    }
                }
            })?;
            triangularize(all, n, line);
            out[0] = eta_of(all, n, scene.layout.sensors, looks);
            Ok(())
        },
    )
}

fn eta_of(factor: &[f64], n: usize, sensors: usize, looks: usize) -> f64 {
    if looks == 0 {
        return 0.0;
    }
    // Of rows that are orthonormal look by look: anything below this is rounding.
    let floor = 32.0 * f64::EPSILON * looks as f64;
    if (0..n).any(|i| factor[i * n + i].abs() <= floor) {
        return 0.0;
    }
    let log: f64 = (0..n).map(|i| factor[i * n + i].abs().ln()).sum();
    let spread = sensors as f64 / (sensors as f64 - 1.0);
    // Rounding must not lift a perfect spread above 1.
    (spread * (2.0 * log / n as f64).exp() / looks as f64).min(1.0)
}

/// eta (trials, K) along tracks: of the last `window` looks at each look, of
/// all so far without one; 0 where there are too few.
///
/// # Errors
/// As [`rows`].
pub fn running_eta(
    scene: Scene<'_>,
    window: Option<usize>,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let (n, m) = (scene.layout.states(), scene.layout.rows());
    let (looks, sensors) = (scene.looks(), scene.layout.sensors);
    let space = || {
        let (work, rows) = scene.scratch();
        (
            work,
            rows,
            vec![0.0; looks * m * n],
            vec![0.0; n * n],
            vec![0.0; n],
        )
    };
    let cost = scene.cost() + 10.0 * (looks * m * n * n * window.unwrap_or(1)) as f64;
    threads.over_with(
        out,
        looks,
        cost,
        space,
        |(work, rows, all, factor, row), trial, out| {
            let sigma = scene.sigma.get(trial);
            scene.each_look(trial, work, rows, |k, rows| {
                for (i, value) in all[k * m * n..(k + 1) * m * n].iter_mut().enumerate() {
                    *value = rows[i] * sigma[i % n];
                }
            })?;
            factor.fill(0.0);
            for k in 0..looks {
                let first = match window {
                    None => k,
                    Some(window) => {
                        factor.fill(0.0);
                        (k + 1).saturating_sub(window)
                    }
                };
                for line in all[first * m * n..(k + 1) * m * n].chunks_exact(n) {
                    row.copy_from_slice(line);
                    rotate_in(factor, row);
                }
                let count = window.map_or(k + 1, |w| w.min(k + 1));
                out[k] = if count * m < n {
                    0.0
                } else {
                    eta_of(factor, n, sensors, count)
                };
            }
            Ok(())
        },
    )
}

/// Which degree of two instants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degree {
    /// |det M|, in metres squared.
    Paper,
    /// How far the whitened planes have turned from each other, in [0, 1].
    Pair,
}

/// Degrees (trials, pairs) between chosen instants of two sensors' looks.
/// `instants` has two looks for each pair.
///
/// # Errors
/// As [`rows`].
pub fn pair_degrees(
    scene: Scene<'_>,
    degree: Degree,
    instants: &[[usize; 2]],
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let cost = 60.0 * (scene.looks() + instants.len()) as f64;
    threads.over_with(
        out,
        instants.len(),
        cost,
        Vec::new,
        |planes: &mut Vec<Plane<f64>>, trial, out| {
            scene.check(trial)?;
            let pair = scene.pair(trial);
            let sigma = match degree {
                Degree::Paper => [[1.0; 2]; 2],
                Degree::Pair => pair.sigma,
            };
            planes.clear();
            for k in 0..pair.positions.len() {
                planes.push(pair.plane(k, &sigma).map_err(|error| (trial, error))?);
            }
            for (value, &[i, j]) in out.iter_mut().zip(instants) {
                *value = match degree {
                    Degree::Paper => planes[i].product(&planes[j]).abs(),
                    Degree::Pair => planes[i].pair_degree(&planes[j]),
                };
            }
            Ok(())
        },
    )
}

/// Reports (trials, K, N, d) without noise.
///
/// # Errors
/// As [`rows`].
pub fn reports(scene: Scene<'_>, threads: Threads, out: &mut [f64]) -> Result<(), (usize, Error)> {
    let layout = scene.layout;
    let size = scene.looks() * layout.sensors * layout.size();
    threads.over(out, size, 60.0 * size as f64, |trial, out| {
        scene.check(trial)?;
        unchecked_report(
            &layout,
            scene.sensors.get(trial),
            scene.biases.get(trial),
            scene.positions.get(trial),
            out,
        )
        .map_err(|error| (trial, error))
    })
}

/// Positions (trials, K, N, d) where each sensor's reports put the target.
pub fn places(
    layout: Layout,
    sensors: Items<'_>,
    biases: Items<'_>,
    reports: Items<'_>,
    threads: Threads,
    out: &mut [f64],
) {
    let (d, per) = (layout.size(), layout.per_sensor());
    let size = reports.size();
    let each = |trial: usize, out: &mut [f64]| -> Result<(), Infallible> {
        let (sensors, biases) = (sensors.get(trial), biases.get(trial));
        let reports = reports.get(trial);
        for (i, (report, out)) in reports
            .chunks_exact(d)
            .zip(out.chunks_exact_mut(d))
            .enumerate()
        {
            let s = i % layout.sensors;
            let sensors = layout.at_look(sensors, i / layout.sensors);
            look::unchecked_place(
                &layout,
                &sensors[s * d..(s + 1) * d],
                &biases[s * per..(s + 1) * per],
                report,
                out,
            );
        }
        Ok(())
    };
    let Ok(()) = threads.over(out, size, 30.0 * size as f64, each);
}

/// Numbers of one trial of [`estimate`]: biases (n), covariance (n, n), the
/// directions that are not determined (n, n), then status (0 determined, 1 not
/// converged, 2 unobservable), iterations, chi square, nullity, noise share, bend,
/// then positions (K, d) if `looks` is not zero.
pub const fn answer_size(layout: &Layout, looks: usize) -> usize {
    let n = layout.states();
    n + 2 * n * n + 6 + looks * layout.size()
}

fn write(estimator: &Estimator<f64>, answer: &Answer<f64>, out: &mut [f64]) {
    let n = estimator.biases().len();
    let (biases, out) = out.split_at_mut(n);
    biases.copy_from_slice(estimator.biases());
    let (covariance, out) = out.split_at_mut(n * n);
    covariance.copy_from_slice(estimator.covariance());
    let (directions, out) = out.split_at_mut(n * n);
    directions.copy_from_slice(estimator.directions());
    let (numbers, positions) = out.split_at_mut(6);
    let status = match answer.status {
        Status::Determined => 0.0,
        Status::NoConvergence => 1.0,
        Status::Unobservable => 2.0,
    };
    numbers.copy_from_slice(&[
        status,
        answer.iterations as f64,
        answer.chi_square,
        answer.nullity as f64,
        answer.noise_share,
        answer.bend,
    ]);
    positions.copy_from_slice(&estimator.positions()[..positions.len()]);
}

/// Estimates (trials, [`answer_size`]) from reports (trials, K, N, d). With
/// `keep_positions` the positions are written too.
///
/// # Errors
/// As [`Estimator::run`], with the trial.
pub fn estimate(
    question: &Question<'_, f64>,
    reports: Items<'_>,
    keep_positions: bool,
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let layout = question.layout;
    let looks = reports.size() / (layout.sensors * layout.size());
    let size = answer_size(&layout, if keep_positions { looks } else { 0 });
    threads.over_with(
        out,
        size,
        3000.0 * looks as f64,
        || Estimator::sized(layout, looks),
        |estimator, trial, out| {
            let answer = estimator
                .answer(question, reports.get(trial))
                .map_err(|error| (trial, error))?;
            write(estimator, &answer, out);
            Ok(())
        },
    )
}

/// Simulates and estimates in one pass: trial i of targets at `positions` with
/// the true `biases`, noise from the stream (seed, first + i).
///
/// # Errors
/// As [`Estimator::run`], with the trial.
pub fn estimate_trials(
    question: &Question<'_, f64>,
    positions: &[f64],
    biases: &[f64],
    (seed, first): (u64, u64),
    threads: Threads,
    out: &mut [f64],
) -> Result<(), (usize, Error)> {
    let layout = question.layout;
    let looks = positions.len() / layout.size();
    let mut exact = vec![0.0; looks * layout.sensors * layout.size()];
    unchecked_report(&layout, question.sensors, biases, positions, &mut exact)
        .map_err(|error| (0, error))?;
    threads.over_with(
        out,
        answer_size(&layout, 0),
        3000.0 * looks as f64,
        || (Estimator::sized(layout, looks), exact.clone()),
        |(estimator, noisy), trial, out| {
            let mut stream = Stream::new(seed, first + trial as u64);
            let sigma = question.sigma.iter().cycle();
            for ((value, &exact), &sigma) in noisy.iter_mut().zip(&exact).zip(sigma) {
                *value = exact + sigma * stream.normal();
            }
            let answer = estimator
                .answer(question, noisy)
                .map_err(|error| (trial, error))?;
            write(estimator, &answer, out);
            Ok(())
        },
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_vector_path_gives_the_sum_of_the_rows() {
        let (sensors, sigma) = ([3.0, -7.0, 60e3, 500.0], [50.0, 2e-3, 30.0, 1e-3]);
        for looks in [1, 2, 3, 7, 8, 9, 16, 17, 33, 64, 65, 73, 150] {
            let positions: Vec<f64> = (0..looks)
                .flat_map(|k| [-20e3 + 4e3 * f64::from(k), 25e3 - 1.3e3 * f64::from(k)])
                .collect();
            let scene = Scene {
                layout: Layout::PAIR,
                sensors: Items::shared(&sensors),
                sigma: Items::shared(&sigma),
                biases: Items::shared(&[0.0; 4]),
                positions: Items::shared(&positions),
            };
            let mut lines = vec![0.0; positions.len() * 4];
            rows(scene, Threads::One, &mut lines).unwrap();
            let mut expected = [0.0; 16];
            for row in lines.chunks_exact(4) {
                for i in 0..4 {
                    for j in 0..4 {
                        expected[i * 4 + j] += row[i] * row[j];
                    }
                }
            }
            for path in Path::available() {
                let mut out = [0.0; 16];
                fisher(scene, Threads::One, path, &mut out).unwrap();
                for i in 0..16 {
                    let unit = f64::from(looks) / (sigma[i / 4] * sigma[i % 4]);
                    assert!(
                        (out[i] - expected[i]).abs() < 1e-13 * unit,
                        "{path:?} {looks} looks, entry {i}: {} {}",
                        out[i],
                        expected[i]
                    );
                }
            }
        }
    }

    #[test]
    fn platforms_have_the_rows_and_the_sums_of_each_look() {
        for looks in [1_usize, 2, 3, 8, 9, 17, 33] {
            let at = |k: usize, s: usize| {
                let (k, s) = (k as f64, s as f64);
                [60e3 * s + 150.0 * k * (1.0 - 2.0 * s), 90.0 * k * s]
            };
            let sensors: Vec<f64> = (0..looks)
                .flat_map(|k| [at(k, 0), at(k, 1)])
                .flatten()
                .collect();
            let positions: Vec<f64> = (0..looks)
                .flat_map(|k| [-20e3 + 4e3 * k as f64, 25e3 - 1.3e3 * k as f64])
                .collect();
            let sigma = [50.0, 2e-3, 30.0, 1e-3];
            let scene = Scene {
                layout: Layout::PAIR,
                sensors: Items::shared(&sensors),
                sigma: Items::shared(&sigma),
                biases: Items::shared(&[0.0; 4]),
                positions: Items::shared(&positions),
            };
            let mut all = vec![0.0; 8 * looks];
            rows(scene, Threads::One, &mut all).unwrap();
            let mut sum = [0.0; 16];
            for k in 0..looks {
                let alone = Scene {
                    sensors: Items::shared(&sensors[4 * k..][..4]),
                    positions: Items::shared(&positions[2 * k..][..2]),
                    ..scene
                };
                let mut one = [0.0; 8];
                rows(alone, Threads::One, &mut one).unwrap();
                assert_eq!(one[..], all[8 * k..][..8]);
                for row in one.chunks_exact(4) {
                    for i in 0..16 {
                        sum[i] += row[i / 4] * row[i % 4];
                    }
                }
            }
            for path in Path::available() {
                let mut out = [0.0; 16];
                fisher(scene, Threads::One, path, &mut out).unwrap();
                for i in 0..16 {
                    let unit = looks as f64 / (sigma[i / 4] * sigma[i % 4]);
                    assert!(
                        (out[i] - sum[i]).abs() < 1e-13 * unit,
                        "{path:?} {looks} {i}"
                    );
                }
            }
        }
    }

    #[test]
    fn looks_beyond_the_range_of_the_vectors_are_summed_one_by_one() {
        // Products of three distances and two deviations exceed the numbers, or vanish;
        // what they make does not.
        for unit in [1e-100, 1e100] {
            let sigma = [50.0, 2e-3, 30.0, 1e-3];
            let scaled = [50.0 * unit, 2e-3, 30.0 * unit, 1e-3];
            let (sensors, positions) = ([0.0, 0.0, 60e3, 0.0], [20e3, 30e3, 5e3, 4e4]);
            let times = |values: &[f64; 4]| values.map(|x| x * unit);
            let scene = |sensors, sigma, positions| Scene {
                layout: Layout::PAIR,
                sensors: Items::shared(sensors),
                sigma: Items::shared(sigma),
                biases: Items::shared(&[0.0; 4]),
                positions: Items::shared(positions),
            };
            let (far, wide) = (times(&sensors), times(&positions));
            for path in Path::available() {
                let (mut near, mut out) = ([0.0; 16], [0.0; 16]);
                let plain = scene(&sensors, &sigma, &positions);
                fisher(plain, Threads::One, path, &mut near).unwrap();
                fisher(scene(&far, &scaled, &wide), Threads::One, path, &mut out).unwrap();
                for i in 0..16 {
                    let wanted = near[i] * sigma[i / 4] * sigma[i % 4];
                    let found = out[i] * scaled[i / 4] * scaled[i % 4];
                    assert!(
                        (found - wanted).abs() < 1e-13,
                        "{path:?} {i} {found} {wanted}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_target_on_a_sensor_is_named_on_every_path() {
        let (sensors, sigma) = ([0.0, 0.0, 60e3, 0.0], [50.0, 2e-3, 50.0, 2e-3]);
        let mut positions = [1e4; 34];
        (positions[10], positions[11]) = (60e3, 0.0);
        let scene = Scene {
            layout: Layout::PAIR,
            sensors: Items::shared(&sensors),
            sigma: Items::shared(&sigma),
            biases: Items::shared(&[0.0; 4]),
            positions: Items::shared(&positions),
        };
        for path in Path::available() {
            let mut out = [0.0; 16];
            let error = fisher(scene, Threads::One, path, &mut out);
            assert_eq!(error, Err((0, Error::OnSensor { look: 5, sensor: 1 })));
        }
    }
}
